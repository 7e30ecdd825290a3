"""What a sample of the demonstrations tells about the columns of a recording: which measure something, and how they
usually move."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rpil.data.demonstrations import Block, Demonstrations
from rpil.faults import segments
from rpil.faults.missing_values import set_aside
from rpil.faults.settings import FaultSettings
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Bool, Float, Int


@dataclass(frozen=True, eq=False)
class MeasuredColumns:
    """The columns that the rules compare: C of them, observations before actions.

    Attributes
    ----------
    names : tuple of str
    number : (C,) int array
        Number of the column among all observations and then all actions.
    is_action : (C,) bool array
    scale : (C,) array
        Median of the changes that are not 0.
    spread : (C,) array
        Standard deviation, by the median distance from the median, which a few wrong demonstrations do not change.
    moving : (C,) array
        Share of the steps in motion in which the column changes.
    motion : float
        Median motion of the steps, see `motion_of`, of those that have any.
    """

    names: tuple[str, ...]
    number: Int[Array, " C"]
    is_action: Bool[Array, " C"]
    scale: Float[Array, " C"]
    spread: Float[Array, " C"]
    moving: Float[Array, " C"]
    motion: float = 1.0
    labels: tuple[str, ...] = ()
    """Of all columns, `column_labels`."""
    rotations: tuple[int, ...] = ()
    """The first of four observations that are a quaternion."""
    towards: Float[Array, "Q 4"] = field(default_factory=lambda: np.zeros((0, 4)))
    """Of each quaternion, a rotation whose sign the others take: q and -q are the same."""

    def of(self, block: Block) -> Float[Array, "C T"]:
        """Their values in a block."""
        n = block.observations.shape[1]
        own = block.observations.T[self.number[~self.is_action]]
        if self.is_action.any():
            own = np.concatenate([own, block.actions.T[self.number[self.is_action] - n]])
        own = np.ascontiguousarray(own, dtype=np.float64)
        for first, towards in zip(self.rotations, self.towards, strict=True):
            own[(self.number >= first) & (self.number < first + 4)] *= _signs(block, first, towards)
        return own

    def motion_of(self, size: Float[Array, "C T"]) -> Float[Array, " T"]:
        """Mean over the columns of the size of their change, relative to their usual one and at most 3."""
        moved = np.minimum(size / self.scale[:, None], 3.0)
        return np.asarray(moved.mean(axis=0)) if len(moved) else np.zeros(size.shape[1])


def column_labels(demonstrations: Demonstrations | Dataset) -> tuple[str, ...]:
    """What findings call the columns: all observations, then all actions, by their numbers where they have no names."""
    names = dict(enumerate(demonstrations.action_names))
    n_actions = 0 if demonstrations.is_discrete else demonstrations.n_actions
    actions = (f"action {names.get(a, a)!r}" for a in range(n_actions))
    return (*(f"observation {name!r}" for name in demonstrations.observation_names), *actions)


def pilot(
    demonstrations: Demonstrations | Dataset, labels: tuple[str, ...], settings: FaultSettings
) -> tuple[Block, Array]:
    """Demonstrations spread evenly over the data, of at most so many steps that the settings allow, and their numbers;
    those with missing values are left out, unless all have some."""
    size = min(len(demonstrations), settings.pilot_demonstrations)
    spread = np.unique(np.linspace(0, len(demonstrations) - 1, size).astype(int))
    share = settings.pilot_steps / max(int(demonstrations.lengths[spread].sum()), 1)
    if share < 1:
        spread = spread[:: int(np.ceil(1 / share))]
    sample = demonstrations.select(spread)
    block = Block(0, sample.observations, sample.actions, sample.offsets)
    kept, mask, _ = set_aside(block, sample.ids, labels)
    return (kept, spread[mask]) if mask.any() else (block, spread)


def describe_columns(sample: Block, labels: tuple[str, ...], settings: FaultSettings) -> MeasuredColumns:
    """The columns of the sample that measure something; `labels` are those of `column_labels`."""
    n_observations = sample.observations.shape[1]
    width = n_observations if n_observations <= settings.max_columns else 0
    everything = list(zip(labels, sample.observations.T[:width], strict=False))
    if sample.actions.ndim == 2:
        everything += zip(labels[n_observations:], sample.actions.T, strict=True)
    measured = [k for k, (_, x) in enumerate(everything) if _is_measurement(x, settings)]
    number = np.array([k if k < width else k - width + n_observations for k in measured], dtype=np.int64)
    chosen = tuple(everything[k][0] for k in measured)
    ones = np.ones(len(number))
    turns = _rotations(sample.observations[:, :width])
    towards = np.array([sample.observations[0, k : k + 4] for k in turns]).reshape(len(turns), 4)
    empty = MeasuredColumns(chosen, number, number >= n_observations, ones, ones, ones, 1.0, labels, turns, towards)
    if not chosen:
        return empty
    values = empty.of(sample)
    size = np.abs(segments.changes(values, sample.offsets))
    scale = np.array([_median_or_one(moved[moved > 0]) for moved in size])
    columns = replace(empty, scale=scale, spread=_spread(values))
    motion = columns.motion_of(size)
    usual = _median_or_one(motion[motion > 0])
    moves = motion > settings.idle_motion * usual
    return replace(columns, moving=(size > 0)[:, moves].mean(axis=1) if moves.any() else ones, motion=usual)


def _signs(block: Block, first: int, towards: Array) -> Float[Array, " T"]:
    """1 or -1 for each step: with it, a quaternion goes on from the step before, and begins near `towards`."""
    turned = block.observations[:, first : first + 4].astype(np.float64)
    before = np.roll(turned, 1, axis=0)
    before[block.offsets[:-1]] = towards
    same = np.where((turned * before).sum(axis=1) < 0, -1.0, 1.0)
    sign = np.cumprod(same)
    lengths = np.diff(block.offsets)
    return sign * np.repeat(sign[block.offsets[:-1]] * same[block.offsets[:-1]], lengths)


def _rotations(observations: Array) -> tuple[int, ...]:
    """The first of each four columns of length 1 that turn."""
    found: list[int] = []
    size = observations.astype(np.float64) ** 2
    for k in range(observations.shape[1] - 3):
        is_free = not found or k >= found[-1] + 4
        if is_free and np.allclose(size[:, k : k + 4].sum(axis=1), 1.0, atol=1e-3) and size[:, k : k + 4].std() > 0:
            found.append(k)
    return tuple(found)


def _spread(values: Float[Array, "C T"]) -> Float[Array, " C"]:
    off = np.median(np.abs(values - np.median(values, axis=1, keepdims=True)), axis=1)
    return np.asarray(np.where(off > 0, off / 0.6745, values.std(axis=1)))


def _median_or_one(values: Array) -> float:
    return float(np.median(values)) if len(values) else 1.0


def _is_measurement(column: Array, settings: FaultSettings) -> bool:
    """Whether a column has many values, which are not those of a byte: 0 to 255, or 0 to 1 in steps of 1 / 255."""
    low, high = float(column.min()), float(column.max())
    if len(np.unique(column)) < settings.min_distinct:
        return False
    is_byte = low >= 0 and high <= 255 and np.array_equal(column, np.rint(column))
    in_parts = column.astype(np.float64) * 255
    return not is_byte and not (low >= 0 and high <= 1 and np.allclose(in_parts, np.rint(in_parts), atol=1e-4))
