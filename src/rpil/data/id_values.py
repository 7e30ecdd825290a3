"""Values of some demonstrations, by id: labels, pairs that were compared, and demonstrators."""

from __future__ import annotations

import csv
import io
import re
from codecs import BOM_UTF8
from collections.abc import Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_extension, check_readable, replacing
from rpil.data.memory import LARGEST_TABLE, read_text
from rpil.data.text import EPISODE, from_cell, quoted, to_cell
from rpil.numerics.types import Array, Int

Label = Literal["good", "bad"]
Relation = Literal["better than", "same as"]
Pairs = dict[tuple[str, str], Relation]
"""Relation of the first demonstration to the second, ids as text; of two that are the same the first is less."""
IdRow = tuple[str, object, *tuple[str, ...]]
"""An id, its value, and what else a file says of it."""


class AnswerRow(NamedTuple):
    """An answer as a row of a file of labels, whose columns after the label may be missing."""

    id: str
    label: object
    """A word, or what else a file has in its place."""
    note: str = ""
    start: object = ""
    end: object = ""
    """The first row and the one after the last within the demonstration; nothing where it is about all of it."""

    @property
    def is_mark(self) -> bool:
        """Whether it is about some rows of a demonstration."""
        return not str(self.start) == str(self.end) == ""

    @property
    def about(self) -> frozenset[str]:
        """The ids of the demonstrations that it is about."""
        return frozenset((self.id, (_compared(self.label) or ("", self.id))[1]))

    @property
    def question(self) -> tuple[object, ...] | frozenset[str]:
        """Its subject; two answers about the same exclude each other."""
        rows = self.id, *(str(row).removesuffix(".0") for row in (self.start, self.end))
        return rows if self.is_mark else self.about


_LABELS: dict[str, Label] = {"good": "good", "bad": "bad", "expert": "good", "adversary": "bad"}
"""Each word of a label, in any case; "expert" and "adversary" are what rpil 0.1 wrote."""

CANNOT_TELL = "cannot tell"
"""In the place of a label: an answer from which nothing is learned."""

_COMPARED = re.compile(r"\s*(better\s+than|same\s+as)\s(.*)", re.IGNORECASE | re.DOTALL)

_WHOLE = re.compile(r"\d{1,15}(?:\.0+)?", re.ASCII)

_OF_ROWS = {"start", "end", "from", "to", "begin", "stop", "start_row", "end_row"}
"""Names, in small letters, of columns that say which rows are meant; the first two are read."""


def check_ids(names: Iterable[object], ids: Iterable[object], source: str, what: str) -> None:
    """A `DataError` naming the first `names` that are no ids, compared as text, and `what` is to be corrected."""
    texts = dict.fromkeys(map(str, ids))
    unknown = dict.fromkeys(str(name) for name in names if str(name) not in texts)
    if unknown:
        wrong, right = quoted(unknown, 5), quoted(texts, 5)
        raise DataError(f"{source}: no demonstration is called {wrong}; the ids are {right}; correct {what}.")


def read_answer_rows(path: StrPath) -> list[AnswerRow]:
    """The answers of a CSV file with the columns ``id`` and ``label``, and maybe note, start and end; a `DataError`
    where there are none, or the file is no such one."""
    rows = read_id_pairs(path, "label", AnswerRow._fields[2:])
    if not rows:
        raise DataError(f"{Path(path).name}: it labels no demonstration; give at least one id and label.")
    return [AnswerRow(*row) for row in rows]


def parse_marks(
    rows: Sequence[AnswerRow], source: str, ids: Sequence[object], lengths: Int[Array, " M"]
) -> Int[Array, "S 4"]:
    """Marks of rows of M demonstrations: the number of the demonstration, the first row and the one after
    the last, and 1 for good or -1; nothing of those about others. A `DataError` where rows lie outside, or are both."""
    number, marks = {str(name): m for m, name in enumerate(ids)}, list[tuple[int, int, int, int]]()
    said = {
        m: np.zeros(lengths[m], dtype=np.int8) for m in {number.get(row.id, -1) for row in rows if row.is_mark} - {-1}
    }
    for row in (row for row in rows if row.is_mark and row.id in number):
        m, place = number[row.id], f"{source}, demonstration {row.id!r}, rows {row.start!s:.40} to {row.end!s:.40}"
        given = (str(row.start).strip(), str(row.end).strip())
        start, end = (int(float(one)) if _WHOLE.fullmatch(one) else -1 for one in given)
        if not 0 <= start < end <= lengths[m]:
            raise DataError(f"{place}: start and end must be whole, 0 <= start < end <= {lengths[m]}; correct them.")
        if (label := _LABELS.get(str(row.label).strip().lower())) is None:
            raise DataError(f"{place}: unknown label {quoted([row.label])}; write 'good' or 'bad'.")
        sign = 1 if label == "good" else -1
        if (said[m][start:end] == -sign).any():
            raise DataError(f"{place}: some of these rows have the other label too; change one of the labels.")
        said[m][start:end] = sign
        marks.append((m, start, end, sign))
    return np.array(marks, dtype=np.int64).reshape(-1, 4)


