"""What holds between commands and states in any recording: planted in few and all, clean, and not known."""

from types import SimpleNamespace

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.faults.checking import check
from rpil.faults.motion import ActionIsState, CommandAgainstState, CommandRule, Exchanged
from rpil.faults.rule import Measurements, Rule
from rpil.faults.tracking import Tracked
from rpil.faults.whole_rules import OtherLag

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


def left(of, rest=0.9):
    """What is left of commands at the lags from -10 to 10."""
    return np.array([of.get(lag, rest) for lag in range(-10, 11)])


M = 8
USUAL = {"slope": 1, "share": 1, "best": 0, "mine": 0.01, "other": 1, "low": 0, "gap": 0, "high": 0}
USUAL |= {"left": left({2: 0.01})}


def commands(rule, many=1, both=False, fits=True, lag=2, **odd):
    """A rule about commands, c2 and c3, of c0 and c1: c2, or both, are odd in the first `many` of eight."""
    rows = np.arange(M)[:, None] < many
    each = {name: [True] if name == "left" else [True, both] for name in USUAL}
    *own, rest = (np.where(rows & each[k], odd.get(k, usual), 1.0 * usual) for k, usual in USUAL.items())
    tracked = Tracked(np.array([2, 3]), np.array([0, 1]), np.ones(2), np.full(2, fits), lag, True)
    columns = SimpleNamespace(names=("c0", "c1", "c2", "c3"), spread=np.ones(4))
    learned = SimpleNamespace(columns=columns, pairs=(), tracked=tracked)
    every = {CommandRule.measure: (*own, rest), OtherLag.measure: ((), ())}
    return rule(Measurements(learned, every, tuple(range(M)), np.full(M, 100), None))


def apart(gap, error=0.0):
    return {"low": gap - 1.645 * error, "gap": gap, "high": gap + 1.645 * error}


def times(ratio):
    return "scale", abs(np.log(ratio)) / np.log(3)


UNFIT, EVERY = {"fits": False, "slope": 1.29, "share": 0.5}, {"fits": False, "many": M}


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        *((apart(*of), ("offset", severity)) for *of, severity in ((0.3, 1.5), (-0.3, 0.06, 1.5), (0.3, 0.08, 1.25))),
        *((apart(gap) | {"many": n}, ("offset", severity)) for gap, n, severity in ((0.3, 2, 1.5), (0.51, 3, 2.55))),
        (apart(0.49) | {"many": 3}, None),  # as of a load
        (apart(0.3) | UNFIT, ("offset", 1.5)),
        *((apart(0.3) | UNFIT | more, None) for more in ({"share": 0.49}, {"slope": 1.31})),
        ({"slope": 1 / 3.1, "share": 0.8}, times(3.1)),
        ({"slope": -1.0, "share": 0.8}, ("sign", 2.0)),
        *(({"slope": slope, "share": 0.79}, None) for slope in (3.1, -1.0)),
        ({"slope": 40.0, "fits": False, "many": 7}, times(40)),
        *(({"slope": slope} | EVERY, times(slope)) for slope in (57.3 * 1.04, 1 / 1000)),
        ({"slope": -1.3} | EVERY, ("sign", 2.0)),
        *(({"slope": slope} | EVERY, None) for slope in (40.0, 57.3 * 1.06, -1.4)),  # as it may be meant
    ],
)
def test_a_command_is_at_the_level_of_its_state_in_its_unit_and_sense(case, expected):
    found = [*commands(CommandAgainstState, **case).findings()]
    faulty = range(case.get("many", 1) if expected else 0)
    assert [(fault.id, fault.column, fault.rule) for fault in found] == [(m, "c2", expected[0]) for m in faulty]
    assert [fault.severity for fault in found] == pytest.approx([expected[1] for _ in faulty])


LAGS = [  # what is left, in how many, and the steps and the severity that are found
    *(({5: 0.01, 2: 0.021}, 1, (3, 2.1**0.5)), ({3: 0.01, 2: 0.041}, 1, (1, 4.1**0.5)), ({5: 0.01}, 2, (3, 90**0.5))),
    *(({-5: 0.01}, 3, (5, 8.0)), ({5: 0.01, 2: np.inf}, 1, None), ({1: 0.01, 2: 0.039}, 1, None), ({5: 0.3}, 6, None)),
    *((of, 3, "unknown") for of in ({5: 0.01}, {-1: 0.01}, {-5: 0.01, 1: 0.02})),
    ({5: 0.3}, 7, "unknown"),
]
BOTH = {"both": True, "best": 1}


@pytest.mark.parametrize(
    ("rule", "case", "expected"),
    [
        *((OtherLag, {"left": left(of), "many": n}, expected) for of, n, expected in LAGS),
        (OtherLag, {"left": left({5: 0.01}), "lag": 0}, None),  # most are at fault
        (ActionIsState, {"left": left({0: 0.044})}, (0.044 / 0.9, 0.05 / (0.044 / 0.9))),
        (ActionIsState, {"left": left({0: 0.0})}, (0, 1e6)),
        *((ActionIsState, {"left": left({0: 0.044} | of)}, None) for of in ({1: 0.8}, {-1: 0.8}, {0: 0.0, 1: 0.0})),
        *((Exchanged, {"mine": 2.4, "other": of, **BOTH}, (of, 0.48 / of)) for of in (0.15, 0.19)),
        *((Exchanged, {"mine": 2.4, **more}, None) for more in ({"other": 0.15}, {"other": 0.21, **BOTH})),
    ],
)
def test_a_command_is_followed_later_by_its_own_state(rule, case, expected):
    rule = commands(rule, **case)
    assert bool(rule.silent) == (expected == "unknown")
    found = [(fault.id, fault.value, fault.severity, "c2 goes with c1" in fault.sentence) for fault in rule.findings()]
    n = case.get("many", 1) if isinstance(expected, tuple) else 0
    faulty = [(m, *expected, isinstance(rule, Exchanged)) for m in range(n)] or np.zeros((0, 4))
    np.testing.assert_allclose(np.reshape(found, (-1, 4)), faulty)
