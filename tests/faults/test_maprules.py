"""Faults of the map between states and actions, and of whole demonstrations, are named."""

from __future__ import annotations

import numpy as np

from recordings import changed, demonstrations, recording
from rpil.faults import settings
from rpil.faults.checking import check
from rpil.faults.rule import Learned

CLEAN = recording()
M = 5  # the demonstration with the fault
SIGN = np.array([1, -1, 1])


def test_the_sign_of_one_action_of_one_state_is_named():
    single = recording(joints=1)
    report = check(demonstrations(changed(single, M, actions=-single[M][1])))
    assert {f.id for f in report.findings} == {M}
    assert ("sign", M) in {(f.rule, f.id) for f in report.findings}


def test_the_sign_of_a_column_is_named_where_that_of_another_cannot_be_known():
    rng = np.random.default_rng(0)
    noisy = [(x, np.column_stack([a, rng.normal(size=len(a))])) for x, a in CLEAN]
    report = check(demonstrations(changed(noisy, M, actions=noisy[M][1] * [1, -1, 1, 1])))
    assert [(f.rule, f.id) for f in report.findings] == [("sign", M)]
    assert report.unknown["sign"] == ("action 3",)


def test_each_action_goes_with_the_state_that_follows_it_whatever_its_unit(monkeypatch):
    monkeypatch.setattr(settings, "MAX_PARTNERS", 1)
    units = np.array([1, 1e3, 1e-3])
    learned = Learned.of(demonstrations([(x * units, a) for x, a in CLEAN]))
    assert sorted((pair.action, pair.state, pair.lag) for pair in learned.pairs) == [
        (3, 0, 2),
        (4, 1, 2),
        (5, 2, 2),
    ]


def test_lags_are_told_in_steps_and_in_time():
    delayed = np.concatenate([np.repeat(CLEAN[M][1][:1], 4, axis=0), CLEAN[M][1][:-4]])
    report = check(demonstrations(changed(CLEAN, M, actions=delayed)), fps=50.0)
    assert report.usual["lag"] == "observation 0 follows action 0 after 2 steps (40 ms)"
    assert "4 steps (80 ms) sooner" in next(f.sentence for f in report.findings if f.rule == "lag")


def test_a_long_lag_is_looked_for_farther():
    late = [(np.concatenate([np.repeat(x[:1], 25, axis=0), x[:-25]]), a) for x, a in CLEAN]
    assert check(demonstrations(late)).usual["lag"].endswith("after 27 steps")


def test_state_and_action_of_one_step_have_no_lag():
    rng = np.random.default_rng(0)
    report = check(demonstrations([(a + 1e-3 * rng.normal(size=a.shape), a) for _, a in CLEAN]))
    assert report.usual["lag"] == "observation 1 follows action 1 after 0 steps"


def test_level_and_columns_that_rest_at_first_are_no_faults():
    late = [
        (x + m * 0.2, np.where(np.arange(len(a))[:, None] < 60 * (m == M), a[60], a)) for m, (x, a) in enumerate(CLEAN)
    ]
    report = check(demonstrations(late))
    assert not {"sign", "frozen action"} & {f.rule for f in report.findings}


def test_quaternions_that_change_sign_are_no_faults():
    rng, turned = np.random.default_rng(1), []
    for x, a in CLEAN:
        angle = np.cumsum(rng.normal(size=len(x))) * 0.02
        quaternion = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle])
        flips = np.where(np.arange(len(x)) // 40 % 2, -1.0, 1.0)[:, None] * rng.choice([-1, 1])
        turned.append((np.column_stack([x, quaternion * flips]), a))
    assert check(demonstrations(turned)).findings == ()


def test_level_that_several_share_is_a_session_and_what_rests_in_many_is_no_fault():
    many = {1, 4, 8}
    offset = [(x, a + 0.5 * (m in many)) for m, (x, a) in enumerate(CLEAN)]
    assert not check(demonstrations(offset)).findings
    resting = [(x, np.where(SIGN < 0, a[:1], a) if m in many | {M, 6} else a) for m, (x, a) in enumerate(CLEAN * 2)]
    assert "never moves" not in check(demonstrations(resting)).counts
