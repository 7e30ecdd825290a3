"""A run of questions, in the terminal or on a page: every answer is learned from and written at once.

Curves of actions and observations, and videos, are looked up by number: no name that a browser sends becomes a path.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data import id_values
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import check_inside
from rpil.data.id_values import AnswerRow
from rpil.data.text import MAX_IDS, counted, listed, printable
from rpil.formats.format import Dataset, Shot
from rpil.formats.lerobot.video import load_av, picture
from rpil.formats.registry import find_format
from rpil.numerics.types import Array, Float
from rpil.results.html.page import View, packed
from rpil.results.judged import bin_means, bin_starts
from rpil.results.vocabulary import in_numbers

if TYPE_CHECKING:
    from rpil.results.record import Audit


MIN_QUESTIONS = 4
"""From this one on a run ends where the answers make every demonstration good or bad."""

Question = tuple[Hashable, ...]
"""Two demonstrations to compare, one to judge, or nothing that is left to ask."""

Reply = tuple[Question, str, str, *tuple[int, ...]]
"""A question, the key that was given as its answer, one of its `choices`, a note, and rows that it is about alone."""


def choices(question: Question) -> dict[str, str]:
    """Meanings of the keys that answer a question, in words."""
    words = {"g": "Good", "b": "Bad"}
    if len(question) == 2:
        first, second = map(printable, question)
        better = {"1": f"The first ({first}) is better", "2": f"The second ({second}) is better"}
        words = better | {"3": "Both good", "4": "Both bad", "5": "No difference"}
    return words | {"u": "Cannot tell", "s": "Skip"}


def count_asked(given: Sequence[Reply]) -> int:
    """The number of questions that were answered, also by "cannot tell"."""
    return sum(key != "s" and not rows for _, key, _, *rows in given)


def next_question(
    start: Audit, audit: Audit, given: Sequence[Reply], most: int | None, untold: Collection[str] = ()
) -> Question:
    """The next question after the keys `given` in this run, which began with `start` and made `audit` of it.

    It asks `most` at most, no more of what was skipped or nobody can tell, and last of the `untold` of earlier runs.
    """
    n_asked = count_asked(given)
    is_done = n_asked >= MIN_QUESTIONS and {*audit.verdicts} <= {"good", "bad"}
    if is_done or (most is not None and n_asked >= most):
        return ()
    if start.question is not None and not any(len(question) == 2 and key not in "gb" for question, key, *_ in given):
        return start.pair
    passed = {question[0] for question, key, *_ in given if len(question) == 1 and key in "us"}
    names = [name for name in audit.suggest_labels(len(passed) + len(untold) + 1) if name not in passed]
    return tuple(sorted(names, key=lambda name: str(name) in untold)[:1])


def rows_of(question: Question, key: str, note: str = "", *rows: int) -> list[AnswerRow]:
    """The answer that a key gives to a question; "cannot tell" is one about a pair where a note says more."""
    ids = [str(name) for name in question]
    if relation := {"1": "better than", "2": "better than", "5": "same as"}.get(key):
        first, second = ids[::-1] if key == "2" else ids
        return [AnswerRow(first, f"{relation} {second}", note)]
    untold = id_values.CANNOT_TELL * (len(ids) == 1 or bool(note))
    word = {"g": "good", "3": "good", "b": "bad", "4": "bad", "u": untold}.get(key)
    return [AnswerRow(name, word, note, *rows) for name in ids] if word else []


class Session:
    """A run of questions about `start`, judged with the answers of the file `path`, which held `before`.

    `audit` has all answers, and `lines` say what the last one did. `version` counts the changes, so that two who answer
    can tell whether they saw the same. `said` are the answers in the file about its demonstrations, `old` is the audit
    before the last change.
    """

    def __init__(self, start: Audit, path: str, before: bytes | None, most: int | None) -> None:
        self.start, self.path, self.before, self.audit = start, path, before, start
        self.version, self.lines = 0, list[str]()
        self.old = start
        self.given: tuple[Reply, ...] = ()
        self.rows: tuple[AnswerRow, ...] = ()
        self._most, self._written = most, before
        ids = {*map(str, start.ids)}
        rows = [] if before is None else id_values.read_answer_rows(path)
        self.said = self._before = [row for row in rows if row.about <= ids]
        self._untold = {row.id for row in self.said if row.label == id_values.CANNOT_TELL and not row.is_mark}
        self.question = next_question(start, start, (), most, self._untold)

    @property
    def is_as_written(self) -> bool:
        """Whether the file of answers is as this run left it."""
        path, written = Path(self.path), self._written
        return path.read_bytes() == written if path.is_file() else written is None and not os.path.lexists(path)

    def answer(self, question: Question, key: str, note: str = "", *rows: int) -> list[str]:
        """Answer a question, this one or another, with one of its `choices`, or say the same, good or bad, of any
        number of demonstrations, or of the `rows` from the first to before the second. Sentences on what it changed.

        A `DataError` where the answer contradicts another so that both cannot be written, or the file cannot be
        written; nothing has changed then.
        """
        return self._go_to((*self.given, (question, key, note, *rows)))

    def undo(self) -> list[str]:
        """Take the last answer of this run back, where there is one; sentences on what that changed."""
        return self._go_to(self.given[:-1]) if self.given else []

    def _go_to(self, given: tuple[Reply, ...]) -> list[str]:
        by_question: dict[Hashable, AnswerRow] = {}
        for row in (row for reply in given for row in rows_of(*reply)):
            by_question.pop(row.question, None)  # a later answer replaces an earlier one
            by_question[row.question] = row
        audit, lines, rows = self.audit, list[str](), tuple(by_question.values())
        if rows != self.rows:
            said = id_values.with_new(self._before, rows)
            labels, pairs = id_values.parse_answers(said, "the answers")
            marks = {(row.id, row.start, row.end): str(row.label) for row in said if row.is_mark}
            is_told = rows and (labels or pairs or marks)
            audit = self.start.answered(labels | marks, pairs, instead=True) if is_told else self.start
            lines = list(change_lines(self.audit, audit))
            self._write(rows)
            self.said = said
        self.question = next_question(self.start, audit, given, self._most, self._untold)
        self.old, self.audit, self.lines = self.audit, audit, lines
        self.given, self.rows, self.version = given, rows, self.version + 1
        return lines

    def _write(self, rows: Sequence[AnswerRow]) -> None:
        """Write the answers, whole or not at all; without any the file is as it was."""
        path = Path(self.path)
        if not self.is_as_written:
            raise DataError(f"{path}: another program has changed it; end this run, and start again.")
        if rows or self.before is not None:
            id_values.write_answers(path, self.before, rows)
            self._written = path.read_bytes()
        else:
            path.unlink(missing_ok=True)
            self._written = None


def change_lines(old: Audit, new: Audit) -> Iterator[str]:
    """Changes by an answer: the number of each verdict, and which demonstrations have another."""
    yield f"Now: {in_numbers(new.verdict_counts())}."
    moved: dict[str, list[Hashable]] = {}
    for name, before, word in zip(new.ids, old.verdicts, new.verdicts, strict=True):
        if before != word:
            moved.setdefault(word, []).append(name)
    lists = "; ".join(f"{word}: {listed(ids, MAX_IDS)}" for word, ids in moved.items())
    yield f"Now called {lists}." if moved else "No verdict changed."
    yield from (doubt for doubt in new.doubts if new.anchor == "answers")
    yield from contradiction_lines(old.contradicting, new)


def contradiction_lines(known: Sequence[Hashable], audit: Audit) -> Iterator[str]:
    """The answers that look wrong, but for those that are `known` to."""
    others = audit.answers.count - 1
    for name in audit.contradicting:
        if name not in known:
            yield f"The answer about {printable(name)} contradicts {counted(others, 'other')}; check it."


MAX_CURVES = 200
"""Columns that a page can draw: the parts of the action, and the first observations."""

N_SPREAD = 30
"""Demonstrations in which the spread of a column is measured, evenly spaced: all of many would take long to read."""

N_POINTS = 48
"""Points of a curve where one column of all demonstrations is drawn."""

CUT = 0.005
"""Share of the values at either end that are drawn at the edge, so that one spike does not flatten all others."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """The columns of demonstrations."""

    data: Demonstrations | Dataset

    @cached_property
    def columns(self) -> list[View]:
        """Each column's name, whether it is of the action, the spread of its values, and its classes, if any."""
        data = self.data
        actions = data.action_names or [f"action {k}" for k in range(data.n_actions)] or ["action"]
        names = [*actions, *data.observation_names][:MAX_CURVES]
        some = data.select(np.unique(np.linspace(0, len(data) - 1, N_SPREAD).round().astype(int)))
        with np.errstate(all="ignore"):  # of the largest numbers it may be infinite, which JSON is not
            spread = [float(np.nan_to_num(self._values(some, k).std())) for k in range(len(names))]
        return [
            {"name": printable(name), "is_action": k < len(actions), "spread": float(f"{spread[k]:.6g}")}
            | {"classes": [printable(one) for one in data.classes.tolist()] if k < len(actions) else []}
            for k, name in enumerate(names)
        ]

    def curves(self, m: int) -> list[View]:
        """The columns of demonstration `m`, each packed by itself; of classes their numbers."""
        one, curves = self.data.select([m]), []
        for k, column in enumerate(self.columns):
            values = self._values(one, k)
            binned = values[bin_starts(len(values))] if column["classes"] else bin_means(values)
            curves.append(packed({"value": binned}))
        return curves

    def column(self, k: int) -> View:
        """Column `k` of every demonstration, on one scale, by number as text; see `rpil.results.html.page.packed`."""
        if not 0 <= k < len(self.columns):
            raise DataError("There is no such column.")
        curves: list[Array] = []
        for block in chain.from_iterable(self.data.shards()):
            for own in np.split(self._values(block, k), block.offsets[1:-1]):
                curves.append(own[np.linspace(0, len(own) - 1, N_POINTS).astype(int)])
        low, high = np.nanquantile(curves, (CUT, 1 - CUT)).tolist()
        return packed({str(m): own for m, own in enumerate(curves)}, (low, high))

    def _values(self, some: Block | Demonstrations, k: int) -> Float[Array, " N"]:
        """Column `k` of some of the data: first come the parts of the action, then the observations."""
        n_parts = max(self.data.n_actions, 1)
        if k >= n_parts:
            return some.observations[:, k - n_parts].astype(float)
        actions = np.searchsorted(self.data.classes, some.actions) if self.data.is_discrete else some.actions
        return actions.reshape(len(actions), -1)[:, k].astype(float)


