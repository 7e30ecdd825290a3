"""The data of one fit; the demonstrators: who gave which demonstration, be it a person, a robot or a program; and facts
beside the steps: the order in which demonstrations were made, their sessions and outcomes."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from rpil.data.arrays import check_name
from rpil.data.demonstrations import DemonstrationSet, EndToEnd
from rpil.data.errors import DataError
from rpil.data.id_values import check_ids, read_id_pairs
from rpil.data.spaces import Space
from rpil.data.text import plain_name
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Demonstrators:
    """The demonstrator of each demonstration; without arguments: demonstrators were not given."""

    index: Array = field(default_factory=lambda: np.empty(0, dtype=int))  # (M,): demonstrator 0 .. U-1 of each
    names: tuple[Hashable, ...] = ()  # of the U demonstrators; None for an unknown one, who gave one demonstration

    @classmethod
    def from_names(cls, names: Sequence[Hashable]) -> Demonstrators:
        """From the name of each of M demonstrations' demonstrator; None is an unknown one, another each time."""
        keys = [(name, m if name is None else -1) for m, name in enumerate(names)]
        numbers = {key: u for u, key in enumerate(dict.fromkeys(keys))}
        return cls(np.array([numbers[key] for key in keys]), tuple(name for name, _ in numbers))

    @property
    def informative(self) -> bool:
        """Whether there are two demonstrators or more, one with two demonstrations or more: else they are not used."""
        return 1 < len(self.names) < len(self.index)

    @property
    def note(self) -> str:
        """How the demonstrators are used, or why they are not, in one sentence; empty where they were not given."""
        if self.informative:
            return "With answers, demonstrators are evidence as far as the answers bear it out."
        if not self.names:
            return ""
        if len(self.names) < len(self.index):
            return f"One demonstrator, {self.names[0]!r}, gave all demonstrations, so demonstrators are not used."
        return "No demonstrator gave two demonstrations, so demonstrators are not used."


DemonstratorNames = Mapping[Any, Hashable] | Sequence[Hashable] | Array
"""Demonstrators as a caller gives them: by id of the demonstration, or one for each demonstration in order."""


def in_order(
    given: DemonstratorNames | Outcome, ids: Sequence[object], source: str, what: str, every: Sequence[object] = ()
) -> list[Any]:
    """The values that are `given` of the demonstrations `ids`: one for each, or by id in a mapping or series of pandas,
    also of others of `every`; None where it names none. An index of 0, 1, ... is no ids unless `ids` are these numbers.
    A `DataError` on unknown ids, two values, or a wrong number."""
    keys = [*given.keys()] if isinstance(given, Mapping) or hasattr(given, "keys") else []
    if isinstance(given, Mapping) or (keys and ({*map(str, keys)} == {*map(str, ids)} or keys != [*range(len(ids))])):
        by_id = {str(m): value for m, value in cast(Mapping[Any, Any], given).items()}
        check_ids(by_id, every or ids, source, what)
        if len(by_id) < len(given):
            raise DataError(f"{source}: a demonstration has two values; correct {what}.")
        return [by_id.get(str(m)) for m in ids]
    values = np.asarray(given, dtype=object)
    if values.shape != (len(ids),):
        wrong = f"{what} cannot have the shape {values.shape}"
        raise DataError(f"{source}: {wrong}; give one for each of the {len(ids)} demonstrations, in their order.")
    return [value.item() if isinstance(value, np.generic) else value for value in values]


def group_by_demonstrator(demonstrators: DemonstratorNames | None, demonstrations: DemonstrationSet) -> Demonstrators:
    """The groups of demonstrations that have one demonstrator; see `in_order`.

    Warns where they carry no information; a `DataError` where a name is neither text nor a number.
    """
    if demonstrators is None:
        return Demonstrators()
    names = in_order(demonstrators, demonstrations.ids, demonstrations.source, "the demonstrators")
    for m, name in zip(demonstrations.ids, names, strict=True):
        place = f"{demonstrations.source}, demonstration {m!r}"
        if not isinstance(name, Hashable):
            raise DataError(f"{place}: the demonstrator {name!r} is no name; give text or a number.")
        if isinstance(name, str):
            check_name(name, "the demonstrator", place)
    groups = Demonstrators.from_names(names)
    if not groups.informative:
        warnings.warn(f"{demonstrations.source}: {groups.note}", UserWarning, stacklevel=2)
    return groups


@dataclass(frozen=True, eq=False)
class FitData(EndToEnd):
    """The data of one fit."""

    features: Array  # (N, D): design matrix, constant in the last column
    actions: Array  # (N,): codes 0..K-1 of discrete actions; or (N, A): numbers
    offsets: Array  # (M + 1,): demonstration m owns the steps ``offsets[m]:offsets[m + 1]``
    space: Space  # of the actions
    labels: Array = field(default_factory=lambda: np.array([], dtype=int))
    """(M,): 1 expert, -1 adversary, 0 not labelled, the default; read by the mixture alone: the judge has answers."""
    judged: Array | None = None  # bool: the parts of continuous actions that the judge sees; None for all
    action_names: tuple[str, ...] = ()  # of the parts of continuous actions, or of discrete actions; may be empty

    def __post_init__(self) -> None:
        if not len(self.labels):
            object.__setattr__(self, "labels", np.zeros(self.n_demonstrations, dtype=int))

    @classmethod
    def from_steps(cls, features: Array, actions: Array, space: Space) -> FitData:
        """Steps without demonstrations, as one unlabelled demonstration."""
        return cls(features, actions, np.array([0, len(actions)]), space)

    def __sizeof__(self) -> int:
        """Bytes, which Dask asks for."""
        return self.features.nbytes + self.actions.nbytes

    def sum_steps(self, values: Array) -> Array:
        """Sums over the steps of each demonstration, (N, ...) -> (M, ...)."""
        return np.add.reduceat(values, self.offsets[:-1], axis=0)

    def mean_steps(self, values: Array) -> Array:
        """Means over the steps of each demonstration, (N,) -> (M,)."""
        return np.asarray(self.sum_steps(values) / self.lengths)

    def per_step(self, values: Array) -> Array:
        """The value of each demonstration repeated for each of its steps, (M, ...) -> (N, ...)."""
        return np.repeat(values, self.lengths, axis=0)

    def select(self, demonstrations: Array) -> FitData:
        """The data of the demonstrations with these numbers."""
        steps = np.concatenate([np.arange(self.offsets[m], self.offsets[m + 1]) for m in demonstrations])
        return replace(
            self,
            features=self.features[steps],
            actions=self.actions[steps],
            offsets=np.concatenate([[0], np.cumsum(self.lengths[demonstrations])]),
            labels=self.labels[demonstrations],
        )


