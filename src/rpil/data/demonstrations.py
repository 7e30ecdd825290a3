"""`Demonstrations`: episodes in memory, checked once when they are made and never changed afterwards."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rpil.data import arrays
from rpil.data.arrays import ActionKind, Id, Indices
from rpil.data.episodes import lay_end_to_end
from rpil.data.errors import DataError
from rpil.data.text import counted
from rpil.numerics.types import Array

SOURCE = "the demonstrations"
"""Name of data without a file, in messages."""

BLOCK_STEPS = 65_536
"""Steps of a block, at most, unless a single demonstration is longer."""


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive whole demonstrations that are processed together; their values were checked before."""

    first: int  # number of its first demonstration
    observations: Array
    actions: Array
    offsets: NDArray[np.int64]  # from 0

    def __sizeof__(self) -> int:
        """Bytes, which Dask asks for."""
        return self.observations.nbytes + self.actions.nbytes

    @property
    def demonstrations(self) -> slice:
        """Numbers of its demonstrations."""
        return slice(self.first, self.first + len(self.offsets) - 1)

    def part(self, first: int, end: int) -> Block:
        """Its demonstrations ``first:end``, without copying."""
        steps, offsets = slice(self.offsets[first], self.offsets[end]), self.offsets[first : end + 1]
        return Block(self.first + first, self.observations[steps], self.actions[steps], offsets - offsets[0])


def shard_bounds(offsets: NDArray[np.int64], n_shards: int, block_steps: int) -> list[list[int]]:
    """For each of `n_shards` shards, or fewer: numbers of the first demonstration of each block, and of the one after.

    Shards have about as many blocks as one another, blocks about `block_steps` steps. The blocks do not
    depend on the number of shards.
    """
    ends = np.searchsorted(offsets, np.arange(block_steps, offsets[-1] + block_steps, block_steps))
    firsts = np.unique(np.clip(np.append(0, ends), 0, len(offsets) - 1)).tolist()
    bounds = np.linspace(0, len(firsts) - 1, min(n_shards, len(firsts) - 1) + 1).astype(int).tolist()
    return [firsts[a : b + 1] for a, b in itertools.pairwise(bounds)]


