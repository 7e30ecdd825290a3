"""Faults that most of a set has, or all of it: planted in few, many and all; clean sets; and where nothing is known."""

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.faults.checking import check

N = 12


def arm(seed, n=N, joints=4):
    """Joints that go to a place of their own and back, and commands two steps before."""
    rng, episodes = np.random.default_rng(seed), []
    for _ in range(n):
        t = np.linspace(0, 1, int(rng.integers(110, 140)))[:, None]
        bend = sum(rng.normal(size=joints) * np.sin(k * np.pi * t) for k in (1, 2, 3))
        path = 20 * bend + 0.1 * rng.normal(size=(len(t), joints))
        episodes.append((path[:-2] + 0.1 * rng.normal(size=(len(t) - 2, joints)), path[2:]))
    return episodes


CLEAN = arm(0)


def stays(values, rows=slice(40, None)):
    values = values.copy()
    values[rows, 1] = values[40, 1]
    return values


@pytest.mark.parametrize("share", [1, 4, 9, N])
@pytest.mark.parametrize("of_action", [True, False])
def test_a_command_that_stays_while_its_state_goes_on_is_named_in_any_share(share, of_action):
    made = [(x, stays(a)) if of_action else (stays(x), a) for x, a in CLEAN[:share]] + CLEAN[share:]
    if share < N:  # and one stays until it is touched
        x, a = CLEAN[-1]
        made[-1] = (x, stays(a, slice(60))) if of_action else (stays(x, slice(60)), a)
    rule, column = ("frozen action", "action 1") if of_action else ("frozen sensor", "observation 1")
    found = [one for one in check(demonstrations(made)).findings if one.rule == rule]
    assert {one.id for one in found} == {*range(share)}
    assert {(one.column, one.first) for one in found} == {(column, 40)}


def test_a_command_that_stays_until_its_state_is_there_is_clean():
    """Waypoints: a step of the command, and a state that goes there within half a second and stays."""
    rng, made = np.random.default_rng(0), []
    for _ in range(N):
        a = np.repeat(20 * rng.normal(size=(4, 3)), 35, axis=0) + 0.01 * rng.normal(size=(1, 3))
        x = [a[0]]
        for command in a[:-1]:
            x.append(x[-1] + 0.15 * (command - x[-1]))
        made.append((np.array(x) + 0.05 * rng.normal(size=a.shape), a))
    assert not {"frozen action", "frozen sensor"} & {*check(demonstrations(made)).counts}


def test_states_that_go_with_no_action_are_one_line():
    for others in (arm(1), [*CLEAN[1:], CLEAN[0]]):
        both = zip(others, CLEAN, strict=True)
        (line,) = check(demonstrations([(x[: len(a)], a[: len(x)]) for (x, _), (_, a) in both])).lines
        assert (line.rule, line.id, line.ids) == ("unrelated", "", tuple(range(N)))
        assert "these columns may belong to something else" in line.sentence


@pytest.mark.parametrize("kind", ["speeds", "changes", "replays", "white"])
def test_states_that_go_with_actions_in_any_way_are_not_unrelated(kind):
    rng = np.random.default_rng(0)
    made = {
        "speeds": [(np.cumsum(a, axis=0), a) for _, a in CLEAN],
        "changes": [(a[:-1], np.clip(np.diff(a, axis=0), -1, 1)) for _, a in CLEAN],
        "replays": [(CLEAN[0][0] + 0.1 * rng.normal(size=CLEAN[0][0].shape), CLEAN[0][1]) for _ in CLEAN],
        "white": [(rng.normal(size=x.shape), rng.normal(size=a.shape)) for x, a in CLEAN],  # nothing can be known
    }
    assert "unrelated" not in check(demonstrations(made[kind])).counts


def turning(m, flips):
    """A hand that turns, whose quaternion takes either sign: at the start, or at each step by chance."""
    x, a = recording(N)[m]
    half = np.cumsum(a[:, :1] / 20, axis=0)
    turn = np.c_[np.cos(half), np.sin(half) * [[0.6, 0.48, 0.64]]]
    rng = np.random.default_rng(m)
    sign = {
        "start": rng.choice([-1, 1]),
        "any": rng.choice([-1, 1], len(x))[:, None],
        "rare": 1 - 2 * (np.arange(len(x)) > 60)[:, None],
    }
    return np.c_[x, turn * sign[flips]], np.c_[a, np.roll(turn, -1, axis=0) * sign[flips]]


@pytest.mark.parametrize("flips", ["start", "any", "rare"])
@pytest.mark.parametrize("share", [2, 6, N])
def test_either_sign_of_a_quaternion_is_no_fault(flips, share):
    made = [turning(m, flips if m < share else "start") for m in range(N)]
    assert not check(demonstrations(made)).findings
