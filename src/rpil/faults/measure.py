"""One pass over the data: what the rules need to know about each demonstration."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields

import numpy as np

from rpil.data.copies import digests
from rpil.data.demonstrations import Block, Demonstrations
from rpil.faults import segments
from rpil.faults.lag import Lag, shifts
from rpil.faults.measured_columns import MeasuredColumns
from rpil.faults.missing_values import set_aside
from rpil.faults.naming import Namer, name_block
from rpil.faults.report import Fault
from rpil.faults.settings import FaultSettings
from rpil.faults.whole import Ends, next_state
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Bool, Float, Int, Shaped

CACHE_STEPS = 8_192
"""Steps of a block: a dozen columns of them stay in a second-level cache."""

PARTS, DIRECTIONS, LENGTH_WEIGHT = 8, 8, 10.0
"""Of a signature: parts of a demonstration, random directions of its columns, and standard deviations of a column to
which a length e times longer amounts."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What a sample of the demonstrations tells, beside the columns."""

    lag: Lag
    namer: Namer | None
    ends: Ends | None


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of M demonstrations, (M, C) for each column or (M,). Steps count from that of the
    demonstration's first, 0."""

    spike: Float[Array, "M C"]  # the largest distance of a value from both its neighbours, on the same side
    spike_step: Int[Array, "M C"]
    jump: Float[Array, "M C"]  # the largest change from one step to the next that is not taken back at once
    jump_step: Int[Array, "M C"]
    largest: Float[Array, "M C"]  # change from one step to the next
    still: Int[Array, "M C"]  # steps in motion during which the column keeps one value, in its longest such run
    run_step: Int[Array, "M C"]
    run: Int[Array, "M C"]  # steps of that run
    run_value: Float[Array, "M C"]
    low: Float[Array, "M C"]
    high: Float[Array, "M C"]
    change: Float[Array, "M C"]  # mean size of a change
    level: Float[Array, "M C"]  # mean size of a value
    repeats: Int[Array, " M"]  # steps that repeat the row before them while the rows around them move
    repeat_step: Int[Array, " M"]  # of the longest of these repetitions
    repeat_run: Int[Array, " M"]
    head: Int[Array, " M"]  # idle steps at the beginning
    tail: Int[Array, " M"]
    shift: Int[Array, " M"]  # of the lag from the usual one
    shift_gain: Float[Array, " M"]  # in agreement of the cross-correlations, relative to the usual one
    named: Int[Array, " M"]  # the fault that `Namer` names, or -1
    gain: Float[Array, " M"]  # of undoing it
    boundary: Float[Array, "M 2"]  # how unlike one between two demonstrations the best step is, and that step
    next_state: Float[Array, "M A 2"]  # whether each action moves, and is then the next state
    signature: Float[Array, "M S"]
    digest: Shaped[Array, " M"]


def measure(
    demonstrations: Demonstrations | Dataset,
    columns: MeasuredColumns,
    learned: Learned,
    settings: FaultSettings,
) -> tuple[Measured | None, Bool[Array, " M"], list[Fault]]:
    """What was measured of the demonstrations without missing values, block by block; None where none is.

    Also a mask of these demonstrations, and the findings in the others.
    """
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS, len(columns.names)))
    directions /= np.where(columns.spread > 0, columns.spread, 1.0)
    parts, masks, missing = [], [], []
    for shard in demonstrations.shards(1, CACHE_STEPS):
        for whole in shard:
            block, kept, found = set_aside(whole, demonstrations.ids, columns.labels)
            masks.append(kept)
            missing += found
            if kept.any():
                numbers = whole.first + np.flatnonzero(kept)
                parts.append(_measure_block(block, numbers, columns, learned, directions, settings))
    joined = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Measured) if parts}
    return Measured(**joined) if parts else None, np.concatenate(masks), missing


def _measure_block(
    block: Block,
    numbers: Array,
    columns: MeasuredColumns,
    learned: Learned,
    directions: Array,
    settings: FaultSettings,
) -> Measured:
    values, offsets = columns.of(block), block.offsets
    change = segments.changes(values, offsets)
    size = np.abs(change)
    spike, jump = _spikes_and_jumps(change, size, offsets)
    changed: Array = size > 0
    motion = columns.motion_of(size)
    moves = motion > settings.idle_motion * columns.motion
    still, run_step, run = segments.longest_runs(changed, moves, offsets)
    head, tail = _idle_ends(motion, moves, offsets, settings)
    return Measured(
        *segments.largest(spike, offsets),
        *segments.largest(jump, offsets),
        np.maximum.reduceat(size, offsets[:-1], axis=1).T,
        still,
        run_step,
        run,
        values[np.arange(len(values)), run_step + offsets[:-1, None]],
        np.minimum.reduceat(values, offsets[:-1], axis=1).T,
        np.maximum.reduceat(values, offsets[:-1], axis=1).T,
        segments.means(size, offsets),
        segments.means(np.abs(values), offsets),
        *_repeats(
            np.asarray(changed[~columns.is_action].any(axis=0)),
            motion > settings.repeat_motion * columns.motion,
            offsets,
        ),
        head,
        tail,
        *shifts(values, change, offsets, learned.lag.pairs, settings),
        *name_block(learned.namer, values, block, numbers),
        _boundaries(learned.ends, values[~columns.is_action], offsets),
        next_state(block),
        _signatures(values, offsets, directions),
        digests(block.observations, block.actions, block.offsets),
    )


