"""Idle ends are seen by a command that stays exactly the same, whatever the noise of the sensors."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.demonstrations import Demonstrations
from rpil.faults.checking import check

N, REST, DEGREES, TICK = 16, 30, 40.0, 0.088
RNG = np.random.default_rng(3)
PATHS = [np.cumsum(np.cumsum(RNG.normal(size=(RNG.integers(90, 130), 4)), axis=0), axis=0) for _ in range(N)]
PATHS = [DEGREES * path / np.abs(path).max(axis=0) for path in PATHS]


def arm(noise, idle=range(N), at_head=True, tick=0.0, drift=0.0):
    """An arm that follows its commands two steps later, and rests at an end of the demonstrations `idle`."""
    rng, episodes = np.random.default_rng(0), []
    for m, path in enumerate(PATHS):
        still = np.repeat(path[:1] if at_head else path[-1:], REST * (m in idle), axis=0)
        command = np.concatenate([still, path] if at_head else [path, still])
        state = command[np.maximum(np.arange(len(command)) - 2, 0)] + noise * rng.normal(size=command.shape)
        state += drift * np.minimum(np.arange(len(state)), REST)[:, None]
        episodes.append((np.round(state / tick) * tick if tick else state, command))
    return Demonstrations.from_episodes(episodes)


@pytest.mark.parametrize(
    ("noise", "tick", "at_head"), [(0.0, 0.0, True), (0.15, 0.0, False), (0.0, TICK, False), (0.05, TICK, True)]
)
def test_what_rests_in_all_may_be_trimmed_whatever_the_noise(noise, tick, at_head):
    demonstrations = arm(noise, at_head=at_head, tick=tick)
    report = check(demonstrations)
    assert report.counts == {"idle head" if at_head else "idle tail": N}  # however usual it is
    assert len(report.lines) == 1
    ends = dict(zip(demonstrations.ids, demonstrations.lengths.tolist(), strict=True))
    idle = [first if at_head else ends[m] - end for m, (first, end) in report.trims.items()]
    assert len(idle) == N
    assert REST - 4 <= min(idle) <= max(idle) <= REST


@pytest.mark.parametrize(("at_head", "rule"), [(True, "idle head"), (False, "idle tail")])
def test_what_rests_in_one_is_a_fault_of_that_one_alone(at_head, rule):
    report = check(arm(0.15, idle=[5], at_head=at_head))
    assert [(fault.rule, fault.id) for fault in report.findings] == [(rule, 5)]
    assert set(report.trims) == {5}
    assert not check(arm(0.15, idle=())).trims


def test_a_state_that_moves_while_its_command_stays_the_same_is_not_idle():
    assert not check(arm(0.15, drift=0.2)).trims


@pytest.mark.parametrize("actions", ["codes", "constant"])
def test_a_command_that_tells_nothing_says_of_no_rest(actions):
    """A code that stays the same may be a push, and a command that never changes is none."""
    rows = list(arm(0.15))
    codes = [(x, (np.arange(len(x)) >= REST).astype(int)) for x, _ in rows]
    constant = [(x, np.full((len(x), 1), 12.5)) for x, _ in rows]
    assert not check(Demonstrations.from_episodes(codes if actions == "codes" else constant)).trims
