"""Idle rows: planted ones are found, slow motion and a gripper that closes are none; and the rule of openpi."""

from itertools import pairwise

import numpy as np
import pytest

import rpil
from idle_worlds import N_SETS, world
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.segments.ranges import _without_waits


@pytest.mark.slow
def test_planted_rests_are_found_and_slow_motion_is_none():
    found, wrong, called = [], [], []
    for seed in range(N_SETS):
        made, bare = world(seed), world(seed, plants=False)
        idle, moves = rpil.idle_rows(made.data), ~(made.idle | made.unclear)
        found.append(idle[made.idle].mean())
        wrong.append(idle[moves].mean())
        called.append(rpil.idle_rows(bare.data)[~bare.unclear].mean())
    assert np.mean(found) >= 0.95
    assert min(found) >= 0.9
    assert np.mean(wrong) <= 0.01
    assert np.mean(called) <= 0.01


def test_a_gripper_that_closes_is_waited_for_and_an_unknown_rule_is_refused():
    made = world(13, plants=False)
    with pytest.raises(DataError, match="choose rest or openpi"):
        rpil.idle_rows(made.data, "droid")
    assert (made.data.actions[:, -1] == 1).any()
    assert not rpil.idle_rows(made.data).any()


def test_of_a_rest_far_longer_than_others_after_a_gripper_only_the_usual_part_waits():
    turns, lengths = np.array([20, 80, 130, 200]), [20, 20, 20, 61]
    rests = np.zeros(300, dtype=bool)
    for turn, length in zip(turns, lengths, strict=True):
        rests[turn : turn + length] = True
    left = np.flatnonzero(_without_waits(rests, turns, np.array([0, 300])))
    assert left.tolist() == [*range(230, 261)]  # 30 rows are the third quartile


def test_order_and_units_change_nothing():
    made = world(1)
    data, idle = made.data, rpil.idle_rows(made.data)
    in_radians = Demonstrations(data.observations / 57.3, data.actions / 57.3, data.offsets)
    np.testing.assert_array_equal(rpil.idle_rows(in_radians), idle)
    back = [*range(len(data))][::-1]
    turned = rpil.idle_rows(data.select(back))
    parts = [idle[data.offsets[m] : data.offsets[m + 1]] for m in back]
    assert np.mean(turned == np.concatenate(parts)) >= 0.999  # a pilot of all is the same


@pytest.mark.parametrize("actions", ["classes", "constant", "noise", "one row"])
def test_what_tells_nothing_is_not_idle(actions):
    rng, n = np.random.default_rng(0), 1 if actions == "one row" else 60
    states = rng.normal(size=(10, n, 3))
    given = {
        "classes": lambda: rng.integers(0, 2, n),
        "constant": lambda: np.full((n, 2), 3.0),
        "noise": lambda: rng.normal(size=(n, 2)),
        "one row": lambda: rng.normal(size=(n, 2)),
    }[actions]
    data = Demonstrations.from_episodes([(own, given()) for own in states])
    for rule in ("rest", *(["openpi"] if actions in ("classes", "noise") else [])):
        assert not rpil.idle_rows(data, rule)[: n - 10 if rule == "openpi" else None].any()


def openpi_ranges(velocity):
    """By the description: steps that differ by less than .001 from the one before are idle; 7 or more of them in a row
    are left out, what is left in fewer than 16 in a row too, and the last 10 steps of each range."""
    idle, kept, ranges = [False], [True] * len(velocity), []
    for before, now in pairwise(velocity):
        idle.append(all(abs(a - b) < 1e-3 for a, b in zip(before, now, strict=True)))
    for wanted, least in ((idle, 7), (kept, 16)):
        start = 0
        while start < len(wanted):
            end = start
            while end < len(wanted) and wanted[end]:
                end += 1
            if wanted is idle and end - start >= least:
                kept[start:end] = [False] * (end - start)
            elif wanted is kept and end - start >= least:
                ranges.append((start, end - 10))
            start = end + 1
    return ranges


def test_the_rule_of_openpi_gives_the_ranges_of_its_description():
    rng, episodes = np.random.default_rng(7), []
    for _ in range(50):
        parts = []
        for _ in range(rng.integers(1, 12)):
            n = int(rng.integers(1, 40))
            moving = rng.normal(size=(n, 7))
            still = np.repeat(rng.normal(size=(1, 7)), n, axis=0) + rng.choice([0, 4e-4, 2e-3]) * rng.random((n, 7))
            parts.append(moving if rng.random() < 0.5 else still)
        velocity = np.concatenate(parts)
        episodes.append((rng.normal(size=(len(velocity), 3)), np.column_stack([velocity, rng.random(len(velocity))])))
    for begin in (rng.normal(size=(1, 7)), episodes[-1][1][-1:, :7]):  # six rows that stay, after the first
        velocity = np.concatenate([np.repeat(begin, 7, axis=0), rng.normal(size=(30, 7))])
        episodes.append((rng.normal(size=(37, 3)), np.column_stack([velocity, rng.random(37)])))
    names = (*(f"joint_velocity_{k}" for k in range(7)), "Gripper")
    data = Demonstrations.from_episodes(episodes)
    data = Demonstrations(data.observations, data.actions, data.offsets, action_names=names)
    ranges = rpil.audit(data).ranges(rpil.idle_rows(data, "openpi"))
    told = {m: openpi_ranges(action[:, :7].tolist()) for m, (_, action) in enumerate(episodes)}
    assert ranges == told
    assert sum(map(len, told.values())) > 50
