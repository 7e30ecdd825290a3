"""Rival groups: whether the lower demonstrations have a policy of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hand_made import Written, reference, same_actions
from problems import fit_data_of, make
from rpil.inference.held_out import HeldOutLogProb, held_out_model, log_reference
from rpil.inference.rivals import gain, look_below
from rpil.inference.settings import HeldOutSettings, JudgeSettings, RivalSettings
from rpil.inference.trimming import TrimmedFit, fit_group

UPPER = np.arange(8) < 4
LOWER = np.where(UPPER, -9.0, 1.0)  # times the gain of a policy of lower demonstrations on them


def looked(gains, upper=UPPER, **limits):
    settings = JudgeSettings(rivals=replace(RivalSettings(), **limits))
    model = Written(same_actions(len(upper)), gains, settings)
    return look_below(model.data, model, upper, fit_of(model, np.ones(len(upper), dtype=bool), 0.0), settings), model


def fit_of(model, group, gain) -> TrimmedFit:
    """A fit to a group that explains everybody with one gain."""
    log_prob = reference(model.data, model.settings) + gain
    return TrimmedFit(HeldOutLogProb(log_prob, log_prob), group, 1e-2, np.zeros(1))


def policies(of_upper, of_lower):
    """Gains of the policy of the upper group, and of those of any lower demonstrations."""
    return lambda group: np.asarray(of_upper if group[0] else of_lower, dtype=float)


def test_gains_are_medians_over_the_group_itself():
    of_upper, of_lower = [1.0, 2.0, 4.0, 9.0, -1, -1, -1, -1], [5.0, 5, 5, 5, 0.1, 0.2, 0.4, 0.9]
    found, _ = looked(policies(of_upper, of_lower))
    assert found.gain_upper == pytest.approx(3.0)
    assert found.gain_all_lower == found.gain_rival == pytest.approx(0.3)
    assert found.upper.tolist() == [0, 1, 2, 3]
    assert found.rival.tolist() == [4, 5, 6, 7]


@pytest.mark.parametrize(("own", "is_rival"), [(0.89, False), (0.91, True), (1.5, True)])
def test_a_rival_has_a_share_of_the_gain_of_the_upper_group(own, is_rival):
    found, _ = looked(policies([2.0] * 4 + [-1.0] * 4, LOWER * own), min_gain=0.45)
    assert found.gain_rival == pytest.approx(own)
    assert found.is_rival is is_rival


def test_the_limit_itself_is_enough():
    of_upper = [2.0] * 4 + [-1.0] * 4
    found, _ = looked(policies(of_upper, LOWER), min_gain=0.0)
    limit = found.gain_rival / found.gain_upper
    assert looked(policies(of_upper, LOWER), min_gain=limit)[0].is_rival


@pytest.mark.parametrize(("of_upper", "own"), [(2.0, 0.0), (2.0, -1e-6), (-2.0, -0.5)])
def test_a_policy_that_explains_nothing_is_no_rival(of_upper, own):
    found, _ = looked(policies([of_upper] * 4 + [-3.0] * 4, LOWER * own), min_gain=0.0)
    assert found.rival.tolist() == [4, 5, 6, 7]
    assert not found.is_rival


def test_policies_begin_with_the_worst_half_and_win_over_others():
    of_upper = np.array([2.0] * 4 + [-1.0, -1.0, -3.0, -3.0])

    def gains(group):
        if group[0]:
            return of_upper
        return LOWER * (1.0 if group[6:].all() and not group[5] else -1.0 if not group[4] else 0.0)

    found, model = looked(gains)
    assert [np.flatnonzero(group).tolist() for group in model.fitted] == [[0, 1, 2, 3]]
    cold = [np.flatnonzero(group).tolist() for group in model.copies[0].fitted]
    # all of them, the lower half, and those that its policy explains better until they stay the same
    assert cold == [[4, 5, 6, 7], [6, 7], [4, 5, 6, 7]]
    assert found.gain_all_lower == pytest.approx(0.0)


def test_rounds_end_where_the_rival_stays_the_same():
    _, model = looked(policies([2.0] * 4 + [-1.0] * 4, LOWER), max_iter=9)
    assert len(model.copies[0].fitted) == 2  # of all lower ones, whose lower half is all of them at one score


def test_a_demonstration_explained_as_well_by_both_is_no_rival():
    found, _ = looked(policies([2.0] * 4 + [1.0, 0.5, 0.5, 0.5], LOWER))
    assert found.rival.tolist() == [5, 6, 7]


@pytest.mark.parametrize(("min_group", "gain_rival"), [(2, 1.0), (3, -np.inf)])
def test_fewer_than_the_smallest_group_are_no_rival(min_group, gain_rival):
    found, _ = looked(policies([2.0] * 4 + [3.0, 3.0, 0.5, 0.5], LOWER), min_group=min_group)
    assert found.gain_rival == pytest.approx(gain_rival)
    assert found.is_rival is (min_group == 2)
    assert found.rival.tolist() == [6, 7]
    assert found.upper.tolist() == [0, 1, 2, 3]
    assert found.gain_all_lower == pytest.approx(1.0)


def test_policies_of_the_upper_group_are_not_fitted_twice():
    model = Written(same_actions(8), policies([2.0] * 4 + [-1.0] * 4, LOWER), JudgeSettings())
    found = look_below(model.data, model, UPPER, fit_of(model, UPPER, 0.7), JudgeSettings())
    assert found.gain_upper == pytest.approx(0.7)
    assert model.fitted == []
    found = look_below(model.data, model, UPPER, fit_of(model, np.arange(8) < 5, 0.7), JudgeSettings())
    assert found.gain_upper == pytest.approx(2.0)
    assert [group.tolist() for group in model.fitted] == [UPPER.tolist()]


def test_gain_is_measured_against_the_actions_of_the_group_alone():
    data = fit_data_of(make("random", 0))
    group, settings = np.arange(12) < 3, HeldOutSettings()
    log_prob = np.random.default_rng(0).normal(size=len(data.actions))
    by_hand = [
        np.mean((log_prob - log_reference(data, group, settings))[data.offsets[m] : data.offsets[m + 1]])
        for m in range(3)
    ]
    assert gain(data, log_prob, group, settings) == pytest.approx(np.median(by_hand))
    everyone = np.ones(12, dtype=bool)
    assert abs(gain(data, log_prob, group, settings) - gain(data, log_prob, everyone, settings)) > 1e-3


@pytest.mark.parametrize(("kind", "is_rival"), [("random", False), ("shifted", True)])
def test_noise_has_no_policy_and_other_actions_have(kind, is_rival):
    toy = make(kind, 1, n_good=10, n_bad=10, steps=(40, 60))
    data = fit_data_of(toy)
    model = held_out_model(data, 0, HeldOutSettings())
    found = look_below(data, model, toy.is_good, fit_group(data, model, toy.is_good, 1e-2), JudgeSettings())
    assert found.is_rival is is_rival
    assert found.gain_upper > 0.3
