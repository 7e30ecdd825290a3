"""What rules make of what was measured, by hand: where each limit lies, and what is not a fault yet."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rpil.faults.checking import without_consequences
from rpil.faults.measured_columns import MeasuredColumns
from rpil.faults.motion import CommandRule, Jump, RepeatedFrames, Scale, Spike
from rpil.faults.rule import Fault, Measurements, above
from rpil.faults.still import FrozenSensor
from rpil.faults.tracking import Tracked
from rpil.faults.whole_rules import Length, OtherLag, Sign

M = 8


def columns(n=1, moving=1.0, is_action=False, memory=1.0):
    names, known = tuple(f"c{k}" for k in range(n)), (np.ones(n), np.ones(n), np.full(n, moving), np.full(n, memory))
    return MeasuredColumns(names, np.arange(n), np.full(n, is_action), *known, partner=np.full(n, -1))


def applied(rule, *measured, lengths=None, of=None):
    """A rule, of arrays (M,) or (M, C) of what its measure gave."""
    n = len(measured[0]) if measured else len(lengths)
    pairs = (SimpleNamespace(usual=np.full(100, 1.0), action=0, correlation=0.5),)
    none = np.zeros(0, dtype=int)
    tracked = Tracked(none, none, np.zeros(0), np.zeros(0, dtype=bool))
    learned = SimpleNamespace(columns=of or columns(), pairs=pairs, tracked=tracked)
    lengths = np.full(n, 100) if lengths is None else lengths
    every = {CommandRule.measure: (np.zeros((n, 0)),), rule.measure: measured}
    return rule(Measurements(learned, every, tuple(range(n)), lengths, None))


def found(rule):
    return [(fault.id, fault.first, fault.last) for fault in rule.findings()]


@pytest.mark.parametrize(
    ("values", "factor", "least", "expected"),
    [
        ([1, 1, 1, 1, 1], 3.0, 0.0, 3.0), ([1, 1, 1, 1.5, 9], 3.0, 0.0, 1.5 * 1.5**3),
        ([1, 1, 1, 1.5, 9], 4.0, 0.0, 1.5 * 4), ([0, 0, 0, 1, 9], 3.0, 1.0, 2 * 8),
        ([0, 0, 0, 1.01, 9], 3.0, 1.0, np.inf), ([0, 0, 0, 0, 9], 3.0, 0.0, 0.0),
    ],
)  # fmt: skip
def test_unusual_is_what_is_beyond_the_upper_quartile_and_how_far_the_quartiles_lie_apart(
    values, factor, least, expected
):
    rule = applied(Length, np.zeros((5, 1)))
    assert rule.fence(np.array(values, float), factor, least) == pytest.approx(expected)


def test_a_value_counts_in_limits_and_nothing_is_known_without_one():
    value, threshold, severity = above(np.array([3.0, 3.0, 3.0, 3.0]), np.array([2.0, 0.0, np.inf, np.nan]))
    np.testing.assert_array_equal(severity, [1.5, 3.0, np.nan, np.nan])
    np.testing.assert_array_equal((value[0], threshold[0]), (3.0, 2.0))


@pytest.mark.parametrize(
    ("lengths", "expected"),
    [
        ([100, 100, 100, 100, 100, 250], [(1.25, 200)]), ([100, 100, 100, 100, 100, 40], [(1.25, 50)]),
        ([100, 100, 100, 100, 100, 200], []),  # as long as the limit
        ([*[100] * 14, *[30] * 4], [(50 / 30, 50)] * 4),
        ([*[100] * 16, *[30] * 5], "unknown"),  # more than four, and than a tenth: another sampling rate
        ([*[100] * 16, *[300] * 5], "unknown"),
        ([50, 60, 60, 100, 200, 200], "unknown"),  # it is known what is too long, and not what is too short
    ],
)  # fmt: skip
def test_lengths_are_compared_where_both_limits_are_known(lengths, expected):
    rule = applied(Length, np.zeros((len(lengths), 1)), lengths=np.array(lengths))
    assert rule.silent == (("",) if expected == "unknown" else ())
    worst = [(fault.severity, fault.threshold) for fault in rule.findings()]
    assert worst == ([] if expected == "unknown" else expected)


@pytest.mark.parametrize(
    ("shift", "gain", "expected"),
    [
        ([3], [0.5], 0.5 / 0.09), ([-2], [0.5], 0.5 / 0.09), ([3], [0.05], None), ([3, -5], [0.5, 0.3], 0.5 / 0.09),
        ([3, 3, 3], [0.5, 0.5, 0.5], "unknown"),  # only five of eight have the usual lag
        ([3, 3, 3], [0.5, 0.02, 0.02], 0.5 / (0.05 * (5 / 3) ** 3)),  # what hardly gains has it
        ([3, *[0] * 7], [0.5, *[0.1] * 7], 0.5 / 0.39),
        ([3, 3, 3, *[0] * 5], [0.1] * 8, None),  # so much is gained by chance
    ],
)  # fmt: skip
def test_a_lag_is_another_where_most_have_the_usual_one(shift, gain, expected):
    rule = applied(OtherLag, np.array(shift + [0] * (M - len(shift))), np.array(gain + [0.0] * (M - len(gain))))
    assert rule.silent == (("",) if expected == "unknown" else ())
    worst = max((fault.severity for fault in rule.findings()), default=None)
    assert worst == (None if expected in ("unknown", None) else pytest.approx(expected))


def test_a_lag_of_few_steps_may_be_another_by_chance():
    shift, gain = np.array([3] + [0] * 7), np.array([0.3] + [0.0] * 7)
    for steps, found_in in ((2, [0]), (1, [])):  # two and a half standard deviations are .25, and .35
        rule = applied(OtherLag, shift, gain, lengths=np.full(M, steps))
        assert [fault.id for fault in rule.findings()] == found_in


@pytest.mark.parametrize(
    ("agreement", "steps", "expected"),
    [
        ([-0.36], 400, 1.2), ([-0.29], 400, None), ([0.9], 400, None), ([-0.6] * 2, 400, 2.0),
        ([-0.55], 100, 1.1), ([-0.45], 100, None),  # five standard deviations of 100 steps are .5
        ([-0.6] * 3, 400, "unknown"), ([0.29] * 8, 400, "unknown"),  # in most it is not as usual
    ],
)  # fmt: skip
def test_another_sign_is_that_of_few_and_beyond_chance(agreement, steps, expected):
    nothing, agreement = np.zeros(M), np.array(agreement + [0.5] * (M - len(agreement)))[:, None]
    rule = applied(Sign, nothing, nothing, agreement, lengths=np.full(M, steps))
    assert rule.silent == (("c0",) if expected == "unknown" else ())
    worst = max((fault.severity for fault in rule.findings()), default=None)
    assert worst == (None if expected in ("unknown", None) else pytest.approx(expected))


@pytest.mark.parametrize(("memory", "is_known"), [(0.71, True), (0.69, False)])
def test_leaps_are_known_where_a_step_tells_about_the_next(memory, is_known):
    size = np.array([[1.0]] * 7 + [[9.0]])
    rule = applied(Spike, size, np.full((M, 1), 5), np.full((M, 1), 5), size, size, of=columns(memory=memory))
    assert found(rule) == ([(7, 5, 5)] if is_known else [])
    assert rule.silent == (() if is_known else ("c0",))


def test_other_columns_with_the_fault_are_counted():
    still = np.where(np.arange(M)[:, None] == 3, [[30, 13, 12]], 1)
    ends, last = (np.full((M, 3), 0.0), np.full((M, 3), 10.0)), np.zeros((2, M), dtype=int)
    frozen = still, np.full((M, 3), 5), still + 1, np.full((M, 3), 5.0), *ends, *last
    (fault,) = applied(FrozenSensor, *frozen, of=columns(3)).findings()
    assert fault.sentence.endswith("(usual: up to 12 steps); the same in 1 more column")


def test_steps_are_told_with_their_time_where_it_is_known():
    data = Measurements(None, {}, (), np.array([3]), 1.0)
    assert data.in_steps(2) == "2 steps (2000 ms)"
    assert Measurements(None, {}, (), np.array([3]), None).in_steps(1) == "1 step"


def fault(rule, column="x", first=5, last=6, value=1.0, threshold=2.0):
    return Fault(rule, 3, first, last, column, value, threshold, 2.0, "")


@pytest.mark.parametrize(
    ("cause", "follows"),
    [
        (fault("length", value=1), False), (fault("length", value=300), True),  # what is too long holds more
        (fault("frozen sensor", first=6), True),  # it freezes there
        (fault("frozen sensor", first=1, last=5), True),  # or moves on
        (fault("frozen sensor", first=5, last=6), False), (fault("frozen sensor", "y", first=6), False),
        (replace(fault("frozen sensor", "y", first=6), sentence="y stays; the same in 5 more columns"), True),
    ],
)  # fmt: skip
def test_a_jump_follows_from_what_begins_or_ends_there(cause, follows):
    assert Jump.follows(fault("jump"), cause) is follows


def test_the_worst_finding_of_each_rule_stays_without_those_that_follow_from_another():
    jump, frozen = fault("jump"), fault("frozen sensor", first=6)
    lighter = replace(jump, severity=1.5, column="y")
    assert without_consequences([lighter, jump]) == [jump]
    assert [replace(jump, severity=of).to_dict()["severity"] for of in (2.0, np.inf)] == [2.0, None]
    assert without_consequences([lighter, jump, frozen]) == [frozen]
    assert without_consequences([jump, replace(frozen, id=4)]) == [jump, replace(frozen, id=4)]
    frozen, idle = fault("frozen sensor", first=6, last=9), fault("idle tail", last=9)  # which explains no jump
    assert without_consequences([jump, frozen]) == [frozen]
    assert {*without_consequences([jump, frozen, idle])} == {jump, idle}


@pytest.mark.parametrize(
    ("level", "change", "severity"),
    [
        (13, 13, 13.001 / 12.012),
        (0.05, 0.06, 1.001 / 0.061 / 12),
        *((*both, None) for both in ((13, 11), (11, 13), (0.05, 0.1), (0.1, 0.05))),
        (0.05, 0, None),  # what never moves has no unit
    ],
)
def test_another_scale_is_that_of_values_and_of_changes_beside_other_columns(level, change, severity):
    for others, moving in ((False, 0.25), (True, 0.25), (False, 0.24)):
        odd = (np.arange(M)[:, None] < 1) & [True, others, others]
        rule = applied(Scale, *(np.where(odd, of, 1.0) for of in (level, change)), of=columns(3, moving=moving))
        known = severity and moving == 0.25 and (not others or level > 1)
        assert [fault.severity for fault in rule.findings()] == pytest.approx([severity] if known else [])


@pytest.mark.parametrize(
    ("repeats", "most", "second", "severity"),
    [(4, 0, 0, 4 / 3), (3, 0, 0, 0), (0, 4, 0, 4 / 3), (0, 3, 0, 0), (0, 6, 3, 2), (0, 5, 3, 0)],
)
def test_rows_repeat_beyond_what_is_usual_or_with_their_actions(repeats, most, second, severity):
    of_one, place = np.arange(M) < 1, (9, 8 + most) if most else (5, 6)
    measured = of_one * repeats, np.full(M, 5), np.full(M, 2), np.full(M, 9), of_one * most, np.full(M, second)
    rule = applied(RepeatedFrames, *measured)
    assert found(rule) == [(0, *place)] * bool(severity)
    assert [fault.severity for fault in rule.findings()] == pytest.approx([severity] * bool(severity))


def test_a_leap_of_all_columns_is_beyond_the_quartiles_or_far_beyond_the_next():
    every = np.arange(5.0)[:, None]
    for second, limit in ((1.0, 2.35), (4.0, 8.35), (5.0, 9.15)):
        assert Jump.limit((None, None, None, every, None, np.full((5, 1), second))) == pytest.approx(limit)
