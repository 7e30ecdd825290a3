"""The commands ``rpil label`` and ``rpil review``: the questions whose answers would say most, in the terminal or on a
page of this computer, and what each answer changes."""

from __future__ import annotations

import os
import shlex
import socket
import sys
import threading
import webbrowser
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from rpil.cli import commands, terminal
from rpil.cli.audit import print_finding
from rpil.cli.options import LABEL_OPTIONS, LABELS_FILE, RunOptions, Value, command_words, with_options
from rpil.cli.terminal import show_stages
from rpil.data.errors import DataError, optional
from rpil.data.files import check_outputs, is_dangling
from rpil.data.memory import LARGEST_TABLE, read_json
from rpil.data.text import counted

if TYPE_CHECKING:
    from rpil.cli.questions.session import Session
    from rpil.data.memory import Parsed
    from rpil.results.html.page import View

MAX_QUESTIONS = 8
"""Questions that one run asks at most."""

BESIDE = {"keep": "keep.json", "verdicts": "verdicts.csv", "weights": "weights.parquet"}
"""Files of a review that is finished: beside labels.csv they are labels-keep.json and so on."""


def begin(file: str, options: dict[str, Value], most: int | None) -> tuple[commands.AuditRun, Session]:
    """The audit of the data in `file` with the answers in the file of labels, if any, and a run of `most` questions."""
    given = RunOptions.of(options)
    path = given.labels or LABELS_FILE
    check_outputs((file, *given.columns.files), [path])
    if Path(path).suffix.lower() != ".csv":
        raise DataError(f"{path}: answers are read from and written to CSV (id,label) here; give another --labels.")
    if is_dangling(path):
        raise DataError(f"{path}: it is a link that leads to nothing; remove it, or give another file of labels.")
    before = Path(path).read_bytes() if Path(path).exists() else None
    given = replace(given, labels=path if before is not None else None)
    with show_stages(given.quiet) as progress:
        run = commands.judge(file, given, progress)
    if not run.audit.columns.size:
        raise DataError(f"{file}: this audit keeps nothing to learn from answers; leave out --adversary.")
    commands.tell_of_set_aside(run.recording)
    print_finding(run.audit)
    from rpil.cli.questions.session import Session

    return run, Session(run.audit, path, before, most)


@click.command()
@click.argument("file", type=click.Path())
@with_options(*LABEL_OPTIONS)
@click.pass_context
def label(ctx: click.Context, /, file: str, **options: Value) -> None:
    """Ask up to eight questions in the terminal, and write the answers to a file of labels.

    The file is labels.csv, or that of --labels. A run goes on where the last one ended. Each answer is written at once.
    """
    _, session = begin(file, options, MAX_QUESTIONS)
    ask(session)
    terminal.print_lines(last_lines(session, command_words(ctx, "audit")))


def last_lines(session: Session, audit: Sequence[str]) -> Iterator[str]:
    """The answers of a run that ends, and the command to run then, which is `audit` with the answers."""
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
    from rpil.cli.questions.session import choices, contradiction_lines, count_asked
    from rpil.results.answering import question_sentence

    click.echo("To say why, write it after the key, as: b slips at 3 s")
    terminal.print_lines(contradiction_lines((), session.audit))
    while question := session.question:
        number = f"Question {count_asked(session.given) + 1} of {MAX_QUESTIONS} at most."
        terminal.print_lines(["", f"{number} {question_sentence(session.audit, question)}"])
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


