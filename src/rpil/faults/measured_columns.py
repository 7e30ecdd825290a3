"""Facts about the columns of a recording, and sums over the steps of each demonstration of a block.

A sample of the demonstrations shows which columns measure something, and how they usually move.
Arrays are (C, T), one column of the recording in a row, so that a demonstration is contiguous. `offsets` (M + 1,) run
from 0 to T, and results are (M, C).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import repeat

import numpy as np

from rpil.data.demonstrations import Block, Demonstrations
from rpil.faults import settings
from rpil.formats.format import Dataset
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Bool, Float, Int, Shaped


@dataclass(frozen=True, eq=False)
class MeasuredColumns:
    """The columns that the rules compare: C of them, observations before actions."""

    names: tuple[str, ...]
    number: Int[Array, " C"]  # among all observations and then all actions
    is_action: Bool[Array, " C"]
    scale: Float[Array, " C"]  # median of the changes that are not 0
    spread: Float[Array, " C"]  # by the median distance from the median, which a few wrong demonstrations do not change
    moving: Float[Array, " C"]  # share of the steps in motion in which the column changes
    memory: Float[Array, " C"]  # rank correlation of the values of steps with those of the steps before
    noise: Float[Array, " C"] = field(default_factory=lambda: np.zeros(0))
    """Standard deviation of its noise at rest."""
    motion: float = 1.0  # median of the steps that have any, see `MovingBlock.motion`
    quaternions: Mapping[int, Float[Array, " 4"]] = field(default_factory=dict)
    """The first of four columns that are one, and a rotation whose sign the others take: q and -q are the same."""
    partner: Int[Array, " C"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    """The action that goes with an observation, or the observation with an action; -1 where none does."""

    def of(self, block: Block) -> Float[Array, "C T"]:
        """Their values in a block."""
        n, own = block.observations.shape[1], np.empty((len(self.number), len(block.observations)))
        own[~self.is_action] = block.observations.T[self.number[~self.is_action]]
        if self.is_action.any():
            own[self.is_action] = block.actions.T[self.number[self.is_action] - n]
        for first, towards in self.quaternions.items():
            own[(self.number >= first) & (self.number < first + 4)] *= _signs(block, first, towards)
        return own


@dataclass(frozen=True, eq=False)
class MovingBlock:
    """M demonstrations, and how their columns move."""

    block: Block
    numbers: Int[Array, " M"]  # of the demonstrations, among all
    offsets: Int[Array, " M1"]
    columns: MeasuredColumns
    values: Float[Array, "C T"]
    change: Float[Array, "C T"]  # from the step before
    size: Float[Array, "C T"]  # of the change
    low: Float[Array, "M C"]  # the smallest value
    high: Float[Array, "M C"]
    largest: Float[Array, "M C"]  # of the sizes
    motion: Float[Array, " T"]  # mean over the columns of the size of the change, in usual ones and at most 3
    of_states: Float[Array, " T"]  # the same, of the observations alone
    growth: Float[Array, " T"]  # mean logarithm of the size, in usual ones and 1 more
    moves: Bool[Array, " T"]  # whether a step is not idle
    turn: Float[Array, " C"]  # of an angle that wraps, 0 of others
    leaps: Int[Array, "M C"]  # by a turn

    @classmethod
    def of(cls, block: Block, numbers: Int[Array, " M"], columns: MeasuredColumns) -> MovingBlock:
        """The columns that are compared, of a block; angles that wrap go on beyond a turn."""
        values, offsets = columns.of(block), block.offsets
        begins, lengths, is_state = offsets[:-1], np.diff(offsets), ~columns.is_action
        change, turn = np.empty_like(values), np.zeros(len(values))
        np.subtract(values[:, 1:], values[:, :-1], out=change[:, 1:])
        change[:, begins] = 0.0
        size, leaps = np.abs(change), np.zeros((len(values), len(begins)), dtype=int)
        for c in np.flatnonzero(size.max(axis=1) >= settings.NEAR_TURN * min(settings.TURNS)).tolist():
            if turn_of := _turn(values[c], change[c], size[c]):
                turn[c], leap = turn_of, np.rint(change[c] / turn_of)
                leaps[c] = np.add.reduceat(leap != 0, begins)
                change[c] -= turn_of * leap
                size[c] = np.abs(change[c])
                turned = np.cumsum(leap)
                values[c] -= turn_of * (turned - np.repeat(turned[begins], lengths))
        low, high = (of.reduceat(values, begins, axis=1).T for of in (np.minimum, np.maximum))
        largest = np.maximum.reduceat(size, begins, axis=1).T
        relative, n = size / columns.scale[:, None], max(len(values), 1)
        # The mean of logarithms, which no single column makes large.
        growth = sum((np.log(own + 1.0) for own in relative), np.zeros(values.shape[1])) / n
        np.minimum(relative, 3.0, out=relative)
        of_states, motion = relative[is_state].sum(axis=0) / max(is_state.sum(), 1), relative.sum(axis=0) / n
        moves = motion > settings.IDLE_MOTION * columns.motion
        found = low, high, largest, motion, of_states, growth, moves, turn, leaps.T
        return cls(block, numbers, offsets, columns, values, change, size, *found)


def column_labels(demonstrations: Demonstrations | Dataset) -> tuple[str, ...]:
    """Names of the columns in findings, all observations, then all actions: their own, where these tell them apart."""
    states, named = demonstrations.observation_names, dict(enumerate(demonstrations.action_names))
    actions = [str(named.get(a, a)) for a in range(0 if demonstrations.is_discrete else demonstrations.n_actions)]
    vague = {*states} & {*actions}
    columns = [*zip(repeat("observation"), states, strict=False), *zip(repeat("action"), actions, strict=False)]
    return tuple(f"{kind} {name}" if name.isdigit() or name in vague else name for kind, name in columns)


def all_values(block: Block) -> Float[Array, "T K"]:
    """Observations, and actions that are numbers."""
    return np.column_stack([block.observations, block.actions] if block.actions.ndim == 2 else [block.observations])


def set_aside(block: Block) -> tuple[Block, Bool[Array, " M"]]:
    """The block without the demonstrations that have values that are NaN or infinite, and a mask of those it keeps."""
    numbers = [x for x in (block.observations, block.actions) if x.ndim == 2]
    with np.errstate(over="ignore", invalid="ignore"):  # of large numbers, and of infinity less infinity
        sums = [x.sum() for x in numbers]  # which takes a moment, and if they are finite, so is each number
    if np.isfinite(sums).all():
        return block, np.ones(len(block.offsets) - 1, dtype=bool)
    kept = np.logical_and.reduceat(np.isfinite(all_values(block)).all(axis=1), block.offsets[:-1])
    return _chosen(block, kept), kept


def _chosen(block: Block, kept: Bool[Array, " M"]) -> Block:
    """The block of these demonstrations alone."""
    if kept.all():
        return block
    lengths = np.diff(block.offsets)
    chosen, offsets = np.repeat(kept, lengths), np.append(0, np.cumsum(lengths[kept]))
    return Block(block.first, block.observations[chosen], block.actions[chosen], offsets)


def not_recorded(ranges: Float[Array, "M C"], zeros: Float[Array, "M C"]) -> Bool[Array, "M C"]:
    """Where columns, two or more, are 0 in every step, by their range and share of zeros: not nearly all demonstrations
    have such a column, most others move, and are not at 0 in most of their steps, as a brake is."""
    absent = zeros == 1
    n_others = np.maximum((~absent).sum(axis=0), 1)
    moving, resting = (np.where(absent, 0.0, x).sum(axis=0) / n_others for x in (ranges > 0, zeros))
    absent &= (moving > settings.MOST_ABSENT) & (resting <= settings.MOST_ABSENT)
    absent &= absent.mean(axis=0) <= settings.MOST_ZERO
    return np.asarray(absent & (absent.sum(axis=1) > 1)[:, None])


def pilot(demonstrations: Demonstrations | Dataset) -> tuple[Block, Array]:
    """Demonstrations spread evenly over the data, of at most so many steps that the settings allow, and their numbers;
    those with missing values are left out, unless all have some."""
    size = min(len(demonstrations), settings.PILOT_DEMONSTRATIONS)
    spread = np.unique(np.linspace(0, len(demonstrations) - 1, size).astype(int))
    share = settings.PILOT_STEPS / max(int(demonstrations.lengths[spread].sum()), 1)
    if share < 1:
        spread = spread[:: int(np.ceil(1 / share))]
    sample = demonstrations.select(spread)
    block = Block(0, sample.observations, sample.actions, sample.offsets)
    kept, mask = set_aside(block)
    return (kept, spread[mask]) if mask.any() else (block, spread)


def learn_columns(sample: Block, numbers: Int[Array, " M"], labels: tuple[str, ...]) -> MovingBlock:
    """The columns of the sample that measure something, and how they move; `labels` are those of `column_labels`.
    Demonstrations in which columns are not recorded are left out, unless these are most."""
    n_observations = sample.observations.shape[1]
    width = n_observations if n_observations <= settings.MOST_COLUMNS else 0
    everything = all_values(sample).T
    compared = (*range(width), *range(n_observations, len(everything)))
    number = np.array([k for k in compared if _is_measurement(everything[k])], dtype=np.int64)
    everything = everything[number]
    ends = (of.reduceat(everything, sample.offsets[:-1], axis=1) for of in (np.maximum, np.minimum))
    zeros = part_means(everything == 0, sample.offsets)[:, 0]
    recorded = np.asarray(~not_recorded(np.subtract(*ends).T, zeros).any(axis=1))
    if recorded.mean() >= settings.MOST_ABSENT:
        sample, numbers = _chosen(sample, recorded), numbers[recorded]
    names, ones = tuple(labels[k] for k in number), np.ones(len(number))
    turns = _quaternions(sample.observations[:, :width])
    if sample.actions.ndim == 2:
        turns |= {n_observations + k: towards for k, towards in _quaternions(sample.actions).items()}
    columns = MeasuredColumns(names, number, number >= n_observations, ones, ones, ones, ones, quaternions=turns)
    moving = MovingBlock.of(sample, numbers, columns)
    scale = np.array([np.median(moved[moved > 0]) if moved.any() else 1.0 for moved in moving.size])
    off = np.median(np.abs(moving.values - np.median(moving.values, axis=1, keepdims=True)), axis=1)
    spread = np.where(off > 0, off / 0.6745, moving.values.std(axis=1))
    columns = replace(columns, scale=scale, noise=_noise_at_rest(moving), spread=spread)
    moving = MovingBlock.of(sample, numbers, columns)
    motion = float(np.median(moving.motion[moving.motion > 0])) if moving.motion.any() else 1.0
    moves = moving.motion > settings.IDLE_MOTION * motion
    share = (moving.size > 0)[:, moves].mean(axis=1) if moves.any() else ones
    columns = replace(columns, motion=motion, moving=share, memory=_memory(moving))
    return replace(moving, columns=columns, moves=moves)


def _noise_at_rest(sample: MovingBlock) -> Float[Array, " C"]:
    """Standard deviation of the noise where it is least, by third differences, to which smooth motion adds little; at
    least that of the steps of an encoder."""
    third = np.diff(sample.values, n=3, axis=1)
    third = third[:, ~np.isin(np.arange(third.shape[1]), np.add.outer(sample.offsets[1:-1], [-3, -2, -1]))]
    least = np.where(sample.size > 0, sample.size, np.inf).min(axis=1) / np.sqrt(12)
    if third.shape[1] < (n := settings.NOISE_ROWS):
        return np.zeros(len(third))
    total = np.cumsum(np.pad(third**2, ((0, 0), (1, 0))), axis=1)
    quiet = np.quantile((total[:, n:] - total[:, :-n]) / n, settings.QUIET, axis=1)
    noise = np.sqrt(quiet / 20) / settings.NOISE_OF_QUIET
    return np.asarray(np.maximum(noise, np.where(np.isfinite(least), least, 0)))


def _memory(sample: MovingBlock) -> Float[Array, " C"]:
    ranks: Array = np.array([mean_ranks(x) for x in sample.values]).reshape(sample.values.shape)
    ranks -= ranks.mean(axis=1, keepdims=True)
    later = np.delete(np.arange(ranks.shape[1]), sample.offsets[:-1])
    if not len(later):
        return np.ones(len(ranks))
    power = np.maximum((ranks**2).mean(axis=1), 1e-300)
    return np.asarray((ranks[:, later] * ranks[:, later - 1]).mean(axis=1) / power)


def _turn(values: Float[Array, " T"], change: Float[Array, " T"], size: Float[Array, " T"]) -> float:
    """By how much an angle that wraps leaps: its values fill a turn at most, it changes little or by a turn, and came
    nearer to where it leaps; 0 where it does not wrap."""
    top, span = float(size.max(initial=0.0)), float(np.ptp(values)) if len(values) else 0.0
    for turn in settings.TURNS:
        if settings.NEAR_TURN * turn <= top <= span <= settings.WITHIN_TURN * turn:
            leaps = np.flatnonzero(size >= settings.NEAR_TURN * turn)
            before = values[leaps - 1] - values[np.maximum(leaps - settings.APPROACH, 0)]
            before = np.where(np.abs(before) > turn / 2, change[leaps], before)  # it leapt just before
            comes = (before * change[leaps] < 0).mean() > 0.5
            others = np.delete(size, leaps)  # beside which nothing is left of a leap of noise where it wraps
            comes |= bool((np.abs(size[leaps] - turn) <= 2.0 * others.max(initial=0.0)).all())
            if comes and others.max(initial=0.0) <= (1 - settings.NEAR_TURN) * turn:
                return float(turn)
    return 0.0


def _signs(block: Block, first: int, towards: Array) -> Float[Array, " T"]:
    """1 or -1 for each step: with it, a quaternion goes on from the step before, and begins near `towards`."""
    n = block.observations.shape[1]
    own, first = (block.observations, first) if first < n else (block.actions, first - n)
    turned = own[:, first : first + 4].astype(np.float64)
    before = np.roll(turned, 1, axis=0)
    before[block.offsets[:-1]] = towards
    same = np.where((turned * before).sum(axis=1) < 0, -1.0, 1.0)
    sign = np.cumprod(same)
    return sign * np.repeat(sign[block.offsets[:-1]] * same[block.offsets[:-1]], np.diff(block.offsets))


def _quaternions(values: Array) -> dict[int, Array]:
    """The first of each four columns of length 1 that turn, with their first values."""
    found: dict[int, Array] = {}
    size = values.astype(np.float64) ** 2
    for k in range(values.shape[1] - 3):
        is_free = k >= max(found, default=-4) + 4
        is_free &= all(np.allclose(x[:, k : k + 4].sum(axis=1), 1.0, atol=1e-3) for x in (size[:1], size) if is_free)
        if is_free and size[:, k : k + 4].std() > 0:
            found[k] = values[0, k : k + 4]
    return found


def _is_measurement(column: Array) -> bool:
    """Whether a column has many values, which are not those of a byte: 0 to 255, or 0 to 1 in steps of 1 / 255."""
    low, high, few = float(column.min()), float(column.max()), 10 * settings.MIN_DISTINCT
    if all(len(np.unique(x)) < settings.MIN_DISTINCT for x in (column[:few], column)) or not np.isfinite(column).all():
        return False  # values are missing where the sample holds no demonstration without
    is_byte = low >= 0 and high <= 255 and np.array_equal(column, np.rint(column))
    in_parts = column.astype(np.float64) * 255
    return not is_byte and not (low >= 0 and high <= 1 and np.allclose(in_parts, np.rint(in_parts), atol=1e-4))


def part_means(values: Shaped[Array, "C T"], offsets: Int[Array, " _"], n: int = 1) -> Float[Array, "M K C"]:
    """Means over `n` parts of each demonstration, one after the other in time; over all of its steps, as one part."""
    firsts = offsets[:-1, None] + (np.arange(n) * np.diff(offsets)[:, None]) // n
    widths = np.maximum(np.diff(firsts, append=offsets[1:, None]).ravel(), 1)
    return np.ascontiguousarray((np.add.reduceat(values, firsts.ravel(), axis=1) / widths).T).reshape(*firsts.shape, -1)
