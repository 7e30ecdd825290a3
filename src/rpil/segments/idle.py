"""Idle rows, anywhere in a demonstration: by states and actions that rest, or by the rule of openpi."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np

from rpil.data.arrays import spans
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, pilot
from rpil.faults.rule import Learned
from rpil.faults.still import long_runs, steady, window_means
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Bool, Float, Int

LEAST_ROWS, WIDTHS, FAR, DRIFT = 7, (3, 8, 24), 3.0, 2e-4
"""Rows of a rest at least; widths whose means are compared, and by how many standard errors; spreads a row beside."""

NOISE_ROWS, QUIET, NOISE_OF_QUIET = 12, 0.1, 0.62
"""Rows that tell noise, the share of them that are quiet, and the noise there of noise of standard deviation 1."""

LONG_WAIT = 1.5
"""Times the usual rest after a gripper has moved, up to which the arm waits for it."""

SAME, LEAST_MOVING, LAST = 1e-3, 16, 10
"""Of openpi's rule: change of an action that is none; moving rows at least; rows by which each range ends earlier."""


def idle_rows(demonstrations: Demonstrations | Dataset, rule: Literal["rest", "openpi"] = "rest") -> Bool[Array, " N"]:
    """Rows in which nothing moves, for `Audit.ranges`.

    Parameters
    ----------
    demonstrations : Demonstrations or Dataset
        Where actions are classes no row is idle.
    rule : {"rest", "openpi"}
        By "rest", states and actions stay the same, but for noise, for 7 rows or more, and not while a gripper closes.
        By "openpi", those that its script for DROID leaves out: 7 or more in a row whose actions, but for those called
        gripper, differ by less than .001 from the row before; less than 16 rows between; and 10 before each.
    """
    if rule not in ("rest", "openpi"):
        raise DataError(f"No rule of idle rows is called {rule!r}; choose rest or openpi.")
    if demonstrations.is_discrete:
        return np.zeros(demonstrations.n_steps, dtype=bool)
    blocks = [block for shard in demonstrations.shards(1, settings.CACHE_STEPS) for block in shard]
    if rule == "openpi":
        names = demonstrations.action_names or [""] * demonstrations.n_actions
        own = [a for a, name in enumerate(names) if "gripper" not in name.lower()]
        return np.concatenate([_left_out_by_openpi(block.actions[:, own], block.offsets) for block in blocks])
    learned, (sample, numbers) = Learned.of(demonstrations), pilot(demonstrations)
    noise = _noise_at_rest(MovingBlock.of(sample, numbers, learned.columns))
    found = [one for block in blocks for one in _resting(block, learned, noise)]
    return np.concatenate(_without_waits(found))


def _left_out_by_openpi(actions: Float[Array, "T A"], offsets: Int[Array, " _"]) -> Bool[Array, " T"]:
    same = np.append(False, (np.abs(np.diff(actions, axis=0)) < SAME).all(axis=1))
    left_out = np.ones(len(actions), dtype=bool)
    same[offsets[:-1]] = False
    for begin, end in pairwise(offsets.tolist()):
        for first, last in spans(~long_runs(same[begin:end], LEAST_ROWS)):
            left_out[begin + first : begin + max(last - LAST, first)] = last - first < LEAST_MOVING
    return left_out


def _noise_at_rest(sample: MovingBlock) -> Float[Array, " C"]:
    """Standard deviation of the noise of each column at rest, by third differences, or of the step of an encoder."""
    third = np.diff(sample.values, n=3, axis=1)
    third = third[:, ~np.isin(np.arange(third.shape[1]), np.add.outer(sample.offsets[1:-1], [-3, -2, -1]))]
    least = np.where(sample.size > 0, sample.size, np.inf).min(axis=1) / np.sqrt(12)
    if third.shape[1] < NOISE_ROWS:
        return np.zeros(len(third))
    quiet = np.sqrt(np.quantile(window_means(third**2, NOISE_ROWS), QUIET, axis=1) / 20) / NOISE_OF_QUIET
    return np.asarray(np.maximum(quiet, np.where(np.isfinite(least), least, 0)))


def _resting(block: Block, learned: Learned, noise: Float[Array, " C"]) -> list[tuple[Bool[Array, " n"], Array]]:
    """Of each demonstration of a block its resting rows, and the rows in which a gripper changes."""
    columns, actions, found = learned.columns, block.actions, []
    tells = FAR * noise <= settings.LARGEST_BAND * columns.spread
    values = MovingBlock.of(block, np.arange(len(block.offsets) - 1), columns).values[tells]
    states, drift = ~columns.is_action[tells], DRIFT * columns.spread[tells] + 1e-12
    bands = {w: FAR * np.sqrt(2 / w) * noise[tells] + drift * w for w in WIDTHS}
    reach = FAR * (noise[tells] + drift)[:, None]
    change = np.diff(actions, axis=0, prepend=actions[:1])
    change[block.offsets[:-1]] = np.inf
    same: Array = ((change == 0) | ((actions == 0) & (not learned.tracked.is_command))).all(axis=1)
    measured = columns.number[columns.is_action] - block.observations.shape[1]
    turns = (~np.isin(np.delete(change, measured, axis=1), (0, np.inf))).any(axis=1)
    for begin, end in pairwise(block.offsets.tolist()):
        own, rests = values[:, begin:end], np.zeros(end - begin, dtype=bool)
        if states.any():
            exact = [(max(a - 1, 0), b) for a, b in spans(long_runs(same[begin:end], LEAST_ROWS))]
            for chosen, parts in ((slice(None), spans(steady(own, bands, LEAST_ROWS))), (states, exact)):
                for a, b in parts:
                    level = np.median(own[chosen, a:b], axis=1, keepdims=True)
                    near = np.flatnonzero((np.abs(own[chosen, a:b] - level) <= reach[chosen]).all(axis=0))
                    if len(near):  # in the first it arrives
                        rests[a + near[0] + (a + near[0] > 0) : a + near[-1] + 1] = True
        found.append((long_runs(rests, LEAST_ROWS), turns[begin:end]))
    return found


def _without_waits(found: list[tuple[Bool[Array, " n"], Bool[Array, " n"]]]) -> list[Bool[Array, " n"]]:
    """The resting rows without those in which the arm waits for its gripper, as it usually does."""
    turns = [(rests, n) for rests, turned in found for n in np.flatnonzero(turned).tolist()]
    ends = [next((b for a, b in spans(rests) if b > n and a < n + LEAST_ROWS), n) for rests, n in turns]
    usual = int(np.quantile([end - n for (_, n), end in zip(turns, ends, strict=True)], 0.75)) if turns else 0
    for (rests, n), end in zip(turns, ends, strict=True):
        rests[n : end if end - n <= LONG_WAIT * usual else n + usual] = False
    return [long_runs(rests, LEAST_ROWS) for rests, _ in found]