class EndToEnd:
    """Demonstrations that lie end to end: number m has the steps ``offsets[m]:offsets[m + 1]``."""

    offsets: NDArray[np.int64]

    @property
    def n_demonstrations(self) -> int:
        """M."""
        return len(self.offsets) - 1

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Steps per demonstration, (M,)."""
        return np.diff(self.offsets)


class DemonstrationSet(EndToEnd):
    """Common parts of demonstrations in memory and on disk: ids, counts and the range of the actions.

    `classes` (K,) are the distinct discrete actions, in order; `low` and `high` (A,) the smallest and largest
    continuous ones.
    """

    ids: tuple[Id, ...]
    source: str
    observation_names: tuple[str, ...]
    classes: Array
    low: Array
    high: Array

    @property
    def is_discrete(self) -> bool:
        """Whether actions are integers or strings, rather than A floats."""
        return bool(len(self.classes))

    @property
    def n_steps(self) -> int:
        """N."""
        return int(self.offsets[-1])

    @property
    def n_observations(self) -> int:
        """D, the numbers per observation."""
        return len(self.observation_names)

    def __len__(self) -> int:
        return self.n_demonstrations

    def __repr__(self) -> str:
        sizes = {"demonstration": self.n_demonstrations, "step": self.n_steps, "observation": self.n_observations}
        shown = ", ".join(counted(n, noun) for noun, n in sizes.items())
        kind = "discrete" if self.is_discrete else "continuous"
        return f"<{type(self).__name__} from {self.source}: {shown}, {kind} actions>"


@dataclass(frozen=True, eq=False, repr=False)
class Demonstrations(DemonstrationSet):
    """Demonstrations laid end to end: one row per step, demonstration m owning rows ``offsets[m]:offsets[m + 1]``.

    Arrays are not copied where they already have the right type; the ones kept here are read-only.

    Parameters
    ----------
    observations : (N, D) array of numbers
        Kept as float32 when given so, float64 otherwise; finite.
    actions : (N,) array of integers or strings, or (N, A) array of floats
        Two-dimensional floats are continuous, text is discrete. One-dimensional numbers are discrete (whole floats
        become integers) or continuous, (N, 1), by `rpil.data.arrays.action_kind`.
    offsets : (M + 1,) array of integers
        From 0 to N, strictly increasing.
    ids : sequence of M distinct ints, or of M distinct strings
        ``0..M-1`` when not given.
    observation_names : sequence of D distinct strings
        ``"0".."D-1"`` when not given.
    source : str
        The file name, or another name for the data, for use in messages.
    action_kind : {"auto", "discrete", "continuous"}
        Whether one-dimensional numbers are classes; as an attribute, the kind found.
    action_names : sequence of A strings
        Names of the parts of continuous actions, for messages; may be empty.
    allows_missing : bool
        Whether observations and continuous actions may be NaN or infinite; no fit takes such values.

    Raises
    ------
    DataError
        One sentence that names the source, the demonstration if the fault is in one, and the remedy.
    """

    observations: Array
    actions: Array
    offsets: NDArray[np.int64]
    ids: tuple[Id, ...] = ()
    observation_names: tuple[str, ...] = ()
    source: str = SOURCE
    action_kind: ActionKind = "auto"
    action_names: tuple[str, ...] = ()
    allows_missing: bool = False

    def __post_init__(self) -> None:
        source = self.source
        arrays.check_any(np.size(self.offsets) - 1, source)
        observations = arrays.as_observations(self.observations, source)
        actions = arrays.as_actions(self.actions, source, self.action_kind)
        if len(observations) != len(actions):
            counts = f"{len(observations)} observations but {len(actions)} actions"
            raise DataError(f"{source}: {counts}; give one action per observation.")
        ids = arrays.as_ids(() if self.ids is None else self.ids, source) or tuple(range(np.size(self.offsets) - 1))
        offsets = arrays.as_offsets(self.offsets, ids, len(observations), source)
        width = observations.shape[1]
        names = arrays.as_names(self.observation_names, source) or tuple(str(d) for d in range(width))
        if len(names) != width or len(set(names)) != width:
            raise DataError(f"{source}: name each of the {width} observation columns, and no two alike.")
        if not self.allows_missing:
            arrays.check_finite(observations, tuple(f"observation {name!r}" for name in names), offsets, ids, source)
        if actions.ndim == 2 and not self.allows_missing:
            arrays.check_finite(actions, tuple(f"action {a}" for a in range(actions.shape[1])), offsets, ids, source)
        for field, array in (("observations", observations), ("actions", actions), ("offsets", offsets)):
            view = array.view()  # the caller's own array stays writable
            view.flags.writeable = False
            object.__setattr__(self, field, view)
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "observation_names", names)
        if len(self.action_names) not in (0, actions[:1].size):
            raise DataError(f"{source}: name each of the {actions[:1].size} parts of the action, or none.")
        object.__setattr__(self, "action_kind", "discrete" if actions.ndim == 1 else "continuous")

    @classmethod
    def from_episodes(
        cls,
        episodes: Iterable[object],
        ids: Iterable[object] | None = None,
        *,
        observation_names: Iterable[object] = (),
        source: str = SOURCE,
        action_kind: ActionKind = "auto",
    ) -> Demonstrations:
        """Take episodes as Gymnasium, Minari and imitation give them.

        Parameters
        ----------
        episodes : iterable
            Each is a pair ``(observations, actions)``; or a dict, or an object, with ``observations`` or ``obs`` and
            ``actions`` or ``acts``. An observation after the last action is dropped. Dicts of observations become
            columns with names such as ``qpos.0``.

        Raises
        ------
        DataError
            As the class; also where an episode is none of these, or has other columns than the first.
        """
        observations, actions, offsets, names, named = lay_end_to_end(episodes, ids, source)
        observation_names = arrays.as_names(observation_names, source) or named
        return cls(observations, actions, offsets, names, observation_names, source, action_kind)

    @classmethod
    def from_groups(
        cls,
        X: ArrayLike,
        y: ArrayLike,
        groups: ArrayLike,
        *,
        observation_names: Iterable[object] = (),
        source: str = SOURCE,
        action_kind: ActionKind = "auto",
    ) -> Demonstrations:
        """Take scikit-learn's ``X, y, groups``: the rows of a group keep their order and need not be adjacent.

        The ids are the values of `groups`, in order of first appearance.
        """
        X, y = arrays.as_array(X, "observations", source), arrays.as_array(y, "actions", source)
        labels = arrays.as_array(groups, "groups", source)
        if labels.ndim != 1 or not (X.shape[:1] == y.shape[:1] == labels.shape):
            raise DataError(
                f"{source}: observations {X.shape}, actions {y.shape} and demonstration ids {labels.shape} do not fit "
                "together; give each one row per step."
            )
        if labels.dtype.kind == "f":
            if not arrays.are_whole(labels):
                raise DataError(f"{source}: demonstration ids must be whole numbers or text; fill in the missing ones.")
            labels = labels.astype(np.int64)
        values, group = np.unique(labels, return_inverse=True)
        chosen, offsets, rows = arrays.group_rows(group)
        if rows is not None:
            X, y = X[rows], y[rows]
        names = arrays.as_names(observation_names, source)
        return cls(X, y, offsets, tuple(values[chosen].tolist()), names, source, action_kind)

    @property
    def n_actions(self) -> int:
        """A, the numbers per action; 0 where actions are discrete."""
        return int(self.actions.shape[1]) if self.actions.ndim == 2 else 0

    @property
    def groups(self) -> NDArray[np.int64]:
        """Index, 0..M-1, of the demonstration of each step, (N,)."""
        return np.repeat(np.arange(self.n_demonstrations), self.lengths)

    @property
    def is_discrete(self) -> bool:
        """Whether actions are (N,) integers or strings, rather than (N, A) floats."""
        return self.actions.ndim == 1

    @cached_property
    def classes(self) -> Array:  # type: ignore[override]
        """The distinct discrete actions, in order, (K,); empty where actions are continuous."""
        return np.unique(self.actions) if self.is_discrete else np.empty(0)

    @cached_property
    def low(self) -> Array:  # type: ignore[override]
        """The smallest of each number of continuous actions, (A,)."""
        return np.atleast_1d(self.actions.min(axis=0))

    @cached_property
    def high(self) -> Array:  # type: ignore[override]
        """The largest of each number of continuous actions, (A,)."""
        return np.atleast_1d(self.actions.max(axis=0))

    def select(self, indices: Indices) -> Demonstrations:
        """The demonstrations at `indices` (integers, a slice or a mask over the M), in that order."""
        chosen = np.atleast_1d(np.arange(self.n_demonstrations)[indices])
        rows = np.concatenate([np.arange(0), *(np.arange(self.offsets[m], self.offsets[m + 1]) for m in chosen)])
        return replace(
            self,
            observations=self.observations[rows],
            actions=self.actions[rows],
            offsets=np.concatenate([[0], np.cumsum(self.lengths[chosen])]),
            ids=tuple(self.ids[m] for m in chosen),
        )

    def shards(self, n_shards: int = 1, block_steps: int = BLOCK_STEPS) -> list[list[Block]]:
        """All demonstrations in order, without copying: shards, each a list of blocks; see `shard_bounds`."""
        whole = Block(0, self.observations, self.actions, self.offsets)
        bounds = shard_bounds(self.offsets, n_shards, block_steps)
        return [list(itertools.starmap(whole.part, itertools.pairwise(of_shard))) for of_shard in bounds]

    def __iter__(self) -> Iterator[tuple[Array, Array]]:
        return (self[m] for m in range(self.n_demonstrations))

    def __getitem__(self, index: int) -> tuple[Array, Array]:
        """``(observations (T, D), actions (T,) or (T, A))`` at a position, as views; see `select` for several."""
        if not isinstance(index, int | np.integer):
            raise DataError(f"{self.source}: [{index!r}] takes one position; use select for several.")
        m = range(self.n_demonstrations)[index]
        steps = slice(self.offsets[m], self.offsets[m + 1])
        return self.observations[steps], self.actions[steps]
