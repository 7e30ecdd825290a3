"""Progress on stderr: in a terminal a line that changes, elsewhere a new line now and then."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from rpil.data.privacy import without_secrets

StageProgress = Callable[[str], None]
"""A function of the name of the current stage."""

LOADING = "loading the libraries"
"""The stage of a command until it names another one."""


FIRST, INTERVAL, ELAPSED_SHARE = 1.0, 3.0, 0.1
"""Where there is no terminal: seconds until the first line, seconds between two lines at least, and these as a share
of the elapsed time: lines become rarer."""


@contextmanager
def show_stages(quiet: bool) -> Iterator[StageProgress]:
    """A function that shows the current stage on stderr; it shows nothing if `quiet`."""
    if quiet:
        yield lambda stage: None
        return
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(LOADING, total=None)
            yield lambda stage: bar.update(task, description=without_secrets(stage))
        return
    start, latest, finished = time.monotonic(), [LOADING], threading.Event()

    def print_lines() -> None:
        wait = FIRST
        while not finished.wait(wait):
            elapsed = time.monotonic() - start
            click.echo(f"rpil: {elapsed:.0f} s: {without_secrets(latest[0])}", err=True)
            wait = max(INTERVAL, ELAPSED_SHARE * elapsed)

    thread = threading.Thread(target=print_lines, daemon=True)
    thread.start()
    try:
        yield lambda stage: latest.__setitem__(0, stage)
    finally:
        finished.set()
        thread.join()  # no line may follow the result