def parse_answers(rows: Sequence[AnswerRow], source: str) -> tuple[dict[str, Label], Pairs]:
    """Labels and pairs from answers, without those about rows.

    Labels are ``good`` or ``bad``, in any case, or ``expert`` and ``adversary``; ``better than ID`` makes a pair, and
    ``same as ID`` one without a difference. A demonstration has one label and any number of pairs. A `DataError` names
    the `source` and the demonstration: unknown words, an id that is labelled twice, pairs that contradict each other.
    """
    labels: dict[str, Label] = {}
    pairs: Pairs = {}
    for m, word, *_ in (row for row in rows if not row.is_mark):
        label = _LABELS.get(str(word).strip().lower())
        if compared := _compared(word):
            _add_pair(pairs, (m, compared[1]), compared[0], source)
        elif label is None and str(word) != CANNOT_TELL:  # which was written for its note
            known = "'good', 'bad', 'better than ID' or 'same as ID', and leave out the demonstrations you cannot judge"
            raise DataError(f"{source}, demonstration {m!r}: unknown label {quoted([word])}; write {known}.")
        elif m in labels:
            raise DataError(f"{source}, demonstration {m!r}: it is labelled twice; keep one of the labels.")
        elif label is not None:
            labels[m] = label
    return labels, pairs


def label_rows(labels: object) -> list[AnswerRow]:
    """The answers of a mapping, a series or pairs, of ids, or of an id, a start and an end, and words."""
    given = () if labels is None else labels
    if hasattr(given, "items") and not hasattr(given, "columns"):  # which a frame has
        given = given.items()
    rows: list[Any] = list(given) if isinstance(given, Iterable) else [given]
    if not all(isinstance(row, tuple | list) and len(row) == 2 for row in rows):
        raise DataError("the labels must be a mapping or series of ids to words, or pairs of an id and a word.")
    named = ((m if isinstance(m, tuple) and len(m) == 3 else (m, "", ""), word) for m, word in rows)
    return [AnswerRow(str(m), word, "", start, end) for (m, start, end), word in named]


def with_new(old: Iterable[AnswerRow], new: Sequence[AnswerRow]) -> list[AnswerRow]:
    """Old answers and new ones; a new label replaces the old one of the demonstration, or of the same rows of it."""
    replaced = {row.question for row in new if not _compared(row.label)}
    return [*(row for row in old if _compared(row.label) or row.question not in replaced), *new]


def write_answers(path: StrPath, before: bytes | None, answers: Sequence[AnswerRow]) -> None:
    """Write a CSV file that `read_answer_rows` reads: what it held `before`, and these answers.

    A label replaces the old one of the demonstration, or of the same rows of it. All other rows keep their cells, and
    the file its columns; note, start and end are added to them once an answer has one. A `DataError` where it cannot be
    written; a file that was there is then as it was.
    """
    old = before or b"id,label\n"
    rows, names, id_column = _csv_rows(old.decode("utf-8-sig"))
    replaced = {row.question for row in answers if not _compared(row.label)}
    kept = []
    for row in rows:
        start, end = ((row.get(name) or "").strip() for name in ("start", "end"))
        said = AnswerRow(from_cell(row[id_column] or ""), row["label"], "", start, end)
        kept += [row] if _compared(said.label) or said.question not in replaced else []
    for answer in answers:
        kept.append({name: str(to_cell(value)) for name, value in {**answer._asdict(), id_column: answer.id}.items()})
    names += [name for k, name in enumerate(AnswerRow._fields) if k > 1 and any(row[k] != "" for row in answers)]
    names = [*dict.fromkeys(names)]
    comma, lines = rows.reader.dialect.delimiter, io.StringIO(newline="")
    for cells in (names, *([row.get(name) or "" for name in names] for row in kept)):
        plain = all(text.isprintable() and text == text.strip() for text in cells)  # else readers leave spaces out
        quoting: Literal[0, 1] = csv.QUOTE_MINIMAL if plain else csv.QUOTE_ALL
        csv.writer(lines, delimiter=comma, lineterminator="\n", quoting=quoting).writerow(cells)
    with replacing(path) as temporary:
        temporary.write_bytes(BOM_UTF8 * old.startswith(BOM_UTF8) + lines.getvalue().encode())


def _compared(word: object) -> tuple[Relation, str] | None:
    """The relation to the other demonstration of a pair, and its id; None where the word makes none."""
    found = _COMPARED.fullmatch(str(word))
    return found and ("same as" if found[1].lower().startswith("same") else "better than", found[2])


