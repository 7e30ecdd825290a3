"""The command ``rpil review``: a page on this computer that shows demonstrations, and asks about them."""

from __future__ import annotations

import shlex
import threading
import webbrowser
from contextlib import suppress
from typing import TYPE_CHECKING

import click

from rpil.cli import terminal
from rpil.cli.commands import CommandSettings
from rpil.cli.label import WITHOUT, Judged, command_with_labels, judge, last_lines
from rpil.cli.options import Value, command_words, with_label_options
from rpil.cli.options_file import file_argument
from rpil.cli.outputs import Audited, about
from rpil.cli.progress import show_stages

if TYPE_CHECKING:
    from rpil.review.server import Review


@click.command()
@file_argument
@click.option(
    "--port",
    type=click.IntRange(1024, 65535),
    metavar="PORT",
    help="The port of the page on this computer; by default one that is free.",
)
@click.option("--browser/--no-browser", default=True, help="Open the page in a browser, or print its address alone.")
@with_label_options
@click.pass_context
def review(ctx: click.Context, /, file: str, port: int | None, browser: bool, **options: Value) -> None:
    """Look at demonstrations on a page of this computer, answer, and see what each answer changes.

    Answers go to labels.csv, or the file of --labels, as those of rpil label: each is written at once, and a run goes
    on where the last one ended. The page is for this computer alone. Ctrl-C ends it.
    """
    from rpil.review.security import Gate
    from rpil.review.server import application, listen, load_server, serve

    load_server()
    with listen(port or 0) as listening:
        quiet = options["quiet"]
        with terminal.print_warnings():  # now, not when the page is closed
            judged = judge(file, options)
            found = _review(file, judged, shlex.join(command_words(ctx, "audit", WITHOUT)), quiet)
        gate = Gate.new(listening.getsockname()[1])
        click.echo(f"The page is at {gate.url}  (Ctrl-C ends it)")
        if browser:
            threading.Thread(target=webbrowser.open, args=[gate.url], daemon=True).start()
        with suppress(KeyboardInterrupt):
            serve(application(found, gate), listening)
    terminal.print_lines(last_lines(found.session, command_with_labels(ctx, judged.path)))


def _review(file: str, judged: Judged, command: str, quiet: bool) -> Review:
    """What the page shows and changes; `command` is that of an audit, without the answers."""
    from rpil.faults.recorded import faults_of
    from rpil.faults.settings import FaultSettings
    from rpil.review.frames import Videos
    from rpil.review.outputs import write_beside
    from rpil.review.page import page_of
    from rpil.review.server import Review
    from rpil.review.session import Session

    audit, recording = judged.audit, judged.recording
    with show_stages(quiet, CommandSettings.current().timing) as progress:
        progress("looking for recording faults")
        faults = faults_of(recording, None, None, False, FaultSettings())
        given = Audited(audit, file, recording, faults, judged.demonstrators)
        shown = about(given, command)
        progress("looking for videos")
        # By another column of ids, no demonstration is an episode that videos are named after.
        videos = Videos.of(file, () if recording.options.id else audit.ids, judged.fps)
    return Review(
        session=Session(audit, judged.path, judged.before, None),
        about=shown,
        videos=videos,
        finish=lambda answered: list(write_beside(judged.path, file, answered, shown, recording)),
        page=page_of,
    )
