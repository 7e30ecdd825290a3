"""One value for each of some demonstrations, by id: labels and demonstrators, in files or columns of their own."""

from __future__ import annotations

import csv
from collections.abc import Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, TypeVar, cast

import numpy as np

from rpil.data.arrays import check_text
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.formats.cells import from_cell
from rpil.data.formats.names import EPISODE, quoted
from rpil.data.formats.table import check_ids
from rpil.data.guard import guarded
from rpil.data.json_files import LARGEST_TABLE, parse, read_text
from rpil.numerics.types import Array, Int

Label = Literal["good", "bad"]
Key = TypeVar("Key", bound=Hashable)

_LABELS: dict[str, Label] = {"good": "good", "bad": "bad", "expert": "good", "adversary": "bad"}
"""Each word of a label, in any case; "expert" and "adversary" are what rpil 0.1 wrote."""

_EXTENSIONS = (".csv", ".json")


def read_labels(path: StrPath) -> dict[str, Label]:
    """Read labels from a CSV file with the columns ``id`` and ``label``, or from a JSON object of id to label.

    Labels are ``good`` or ``bad``; ``expert`` and ``adversary`` are read as these. Ids come back as text, see
    `match_labels`. A `DataError` names the file and the demonstration: unknown words, an id labelled twice, no labels.
    """
    path = check_extension(path, _EXTENSIONS, "labels")
    labels: dict[str, Label] = {}
    for m, word in read_id_pairs(path, "label", "good"):
        label = _label(word)
        if label is None:
            raise DataError(
                f"{path.name}, demonstration {m!r}: unknown label {word!r}; write 'good' or 'bad', "
                "and leave out the demonstrations you cannot judge."
            )
        if m in labels:
            raise DataError(f"{path.name}, demonstration {m!r}: it is labelled twice; keep one of the labels.")
        labels[m] = label
    if not labels:
        raise DataError(f"{path.name}: it labels no demonstration; give at least one id and label.")
    return labels


def _label(word: object) -> Label | None:
    return _LABELS.get(word.strip().lower()) if isinstance(word, str) else None


def match_labels(labels: Mapping[Key, str], ids: Sequence[object], source: str = "the labels") -> dict[int, bool]:
    """Number of each labelled demonstration to whether it is good; ids are compared as text.

    A `DataError` where a label is neither "good" nor "bad", or an id is not among `ids`.
    """
    for m, label in labels.items():
        if _label(label) is None:
            raise DataError(f"Demonstration {m!r}: the label {label!r} is unknown; use 'good' or 'bad'.")
    check_ids(labels, ids, source, "the labels")
    number = {str(name): m for m, name in enumerate(ids)}
    return {number[str(name)]: _label(label) == "good" for name, label in labels.items()}


def match_pairs(pairs: Sequence[tuple[Hashable, Hashable]], ids: Sequence[object]) -> Int[Array, "P 2"]:
    """Numbers of the better and the worse demonstration of each pair; ids are compared as text.

    A `DataError` where an id is not among `ids`, a demonstration is compared with itself, or two pairs contradict.
    """
    number = {str(name): m for m, name in enumerate(ids)}
    found: dict[tuple[int, int], None] = {}
    for pair in pairs:
        better, worse = map(str, pair)
        check_ids([better, worse], ids, "the pairs", "the pairs")
        if better == worse:
            raise DataError(f"The pairs, demonstration {better!r}: it is compared with itself; name two.")
        if (number[worse], number[better]) in found:
            raise DataError(f"The pairs, {better!r} and {worse!r}: each is better than the other; keep one answer.")
        found[number[better], number[worse]] = None
    return np.array(list(found), dtype=int).reshape(-1, 2)


def is_id_file(where: str) -> bool:
    """Whether `where` names a file of ids and values rather than a column."""
    return Path(where).suffix.lower() in _EXTENSIONS


def match_demonstrators(pairs: Iterable[tuple[str, object]], source: str) -> dict[str, str]:
    """Demonstrator of each demonstration from pairs of the two; a `DataError` where one has two, or none."""
    demonstrators: dict[str, str] = {}
    for m, value in pairs:
        place = f"{source}, demonstration {m!r}"
        if value is not None and not isinstance(value, str | int):
            raise DataError(f"{place}: the demonstrator is neither text nor a whole number; name one, or leave it out.")
        name = "" if value is None else str(value).strip()
        if not name:
            raise DataError(f"{place}: it has no demonstrator; name one, or leave it out.")
        check_text(name, "the demonstrator", place)
        if demonstrators.setdefault(m, name) != name:
            raise DataError(f"{place}: both {demonstrators[m]!r} and {name!r} gave it; name one.")
    if not demonstrators:
        raise DataError(f"{source}: it names no demonstrator; give at least one id and demonstrator.")
    return demonstrators


def read_id_pairs(path: StrPath, column: str, example: str) -> list[tuple[str, object]]:
    """Ids and values of a CSV file with the columns ``id`` and `column`, or of a JSON object; an id may come twice."""
    path = check_readable(path)
    with guarded(path.name, f"it cannot be read as {path.suffix[1:].upper()}", "write it again"):
        text = read_text(path, LARGEST_TABLE, "utf-8-sig")
        if path.suffix.lower() == ".csv":
            return _csv_pairs(text, column, path.name)
        pairs = cast(list[tuple[str, object]], parse(text, path.name, LARGEST_TABLE, list))
    if not text.lstrip().startswith("{"):
        raise DataError(f'{path.name}: it must hold one object such as {{"17": "{example}"}}.')
    for m, _ in pairs:
        check_text(m, "an id", path.name)
    return pairs


def _csv_pairs(text: str, column: str, source: str) -> list[tuple[str, object]]:
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True, strict=True)
    header = rows.fieldnames or ()
    id_column = next((name for name in ("id", *EPISODE) if name in header), None)
    if id_column is None or column not in header:
        raise DataError(f"{source}: the columns must be id and {column} (found {quoted(header)}).")
    pairs: list[tuple[str, object]] = []
    for row in rows:
        m = from_cell((row[id_column] or "").strip())
        if not m or None in row:
            problem = "it names no demonstration" if not m else "it has more values than there are columns"
            raise DataError(f"{source}, line {rows.line_num}: {problem}; give one id and one {column}.")
        pairs.append((m, from_cell(row[column] or "")))
    return pairs
