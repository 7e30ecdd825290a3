"""Options that decide how a file is read, and the columns that are read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from typing import Literal

from rpil.data.arrays import ActionKind, Id
from rpil.data.errors import DataError
from rpil.data.fit_data import FILE_SESSION
from rpil.data.id_values import is_id_file
from rpil.data.memory import Size, parse_size
from rpil.data.text import short_name

Names = str | Sequence[str]
"""Names of columns, or patterns such as ``joint_*``; several may stand in one text, with commas between them."""

Ids = Id | Sequence[Id]
"""Ids of demonstrations; in a text there may be ranges such as ``0-16``, and several with commas between them."""

STRETCH = "pauses in time"
"""The column of the demonstrations that end at pauses, where no other column tells them apart."""

FILE = "name of the file"
"""The column of the names of files, each of which is a demonstration where no other column tells them apart."""

LENGTH = "length"
"""The word that a user names in the place of a column: the number of steps of each demonstration."""

TIME_OF_STEP = "time or number of the step"  # why a column is no observation
_MOST_COLUMNS = 50_000  # Arrow ends the process where there is no memory for its columns


@dataclass(frozen=True)
class ColumnOptions:
    """Options of how a file is read: what the user says of its columns, of which the others are found by name.

    Most are the arguments of `rpil.read`; these are the others.

    Attributes
    ----------
    operator, task : str
        One column each: of who gave the demonstration (or a file), and of what was to be done.
    session : str
        The column of the session, or "file" for the file of each demonstration.
    outcome : str, or several
        The column, or file, that says how each ended, or "length", with a minus before it where more is worse.
    skip_bad : bool or "damage"
        Whether demonstrations with missing values are set aside, and damaged files or groups skipped; or these alone.
    allow_missing : bool
        Whether demonstrations may hold values that are missing or infinite, as for `rpil.check`; no fit is given them.
    on_disk : bool
        Whether the rows go to disk instead of into memory; `rpil.formats.read_recording` decides it.
    """

    id: str | None = None
    action: Names = ()
    observations: Names = ()
    exclude: Names = ()
    order: str | None = None
    operator: str | None = None
    task: str | None = None
    session: str | None = None
    outcome: Names = ()
    split_gap: float | None = None
    segment: float | None = None
    action_kind: ActionKind = "auto"
    only: Ids = ()
    without: Ids = ()
    skip_bad: bool | Literal["damage"] = False
    allow_missing: bool = False
    memory: Size | None = None
    on_disk: bool = False

    @property
    def files(self) -> list[str]:
        """The operator and the outcomes that are files, and no columns."""
        outcomes = (self.outcome,) if isinstance(self.outcome, str) else self.outcome
        return [path for path in dict.fromkeys((self.operator, *outcomes)) if path and is_id_file(path)]

    @property
    def outcomes(self) -> tuple[str, ...]:
        """The outcomes that are columns, with a minus where more is worse."""
        outcomes = (self.outcome,) if isinstance(self.outcome, str) else self.outcome
        return tuple(name for name in dict.fromkeys(outcomes) if name and not is_id_file(name))

    def __post_init__(self) -> None:
        if self.memory is not None:
            parse_size(self.memory)  # an error where it is none
        for option in ("id", "order", "operator", "task", "session"):
            if not isinstance(name := getattr(self, option), str | None):
                raise DataError(f"--{option} is {' '.join(repr(name).split()):.60}; give one name, as text.")
        for option, seconds in (("--split-gap", self.split_gap), ("--segment", self.segment)):
            if seconds is not None and not 0 < seconds < float("inf"):
                raise DataError(f"{option} is {seconds}; give a number of seconds, more than 0.")


def check_options(given: Iterable[str]) -> None:
    """A `TypeError` that names the option that was meant, where one of the `given` names is that of none."""
    known = [one.name for one in fields(ColumnOptions) if one.name not in ("allow_missing", "on_disk")]
    for name in sorted({*given} - {*known}):
        close = [f"; did you mean {one}?" for one in get_close_matches(name, [*known, "labels", "settings"], 1)]
        raise TypeError(f"there is no option {name!r}{''.join(close)}")


@dataclass(frozen=True)
class Columns:
    """Names of the columns that are read, and why the others are not."""

    episode: str  # id of the demonstration
    actions: tuple[str, ...]  # one column, or one for each number of a continuous action
    observations: tuple[str, ...]
    one_action: bool  # whether the action is one column, which may then be discrete
    orders: tuple[str, ...] = ()  # columns that may give the order of the steps, the likeliest first
    order: str | None = field(default=None, kw_only=True)  # the one of them that does
    order_words: str = field(default="", kw_only=True)
    index: tuple[str, ...] = ()  # numbers of rows that the file itself gives
    parts: tuple[str, ...] = ()  # columns that may name a demonstration only together with `episode`, as session does
    operator: str | None = None
    task: str | None = None
    ignored: Mapping[str, str] = field(default_factory=dict, compare=False)  # name -> reason
    options: ColumnOptions = field(default=ColumnOptions(), compare=False)
    times: tuple[str, ...] = ()  # timestamps that are neither data nor the order
    session: str | None = None  # or FILE_SESSION
    outcomes: tuple[str, ...] = ()  # and LENGTH; with a minus where more is worse
    lists: Mapping[str, Sequence[str]] = field(default_factory=dict, compare=False)  # columns of the numbers of a list
    id_written: bool = False  # ids are text, of which whole numbers are numbers
    intervention: str | None = None  # a flag of the steps in which a person had taken over

    @property
    def stored(self) -> list[str]:
        """The columns of the file that hold all columns to read."""
        owners = {part: name for name, parts in self.lists.items() for part in parts}
        return list(dict.fromkeys(owners.get(name, name) for name in self.all))

    @property
    def all(self) -> list[str]:
        """All columns to read, without the one that no file has."""
        data, ones = (self.episode, *self.actions, *self.observations), (self.operator, self.task, self.intervention)
        outcomes = (name.removeprefix("-") for name in self.outcomes)
        facts = *([self.session] * (self.session != FILE_SESSION)), *(name for name in outcomes if name != LENGTH)
        others = *self.orders, *self.index, *self.parts, *self.times, *ones, *facts
        return [name for name in dict.fromkeys((*data, *others)) if name not in (None, STRETCH)]


def by_column(reasons: Mapping[str, str], lists: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """The `reasons` of columns, by the name of a list where all of its numbers have the same one."""
    owners = {part: name for name, parts in lists.items() for part in parts}
    alike = {name for name, parts in lists.items() if len({reasons.get(part) for part in parts}) == 1}
    names = {part: owners[part] if owners[part] in alike else short_name(part) for part in owners}
    return {names.get(name, name): why for name, why in reasons.items()}


def check_names(names: Sequence[str], source: str) -> None:
    """A `DataError` where two columns have one name, or there are too many of them."""
    if len(names) > _MOST_COLUMNS:
        raise DataError(f"{source}: it has {len(names):,} columns; write {_MOST_COLUMNS:,} at most.")
    if repeated := sorted(name for name, n in Counter(names).items() if n > 1):
        raise DataError(f"{source}: column {repeated[0]!r} appears twice; rename or drop one of them.")


def as_list(names: Names) -> list[str]:
    """Names as the user gave them: one text, which may hold several with commas between them, or a sequence."""
    return [name.strip() for text in ([names] if isinstance(names, str) else names) for name in text.split(",")]
