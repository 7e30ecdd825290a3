"""Columns that are 0 throughout in some demonstrations are named as not recorded there, in one finding of each."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.faults.checking import check

N, ARM = 30, slice(3, 6)
CLEAN = recording(N, joints=6, seed=2)


def without_arm(absent, columns=ARM):
    """A recording of two arms, in which the second one is 0 in the demonstrations `absent`."""
    episodes = []
    for m, (states, actions) in enumerate(CLEAN):
        states, actions = (values + np.arange(6) for values in (states, actions))
        for values in (states, actions):
            values[:, columns] *= m not in absent
        episodes.append((states, actions))
    return demonstrations(episodes)


@pytest.mark.parametrize("n_absent", [3, 15])
def test_columns_that_are_not_recorded_are_named_once_in_each_demonstration(n_absent):
    absent = set(range(1, 2 * n_absent, 2))
    report = check(without_arm(absent))
    assert {(fault.rule, fault.id) for fault in report.findings} == {("never moves", m) for m in absent}
    assert len(report.findings) == n_absent
    for fault in report.findings:
        assert fault.sentence.startswith("these columns are not recorded here: ")
        assert fault.sentence.endswith("; the same in 5 more columns")


def test_the_column_that_moves_most_alike_in_the_others_is_named():
    episodes = [(states.copy(), actions.copy()) for states, actions in CLEAN]
    for states, actions in episodes:
        states[:, 5] *= 3 / np.ptp(states[:, 5])  # its range is the same in all
        states[:, ARM] += 10
        actions[:, ARM] += 10
    for values in episodes[4]:
        values[:, ARM] = 0.0
    (fault,) = check(demonstrations(episodes)).findings
    assert fault.column == "observation 5"


def test_without_them_and_where_nearly_all_lack_them_nothing_is_said():
    assert not check(without_arm(())).findings
    assert check(without_arm(range(N - 5))).counts == {"never moves": N - 5}
    assert not check(without_arm(range(N - 2))).counts.get("never moves")
    halves = [(x * (np.arange(6) // 3 != m % 2), a) for m, (x, a) in enumerate(CLEAN)]  # of two arms each has one
    assert check(demonstrations(halves)).counts == {"never moves": N}


def test_one_column_alone_rests_and_so_does_what_is_constant_in_all():
    states = [(np.column_stack([x[:, :5], x[:, 5] * (m != 7)]), a) for m, (x, a) in enumerate(CLEAN)]
    (fault,) = [fault for fault in check(demonstrations(states)).findings if fault.rule == "never moves"]
    assert fault.sentence == "observation 5 does not move, and in the others it does"
    goals = np.arange(N) * (np.arange(N) % 5 > 0)
    towards = [(np.column_stack([x, np.full((len(x), 2), goals[m])]), a) for m, (x, a) in enumerate(CLEAN)]
    assert not check(demonstrations(towards)).findings


def test_what_is_at_0_in_most_steps_of_the_others_rests():
    rng, episodes = np.random.default_rng(0), []
    for m, (states, actions) in enumerate(CLEAN):
        pressed = rng.random((len(states), 2)) * (np.arange(len(states)) % 50 < 10)[:, None] * (m % 3 > 0)
        episodes.append((np.column_stack([states, pressed]), actions))
    assert not any("not recorded" in fault.sentence for fault in check(demonstrations(episodes)).findings)