def _spikes_and_jumps(change: Array, size: Array, offsets: Array) -> tuple[Array, Array]:
    """Of each step t, with changes d_t to it: the spike, max(0, min(|d_t|, |d_t+1|) - max(|d_t-1|, |d_t+2|)) where d_t
    and d_t+1 have opposite signs; and the jump, by how much |d_t| is larger than both |d_t-1| and |d_t+1|, if it is
    twice as large."""
    around = np.zeros_like(size)  # of the changes before and after that to a step
    np.maximum(size[:, :-2], size[:, 2:], out=around[:, 1:-1])
    jump = np.where(2.0 * around < size, size - around, 0.0)
    jump[:, offsets[:-1] + np.minimum(np.diff(offsets) - 1, 1)] = 0.0  # nothing tells how it moved before
    jump[:, offsets[1:] - 1] = 0.0
    spike = np.zeros_like(size)
    np.minimum(size[:, 1:-2], size[:, 2:-1], out=spike[:, 1:-2])
    spike[:, 1:-2] *= change[:, 1:-2] * change[:, 2:-1] < 0
    spike[:, 1:-2] -= np.maximum(size[:, :-3], size[:, 3:])
    return np.maximum(spike, 0.0), jump


def _idle_ends(motion: Array, moves: Array, offsets: Array, s: FaultSettings) -> tuple[Array, Array]:
    """Steps before the first and after the last step that moves, of each demonstration. Where motion
    grows slowly, or decays as that of a controller that settles, nothing is idle."""
    n, steps = len(moves), np.arange(len(moves))
    first = np.minimum.reduceat(np.where(moves, steps, n), offsets[:-1])
    last = np.maximum.reduceat(np.where(moves, steps, -1), offsets[:-1])
    nothing = first == n
    head = np.where(nothing, np.diff(offsets), np.maximum(first - 1 - offsets[:-1], 0))
    tail = np.where(nothing, 0, offsets[1:] - 1 - last)
    for idle, ends, way in ((head, offsets[:-1], 1), (tail, offsets[1:], -1)):
        for m in np.flatnonzero(idle >= s.min_idle).tolist():
            first = ends[m] if way > 0 else ends[m] - idle[m]
            own = motion[first + 1 : first + idle[m]][::way]
            third = len(own) // 3
            if 0 < s.settling * own[1 : third + 1].mean() < own[-third:].mean():
                idle[m] = 0
    return head, tail


def _boundaries(ends: Ends | None, values: Array, offsets: Array) -> Array:
    """`Ends.boundary` of each demonstration, (M, 2)."""
    if ends is None or np.isnan(ends.limit):
        return np.tile([np.inf, 0.0], (len(offsets) - 1, 1))
    return np.array([ends.boundary(values[:, a:b]) for a, b in itertools.pairwise(offsets)])


def _repeats(changed: Array, moves: Array, offsets: Array) -> tuple[Array, Array, Array]:
    """Number of repeated rows between rows that move, and the first step and the length of the longest repetition."""
    runs, starts, bounds = segments.runs_of(changed[None], offsets)
    is_first = np.zeros(len(starts), dtype=bool)
    is_first[bounds] = True
    after = np.append(starts[1:], 0)
    between = ~is_first & ~np.append(is_first[1:], True) & moves[starts] & moves[after]
    repeated = np.where(between, runs - 1, 0)
    key = np.maximum.reduceat(repeated * len(changed) + len(changed) - 1 - starts, bounds)
    first = len(changed) - 1 - key % len(changed)
    return np.add.reduceat(repeated, bounds), first + 1 - offsets[:-1], key // len(changed)


def _signatures(values: Array, offsets: Array, directions: Array) -> Array:
    """Means over parts of each demonstration, seen from some directions, and the logarithm of its length, (M, S)."""
    lengths = np.diff(offsets)
    firsts = offsets[:-1, None] + (np.arange(PARTS) * lengths[:, None]) // PARTS
    widths = np.diff(firsts, append=offsets[1:, None]).ravel()
    seen = np.add.reduceat(directions @ values, firsts.ravel(), axis=1) / np.maximum(widths, 1)
    parts = np.ascontiguousarray(seen.T).reshape(len(lengths), -1)
    return np.column_stack([parts, LENGTH_WEIGHT * np.log(lengths)])
