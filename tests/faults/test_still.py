"""Where everything rests, by the noise of sensors, at the ends and between; and columns that are 0 in some."""

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.cli.check import fault_lines
from rpil.faults.checking import check
from rpil.faults.measured_columns import column_labels, learn_columns, pilot

N, REST, TICK = 10, 52, 0.088
PLACES = {"head": 0, "middle": 70, "tail": 139}


def arm(noise, at="head", trembles=False, tick=0.0):
    """Commands by a leader, whose hand may have noise as well, and states two steps later; it rests at a place."""
    rng, episodes = np.random.default_rng(1), []
    for _ in range(N):
        time = np.arange(140)[:, None]
        path = 30 * np.sin(time / rng.uniform(8, 14, 4) + rng.uniform(0, 6, 4))
        path = np.insert(path, [PLACES[at]] * REST, path[PLACES[at]], axis=0)
        leader = path + trembles * noise * rng.normal(size=path.shape)
        late = np.concatenate([leader[:1], leader[:1], leader[:-2]]) + noise * rng.normal(size=path.shape)
        episodes.append((np.round(late / tick) * tick if tick else late, leader))
    return demonstrations(episodes)


@pytest.mark.parametrize(("at", "rule"), [("head", "idle head"), ("middle", "pause"), ("tail", "idle tail")])
@pytest.mark.parametrize(
    ("noise", "trembles", "tick"), [(0.02, False, 0), (0.15, False, 0), (0.15, True, 0), (0.0, False, TICK)]
)
def test_rest_of_all_is_one_line_and_may_be_trimmed_at_the_ends(at, rule, noise, trembles, tick):
    report = check(data := arm(noise, at, trembles=trembles, tick=tick))
    assert report.counts == {rule: N}
    (line,) = report.lines
    assert (line.ids, line.grade) == (tuple(range(N)), "odd")
    assert REST - 10 <= line.last - line.first + 1 <= REST + 10
    ends = [(first, n - end) for n, (first, end) in zip(data.lengths, report.trims.values(), strict=False)]
    idle = [of_each[at == "tail"] for of_each in ends]
    assert len(idle) == N * (at != "middle")
    assert all(REST - 10 <= n <= REST for n in idle)
    for first, end in [*report.trims.values()][:1]:
        assert f"idle heads); steps to keep: 0: {first} to {end - 1}, " in "".join(fault_lines(report))


ARM, TWO_ARMS = slice(3, 6), recording(30, joints=6, seed=2)


def without_arm(absent, columns=ARM):
    """A recording of two arms, in which the second one is 0 in the demonstrations `absent`."""
    episodes = []
    for m, (states, actions) in enumerate(TWO_ARMS):
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


def test_of_two_arms_each_demonstration_may_lack_one():
    halves = [(x * (np.arange(6) // 3 != m % 2), a) for m, (x, a) in enumerate(TWO_ARMS)]
    assert check(demonstrations(halves)).counts == {"never moves": 30}


def test_one_column_alone_rests_and_so_does_what_is_constant_in_all():
    states = [(np.column_stack([x[:, :5], x[:, 5] * (m != 7)]), a) for m, (x, a) in enumerate(TWO_ARMS)]
    (fault,) = [fault for fault in check(demonstrations(states)).findings if fault.rule == "never moves"]
    assert fault.sentence == "observation 5 does not move, and in the others it does"
    goals = np.arange(30) * (np.arange(30) % 5 > 0)
    towards = [(np.column_stack([x, np.full((len(x), 2), goals[m])]), a) for m, (x, a) in enumerate(TWO_ARMS)]
    assert not check(data := demonstrations(towards)).findings
    assert len(learn_columns(*pilot(data), column_labels(data)).numbers) == 30  # a goal at 0 is recorded as well
