"""Idle rows, anywhere in a demonstration: by states and actions that rest, or by the rule of openpi."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.rule import Learned
from rpil.faults.still import long_runs, parts, resting_rows
from rpil.formats.dataset import Dataset
from rpil.numerics.types import Array, Bool, Float, Int

LONG_WAIT = 1.5
"""Times the usual rest after a gripper has moved, up to which the arm waits for it."""

SAME, LEAST_MOVING, LAST = 1e-3, 16, 10
"""Openpi's rule: change of an action that is none; moving rows at least; rows by which each range ends earlier."""


def idle_rows(demonstrations: Demonstrations | Dataset, rule: Literal["rest", "openpi"] = "rest") -> Bool[Array, " N"]:
    """Rows in which nothing moves, for `Audit.ranges`.

    Parameters
    ----------
    demonstrations : Demonstrations or Dataset
        With discrete actions no row is idle.
    rule : {"rest", "openpi"}
        "rest": states and actions stay the same, but for noise, for 7 rows or more, and not while a gripper closes.
        "openpi": the rows that its script for DROID leaves out: 7 or more in a row whose actions, but for those called
        gripper, differ by less than .001 from the row before; fewer than 16 rows between these; and 10 before each.
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
    learned, rests, turned = Learned.of(demonstrations), list[Bool[Array, " n"]](), list[Bool[Array, " n"]]()
    measured = learned.columns.number[learned.columns.is_action] - demonstrations.n_observations
    for block in blocks:
        moving = MovingBlock.of(block, np.arange(len(block.offsets) - 1), learned.columns)
        turns = np.asarray(np.diff(np.delete(block.actions, measured, axis=1), axis=0, prepend=0).any(axis=1))
        turns[block.offsets[:-1]] = False
        rests, turned = [*rests, resting_rows(moving, learned.tracked.is_command)], [*turned, turns]
    return _without_waits(np.concatenate(rests), np.flatnonzero(np.concatenate(turned)), demonstrations.offsets)


def _left_out_by_openpi(actions: Float[Array, "T A"], offsets: Int[Array, " _"]) -> Bool[Array, " T"]:
    same = np.append(False, (np.abs(np.diff(actions, axis=0)) < SAME).all(axis=1))
    left_out = np.ones(len(actions), dtype=bool)
    same[offsets[:-1]] = False
    for first, last in zip(*parts(~long_runs(same, offsets), offsets), strict=True):
        left_out[first : max(last - LAST, first)] = last - first < LEAST_MOVING
    return left_out


def _without_waits(rests: Bool[Array, " n"], turns: Int[Array, " K"], offsets: Int[Array, " M1"]) -> Bool[Array, " n"]:
    """The resting rows without those in which the arm waits for its gripper, which `turns`, as it usually does."""
    if not len(turns):
        return rests
    begins, ends = (np.append(of, len(rests)) for of in parts(rests, offsets))
    run, last = np.searchsorted(ends[:-1], turns, side="right"), offsets[np.searchsorted(offsets, turns, side="right")]
    ends = np.where(begins[run] < np.minimum(turns + settings.REST_ROWS, last), ends[run], turns)
    usual = int(np.quantile(ends - turns, 0.75))
    ends = np.where(ends - turns <= LONG_WAIT * usual, ends, np.minimum(turns + usual, last))
    for first, end in zip(turns, ends, strict=True):
        rests[first:end] = False
    return long_runs(rests, offsets)
