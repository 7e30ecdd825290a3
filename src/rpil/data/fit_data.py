"""The data of one fit, and the demonstrators: who gave which demonstration, be it a person, a robot or a program."""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rpil.data.arrays import check_name
from rpil.data.demonstrations import DemonstrationSet
from rpil.data.errors import DataError
from rpil.data.id_values import check_ids
from rpil.data.spaces import Space
from rpil.numerics.types import Array


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
            return "With answers, log-odds include evidence from the other demonstrations of the same demonstrator."
        if not self.names:
            return ""
        if len(self.names) < len(self.index):
            return f"One demonstrator, {self.names[0]!r}, gave all demonstrations, so demonstrators are not used."
        return "No demonstrator gave two demonstrations, so demonstrators are not used."

    def select(self, demonstrations: Array) -> Demonstrators:
        """The demonstrators of the demonstrations with these numbers."""
        return Demonstrators.from_names([self.names[u] for u in self.index[demonstrations]]) if self.names else self

    @cached_property
    def indicator(self) -> Array:
        """1 where demonstrator u gave demonstration m, else 0, (U, M)."""
        return np.asarray(np.arange(len(self.names))[:, None] == self.index, dtype=float)

    @property
    def counts(self) -> Array:
        """Number of demonstrations of each demonstrator, (U,)."""
        return np.bincount(self.index, minlength=len(self.names))


DemonstratorNames = Mapping[Any, Hashable] | Sequence[Hashable] | Array
"""Demonstrators as a caller gives them: by id of the demonstration, or one for each demonstration in order."""


def names_by_id(
    demonstrators: DemonstratorNames | None, ids: Sequence[object], source: str, known: Sequence[object] = ()
) -> dict[str, Hashable]:
    """The demonstrators of the demonstrations `ids`, by the id as text; a mapping may name others that are `known`.

    A `DataError` on unknown ids, or a wrong number of demonstrators.
    """
    if isinstance(demonstrators, Mapping):
        check_ids(demonstrators, known or ids, source, "the demonstrators")
        names = {str(m): name for m, name in demonstrators.items()}
        return {m: names[m] for m in map(str, ids) if m in names}
    given = np.asarray([] if demonstrators is None else demonstrators)
    if demonstrators is not None and given.shape != (len(ids),):
        wrong = f"demonstrators has the shape {given.shape}"
        raise DataError(f"{source}: {wrong}; give one for each of the {len(ids)} demonstrations, in their order.")
    return dict(zip(map(str, ids), given.tolist(), strict=False))


def group_by_demonstrator(demonstrators: DemonstratorNames | None, demonstrations: DemonstrationSet) -> Demonstrators:
    """The groups of demonstrations that have one demonstrator; see `names_by_id`.

    Warns where they carry no information; a `DataError` where a name is neither text nor a number.
    """
    source, ids = demonstrations.source, demonstrations.ids
    if demonstrators is None:
        return Demonstrators()
    by_id = names_by_id(demonstrators, ids, source)
    names = [by_id.get(str(m)) for m in ids]
    for m, name in zip(ids, names, strict=True):
        place = f"{source}, demonstration {m!r}"
        if not isinstance(name, Hashable):
            raise DataError(f"{place}: the demonstrator {name!r} is no name; give text or a number.")
        if isinstance(name, str):
            check_name(name, "the demonstrator", place)
    groups = Demonstrators.from_names(names)
    if not groups.informative:
        warnings.warn(f"{source}: {groups.note}", UserWarning, stacklevel=2)
    return groups


@dataclass(frozen=True, eq=False)
class FitData:
    """The data of one fit."""

    features: Array  # (N, D): design matrix, constant in the last column
    actions: Array  # (N,): codes 0..K-1 of discrete actions; or (N, A): numbers
    offsets: Array  # (M + 1,): demonstration m owns the steps ``offsets[m]:offsets[m + 1]``
    space: Space  # of the actions
    labels: Array = field(default_factory=lambda: np.array([], dtype=int))
    """(M,): 1 expert, -1 adversary, 0 not labelled, the default; read by the mixture alone: the judge has answers."""
    demonstrators: Demonstrators = field(default_factory=Demonstrators)
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

    @property
    def n_demonstrations(self) -> int:
        """M."""
        return len(self.offsets) - 1

    def action_name(self, k: int) -> str:
        """The name of part k of continuous actions, or of discrete action k; its number where it has none."""
        return self.action_names[k] if self.action_names else str(k)

    @property
    def lengths(self) -> Array:
        """Steps per demonstration, (M,)."""
        return np.diff(self.offsets)

    def sum_steps(self, values: Array) -> Array:
        """Sums over the steps of each demonstration, (N, ...) -> (M, ...)."""
        return np.add.reduceat(values, self.offsets[:-1], axis=0)

    def mean_steps(self, values: Array) -> Array:
        """Means over the steps of each demonstration, (N,) -> (M,)."""
        means: Array = self.sum_steps(values) / self.lengths
        return means

    def per_step(self, values: Array) -> Array:
        """The value of each demonstration repeated for each of its steps, (M, ...) -> (N, ...)."""
        return np.repeat(values, self.lengths, axis=0)

    def select(self, demonstrations: Array) -> FitData:
        """The data of the demonstrations with these numbers, without demonstrators."""
        steps = np.concatenate([np.arange(self.offsets[m], self.offsets[m + 1]) for m in demonstrations])
        offsets = np.concatenate([[0], np.cumsum(self.lengths[demonstrations])])
        return replace(
            self,
            features=self.features[steps],
            actions=self.actions[steps],
            offsets=offsets,
            labels=self.labels[demonstrations],
            demonstrators=Demonstrators(),
        )
