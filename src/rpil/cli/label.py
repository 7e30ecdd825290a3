"""The command ``rpil label``: the questions whose answers would say most, and what each answer changes."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.cli import commands, terminal
from rpil.cli.commands import (
    CommandSettings,
    audit_by_task,
    check_paths,
    connect_engine,
    open_recording,
    tell_if_interrupted,
)
from rpil.cli.options import FitOptions, Value, command_words, pop_columns, with_label_options
from rpil.cli.options_file import file_argument
from rpil.cli.progress import show_stages
from rpil.data.errors import DataError

if TYPE_CHECKING:
    from rpil.results.record import Audit

MIN_QUESTIONS, MAX_QUESTIONS = 4, 8
"""From the first on it ends where the answers leave no demonstration open; the second is the most that one run asks."""

N_MOVED = 3
"""Demonstrations of which it is printed how far an answer moved them."""

LABELS_FILE = "labels.csv"

_OTHER_KEYS = "u cannot tell, s skip, z undo, q quit"
_KEYS_OF_PAIR = f"1 the first, 2 the second, 3 both good, 4 both bad, {_OTHER_KEYS}"
_KEYS_OF_ONE = f"g good, b bad, {_OTHER_KEYS}"

Rows = tuple[tuple[str, str], ...]
"""Answers as a file of labels has them: ids as text, and words."""


@dataclass(frozen=True, eq=False)
class Asking:
    """Where a run of questions is; each answer makes a new one."""

    start: Audit
    """Judged with the answers that were there before."""
    rows: Rows = ()
    """The answers of this run."""
    passed: frozenset[Hashable] = field(default=frozenset())
    """Demonstrations about which this run asks no more, because nobody can tell or they were skipped."""
    pair_passed: bool = False
    n_asked: int = 0
    """Questions that were answered, also by "cannot tell"."""

    def audit(self) -> Audit:
        """The audit with all answers; no policy is fitted again."""
        from rpil.data.id_values import parse_answers

        return self.start.answered(*parse_answers(self.rows, "the answers")) if self.rows else self.start

    def question(self, audit: Audit) -> tuple[Hashable, ...]:
        """The two demonstrations to compare, the one to judge, or nothing that is left to ask."""
        is_done = self.n_asked >= MIN_QUESTIONS and audit.anchor == "answers" and "open" not in audit.verdicts
        if is_done or self.n_asked >= MAX_QUESTIONS:
            return ()
        if self.start.question is not None and not self.pair_passed:
            return self.start.pair
        suggested = audit.suggest_labels(len(self.passed) + 1)
        return tuple(name for name in suggested if name not in self.passed)[:1]

    def after(self, question: tuple[Hashable, ...], key: str) -> Asking:
        """The state after the question was answered with a key."""
        is_pair = len(question) == 2
        passed = frozenset() if is_pair or key not in "us" else frozenset(question)
        return replace(
            self,
            rows=self.rows + rows_of(question, key),
            passed=self.passed | passed,
            pair_passed=self.pair_passed or is_pair,
            n_asked=self.n_asked + (key != "s"),
        )


def rows_of(question: tuple[Hashable, ...], key: str) -> Rows:
    """The answer that a key gives to a question."""
    from rpil.data.id_values import better_than

    ids = [str(name) for name in question]
    if key in ("1", "2"):
        better, worse = ids if key == "1" else ids[::-1]
        return ((better, better_than(worse)),)
    word = {"g": "good", "3": "good", "b": "bad", "4": "bad"}.get(key)
    return tuple((name, word) for name in ids) if word else ()


@click.command()
@file_argument
@with_label_options
@click.pass_context
def label(ctx: click.Context, /, file: str, **options: Value) -> None:
    """Ask the questions whose answers would say most, four to eight, and write the answers to a file of labels.

    It is labels.csv, or that of --labels. Answers that it holds count: a run goes on where the last one ended. Each
    answer is written at once.
    """
    path = options["labels"] or LABELS_FILE
    check_paths((file, options["operator"]), path)
    from rpil import formats

    formats.check_labels_file(path)
    before = Path(path).read_bytes() if Path(path).exists() else None
    options["labels"] = path if before is not None else None
    if before is not None:
        formats.read_answers(path)  # refused before anything is judged
    quiet, stream, scheduler = (options.pop(name) for name in ("quiet", "stream", "scheduler"))
    columns = pop_columns(options)
    if options["features"] == "auto":
        options["features"] = "folded"  # the judge's, as in an audit: no policy is kept
    with (
        show_stages(quiet, CommandSettings.current().timing) as progress,
        connect_engine(scheduler, progress) as engine,
    ):
        read = open_recording(file, columns, progress, commands.resolve_stream(file, stream, scheduler))
        audit, _ = audit_by_task(file, read, FitOptions(**options), progress, engine)
    if not audit.columns.size:
        raise DataError(f"{file}: this audit keeps nothing to learn from answers; leave out --adversary.")
    commands.tell_of_set_aside(read)
    terminal.print_lines([terminal.finding_sentence(audit), terminal.verdict_sentence(audit)])
    last = ask(Asking(audit), path, before, read.description.fps or read.times().fps)
    terminal.print_lines(_last_lines(last, path, before, shlex.join(command_words(ctx, "audit"))))


def _last_lines(last: Asking, path: str, before: bytes | None, command: str) -> Iterator[str]:
    yield ""
    if not last.rows and before is None:
        yield "No answer was given, and nothing was written."
        return
    n = len(last.rows)
    yield f"{n} answer{'s' * (n != 1)} of this run in {path}."
    yield f"Then run: {command} --labels {shlex.quote(path)}"


def ask(asking: Asking, path: str, before: bytes | None, fps: float | None) -> Asking:
    """Ask until nothing is left, or the user ends it; write every answer to the file at `path`, which held `before`."""
    earlier: list[Asking] = []
    audit = asking.audit()
    click.echo("Ranks are from 0, the least of all demonstrations, to 1, the most.")
    terminal.print_lines(contradiction_lines((), audit))
    while question := asking.question(audit):
        terminal.print_lines(["", *question_lines(audit, question, asking.n_asked + 1, fps)])
        key = _read_key(_KEYS_OF_PAIR if len(question) == 2 else _KEYS_OF_ONE)
        if key == "q":
            break
        if key == "z" and not earlier:
            click.echo("There is nothing to undo.")
            continue
        old = asking
        if key == "z":
            asking = earlier.pop()
        else:
            earlier.append(asking)
            asking = asking.after(question, key)
        if asking.rows != old.rows:
            changed = asking.audit()
            _write(path, before, asking.rows)
            terminal.print_lines(change_lines(audit, changed))
            audit = changed
    else:
        terminal.print_lines(["", "Nothing more is asked in this run."])
    return asking


def _write(path: str, before: bytes | None, rows: Rows) -> None:
    """Write the answers, atomically; without any the file is as it was."""
    from rpil.data.id_values import write_answers

    tell_if_interrupted(f"the answers so far are in {path}")
    if rows or before is not None:
        write_answers(path, before, rows)
    else:
        Path(path).unlink(missing_ok=True)


def _read_key(keys: str) -> str:
    """The key that the user gives as a line; q at the end of the input."""
    allowed = [words.split()[0] for words in keys.split(", ")]
    click.echo(keys)
    while True:
        click.echo("> ", nl=False)
        sys.stdout.flush()
        line = sys.stdin.readline()
        key = line.strip().lower()
        if not line:
            click.echo()
            return "q"
        if key in allowed:
            return key
        click.echo(f"Give one of {', '.join(allowed)}.")


def question_lines(audit: Audit, question: tuple[Hashable, ...], number: int, fps: float | None) -> Iterator[str]:
    """The question in words, with the facts about its demonstrations; never what the audit thinks of them."""
    from rpil.results.answering import where_to_look
    from rpil.results.facts import in_words

    where = " or ".join(where_to_look(audit, name, fps) for name in question)
    what = f"Which is better: {where}?" if len(question) == 2 else f"Is it good or bad: {where}?"
    yield f"Question {number} of {MAX_QUESTIONS} at most. {what}"
    for name in question:
        m = audit.index(name)
        facts = in_words(audit.facts, m)
        yield f"  {name}: {audit.lengths[m]:,} steps{'; ranks: ' * bool(facts)}{facts}"


def change_lines(old: Audit, new: Audit) -> Iterator[str]:
    """What an answer changed: the number of each word, which demonstrations have another, and who moved most."""
    counts = ", ".join(f"{count:,} {word}" for word, count in new.verdict_counts().items())
    yield f"Now: {counts}."
    moved: dict[str, list[Hashable]] = {}
    for name, before, word in zip(new.ids, old.verdicts, new.verdicts, strict=True):
        if before != word:
            moved.setdefault(word, []).append(name)
    lists = "; ".join(f"{word}: {terminal.join_ids(ids)}" for word, ids in moved.items())
    yield f"Other words than before, {lists}." if moved else "No word changed."
    distance = abs(new.expert_proba - old.expert_proba)
    most = distance.argsort(kind="stable")[::-1][:N_MOVED].tolist()
    far = (f"{new.ids[m]} {old.expert_proba[m]:.2f} to {new.expert_proba[m]:.2f}" for m in most)
    yield f"{new.words.probability} moved most: {', '.join(far)}."
    yield from (doubt for doubt in new.doubts if new.anchor == "answers")
    yield from contradiction_lines(old.contradicting, new)


def contradiction_lines(known: Sequence[Hashable], audit: Audit) -> Iterator[str]:
    """The answers that look wrong, but for those that are `known` to."""
    others = audit.answers.count - 1
    for name in audit.contradicting:
        if name not in known:
            yield f"{name} contradicts {others:,} other{'s' * (others != 1)}; look again."