FRAME_WIDTH = 320
"""Pixels."""


@dataclass(frozen=True)
class EpisodeVideos:
    """Where each camera saw each demonstration, by its number, in the folder `top`."""

    top: Path
    fps: float
    shots: Mapping[int, Sequence[Shot]] = field(default_factory=dict)
    has_frames: bool = False
    """Whether single frames can be shown."""
    note: str = ""
    """A sentence on what cannot be shown, and why."""

    @classmethod
    def of(cls, source: str, ids: Sequence[Hashable], fps: float | None) -> EpisodeVideos:
        """Videos of the data at `source`; none where their format has none, or where they are not there."""
        top, shots = Path(source), dict[int, list[Shot]]()
        known = find_format(source) if top.exists() else None
        if known is None or known.shots is None or not fps:
            return cls(top, 1.0, note="These data have no videos.")
        numbers = {str(name): m for m, name in enumerate(ids)}
        try:
            for shot in known.shots(top):
                if str(shot.episode) in numbers and shot.path.is_file():
                    shots.setdefault(numbers[str(shot.episode)], []).append(shot)
            if shots:
                load_av()
        except DataError as error:
            return cls(top, fps, note=f"Videos are not shown. {error}")
        except MissingExtraError as error:
            return cls(top, fps, shots, note=str(error))
        none = "There are no videos of these demonstrations in their folder."
        return cls(top, fps, shots, bool(shots), "" if shots else none)

    def of_one(self, m: int) -> dict[str, object]:
        """The videos of demonstration `m`: camera, and seconds in its file; whether frames are shown; and the note."""
        found = [
            {"camera": shot.camera, "start": shot.start, "end": min(shot.end, shot.start + shot.n_rows / self.fps)}
            for shot in self.shots.get(m, ())
        ]
        return {"videos": found, "frames": self.has_frames, "note": self.note}

    def file(self, m: int, camera: int) -> Path:
        """The file in which a camera saw demonstration `m`; a `DataError` where there is none, or it lies elsewhere."""
        shot = self._shot(m, camera)
        check_inside(shot.path, self.top)
        if not shot.path.is_file():
            raise DataError(f"{shot.path.name}: this video is not there any more; download it again.")
        return shot.path

    def frame(self, m: int, camera: int, step: int) -> bytes:
        """A camera's picture at a step, as a small JPEG file; a `DataError` where there is no such frame."""
        shot = self._shot(m, camera)
        if not 0 <= step < shot.n_rows:
            raise DataError(f"Demonstration {shot.episode} has no step {step}.")
        return picture(self.file(m, camera), shot.start + step / self.fps, self.fps, FRAME_WIDTH)

    def _shot(self, m: int, camera: int) -> Shot:
        shots = self.shots.get(m, ())
        if not 0 <= camera < len(shots):
            raise DataError("There is no such video.")
        return shots[camera]