@click.command()
@click.argument("file", type=click.Path())
@click.option("--browser/--no-browser", default=True, help="Open the page in a browser, or print its address alone.")
@with_options(*LABEL_OPTIONS)
@click.pass_context
def review(ctx: click.Context, /, file: str, browser: bool, **options: Value) -> None:
    """Look at demonstrations on a page of this computer, answer, and see what each answer changes.

    The page asks the questions of rpil label. It writes each answer at once to labels.csv, or the file of --labels,
    and a run goes on where the last one ended. No other computer can open the page. Ctrl-C ends it.
    """
    from rpil.cli.questions.server import Gate, Review, application, serve
    from rpil.cli.questions.session import EpisodeVideos

    for name in ("starlette", "uvicorn"):
        optional(name, "To review on a page", "review")
    local = socket.create_server(("127.0.0.1", 0))  # of this computer alone, at any free port
    with local as listening, TemporaryDirectory(prefix="rpil-") if browser else nullcontext() as folder:
        quiet = options["quiet"]
        with terminal.print_warnings():  # now, not when the page is closed
            run, session = begin(file, options, None)
            with show_stages(quiet) as progress:
                run = replace(run, faults=commands.look_for_faults(run.recording, progress))
                progress("looking for videos")
                # By another column of ids, no demonstration is an episode that videos are named after.
                videos = EpisodeVideos.of(run.source, () if run.recording.options.id else run.audit.ids, run.audit.fps)
            finish = partial(_finish, ctx, run, session)
            shown = Review(session, commands.about(run), videos, finish, run.recording.demonstrations)
        gate = Gate(listening.getsockname()[1])
        click.echo(f"The page is at {gate.url}  (Ctrl-C ends it)")
        if folder:
            page = Path(folder, "review.html")  # all users see what a browser opens, and only this one may read it
            page.touch(0o600)
            page.write_text(f'<meta http-equiv="refresh" content="0; url={gate.url}">', encoding="ascii")
            threading.Thread(target=webbrowser.open, args=[page.as_uri()], daemon=True).start()
        with suppress(KeyboardInterrupt):
            serve(application(shown, gate), listening)
    terminal.print_lines(last_lines(session, command_words(ctx, "audit")))


def _finish(ctx: click.Context, run: commands.AuditRun, session: Session, given: Mapping[str, Parsed]) -> View:
    """Which demonstrations are kept, and by which rules the others are not; or, if a page asks to "write", the files
    `BESIDE` that of the answers, which replace those of earlier reviews of the same data alone. The page gives the ids
    that are "spared" and the "rules" of faults that reject."""
    from rpil.formats.registry import find

    said = (given.get(name) for name in ("spared", "rules"))
    spared, rules = ({*map(str, one)} if isinstance(one, list) else set() for one in said)
    faulty = {str(fault.id) for fault in (run.faults.findings if run.faults else ()) if fault.rule in rules}
    run = replace(run, audit=session.audit, faulty=faulty, spared=spared)
    if not given.get("write"):
        places = {name: m for m, name in enumerate(run.audit.ids)}
        rejected = {rule: [places[name] for name in ids] for rule, ids in run.choice.rejected.items()}
        found = {"kept": len(run.choice.kept), "rejected": rejected, "notes": run.choice.notes}
        return found | {"outcome": run.choice.words("outcome")}
    beside = {title: f"{Path(session.path).with_suffix('')}-{name}" for title, name in BESIDE.items()}
    for path in filter(os.path.islink, beside.values()):
        raise DataError(f"{path}: it is a link, and no review writes where a link leads; remove it.")
    check_outputs((run.source, session.path, *run.recording.options.files), beside.values())
    before = b""  # the run id in the list to keep, and in the other files, that a review of the same data wrote
    with suppress(DataError, OSError, ValueError, LookupError, TypeError):
        kept, made = read_json(Path(beside["keep"]), LARGEST_TABLE), run.audit.provenance or {}
        is_same = kept["provenance"]["files"][0]["path"] == made["files"][0]["path"]
        if is_same and len(id_before := str(kept["run"])) == len(run.audit.run_id):  # a letter is in every file
            before = id_before.encode()
    for path in beside.values():
        if os.path.exists(path) and not (before and before in Path(path).read_bytes()):
            raise DataError(f"{path}: it is there, and no review of these data wrote it; move it to another folder.")
    with ctx.scope(cleanup=False):  # the server answers in threads, which have no context
        commands.write_outputs({title: beside.get(title) for title in commands.OUTPUTS}, run, lambda _: None)
    suffix = ".json" if find(run.source).unkept(run.recording.options) else Path(run.source).suffix
    new = f"{Path(run.source).stem}-kept{suffix}"
    command = [*command_words(ctx, "keep"), "--verdicts", beside["keep"], "-o", new]
    return {"files": beside, "lost": run.lost, "command": shlex.join(command)}
