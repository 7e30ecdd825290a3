"""One group of scores or two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit
from scipy.stats import beta, norm

from rpil.inference.groups import Groups, expert_share_interval, fit_groups, least_within, one_group, two_groups
from rpil.inference.settings import GroupSettings


def fitted(score, variance=None, steps=100, **settings) -> Groups:
    m = len(score)
    variance = np.full(m, 1e-4) if variance is None else variance
    return fit_groups(score, variance, np.full(m, steps), GroupSettings(**settings))


def best_two_piece_normal(score, variance):
    """Log-likelihood of the best of very many two-piece normals."""
    spreads = score.std() * np.geomspace(1e-3, 4, 60)
    modes = np.concatenate([score, np.linspace(score.min(), score.max(), 40)])
    best = -np.inf
    for mode in modes:
        sides = np.sqrt(spreads[:, None] ** 2 + variance)
        z = ((score - mode) / sides) ** 2 / 2
        left, right = ((z * of).sum(axis=1) for of in (score < mode, score >= mode))
        total = np.log(sides[:, None] + sides).sum(axis=2)
        best = max(best, len(score) * np.log(2 / np.sqrt(2 * np.pi)) - (left[:, None] + right + total).min())
    return best


@pytest.mark.parametrize("kind", ["normal", "skewed", "heavy tails", "two groups", "one spike"])
def test_one_group_finds_the_best_mode_and_spreads(kind):
    rng = np.random.default_rng(3)
    score = {
        "normal": rng.normal(size=40),
        "skewed": -rng.gamma(1.5, size=40),
        "heavy tails": rng.standard_t(2, size=40),
        "two groups": np.concatenate([rng.normal(size=25), 6 + rng.normal(size=15)]),
        "one spike": np.concatenate([rng.normal(size=20), 3 + 0.05 * rng.normal(size=20)]),
    }[kind]
    variance = 0.3 * score.var() * rng.gamma(2, size=40)
    found = one_group(score, variance)
    assert found >= best_two_piece_normal(score, variance) - 1e-9
    assert one_group(1e3 * score + 7, 1e6 * variance) == pytest.approx(found - 40 * np.log(1e3), abs=1e-4)


SETTINGS = GroupSettings()
QUANTILES = np.array([0.0, 0.2, 0.4, 0.6, 1.0])


def groups_of(log_bayes_factor=np.inf, spread=(0.04, 0.01), share=0.3, noise=0.5, quantiles=QUANTILES):
    return Groups(log_bayes_factor, np.array([0.0, 1.0]), np.array(spread), share, noise, quantiles)


def upper_by_hand(score, variance, spread=(0.04, 0.01), share=0.3, noise=0.5):
    """P(upper group) of one score."""
    score, widths = min(max(score, 0.0), 1.0), np.sqrt(np.array(spread) + noise * variance)
    lower = norm.pdf(score, 0.0, widths[0])
    upper = norm.pdf(score, 1.0, widths[1])
    return share * upper / (share * upper + (1 - share) * lower)


SCORES, VARIANCES = np.array([-1.0, 0.2, 0.45, 0.6, 0.8, 3.0]), np.array([0.1, 0.2, 0.0, 0.05, 0.3, 0.1])


def test_log_odds_of_two_groups_and_of_one_by_hand():
    found = groups_of().log_odds(SCORES, VARIANCES)
    by_hand = [logit(upper_by_hand(*pair)) for pair in zip(SCORES, VARIANCES, strict=True)]
    np.testing.assert_allclose(found, by_hand + 1e-3 * np.tanh(SCORES - 0.4), atol=1e-9)
    np.testing.assert_array_equal(groups_of(-5.0).upper(SCORES, VARIANCES), np.array(by_hand) > 0)
    found = groups_of(-np.inf).log_odds(SCORES, VARIANCES)
    np.testing.assert_allclose(found, 1e-3 * np.tanh(SCORES - 0.4))
    mixed = groups_of(1.0).log_odds(SCORES, VARIANCES)
    p_two, two = expit(1.0), expit(by_hand)
    np.testing.assert_allclose(mixed, logit(p_two * two + (1 - p_two) / 2) + 1e-3 * np.tanh(SCORES - 0.4))


def test_log_odds_are_finite_and_keep_the_order():
    found = groups_of(spread=(1e-6, 1e-6)).log_odds(np.array([-3.0, -2.0, 2.0, 3.0]), np.zeros(4))
    assert (np.diff(found) > 0).all()
    np.testing.assert_allclose(np.abs(found), logit(1 - 1e-9), atol=2e-3)


def test_distance_is_in_deviations_of_the_wider_group():
    assert groups_of(spread=(0.04, 0.01)).distance == groups_of(spread=(0.01, 0.04)).distance == pytest.approx(5.0)
    assert groups_of(1.5).p_two == pytest.approx(expit(1.5))


TWO = np.concatenate([np.linspace(-0.2, 0.2, 9), np.linspace(0.9, 1.1, 7)])


@pytest.mark.parametrize(("given", "is_fitted"), [({"steps": 8}, True), ({"steps": 7}, False)])
def test_means_of_few_steps_are_one_group(given, is_fitted):
    assert (fitted(TWO, **given).log_bayes_factor > 0) is is_fitted


def test_few_scores_and_equal_ones_are_one_group():
    four = np.array([0.0, 0.01, 1.0, 1.01])
    assert np.isfinite(fitted(four).log_bayes_factor)
    assert fitted(four[:3]).log_bayes_factor == -np.inf
    single = fitted(np.full(6, 3.0))
    assert single.log_bayes_factor == -np.inf
    np.testing.assert_allclose(single.mean, 3.0)
    np.testing.assert_allclose(fitted(four[:3]).spread, four[:3].var())


def test_quantiles_are_of_all_scores():
    np.testing.assert_allclose(fitted(TWO).quantiles, np.sort(TWO))
    many = np.random.default_rng(0).normal(size=402)
    np.testing.assert_allclose(fitted(many, steps=1).quantiles, np.quantile(many, np.linspace(0, 1, 201)))


def test_the_bayes_factor_is_that_of_bic():
    variance = np.random.default_rng(0).gamma(2, 1e-3, size=len(TWO))
    groups = fitted(TWO, variance)
    each = (replace(SETTINGS, noise_shares=(c,)) for c in SETTINGS.noise_shares)
    two = max((two_groups(TWO, variance, settings) for settings in each), key=lambda found: found[0])
    one = max(one_group(TWO, c * variance) for c in SETTINGS.noise_shares)
    assert groups.log_bayes_factor == pytest.approx(two[0] - one - np.log(len(TWO)))
    np.testing.assert_allclose(groups.mean, two[1].mean)
    assert groups.noise == two[1].noise


def test_of_very_many_scores_quantiles_are_fitted():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0, 0.1, 300), rng.normal(1, 0.1, 100)])
    groups = fitted(score, max_scores=40)
    chosen = np.sort(score)[np.linspace(0, 399, 40).astype(int)]
    few = fitted(chosen)
    assert groups.log_bayes_factor == pytest.approx(few.log_bayes_factor)
    np.testing.assert_allclose(groups.mean, few.mean)
    assert len(groups.quantiles) == 201


def test_two_groups_have_the_likelihood_that_they_say():
    rng = np.random.default_rng(1)
    variance = rng.gamma(2, 0.01, size=len(TWO))
    log_likelihood, found = two_groups(TWO, variance, replace(SETTINGS, noise_shares=(0.5,)))
    widths = np.sqrt(found.spread + 0.5 * variance[:, None])
    density = norm.pdf(TWO[:, None], found.mean, widths) @ [1 - found.share, found.share]
    assert log_likelihood == pytest.approx(np.log(density).sum(), abs=1e-3)


def test_two_groups_are_where_em_stands_still():
    """Means, spreads and share are those of their own responsibilities, with the prior of one demonstration."""
    rng = np.random.default_rng(1)
    score = np.concatenate([rng.normal(0, 0.3, 12), rng.normal(1, 0.2, 9)])
    variance = rng.gamma(2, 0.01, size=21)
    _, found = two_groups(score, variance, GroupSettings(noise_shares=(0.5,), tol=1e-13, max_iter=5000))
    widths = found.spread + 0.5 * variance[:, None]
    joint = norm.pdf(score[:, None], found.mean, np.sqrt(widths)) * [1 - found.share, found.share]
    own = joint / joint.sum(axis=1, keepdims=True)
    assert found.share == pytest.approx((own[:, 1].sum() + 1) / 23, abs=1e-6)
    np.testing.assert_allclose(
        found.mean, (own / widths * score[:, None]).sum(axis=0) / (own / widths).sum(axis=0), atol=1e-6
    )
    prior = score.var() / 16
    # of the true score, given the score: its variance and the square of its distance from the mean
    shrinkage = found.spread / widths
    square = shrinkage * 0.5 * variance[:, None] + (shrinkage * (score[:, None] - found.mean)) ** 2
    np.testing.assert_allclose(found.spread, ((own * square).sum(axis=0) + prior) / (own.sum(axis=0) + 1), atol=1e-6)


def test_no_first_step_moves_a_parameter_by_more_than_1():
    seen, far = [], np.array([30.0, 20.0])
    loss = lambda x: seen.append(x) or (float((x - far) @ (x - far)), 2 * (x - far))  # noqa: E731
    assert least_within(loss, np.zeros(2), np.array([[-99.0, 99.0]] * 2)) == pytest.approx(0.0, abs=1e-9)
    assert np.abs(seen[1] - seen[0]).max() == 1


def test_groups_of_one_are_no_groups():
    assert two_groups(np.array([0.0, 5.0, 5.0, 5.0, 5.01]), np.full(5, 1e-6), SETTINGS) is None
    assert two_groups(np.arange(3.0), np.full(3, 1e-6), SETTINGS) is None


def test_interval_of_the_share():
    proba = np.array([0.9] * 6 + [0.1] * 2)
    mean, low, high = expert_share_interval(proba, 0.5)
    assert mean == pytest.approx(0.7)
    np.testing.assert_allclose([low, high], beta.ppf([0.025, 0.975], 1 + 5.6, 1 + 2.4))
    np.testing.assert_allclose(expert_share_interval(proba, 0.49)[1:], beta.ppf([0.025, 0.975], 2, 2))
    assert expert_share_interval(np.ones(5), 0.1) == pytest.approx((1.0, beta.ppf(0.025, 2, 2), 1.0))
    assert expert_share_interval(np.zeros(5), 0.1)[:2] == (0.0, 0.0)
