"""Sentences on damaged lines and files: an error, or what was skipped where a user asks for that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import TypeVar

from rpil.data.errors import DamagedError, DataError
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas

Found = TypeVar("Found")

_MOST_NAMED = 30  # in one line


def without_damaged(
    names: Iterable[str], read: Callable[[str], Found], options: ColumnOptions
) -> tuple[dict[str, Found], list[str]]:
    """What `read` makes of each file, and the names of the damaged ones, which the options skip.

    A `DataError` where they do not, or no file is left.
    """
    found: dict[str, Found] = {}
    damaged: dict[str, DataError] = {}
    for name in names:
        try:
            found[name] = read(name)
        except DamagedError as error:
            damaged[name] = error
            if not options.skips_damage:
                raise
    if damaged and not found:
        raise next(iter(damaged.values()))
    return found, [*damaged]


def damaged_lines(name: str, damaged: Sequence[str]) -> DataError:
    """The error on the first of the `damaged` lines of a file, each of which is a place and what is wrong there."""
    more = f", the first of {len(damaged):,} damaged lines" if len(damaged) > 1 else ""
    return DataError(f"{name}, {damaged[0]}{more}; write it again, or skip such lines with <option>.", "skip_bad")


def skipped_lines(name: str, lines: Sequence[int]) -> tuple[str, ...]:
    """The sentence on lines that were skipped; none where there are none."""
    are = "which is" if len(lines) == 1 else "which are"
    numbers = commas([f"{line:,}" for line in lines], _MOST_NAMED)
    return (f"Skipped: line{'s' * (len(lines) > 1)} {numbers} of {name}, {are} damaged.",) if lines else ()


def damaged_files(source: str, names: Sequence[str], lost: Sequence[int], left: Sequence[int]) -> DataError:
    """The error that files are damaged, with which the episodes `lost` are lost, and those `left` are not."""
    it = "them" if len(names) > 1 else "it"
    said = f"{commas(names, _MOST_NAMED)} cannot be read, as where a recording was cut off"
    said += f", and with {it} {_episodes(lost)}" if lost else ""
    others = _episodes(left) if left else "the others"
    return DataError(f"{source}: {said}; copy {it} again, or read and keep {others} with <option>.", "skip_bad")


def skipped_files(names: Sequence[str], lost: Sequence[int] = ()) -> tuple[str, ...]:
    """The sentence on files that were skipped, with the episodes in them; none where there are none."""
    of, are = f"{_episodes(lost)} of " if lost else "", "is" if len(names) == 1 else "are"
    return (f"Skipped: {of}{commas(names, _MOST_NAMED)}, which {are} damaged.",) if names else ()


def _episodes(numbers: Iterable[int]) -> str:
    """Numbers as --only takes them, as "episodes 0-16,22"."""
    runs = [[m for _, m in run] for _, run in groupby(enumerate(sorted(numbers)), lambda one: one[1] - one[0])]
    words = [f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs]
    return f"episode{'s' * (len(runs) > 1 or len(runs[0]) > 1)} {','.join(words)}"
