"""Lines, tables, progress, warnings and JSON in a terminal."""

from __future__ import annotations

import json
import re
import shutil
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import click

from rpil.data.errors import shortened
from rpil.data.memory import finite
from rpil.data.text import printable

NUMBER = re.compile(r"([-+]?[\d,.]+(e[-+]\d+)?)?")

THEN_RUN = "Then run: "
"""Begins the line of the command to run next, which a terminal shows as one line, to be pasted."""

PIPE_WIDTH = 80
"""Columns of a line where there is no terminal."""

StageProgress = Callable[[str], None]
"""A function of the name of the current stage."""

LOADING = "loading the libraries"
"""The stage of a command until it names another one."""


@contextmanager
def show_stages(quiet: bool) -> Iterator[StageProgress]:
    """A function that shows the current stage in a terminal; it shows nothing if `quiet`, or in a pipe."""
    if quiet or not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status(LOADING) as status:
        yield lambda stage: status.update(escape(stage))


@contextmanager
def print_warnings() -> Iterator[None]:
    """Print every warning for users as one line on stderr, once, and no other warnings; none if there is an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    messages = map(str, (warning.message for warning in caught if issubclass(warning.category, UserWarning)))
    for message in dict.fromkeys(messages):
        click.echo(f"note: {to_one_line(message)}", err=True)


def to_one_line(text: str) -> str:
    """The text on one line, without colours and secrets."""
    return " ".join(click.unstyle(shortened(text)).split())


def to_json(value: Mapping[str, object], schema: str = "") -> str:
    """The value as standard JSON, in which NaN and infinity become null.

    It says by which `schema` of docs/schemas it is, if by any; a change that is no addition raises the version.
    """
    said = {"schema": {"name": f"rpil.{schema}", "version": 1}} if schema else {}
    return json.dumps(finite({**said, **value}), allow_nan=False)


def print_lines(lines: Iterable[str]) -> None:
    """Print lines, without control characters; a terminal has long ones in several, but for code to paste."""
    for line in lines:
        whole = not sys.stdout.isatty() or line.startswith(("    ", THEN_RUN))
        click.echo(printable(line) if whole else "\n".join(fit(line, line_width())))


def line_width() -> int:
    """The columns of the terminal, or `PIPE_WIDTH` in a pipe or a file."""
    return shutil.get_terminal_size((PIPE_WIDTH, 25)).columns if sys.stdout.isatty() else PIPE_WIDTH


def fit(text: str, width: int, most: int | None = None) -> list[str]:
    """The text in lines of this width, up to `most` of them: then the end is left out."""
    wrapper = textwrap.TextWrapper(width, subsequent_indent="  ", break_on_hyphens=False, placeholder=" ...")
    wrapper.max_lines = most
    return wrapper.wrap(printable(text)) or [""]


def table_lines(columns: Mapping[str, Sequence[str]], width: int | None) -> Iterator[str]:
    """The columns side by side, numbers to the right; cells may be coloured. The last column is cut at the `width`."""
    from rich.cells import cell_len, set_cell_size

    rows = [[*columns], *zip(*columns.values(), strict=True)]
    sizes = [max(cell_len(click.unstyle(cell)) for cell in cells) for cells in zip(*rows, strict=True)]
    room = None if width is None else max(width - sum(sizes[:-1]) - 2 * (len(sizes) - 1), len("..."))
    is_number = [title != "id" and all(map(NUMBER.fullmatch, cells)) for title, cells in columns.items()]
    for *cells, last in rows:
        row, end = [], last
        if room is not None and cell_len(last) > room:
            end = f"{set_cell_size(last, room - len('...')).rstrip()}..."
        for cell, size, right in zip((*cells, end), sizes, is_number, strict=True):
            gap = " " * (size - cell_len(click.unstyle(cell)))
            row.append(gap + cell if right else cell + gap)
        yield "  ".join(row).rstrip()
