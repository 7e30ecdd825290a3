"""Summary of a recording: counts, columns and their roles; and words for what of it is damaged, and skipped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from typing import TypeVar

from rpil.data.errors import DamagedError, DataError
from rpil.data.text import counted, listed

SHORT_NAMES = 6  # in one line


@dataclass(frozen=True)
class Description:
    """What a recording holds: demonstrations, steps, and the part that each column plays.

    Attributes
    ----------
    format : str
        Format and version of the file, as "LeRobot v3.0" or "CSV, separated by ;".
    seconds, fps : float, optional
        Duration of all demonstrations, and steps a second.
    action_kind, action_reason : str
        "discrete" or "continuous", and why.
    order_column, order : str
        The column that orders the steps of a demonstration, if any, and what was done about the order, in words.
    operators, tasks : tuple of str
        Their names, the first ones.
    ignored : mapping of str to str
        Columns that are not read, and why.
    missing : mapping of str to int
        Values that are missing, by column.
    ranges : mapping of str to pair of float
        Smallest and largest value of each observation and continuous action.
    outcomes : mapping of str to str
        Columns that may say how each demonstration ended, and the option that has an audit use one.
    notes : tuple of str
        What else a user should know, in sentences.
    """

    source: str
    format: str
    demonstrations: int
    steps: int
    observations: tuple[str, ...]
    actions: tuple[str, ...]
    action_kind: str
    action_reason: str
    id_column: str
    order_column: str | None = None
    order: str = "steps in the order of the file"
    seconds: float | None = None
    fps: float | None = None
    operator_column: str | None = None
    operators: tuple[str, ...] = ()
    task_column: str | None = None
    tasks: tuple[str, ...] = ()
    ignored: Mapping[str, str] = field(default_factory=dict)
    missing: Mapping[str, int] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    outcomes: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, object]:
        """All of it, for JSON."""
        return asdict(self)

    def short(self) -> list[str]:
        """A few lines for the head of an audit."""
        observations = f"Observations: {len(self.observations):,}: {commas(self.observations)}."
        lines = [self._size(), self._actions(), observations, f"Demonstrations by {self.id_column}; {self.order}."]
        missing = [f"Missing values: {commas(f'{n:,} in {name}' for name, n in self.missing.items())}."]
        ignored = [f"Ignored: {commas(f'{name} ({reason})' for name, reason in self.ignored.items())}."]
        return [*lines, *(missing if self.missing else []), *(ignored if self.ignored else []), *self.notes]

    def lines(self) -> list[str]:
        """Everything, for ``rpil info``; a column a line."""
        lines = [self._size(), f"Demonstrations by {self.id_column}; {self.order}.", self._actions()]
        given = ("Task", self.task_column, self.tasks), ("Operator", self.operator_column, self.operators)
        for what, column, names in given:
            if column:  # a task is often a sentence, with its full stop
                lines.append(f"{what}, in {column}: {commas([name.removesuffix('.') for name in names])}.")
        lines += [*self.notes, "", f"Observations: {len(self.observations):,}"]
        lines += [f"  {name}{self._range(name)}" for name in self.observations]
        if self.action_kind != "discrete":
            lines += ["Actions:", *(f"  {name}{self._range(name)}" for name in self.actions)]
        others = self.ranges.keys() - {*self.observations, *self.actions}
        if others:
            lines += ["Ranges of whole columns:", *(f"  {name}{self._range(name)}" for name in sorted(others))]
        outcomes = {name: f"for rpil audit: {option}" for name, option in self.outcomes.items()}
        named = (("Ignored", self.ignored), ("Missing values", self.missing), ("May be an outcome", outcomes))
        for title, values in named:
            if values:
                lines += [f"{title}:", *(f"  {name or 'no name'}: {value}" for name, value in values.items())]
        return lines

    def _size(self) -> str:
        numbers = f"{counted(self.demonstrations, 'demonstration')}, {counted(self.steps, 'step')}"
        size = f"{self.source}: {self.format}; {numbers}"
        if self.seconds is not None:
            size += f", {self.seconds:,.1f} s"
        return f"{size} at {self.fps:.4g} a second." if self.fps else f"{size}."

    def _actions(self) -> str:
        return f"Action: {commas(self.actions)}; {self.action_kind}: {self.action_reason}."

    def _range(self, name: str) -> str:
        return f": {self.ranges[name][0]:.6g} to {self.ranges[name][1]:.6g}" if name in self.ranges else ""


def commas(names: Iterable[object], most: int = SHORT_NAMES) -> str:
    """Up to `most` of the names in one line, with commas between them, and how many more there are."""
    return listed(names, most, last=", ")


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
