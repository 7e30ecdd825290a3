"""Idle rows, anywhere in a demonstration: by states and actions that rest, or by the rule of openpi."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rpil.data.arrays import spans
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError
from rpil.faults import settings
from rpil.faults.measured_columns import MeasuredColumns, MovingBlock, pilot
from rpil.faults.rule import Learned
from rpil.faults.still import window_means
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Bool, Float, Int

LEAST_ROWS, WIDTHS, FAR = 7, (3, 8, 24), 4.0
"""Rows of a rest at least; rows whose mean is compared with that of the next ones; standard errors they lie apart."""

DRIFT, NOISE_ROWS, QUIET, OF_QUIET = 2e-4, 12, 0.1, 0.62
"""Spreads a row that what rests may go; rows that tell noise, the share of them that are quiet, and the noise there."""

LONG_WAIT = 1.5
"""Times the usual rest after a gripper has moved, up to which the arm waits for it."""

NEAR, LEAST_MOVING, LAST = 1e-3, 16, 10
"""Of openpi's rule: what an action changes by that is idle; moving rows at least; rows that each range ends earlier."""

Rule = Literal["rest", "openpi"]


def idle_rows(demonstrations: Demonstrations | Dataset, rule: Rule = "rest") -> Bool[Array, " N"]:
    """Rows of demonstrations in which nothing moves, for `Audit.ranges`.

    Parameters
    ----------
    demonstrations : Demonstrations or Dataset
        With actions that are numbers; of classes no row is idle.
    rule : {"rest", "openpi"}
        By "rest", states stand still within the noise of their sensors for 7 rows or more, and actions stay the same,
        or rest as well; not while a gripper closes. By "openpi" the rows that its script for DROID leaves out: 7 or
        more in a row whose actions, without those called gripper, differ by less than .001 from the row before; what
        is left, where it is shorter than 16 rows; and the last 10 rows of every rest of it.

    Examples
    --------
    >>> audit.ranges(rpil.idle_rows(demonstrations))                             # doctest: +SKIP
    """
    if rule not in ("rest", "openpi"):
        raise DataError(f"No rule of idle rows is called {rule!r}; choose rest or openpi.")
    if demonstrations.is_discrete:
        return np.zeros(demonstrations.n_steps, dtype=bool)
    blocks = [block for shard in demonstrations.shards(1, settings.CACHE_STEPS) for block in shard]
    if rule == "openpi":
        names = demonstrations.action_names or [""] * demonstrations.n_actions
        own = np.array([a for a, name in enumerate(names) if "gripper" not in str(name).lower()], dtype=int)
        return np.concatenate([_left_out_by_openpi(block.actions[:, own], block.offsets) for block in blocks])
    learned = Learned.of(demonstrations)
    sample, numbers = pilot(demonstrations)
    noise = _noise_at_rest(MovingBlock.of(sample, numbers, learned.columns))
    found = [_resting(block, learned, noise) for block in blocks]
    return np.concatenate(_without_waits([own for of_block in found for own in of_block]))


def _left_out_by_openpi(actions: Float[Array, "T A"], offsets: Int[Array, " _"]) -> Bool[Array, " T"]:
    same = np.append(False, (np.abs(np.diff(actions, axis=0)) < NEAR).all(axis=1))
    same[offsets[:-1]] = False
    left_out = np.ones(len(actions), dtype=bool)
    for begin, end in zip(offsets[:-1].tolist(), offsets[1:].tolist(), strict=True):
        moves = np.ones(end - begin, dtype=bool)
        for first, last in spans(same[begin:end]):
            moves[first:last] = last - first < LEAST_ROWS
        for first, last in spans(moves):
            left_out[begin + first : begin + max(last - LAST, first)] = last - first < LEAST_MOVING
    return left_out


def _noise_at_rest(sample: MovingBlock) -> Float[Array, " C"]:
    """Standard deviation of the noise of each column where it is quiet, by third differences; a step of an encoder has
    its own."""
    third = np.diff(sample.values, n=3, axis=1) ** 2
    inside = np.ones(third.shape[1], dtype=bool)
    inside[np.add.outer(sample.offsets[1:-1], [-3, -2, -1])] = False
    third = third[:, inside]
    if third.shape[1] < NOISE_ROWS:
        return np.zeros(len(third))
    quiet = np.quantile(window_means(third, NOISE_ROWS), QUIET, axis=1)
    least = np.where(sample.size > 0, sample.size, np.inf).min(axis=1) / np.sqrt(12)
    return np.asarray(np.maximum(np.sqrt(quiet / 20) / OF_QUIET, np.where(np.isfinite(least), least, 0)))