Outcome = Mapping[int, float] | Mapping[str, float] | Sequence[float] | Array
"""Values that a user gives: a number by id, or one for each demonstration."""

FILE_SESSION = "file"
"""The word that stands for the file of each demonstration in the place of a column of the session."""

_REWARD = re.compile(r"(?:next_)?rew(?:ard)?s?")


@dataclass(frozen=True, eq=False)
class Facts:
    """Facts about M demonstrations beside their steps; nothing of it is used unless it is asked for."""

    order: Float[Array, " M"] | None = None
    """The position of each demonstration in the order that the file states, if it states one."""
    sessions: tuple[str, ...] = ()
    """Session of each demonstration; empty where none is known."""
    outcomes: tuple[Float[Array, " M"], ...] = ()
    """How each demonstration ended, by one column or several, more is better; NaN where it is not known."""
    outcome_names: tuple[str, ...] = ()
    """The columns, as the user named them."""


def outcome_of_steps(values: Float[Array, " N"], offsets: Int[Array, " _"], column: str) -> Float[Array, " M"] | None:
    """One number for each demonstration, of a column with a value for each step: the sum of a reward, the value of a
    column that is constant within each, the last one of a flag, 0 or 1; else None. NaN is a missing value: one in a
    reward makes its sum unknown, others are left out."""
    if _REWARD.fullmatch(plain_name(column)):
        return np.add.reduceat(values, offsets[:-1])
    low, high = (extreme.reduceat(values, offsets[:-1]) for extreme in (np.fmin, np.fmax))
    if np.all((low == high) | np.isnan(low)):
        return np.asarray(low)
    if np.isin(values[~np.isnan(values)], (0, 1)).all():
        last = np.maximum.reduceat(np.where(np.isnan(values), -1, np.arange(len(values))), offsets[:-1])
        return np.where(last < 0, np.nan, values[last])
    return None


def check_outcome(outcome: Float[Array, " M"], name: str, source: str) -> Float[Array, " M"]:
    """The `outcome` called `name`; a `DataError` where it is infinite, known for none, or the same for all."""
    known = outcome[~np.isnan(outcome)]
    if not np.isfinite(known).all():
        raise DataError(f"{source}: {name} is infinite for some demonstrations; give numbers, or leave it out.")
    if len(np.unique(known)) < 2:
        known_of = "every demonstration that it is known of, which tells none from another"
        fault = f"{known[0]:g} for {known_of}" if len(known) else "known for no demonstration"
        raise DataError(f"{source}: {name} is {fault}; name another, or leave it out.")
    return outcome


def given_outcome(
    given: Outcome | str, ids: Sequence[Hashable], source: str, every: Sequence[Hashable] = ()
) -> Float[Array, " M"]:
    """The outcome that a user gives, as for `in_order`, or in a file (id,value); unknown for those left out. A
    `DataError` as of `in_order` and `check_outcome`, and where an id is twice in the file, or a value no number."""
    if isinstance(given, str):
        source, rows = Path(given).name, read_id_pairs(given, "value")
        words = {"true": 1.0, "false": 0.0, "": np.nan}
        found = cast(dict[str, float], {m: words.get(str(value).lower(), value) for m, value, *_ in rows})
        if len(found) < len(rows):
            [(twice, _)] = Counter(m for m, *_ in rows).most_common(1)
            raise DataError(f"{source}, demonstration {twice!r}: it has two outcomes; keep one.")
        return given_outcome(found, ids, source, every)
    values = np.empty(len(ids))
    for k, value in enumerate(in_order(given, ids, source, "--outcome", every)):
        try:
            values[k] = value  # as a text of a number, too; of None it is unknown
        except (TypeError, ValueError, OverflowError) as error:
            said = f"the outcome {value!r:.40} is no number; write one, such as 1 for a success and 0 for a failure"
            raise DataError(f"{source}, demonstration {ids[k]!r}: {said}.") from error
    return check_outcome(values, "the outcome", source)


def check_sessions(sessions: Sequence[str], name: str, source: str) -> None:
    """A `DataError` where the `sessions` of M demonstrations, of the column `name` or by "file", divide nothing."""
    n_sessions = len(set(sessions))
    if n_sessions == len(sessions) or (n_sessions == 1 and name == FILE_SESSION):
        each = "one session" if n_sessions == 1 else "a session of its own each"
        said = f"the demonstrations have {each} by {name!r}, which makes no sessions to judge within"
        raise DataError(f"{source}: {said}; name a column that several share with --session, or leave it out.")
