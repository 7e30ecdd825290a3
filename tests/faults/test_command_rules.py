"""What holds between commands and states in any recording: planted in few and all, clean, and not known."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.faults.checking import check
from rpil.faults.rule import Rule

CLEAN = [(np.c_[x, 40 * x[:, :1] ** 2], np.c_[a, 40 * a[:, :1] ** 2]) for x, a in recording(12, joints=5)]
RULES = {"action is state", "exchanged", "offset", "sign", "scale", "lag"}


KINDS = {
    "offset": lambda x, a: (x + np.array([0, 0, 1.5, 0, 0, 0]), a),
    "exchanged": lambda x, a: (x, a[:, [1, 0, 2, 3, 4, 5]]),
    "action is state": lambda x, a: (x, x),
    "sign": lambda x, a: (x, a * [1, -1, 1, 1, 1, 1]),
    "scale": lambda x, a: (x * [1, 1, 1, 57.29578, 1, 1], a),
    "lag": lambda x, a: (x[7:], a[:-7]),
}


@pytest.mark.parametrize("rule", KINDS)
@pytest.mark.parametrize("share", [2, 6, 9, 12])
def test_a_fault_is_found_in_every_share_of_the_set_and_the_others_are_not_accused(rule, share):
    episodes = [KINDS[rule](x, a) if m < share else (x, a) for m, (x, a) in enumerate(CLEAN)]
    report = check(demonstrations(episodes))
    assert {fault.id for fault in report.findings if fault.rule == rule} == set(range(share))
    assert {fault.id for fault in report.findings} == set(range(share))
    if share > 3:
        (line,) = [one for one in report.lines if one.rule == rule]
        assert line.ids == tuple(range(share))
        said = "all of 12 demonstrations" if share == 12 else f"{share} of 12 demonstrations, 0 to {share - 1}"
        assert line.sentence.startswith(said)


@pytest.mark.parametrize("lag", [1, 2, 5])
@pytest.mark.parametrize("error", [0.0, 0.02])
def test_clean_commands_have_no_fault(lag, error):
    rng = np.random.default_rng(lag)
    episodes = [(a[:-lag] + error * rng.normal(size=a[:-lag].shape), a[lag:]) for _, a in CLEAN]
    assert not RULES & {*check(demonstrations(episodes)).counts}


@pytest.mark.parametrize("n", [3, 4, 7, 10])
def test_few_steps_tell_no_lag_but_that_an_action_is_the_state(n):
    for same, expected in ((False, set()), (True, {"lag"} if n > 4 else set())):
        short = [(x[40:][:n], (x if same else a)[40:][:n]) for x, a in CLEAN[:2]]
        assert RULES & {*check(demonstrations([*short, *CLEAN[2:]])).counts} == expected


def test_a_hand_that_holds_something_and_an_arm_that_sags_under_its_load_have_no_offset():
    """The hand's command is below the width of what it holds, and equal where it is open. All joints of the arm lie a
    quarter of a spread below their commands, in some poses more."""
    hand = [np.where(np.arange(len(x)) % 80 < 40, 1.0, 0.4) for x, _ in CLEAN]
    held = [(np.c_[x, h], np.c_[a, np.where(h < 1, 0.1, 1.0)]) for (x, a), h in zip(CLEAN, hand, strict=True)]
    sagging = [(x - 0.25 * CLEAN[0][0].std(axis=0) * (1 + 0.2 * np.cos(x)), a) for x, a in CLEAN]
    for made in (held, sagging):
        assert "offset" not in check(demonstrations(made)).counts


@pytest.mark.parametrize("kind", ["speeds", "normalised", "noise"])
def test_of_actions_that_are_no_commands_nothing_is_known(kind):
    rng = np.random.default_rng(0)
    made = {
        "speeds": [(np.cumsum(a, axis=0), a) for _, a in CLEAN],
        "normalised": [(50 * x + 3, a) for x, a in CLEAN],
        "noise": [(rng.normal(size=x.shape), rng.normal(size=a.shape)) for x, a in CLEAN],
    }
    report = check(demonstrations(made[kind]))
    assert not {"offset", "action is state"} & {*report.counts}
    assert {"offset", "action is state"} <= {*report.not_checked}


def test_offsets_of_either_sign_say_how_far_and_which_is_above():
    report = check(demonstrations([(x, a - [0, 2, 0, 0, 0, 0]) for x, a in CLEAN]))
    assert report.lines[0].sentence == (
        "all of 12 demonstrations: action 1 is 2 below observation 1 throughout: the zero of one of them has moved"
    )
    assert Rule.named["offset"].grade == report.lines[0].grade == "broken"
