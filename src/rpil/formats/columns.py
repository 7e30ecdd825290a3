"""Options that decide how a file is read, the columns that are read, and guesses at two of them by values and words."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Literal

import numpy as np
import pyarrow as pa

from rpil.data.arrays import ActionKind, Id, are_whole
from rpil.data.errors import DataError, DataWarning
from rpil.data.id_values import is_id_file
from rpil.data.memory import Size, parse_size
from rpil.data.names import OPERATOR, is_observation, is_order, plain_name
from rpil.data.recorded_facts import FILE_SESSION
from rpil.formats.table import encoded

Names = str | Sequence[str]
"""Names of columns, or patterns such as ``joint_*``; several may stand in one text, with commas between them."""

Ids = Id | Sequence[Id]
"""Ids of demonstrations; in a text there may be ranges such as ``0-16``, and several with commas between them."""

STRETCH = "pauses"
"""The column of the demonstrations that end at pauses, where no other column tells them apart."""

LENGTH = "length"
"""The word that a user names in the place of a column: the number of steps of each demonstration."""

TIME_OF_STEP = "time or number of the step"  # why a column is no observation
_MOST_COLUMNS = 50_000  # Arrow ends the process where there is no memory for its columns


GUESSED_ROWS = 20_000
"""The first rows, by which the column of the demonstration is guessed."""

_SHORTEST = 3
"""Steps of a demonstration, on average and at least."""

_CONTROL = re.compile(
    r"(?:.*_)?(?:(?P<pedal>gas|brak(?:e|ing)|accel(?:eration)?|pedal)|steer(?:ing)?|throttle|torque|thrust|force|rudder"
    r"|aileron|motor|gripper|joystick|command|cmd|control|ctrl|button|key|bolus)s?(?:_.*|\d+)?"
    r"|(?:.*_)?stick(?:_.*|[a-z]?\d*)|user_angle"
)

_OF_MANY = re.compile(r"(?:operator|demonstrator|teleoperator|annotator|worker)s?(?:_.*)?")
"""Names of people who give many demonstrations each, as a participant or a driver need not."""

OF_PART = re.compile(r"(?:lap|round|attempt|take|rep|repetition|leg|heat|stint)s?(?:_(?:index|ids?|no|num|number|nr))?")
"""Names of the parts of what a driver did, each of which may be a demonstration."""


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
        Whether demonstrations with missing values are set aside, and damaged lines and files skipped; or these alone.
    guess : bool
        Whether the id and the action may be guessed from values where no name says them.
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
    guess: bool = False
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
        for option, seconds in (("split_gap", self.split_gap), ("segment", self.segment)):
            if seconds is not None and not 0 < seconds < float("inf"):
                raise DataError(f"<option> is {seconds}; give a number of seconds, more than 0.", option)


def check_options(given: Iterable[str]) -> None:
    """A `TypeError` that names the option that was meant, where one of the `given` names is that of none."""
    known = [one.name for one in fields(ColumnOptions) if one.name not in ("allow_missing", "on_disk", "guess")]
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
    may_be_outcomes: tuple[str, ...] = field(default=(), compare=False)  # which the user may name as outcomes
    # Of columns of which not all are read:
    chosen_parts: Mapping[str, Names] = field(default_factory=dict, compare=False)
    excluded_parts: Mapping[str, bool] = field(default_factory=dict, compare=False)  # pattern -> also names columns
    source: str = field(default="", compare=False)  # in messages
    id_chosen: bool = False  # by the user, or by a guess, and not by its name
    guessed: Mapping[str, str] = field(default_factory=dict, compare=False)  # option -> columns
    made: tuple[str, ...] = ()  # columns that are not in the rows of the file yet
    id_written: bool = False  # ids are text, of which whole numbers are numbers
    intervention: str | None = None  # a flag of the steps in which a person had taken over

    def without_observations(self, reasons: Mapping[str, str]) -> Columns:
        """The same, where some columns are no observations for the `reasons`, of which a time may give the order."""
        ignored, clocks = {**self.ignored, **reasons}, (m for m, why in reasons.items() if why == TIME_OF_STEP)
        left = tuple(m for m in self.observations if m not in reasons)
        return replace(self, observations=left, ignored=ignored, times=(*self.times, *clocks))

    @property
    def guess(self) -> DataWarning:
        """Warning that says what was guessed, and how to change it."""
        roles = {"id": "demonstrations by", "action": "action"}
        said = ", ".join(f"{roles[role]} {names.replace(',', ', ')}" for role, names in self.guessed.items())
        ways = " and ".join("<option>" for _ in self.guessed)
        return DataWarning(f"Guess: {said}; to change it, give {ways}.", tuple(self.guessed))

    @property
    def data(self) -> list[str]:
        """The columns that hold the demonstrations themselves."""
        return self._there(self.episode, *self.actions, *self.observations)

    @property
    def facts(self) -> list[str]:
        """The columns of the session and of the outcomes."""
        outcomes = (name.removeprefix("-") for name in self.outcomes)
        session = [self.session] if self.session not in (None, FILE_SESSION) else []
        return list(dict.fromkeys([*session, *(name for name in outcomes if name != LENGTH)]))

    @property
    def all(self) -> list[str]:
        """All columns to read."""
        ones = self.operator, self.task, self.intervention
        named = [*(name for name in ones if name is not None), *self.facts]
        return self._there(*self.data, *self.orders, *self.index, *self.parts, *self.times, *named)

    def _there(self, *names: str) -> list[str]:
        """Different names, without those of columns that are not there yet."""
        return [name for name in dict.fromkeys(names) if name not in self.made]


def check_names(names: Sequence[str], source: str) -> None:
    """A `DataError` where two columns have one name, or there are too many of them."""
    if len(names) > _MOST_COLUMNS:
        raise DataError(f"{source}: it has {len(names):,} columns; write {_MOST_COLUMNS:,} at most.")
    repeated = sorted(name for name, n in Counter(names).items() if n > 1)
    if repeated:
        raise DataError(f"{source}: column {repeated[0]!r} appears twice; rename or drop one of them.")


def as_list(names: Names) -> list[str]:
    """Names as the user gave them: one text, which may hold several with commas between them, or a sequence."""
    texts = [names] if isinstance(names, str) else names
    return [name.strip() for text in texts for name in text.split(",")]


def guess_id(head: pa.Table | None, names: Iterable[str]) -> str | None:
    """The column of the demonstration by the first rows, if any: its values come in runs, and none of them comes again.

    Of several such columns it is the one with most values. A time is none, whatever its values, nor is an operator.
    """
    found, most = None, 1
    for name, column in _there(head, names).items():
        column = column.slice(0, GUESSED_ROWS)
        has_parts = pa.types.is_floating(column.type) and not are_whole(column.to_numpy())
        if column.null_count or pa.types.is_boolean(column.type) or has_parts:
            continue
        if not (is_order(name) or _OF_MANY.fullmatch(plain_name(name))):
            codes = encoded(column)[1]
            n_values, n_runs = len(np.unique(codes)), 1 + int(np.count_nonzero(np.diff(codes)))
            if most < n_values == n_runs <= len(column) / _SHORTEST:
                found, most = name, n_values
    return found


def guess_actions(numbers: Iterable[str], texts: Iterable[str] = (), head: pa.Table | None = None) -> list[str]:
    """The columns of numbers that are called as what people steer with, such as a wheel or a gripper, but for pedals
    alone; else a choice or order, of numbers or `texts`, which does not count the rows of the `head`."""
    own = [name for name in numbers if "," not in name and not is_observation(name)]
    if controls := {name: found for name in own if (found := _CONTROL.fullmatch(plain_name(name)))}:
        return [] if all(found["pedal"] for found in controls.values()) else [*controls]  # a wheel of another name
    decisions = [name for name in (*own, *texts) if plain_name(name).rstrip("s") in ("choice", "order")]
    decided = {name: column.to_numpy() for name, column in _there(head, decisions).items()}
    counts = {m for m, x in decided.items() if x.dtype.kind in "iuf" and np.sum(np.diff(x) == 1) > len(x) / 2}
    return [name for name in decided if name not in counts][:1]  # it counts rows where most numbers are one more


def one_id(head: pa.Table | None, names: Iterable[str]) -> str:
    """The first column that may be an id and has one value in all the first rows, in words; else nothing."""
    for name, column in _there(head, names).items():
        is_id = re.fullmatch(rf"(?:.*_)?(?:id|name|no|number)|{OPERATOR.pattern}", plain_name(name))
        if is_id and len(values := column.unique().to_pylist()) == 1:
            return f" ({name!r} is {values[0]!r:.40} in every row: one demonstration)"
    return ""


def _there(head: pa.Table | None, names: Iterable[str]) -> dict[str, pa.ChunkedArray]:
    """Columns that are in the first rows."""
    return {name: head[name] for name in names if head is not None and name in head.column_names}
