"""Progress on stderr: in a terminal a line that changes, elsewhere a new line now and then."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from rpil.data.privacy import without_secrets

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

StageProgress = Callable[[str], None]
"""A function of the name of the current stage."""

CountProgress = Callable[[int, int], None]
"""A function of the number of finished items and the number of all items."""

LOADING = "loading the libraries"
"""The stage of a command until it names another one."""


@dataclass(frozen=True)
class ProgressTiming:
    """When lines about progress are printed where there is no terminal."""

    first: float = 1.0  # seconds until the first line
    interval: float = 3.0  # seconds between two lines, at least
    elapsed_share: float = 0.1  # the same as a share of the elapsed time: lines become rarer
    unchanged: float = 30.0  # seconds until a line of the same stage, at least


@contextmanager
def show_stages(quiet: bool, timing: ProgressTiming) -> Iterator[StageProgress]:
    """A function that shows the current stage; it shows nothing if `quiet`."""
    if quiet or not sys.stderr.isatty():
        with _print_lines(quiet, timing) as show:
            yield show
        return
    from rich.progress import SpinnerColumn

    with _progress_bar([SpinnerColumn()]) as bar:
        task = bar.add_task(LOADING, total=None)
        yield lambda stage: bar.update(task, description=without_secrets(stage))


@contextmanager
def show_count(title: str, quiet: bool, timing: ProgressTiming) -> Iterator[CountProgress]:
    """A function that shows how many items are finished; it shows nothing if `quiet`."""
    if quiet or not sys.stderr.isatty():
        with _print_lines(quiet, timing) as show:
            show(title)
            start = time.monotonic()
            yield lambda done, total: show(f"{title}, {done} of {total}{_time_left(start, done, total)}")
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

    with _progress_bar([], BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _time_left(start: float, done: int, total: int) -> str:
    """The time that the unfinished items will take if each takes as long as the finished ones did on average."""
    return f", about {(time.monotonic() - start) * (total - done) / done:.0f} s left" if done else ""


def lines(timing: ProgressTiming) -> Generator[float, tuple[float, str], None]:
    """Print a line now and then, when the elapsed seconds and the stage are sent; yields the seconds until the next."""
    wait, said, last = timing.first, "", 0.0
    while True:
        elapsed, stage = yield wait
        wait = max(timing.interval, timing.elapsed_share * elapsed)
        if stage != said or elapsed - last >= timing.unchanged:
            said, last = stage, elapsed
            click.echo(f"rpil: {elapsed:.0f} s: {without_secrets(stage)}", err=True)


@contextmanager
def _print_lines(quiet: bool, timing: ProgressTiming) -> Iterator[StageProgress]:
    """A function that sets the text of the next line; a thread prints the lines."""
    start, latest, finished = time.monotonic(), [LOADING], threading.Event()

    def print_lines() -> None:
        printer = lines(timing)
        wait = next(printer)
        while not finished.wait(wait):
            wait = printer.send((time.monotonic() - start, latest[0]))

    thread = threading.Thread(target=print_lines, daemon=True)
    if not quiet:
        thread.start()
    try:
        yield lambda stage: latest.__setitem__(0, stage)
    finally:
        finished.set()
        if not quiet:
            thread.join()  # no line may follow the result


def _progress_bar(first: list[ProgressColumn], *columns: ProgressColumn) -> Progress:
    """A line of the columns `first`, the description, the other columns and the elapsed time."""
    from rich.console import Console
    from rich.progress import Progress, TextColumn, TimeElapsedColumn

    columns = *first, TextColumn("{task.description}", markup=False), *columns, TimeElapsedColumn()
    return Progress(*columns, console=Console(stderr=True), transient=True)