def _resting(block: Block, learned: Learned, noise: Float[Array, " C"]) -> list[tuple[Bool[Array, " n"], Array]]:
    """Of each demonstration of a block its resting rows, and those in which a gripper changes."""
    columns, actions = learned.columns, block.actions
    tells = FAR * noise <= settings.LARGEST_BAND * columns.spread
    values = MovingBlock.of(block, np.arange(len(block.offsets) - 1), columns).values
    change = np.diff(actions, axis=0, prepend=actions[:1])
    same = ((change == 0) | ((actions == 0) & (not learned.tracked.is_command))).all(axis=1)
    measured = columns.number[columns.is_action] - block.observations.shape[1]
    turns = (np.delete(change, measured, axis=1) != 0).any(axis=1)
    error, drift = noise[tells, None], DRIFT * columns.spread[tells, None] + 1e-12
    states, found = ~columns.is_action[tells], []
    for begin, end in zip(block.offsets[:-1].tolist(), block.offsets[1:].tolist(), strict=True):
        own, rests = values[tells, begin:end], np.zeros(end - begin, dtype=bool)
        if states.any():
            same[begin] = turns[begin] = False
            exact = [(max(a - 1, 0), b) for a, b in spans(same[begin:end]) if b - a >= LEAST_ROWS]
            for chosen, parts in ((slice(None), spans(_steady(own, error, drift))), (states, exact)):
                for a, b in parts:
                    first, last = _at_level(own[chosen, a:b], error[chosen], drift[chosen])
                    rests[a + first + (a + first > 0) : a + last] = True  # it arrives in the first
        found.append((_long(rests), turns[begin:end]))
    return found


def _long(rows: Bool[Array, " n"]) -> Bool[Array, " n"]:
    """The rows without those of short runs."""
    for a, b in spans(rows):
        rows[a:b] = b - a >= LEAST_ROWS
    return rows


def _steady(values: Float[Array, "C n"], noise: Float[Array, "C 1"], drift: Float[Array, "C 1"]) -> Bool[Array, " n"]:
    """Rows in whose runs the means over W rows and the next W are alike, for each width W: a longer one sees slower
    motion, and looks only at what rests by the shorter ones."""
    found = np.ones(values.shape[1], dtype=bool)
    for w in WIDTHS:
        for a, b in spans(found):
            if b - a >= 2 * w:
                means = window_means(values[:, a:b], w)
                apart = (means[:, w:] - means[:, :-w]) / (np.sqrt(2 / w) * noise + drift * w / FAR)
                found[a:b] = np.convolve(_is_noise(apart, FAR), np.ones(2 * w)) > 0
        found = _long(found)
    return found


def _is_noise(deviations: Float[Array, "C n"], most: float) -> Bool[Array, " n"]:
    """Whether the standard deviations of all columns are what noise has, each and in the sum of their squares."""
    n = len(deviations)
    return np.asarray((np.abs(deviations).max(axis=0) <= most) & ((deviations**2).sum(axis=0) <= n + 3 * np.sqrt(2 * n)))


def _at_level(values: Float[Array, "C n"], noise: Array, drift: Array) -> tuple[int, int]:
    """The first row, and the one after the last, at the level of the run."""
    near = np.flatnonzero(_is_noise((values - np.median(values, axis=1, keepdims=True)) / (noise + drift), FAR))
    return (int(near[0]), int(near[-1]) + 1) if len(near) else (0, 0)


def _without_waits(found: list[tuple[Bool[Array, " n"], Bool[Array, " n"]]]) -> list[Bool[Array, " n"]]:
    """The resting rows without those in which the arm waits for its gripper, as it usually does."""
    waits = []
    for rests, turns in found:
        for n in np.flatnonzero(turns).tolist():
            after = next((b for a, b in spans(rests) if b > n and a < n + LEAST_ROWS), n)
            waits.append((rests, n, after - n))
    usual = int(np.quantile([n for _, _, n in waits], 0.75)) if waits else 0
    for rests, first, n in waits:
        rests[first : first + (n if n <= LONG_WAIT * usual else usual)] = False
    return [_long(rests) for rests, _ in found]
