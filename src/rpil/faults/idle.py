"""The rules about idle beginnings and ends, which may be trimmed."""

from __future__ import annotations

import numpy as np

from rpil.data.arrays import Id
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.rule import Compared, ComparingRule, Learned, Measurements, above
from rpil.numerics.types import Array, Float

THIRD_DIFFERENCE = 3.016
"""Median size of the third difference, .6745 sqrt(20), of noise of standard deviation 1: smooth motion adds little."""

NOISE_BAND = 5.0
"""Standard deviations of the noise of a state within which it is at rest."""

LARGEST_BAND = 0.5
"""Spreads of a state: where rest may be farther apart, the state does not tell rest from motion."""


class IdleEnd(ComparingRule):
    """Idle beginnings and ends, which may be trimmed."""

    at_head = False

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Steps before the first and after the last step that moves, of each demonstration. Where motion grows slowly,
        or decays as that of a controller that settles, nothing is idle. A command that stays exactly the same while no
        state leaves its noise is idle, however large the noise."""
        moves, offsets = block.moves, block.offsets
        n, steps = len(moves), np.arange(len(moves))
        first = np.minimum.reduceat(np.where(moves, steps, n), offsets[:-1])
        last = np.maximum.reduceat(np.where(moves, steps, -1), offsets[:-1])
        nothing = first == n
        head = np.where(nothing, np.diff(offsets), np.maximum(first - 1 - offsets[:-1], 0))
        tail = np.where(nothing, 0, offsets[1:] - 1 - last)
        for idle, begins, way in ((head, offsets[:-1], 1), (tail, offsets[1:] - tail, -1)):
            for m in np.flatnonzero(idle >= settings.MIN_IDLE).tolist():
                motion = block.motion[begins[m] + 1 : begins[m] + idle[m]][::way]
                third = len(motion) // 3
                if 0 < settings.SETTLING * motion[1 : third + 1].mean() < motion[-third:].mean():
                    idle[m] = 0
        held = np.array([_held(block, m) for m in range(len(head))])
        return np.maximum(head, held[:, 0]), np.maximum(tail, held[:, 1])

    def compare(self) -> Compared:
        idle, least = self.measured[0 if self.at_head else 1], settings.MIN_IDLE
        self.first, self.last = (self.first, idle - 1) if self.at_head else (self.data.lengths - idle, self.last)
        factor = settings.USUAL_FACTOR
        return above(idle, np.maximum(self.fence(idle, factor, least / factor), least))


class IdleHead(IdleEnd):
    name, words = "idle head", "nothing moves for long at the beginning"
    sentence = "nothing moves for the first {long} (usual: up to {most})"
    at_head = True


class IdleTail(IdleEnd):
    name, words = "idle tail", "nothing moves for long at the end"
    sentence = "nothing moves for the last {long} (usual: up to {most})"


def trims(data: Measurements) -> dict[Id, tuple[int, int]]:
    """The steps to keep of each demonstration with idle ends, whether they are usual or not."""
    least = settings.MIN_IDLE
    head, tail = (np.where(idle >= least, idle, 0) for idle in data.measured[IdleEnd.measure])
    end = data.lengths - tail
    idle = np.flatnonzero((head + tail > 0) & (head < end)).tolist()
    return {data.ids[m]: (int(head[m]), int(end[m])) for m in idle}


def _held(block: MovingBlock, m: int) -> tuple[int, int]:
    """Steps at the beginning, and at the end, of demonstration `m` of a block in which the action is exactly constant
    and no state leaves its noise; the step that moves next, or moved last, does not count."""
    rows, least = slice(*block.offsets[m : m + 2].tolist()), settings.MIN_IDLE
    if (actions := block.block.actions[rows]).ndim == 1:  # a code that stays the same may be a push
        return 0, 0
    same = [(actions == actions[end]).all(axis=1)[::way] for end, way in ((0, 1), (-1, -1))]
    held = [int(np.argmin(each)) for each in same]  # 0 where the action never changes, which tells nothing
    if max(held) <= least:
        return 0, 0
    columns, is_state = block.columns, ~block.columns.is_action
    states = block.values[is_state, rows]
    noise = np.median(np.abs(np.diff(states, n=3, axis=1)), axis=1) / THIRD_DIFFERENCE
    band = np.maximum(NOISE_BAND * noise, columns.scale[is_state])
    tells = band <= LARGEST_BAND * columns.spread[is_state]
    states, band = states[tells], band[tells]
    ends = zip((states, states[:, ::-1]), held, strict=True)
    first, last = (_quiet(values[:, :n], band, least) if n > least and tells.any() else 0 for values, n in ends)
    return first, last


def _quiet(values: Float[Array, "S T"], band: Float[Array, " S"], least: int) -> int:
    """Steps but one, from the first on, in which no state is farther from where it rests."""
    at_rest = np.median(values[:, :least], axis=1)
    leaves = np.append((np.abs(values - at_rest[:, None]) > band[:, None]).any(axis=0), True)
    return max(int(np.argmax(leaves)) - 1, 0)