def _add_pair(pairs: Pairs, pair: tuple[str, str], relation: Relation, source: str) -> None:
    """Add a pair of ids as text, of which `source` says what the first is to the second, unless it is there."""
    first, second = sorted(pair) if relation == "same as" else pair
    if first == second:
        raise DataError(f"{source}, demonstration {first!r}: it is compared with itself; name two.")
    if (second, first) in pairs or pairs.setdefault((first, second), relation) != relation:
        raise DataError(f"{source}, {first!r} and {second!r}: two answers contradict each other; keep one answer.")


def label_signs(labels: Mapping[str, Label], ids: Sequence[object]) -> Int[Array, " M"]:
    """1 for demonstrations labelled "good", -1 for "bad", 0 for the rest of the M `ids`, which are compared as text."""
    return np.array([{None: 0, "good": 1, "bad": -1}[labels.get(str(m))] for m in ids], dtype=np.int64)


def match_pairs(
    pairs: Iterable[tuple[tuple[Hashable, Hashable], Relation]], ids: Sequence[object]
) -> tuple[Int[Array, "P 2"], Int[Array, "T 2"]]:
    """Numbers of the better and the worse demonstration of each pair, and of the two of each without a difference. A
    `DataError` where an id, as text, is not among `ids` or compared with itself, or two pairs contradict."""
    number = {str(name): m for m, name in enumerate(ids)}
    found: Pairs = {}
    for (first, second), relation in pairs:
        check_ids([first, second], ids, "the pairs", "the pairs")
        _add_pair(found, (str(first), str(second)), relation, "The pairs")
    better, tied = (
        np.array([[number[m] for m in pair] for pair in found if found[pair] == kind], dtype=int).reshape(-1, 2)
        for kind in get_args(Relation)
    )
    return better, tied


def is_id_file(where: str) -> bool:
    """Whether `where` names a file of ids and values rather than a column."""
    return Path(where).suffix.lower() == ".csv" or ("." in where and Path(where).is_file())


def match_demonstrators(pairs: Iterable[IdRow], source: str) -> dict[str, str]:
    """Demonstrator of each demonstration from pairs of the two; a `DataError` where one has two, or none."""
    demonstrators: dict[str, str] = {}
    for m, value, *_ in pairs:
        place, name = f"{source}, demonstration {m!r}", "" if value is None else str(value).strip()
        if not name or not isinstance(value, str | int):
            raise DataError(f"{place}: it has no demonstrator; name one, or leave it out.")
        if demonstrators.setdefault(m, name) != name:
            raise DataError(f"{place}: both {demonstrators[m]!r} and {name!r} gave it; name one.")
    if not demonstrators:
        raise DataError(f"{source}: it names no demonstrator; give at least one id and demonstrator.")
    return demonstrators


def read_id_pairs(path: StrPath, column: str, more: Sequence[str] = ()) -> list[IdRow]:
    """Ids and values of a CSV file with the columns ``id`` and `column`, and perhaps `more`; an id may come twice."""
    path = check_readable(check_extension(path, (".csv",), f"a table of id and {column}"))
    with guarded(path.name, "it cannot be read as CSV", "write it again"):
        rows, names, id_column = _csv_rows(read_text(path, LARGEST_TABLE))
        others = [name for name in names if name.strip().lower() in _OF_ROWS and name not in ("start", "end")]
        if more and others:
            raise DataError(f"{path.name}: call the columns of rows start and end (found {quoted(others)}).")
        if missing := [*["id"] * (not id_column), *[column] * (column not in names)]:
            said = f"no column is called {quoted(missing)}; rename one (found {quoted(names)})"
            said += "" if id_column else "; ids are those of the column that rpil info names after 'Demonstrations by'"
            raise DataError(f"{path.name}: {said}.")
        pairs: list[IdRow] = []
        for row in rows:
            m, value, *others = (from_cell(row.get(name) or "") for name in (id_column, column, *more))
            if not m or None in row:
                problem = "it names no demonstration" if not m else "it has more values than there are columns"
                raise DataError(f"{path.name}, line {rows.line_num}: {problem}; give one id and one {column}.")
            pairs.append((m, value, *others))
    return pairs


def _csv_rows(text: str) -> tuple[csv.DictReader[str], list[str], str]:
    """The rows of a CSV file, whose cells may hold ends of lines, the names of its columns, and that of the ids."""
    header = text.partition("\n")[0]
    comma = ";" if ";" in header and "," not in header else ","  # Excel writes the first where numbers have commas
    # White space at the end of a cell goes, but not in quotes, where an id may have it.
    text = re.sub(rf'("[^"]*")|(?<![ \t])[ \t]+(?=[{comma}\r\n]|\Z)', r"\1", text)
    rows = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True, delimiter=comma)
    names = [*(rows.fieldnames or ())]
    return rows, names, next((name for name in ("id", *EPISODE) if name in names), "")
