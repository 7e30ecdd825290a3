"""Damaged lines and files: an error, or skipped where a user asks for that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import TypeVar

from rpil.data.errors import DamagedError, DataError
from rpil.formats.description import commas

Found = TypeVar("Found")

_MOST_NAMED = 30  # in one line


def without_damaged(
    names: Iterable[str], read: Callable[[str], Found], skips: object = True
) -> tuple[dict[str, Found], list[str]]:
    """What `read` makes of each file, and the names of the damaged ones; an error where `skips` is false for them, or
    no file is left."""
    found: dict[str, Found] = {}
    damaged: dict[str, DataError] = {}
    for name in names:
        try:
            found[name] = read(name)
        except DamagedError as error:
            damaged[name] = error
            if not skips:
                raise
    if damaged and not found:
        raise next(iter(damaged.values()))
    return found, [*damaged]


def damaged_lines(name: str, damaged: Sequence[str]) -> DataError:
    """The error on the first of the `damaged` lines of a file, each of which is a place and what is wrong there."""
    more = f", the first of {len(damaged):,} damaged lines" if len(damaged) > 1 else ""
    return DataError(f"{name}, {damaged[0]}{more}; write it again, or skip such lines with <option>.", "skip_bad")


def parts_in_words(numbers: Iterable[int], what: str, names: Sequence[str]) -> str:
    """Numbers of lines or episodes of files, as "lines 2-7 and 9 of a.csv"; the files alone where there are none."""
    runs = [[m for _, m in run] for _, run in groupby(enumerate(sorted(numbers)), lambda one: one[1] - one[0])]
    words = commas([f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs], _MOST_NAMED)
    what = f"{what}s" if sum(map(len, runs)) > 1 else what
    return " of ".join([*([f"{what} {words}"] if runs else []), *([commas(names, _MOST_NAMED)] if names else [])])


def left_out_lines(skipped: Sequence[str], ids: Sequence[object] = ()) -> tuple[str, ...]:
    """Lines that name damaged parts, and demonstrations that were set aside; none where there are none."""
    damaged = [f"Skipped, because damaged: {', '.join(skipped)}."] if skipped else []
    named = commas(list(map(str, ids)), _MOST_NAMED)
    return (*damaged, *([f"Set aside: {named}, because a value is missing or infinite."] if ids else []))
