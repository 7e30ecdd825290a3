"""Rival groups: whether the lower demonstrations have a policy of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hand_made import Written, reference, same_actions
from problems import fit_data_of, make, make_continuous
from rpil.inference.held_out import HeldOutRidge, held_out_model, log_reference
from rpil.inference.rivals import gains, is_credible, is_learnable, look_below, shared_gains
from rpil.inference.settings import ClaimSettings, HeldOutSettings, JudgeSettings, RivalSettings
from rpil.inference.trimming import TrimmedFit, fit_group

UPPER = np.arange(8) < 4
LOWER = np.where(UPPER, -9.0, 1.0)  # times the gain of a policy of lower demonstrations on them


def looked(of_policies, upper=UPPER, at=None, **limits):
    claims = ClaimSettings(min_group=limits.pop("min_group", 2))
    settings = JudgeSettings(rivals=replace(RivalSettings(), **limits), claims=claims)
    model = Written(same_actions(len(upper)), of_policies, settings, gains_at=at)
    return look_below(model.data, model, upper, fit_of(model, np.ones(len(upper), dtype=bool), 0.0), settings), model


def fit_of(model, group, gain) -> TrimmedFit:
    """A fit to a group that explains everybody with one gain."""
    log_prob = reference(model.data, model.settings) + gain
    return TrimmedFit(log_prob, group, 1e-2, np.zeros(1))


def policies(of_upper, of_lower):
    """Gains of the policy of the upper group, and of those of any lower demonstrations."""
    return lambda group: np.asarray(of_upper if group[0] else of_lower, dtype=float)


def test_gains_are_medians_over_the_group_itself():
    of_upper, of_lower = [1.0, 2.0, 4.0, 9.0, -1, -1, -1, -1], [5.0, 5, 5, 5, 0.1, 0.2, 0.4, 0.9]
    found, _ = looked(policies(of_upper, of_lower))
    assert found.gain_upper == pytest.approx(3.0)
    assert found.upper.tolist() == [0, 1, 2, 3]
    assert found.rival.tolist() == [4, 5, 6, 7]


# The robust standard error of 1, 2, 3, 4, 5 is 1.2533 x 1.4826 x 1 / sqrt(5) = .831, and 3 is 3.610 of it.
@pytest.mark.parametrize(("standard_errors", "credible"), [(3.60, True), (3.62, False)])
def test_a_gain_is_credible_by_robust_standard_errors(standard_errors, credible):
    assert is_credible(np.array([3.0, 1.0, 5.0, 2.0, 4.0]), standard_errors) is credible
    assert is_credible(np.array([3.0, 1.0, 5000.0, 2.0, 4.0]), standard_errors) is credible
    assert is_credible(np.array([1.0, 2, 3, 4, 5] * 4), 2 * standard_errors) is credible  # four times as many: half


@pytest.mark.parametrize(("gain", "credible"), [(1e-9, True), (0.0, False), (-1.0, False)])
def test_a_gain_without_errors_is_credible_above_zero(gain, credible):
    assert is_credible(np.full(5, gain), 2.0) is credible


def sharing(ratios, n_lapses):
    """Shared gain of the first three of five demonstrations, whose steps have these log-ratios by turns."""
    settings = JudgeSettings(rivals=replace(RivalSettings(), n_lapses=n_lapses))
    data, group = same_actions(5, discrete=True), np.arange(5) < 3
    by_turns = np.repeat([*ratios, (50.0, 50.0), (50.0, 50.0)], 2, axis=0).ravel()
    return float(
        np.median(shared_gains(data, log_reference(data, group, settings.held_out) + by_turns, group, settings))
    )


# Steps that are 3 times and 1/3 times as likely: mean log((1 - l) r + l) is 0 at l = 0, log(1.1 x .96667) / 2 at .95,
# and largest at l = 1/2, with log(2 x 2/3) / 2.
@pytest.mark.parametrize(("n_lapses", "ratio"), [(1, 1.0), (2, 1.1 * (0.05 / 3 + 0.95)), (20, 4 / 3)])
def test_shared_gain_is_that_of_the_best_lapse(n_lapses, ratio):
    middle = (np.log(3), -np.log(3))
    assert sharing([(2.0, 2.0), middle, (-4.0, -4.0)], n_lapses) == pytest.approx(np.log(ratio) / 2, abs=1e-9)


def test_a_policy_that_explains_each_step_shares_its_gain_without_lapses():
    assert sharing([(0.1, 0.3), (0.5, 0.7), (9.0, 9.0)], 11) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("shared", "limit", "is_rival"),
    [
        *[(0.49, 0.5, True), (0.51, 0.5, False), (1.5, 0.5, False), (-3.0, 0.5, True)],
        *[(0.2, 0.1, False), (0.2, 0.3, True), (1.0, 1.0, False)],
    ],
)
def test_a_rival_shares_less_than_half_of_its_gain_with_the_upper_group(shared, limit, is_rival):
    own = 0.2
    of_policies = policies([2.0] * 4 + [-1.0] * 4, LOWER * own)
    found, model = looked(of_policies, at=lambda group: np.full(8, shared * own), max_shared_gain=limit)
    assert found.is_rival is is_rival
    ((fitted_to, scale_of),) = model.scaled
    assert fitted_to.tolist() == UPPER.tolist()
    assert scale_of.tolist() == (~UPPER).tolist()


# Gains of .3 to .6 around .45: the robust standard error is 1.858 x .1 / 2 = .0929, a fifth of it (4.84).
@pytest.mark.parametrize(("standard_errors", "is_rival"), [(4.8, True), (4.9, False)])
def test_the_gain_of_a_rival_is_credible(standard_errors, is_rival):
    of_lower = np.append(LOWER[:4], [0.3, 0.4, 0.5, 0.6])
    found, model = looked(policies([2.0] * 4 + [-1.0] * 4, of_lower), standard_errors=standard_errors)
    assert found.rival.tolist() == [4, 5, 6, 7]
    assert found.is_rival is is_rival
    assert len(model.scaled) == is_rival  # else no policy is fitted
    assert not found.is_noise


@pytest.mark.parametrize(("of_upper", "own"), [(2.0, 0.0), (2.0, -1e-6), (-2.0, -0.5)])
def test_a_policy_that_explains_nothing_is_no_rival(of_upper, own):
    found, _ = looked(policies([of_upper] * 4 + [-3.0] * 4, LOWER * own))
    assert found.rival.tolist() == [4, 5, 6, 7]
    assert not found.is_rival


@pytest.mark.parametrize(("middle", "is_noise"), [(0.19, True), (0.21, False), (-1.0, True)])
def test_a_policy_of_noise_gains_less_than_a_tenth(middle, is_noise):
    of_lower = np.append(LOWER[:4], middle + np.array([-0.5, -0.4, 0.4, 0.5]))
    assert looked(policies([2.0] * 4 + [-3.0] * 4, of_lower))[0].is_noise is is_noise
    assert looked(policies([1.0] * 4 + [-3.0] * 4, of_lower), max_noise=0.2)[0].is_noise is is_noise


@pytest.mark.parametrize(("gain", "is_noise"), [(1e-3, False), (0.0, True)])
def test_a_credible_gain_is_no_noise(gain, is_noise):
    of_upper = [2.0] * 4 + [-1.0] * 4
    assert looked(policies(of_upper, LOWER * gain))[0].is_noise is is_noise
    assert looked(policies(of_upper, LOWER * gain), max_noise=0.0)[0].is_noise is is_noise  # at the limit itself


def test_policies_begin_with_the_worst_half_and_win_over_others():
    of_upper = np.array([2.0] * 4 + [-1.0, -1.0, -3.0, -3.0])

    def of_policies(group):
        if group[0]:
            return of_upper
        return LOWER * (1.0 if group[6:].all() and not group[5] else -1.0 if not group[4] else 0.0)

    _, model = looked(of_policies)
    assert [np.flatnonzero(group).tolist() for group in model.fitted] == [[0, 1, 2, 3]]
    cold = [np.flatnonzero(group).tolist() for group in model.copies[0].fitted]
    assert cold == [[4, 5, 6, 7], [6, 7]]  # all of them, and the lower half


def test_a_demonstration_explained_as_well_by_both_is_no_rival():
    found, _ = looked(policies([2.0] * 4 + [1.0, 0.5, 0.5, 0.5], LOWER))
    assert found.rival.tolist() == [5, 6, 7]


@pytest.mark.parametrize("min_group", [2, 3])
def test_fewer_than_the_smallest_group_are_no_rival(min_group):
    found, _ = looked(policies([2.0] * 4 + [3.0, 3.0, 0.4, 0.4], LOWER), min_group=min_group)
    assert found.is_rival is (min_group == 2)
    assert found.rival.tolist() == [6, 7]
    assert found.upper.tolist() == [0, 1, 2, 3]
    assert found.gain_upper == pytest.approx(2.0)
    assert not found.is_noise


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
    assert gains(data, log_prob, group, settings) == pytest.approx(by_hand)
    of_everyone = gains(data, log_prob, np.ones(12, dtype=bool), settings)
    assert of_everyone.shape == (12,)
    assert np.abs(of_everyone[:3] - by_hand).max() > 1e-3


def below(toy, **limits):
    """Those below the good ones."""
    data = fit_data_of(toy)
    model = held_out_model(data, 0, HeldOutSettings())
    settings = JudgeSettings(rivals=RivalSettings(**limits))
    return look_below(data, model, toy.is_good, fit_group(data, model, toy.is_good, 1e-2), settings)


@pytest.mark.parametrize(
    ("kind", "is_rival", "is_noise"), [("random", False, True), ("shifted", True, False), ("noisy", False, False)]
)
def test_noise_has_no_policy_and_other_actions_have(kind, is_rival, is_noise):
    found = below(make(kind, 1, n_good=10, n_bad=10, steps=(40, 60)))
    assert (found.is_rival, found.is_noise) == (is_rival, is_noise)
    assert found.gain_upper > 0.3


def noisier(seed):
    """Demonstrations by one linear policy, of which the bad ones have errors ten times as large."""
    toy = make_continuous("none", seed, n_good=10, n_bad=10, steps=(40, 60), noise=0.1)
    errors = np.random.default_rng(seed).normal(size=toy.actions.shape)
    return replace(toy, actions=toy.actions + np.where(toy.is_good[toy.groups][:, None], 0.0, errors))


@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_version_of_the_upper_policy_is_no_rival_at_its_own_scale(seed, monkeypatch):
    found = below(noisier(seed))
    assert len(found.rival) == 10  # their own policy explains them better: it knows how large their errors are
    assert not found.is_rival
    assert not found.is_noise
    at = HeldOutRidge.log_prob_at
    own = lambda model, weight, other, ridge: at(model, weight, weight, ridge)  # noqa: E731  the upper group's own scale
    monkeypatch.setattr(HeldOutRidge, "log_prob_at", own)
    found = below(noisier(seed), max_noise=0.0)
    assert found.is_rival


def test_another_linear_policy_is_a_rival():
    assert below(make_continuous("smooth", 0, n_good=10, n_bad=10, steps=(40, 60))).is_rival


@pytest.mark.parametrize(("least", "learnable"), [(3, True), (4, False)])
def test_few_demonstrations_are_learnable_where_a_policy_of_as_many_explains_them(least, learnable):
    settings = JudgeSettings()
    model = Written(same_actions(8), lambda group: np.full(8, 1.0 if group.sum() >= least else -1.0), settings)
    group = np.arange(8) < 6
    assert is_learnable(model.data, model, group, 3, 1e-2, settings) is learnable
    (chosen,) = model.copies[0].fitted
    assert chosen.sum() == 3
    assert not chosen[~group].any()
    assert is_learnable(model.data, model, group, 20, 1e-2, settings)  # more than there are: all of them


def test_which_few_demonstrations_are_tried_does_not_depend_on_their_order():
    data = make("random", 0, n_good=6, n_bad=6).problem()
    order, group = np.random.default_rng(0).permutation(12), np.arange(12) < 8
    chosen = []
    for places in (np.arange(12), order):
        model = Written(data.select(places), lambda tried: np.ones(12), JudgeSettings())
        is_learnable(model.data, model, group[places], 3, 1e-2, JudgeSettings())
        chosen.append({*places[model.copies[0].fitted[0]].tolist()})
    assert chosen[0] == chosen[1] < {*range(8)}
