"""The command ``rpil label``: the questions whose answers would say most, and what each answer changes."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.cli import terminal
from rpil.cli.commands import AuditRun, check_paths, judge, tell_of_set_aside
from rpil.cli.options import LABEL_OPTIONS, RunOptions, Value, command_words, with_options
from rpil.cli.printed_audit import finding_lines, verdict_sentence
from rpil.cli.terminal import show_stages
from rpil.data.errors import DataError
from rpil.data.folders import is_dangling
from rpil.data.text import counted

if TYPE_CHECKING:
    from rpil.cli.questions.session import Session

MAX_QUESTIONS = 8
"""Questions that one run asks at most."""

LABELS_FILE = "labels.csv"

WITHOUT = "labels", "quiet", "port", "browser"
"""Options that an audit with the answers does not need, or does not have."""


def audit_with_answers(file: str, options: dict[str, Value]) -> tuple[AuditRun, str, bytes | None]:
    """The audit of the data in `file` with the answers in the file of labels, which need not be there; the path of this
    file, and what is in it."""
    given = RunOptions.of(options)
    path = given.labels or LABELS_FILE
    check_paths((file, *given.columns.files.values()), path)
    from rpil import formats

    formats.check_labels_file(path)
    if is_dangling(path):
        raise DataError(f"{path}: it is a link that leads to nothing; remove it, or give another file of labels.")
    before = Path(path).read_bytes() if Path(path).exists() else None
    given = replace(given, labels=path if before is not None else None)
    with show_stages(given.quiet) as progress:
        run = judge(file, given, progress)
    if not run.audit.columns.size:
        raise DataError(f"{file}: this audit keeps nothing to learn from answers; leave out --adversary.")
    tell_of_set_aside(run.recording)
    terminal.print_lines([*finding_lines(run.audit), verdict_sentence(run.audit)])
    return run, path, before


@click.command()
@click.argument("file", type=click.Path())
@with_options(*LABEL_OPTIONS)
@click.pass_context
def label(ctx: click.Context, /, file: str, **options: Value) -> None:
    """Ask the questions whose answers would say most, four to eight, and write the answers to a file of labels.

    It is labels.csv, or that of --labels. Answers that it holds count: a run goes on where the last one ended. Each
    answer is written at once.
    """
    run, path, before = audit_with_answers(file, options)
    from rpil.cli.questions.session import Session

    session = Session(run.audit, path, before, MAX_QUESTIONS)
    ask(session)
    terminal.print_lines(last_lines(session, command_words(ctx, "audit", WITHOUT)))


def last_lines(session: Session, audit: Sequence[str]) -> Iterator[str]:
    """What was answered in a run that ends, and the command to run then, which is `audit` with the answers."""
    yield ""
    if not session.rows and session.before is None:
        yield "No answer was given, and nothing was written."
        return
    if not session.is_as_written:
        yield f"Another program has changed or removed {session.path}; look whether your answers are in it."
        return
    yield f"{counted(len(session.rows), 'answer')} of this run in {session.path}."
    yield f"Then run: {shlex.join([*audit, '--labels', session.path])}"


def ask(session: Session) -> None:
    """Ask until nothing is left, or the user ends it."""
    from rpil.cli.questions.session import choices, contradiction_lines, count_asked, fact_lines, question_sentence

    click.echo("Ranks: 0 is the least of all, 1 the most. To say why, write it after the key, as: b slips at 3 s")
    terminal.print_lines(contradiction_lines((), session.audit))
    while question := session.question:
        number = f"Question {count_asked(session.given) + 1} of {MAX_QUESTIONS} at most."
        terminal.print_lines(["", f"{number} {question_sentence(session.audit, question)}"])
        terminal.print_lines(f"  {line}" for line in fact_lines(session.audit, question))
        key, note = _read_key(choices(question) | {"z": "Undo", "q": "Quit"})
        if key == "q":
            break
        if key == "z" and not session.given:
            click.echo("There is nothing to undo.")
            continue
        try:
            lines = session.undo() if key == "z" else session.answer(question, key, note)
        except DataError as error:  # such as two labels that contradict each other: the question comes again
            if not session.is_as_written:
                raise
            lines = [error.in_shell]
        terminal.print_lines(lines)
    else:
        terminal.print_lines(["", "Nothing more is asked in this run."])


def _read_key(keys: Mapping[str, str]) -> tuple[str, str]:
    """The key that the user gives as a line, and the note after it; q at the end of the input."""
    terminal.print_lines([", ".join(f"{key}: {words}" for key, words in keys.items())])
    while True:
        click.echo("> ", nl=False)
        sys.stdout.flush()
        line = sys.stdin.readline()
        key, _, note = line.strip().partition(" ")
        if not line:
            click.echo()
            return "q", ""
        if key.lower() in keys:
            return key.lower(), note.strip()
        click.echo(f"Give one of {', '.join(keys)}.")
