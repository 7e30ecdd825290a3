"""A run of questions, in the terminal or on a page: every answer is learned from and written at once."""

from __future__ import annotations

import os
from collections.abc import Hashable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.id_values import (
    CANNOT_TELL,
    AnswerRow,
    parse_answers,
    read_answer_rows,
    same_question,
    with_new,
    write_answers,
)
from rpil.data.text import MAX_IDS, counted, listed, printable
from rpil.results.answering import where_to_look
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


def next_question(start: Audit, audit: Audit, given: Sequence[Reply], most: int | None) -> Question:
    """The next question after the keys `given` in this run, which began with `start` and made `audit` of it.

    It asks `most` questions at most, and no more about what was skipped, or what nobody can tell.
    """
    n_asked = count_asked(given)
    is_done = n_asked >= MIN_QUESTIONS and {*audit.verdicts} <= {"good", "bad"}
    if is_done or (most is not None and n_asked >= most):
        return ()
    if start.question is not None and not any(len(question) == 2 and key not in "gb" for question, key, *_ in given):
        return start.pair
    passed = {question[0] for question, key, *_ in given if len(question) == 1 and key in "us"}
    suggested = audit.suggest_labels(len(passed) + 1)
    return tuple(name for name in suggested if name not in passed)[:1]


def rows_of(question: Question, key: str, note: str = "", *rows: int) -> list[AnswerRow]:
    """The answer that a key gives to a question; "cannot tell" is one where a note says more."""
    ids = [str(name) for name in question]
    if relation := {"1": "better than", "2": "better than", "5": "same as"}.get(key):
        first, second = ids[::-1] if key == "2" else ids
        return [AnswerRow(first, f"{relation} {second}", note)]
    word = {"g": "good", "3": "good", "b": "bad", "4": "bad", "u": CANNOT_TELL * bool(note)}.get(key)
    return [AnswerRow(name, word, note, *rows) for name in ids] if word else []


class Session:
    """A run of questions about `start`, judged with the answers of the file `path`, which held `before`.

    `audit` has all answers, and `lines` say what the last one did. `version` counts the changes, so that two who answer
    can tell whether they saw the same. `said` are the answers in the file about demonstrations of the audit. `old` is
    the audit before the last change.
    """

    def __init__(self, start: Audit, path: str, before: bytes | None, most: int | None) -> None:
        self.start, self.path, self.before, self.audit = start, path, before, start
        self.version, self.lines = 0, list[str]()
        self.old = start
        self.given: tuple[Reply, ...] = ()
        self.rows: tuple[AnswerRow, ...] = ()
        self.question = next_question(start, start, (), most)
        self._most, self._written = most, before
        ids = {*map(str, start.ids)}
        rows = [] if before is None else read_answer_rows(path)
        self.said = self._before = [row for row in rows if same_question(row.id, row.label) <= ids]

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
            said = with_new(self._before, rows)
            labels, pairs = parse_answers(said, "the answers") if rows else ({}, {})
            marks = {(row.id, row.start, row.end): str(row.label) for row in said if row.is_mark} if rows else {}
            is_told = labels or pairs or marks
            audit = self.start.answered(labels | marks, pairs, instead=True) if is_told else self.start
            lines = list(change_lines(self.audit, audit))
            self._write(rows)
            self.said = said
        self.question = next_question(self.start, audit, given, self._most)
        self.old, self.audit, self.lines = self.audit, audit, lines
        self.given, self.rows, self.version = given, rows, self.version + 1
        return lines

    def _write(self, rows: Sequence[AnswerRow]) -> None:
        """Write the answers, whole or not at all; without any the file is as it was."""
        path = Path(self.path)
        if not self.is_as_written:
            raise DataError(f"{path}: another program has changed it; end this run, and start again.")
        if rows or self.before is not None:
            write_answers(path, self.before, rows)
            self._written = path.read_bytes()
        else:
            path.unlink(missing_ok=True)
            self._written = None


def question_sentence(audit: Audit, question: Question) -> str:
    """The question in words, with where to look; never what the audit thinks of the demonstrations."""
    where = " or ".join(where_to_look(audit, name) for name in question)
    return f"Which is better: {where}?" if len(question) == 2 else f"Is it good or bad: {where}?"


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
