"""One group of scores or two."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.inference.groups import Groups, fit_groups, one_group, two_groups
from rpil.inference.settings import GroupSettings


def fitted(score, variance=None, labels=None) -> Groups:
    m = len(score)
    variance = np.full(m, 1e-4) if variance is None else variance
    labels = np.zeros(m, dtype=int) if labels is None else labels
    return fit_groups(score, variance, labels, np.full(m, 100.0), np.full(m, 100), GroupSettings())


def test_two_clear_groups_have_their_share_and_means():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0.0, 0.1, 14), rng.normal(1.0, 0.1, 6)])
    groups = fitted(score)
    assert groups.p_two > 0.99
    np.testing.assert_allclose(groups.mean, [0.0, 1.0], atol=0.1)
    assert groups.share == pytest.approx(0.3, abs=0.1)
    log_odds = groups.log_odds(score, np.full(20, 1e-4), GroupSettings())
    assert (log_odds[:14] < -2.2).all()
    assert (log_odds[14:] > 2.2).all()


@pytest.mark.slow
@pytest.mark.parametrize("draw", ["normal", "skewed"])
def test_one_group_is_rarely_taken_for_two(draw):
    rng, found = np.random.default_rng(0), []
    for _ in range(20):
        score = rng.normal(size=30) if draw == "normal" else -rng.gamma(4.0, size=30)
        found.append(fitted(score).p_two >= 0.9)
    assert np.mean(found) <= 0.1


def test_log_odds_rise_with_the_score():
    rng = np.random.default_rng(0)
    for spread in (0.1, 1.0):
        groups = fitted(np.concatenate([rng.normal(0.0, spread, 10), rng.normal(2.0, 0.1, 10)]))
        at = np.linspace(-6, 6, 101)
        assert (np.diff(groups.log_odds(at, np.full(101, 1e-4), GroupSettings())) > 0).all()


def test_scores_of_one_group_are_ranked_without_certainty():
    score = np.linspace(0, 1, 40)
    groups = fitted(score, np.full(40, 1e-6))
    assert groups.p_two < 0.5
    proba = 1 / (1 + np.exp(-groups.log_odds(score, np.full(40, 1e-6), GroupSettings())))
    assert (np.diff(proba) > 0).all()
    assert proba[0] > 0.1
    assert proba[-1] < 0.9
    alike = fitted(score, np.full(40, 10.0))  # nothing but error
    assert alike.graded == 0.0
    assert np.abs(alike.log_odds(score, np.full(40, 10.0), GroupSettings())).max() < 0.3


def test_two_groups_with_one_centre_are_refused():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0.0, 1.0, 20), rng.normal(0.0, 0.05, 80)])
    found = two_groups(score, np.full(100, 1e-6), np.zeros(100, dtype=int), 1.0, GroupSettings())
    assert found is None or found[1].mean[1] - found[1].mean[0] >= np.sqrt(found[1].spread.mean())


def test_label_fixes_the_group():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0.0, 0.3, 10), rng.normal(1.0, 0.3, 10)])
    labels = np.zeros(20, dtype=int)
    labels[10 + np.argsort(score[10:])[:4]] = -1
    plain, told = (
        two_groups(score, np.full(20, 1e-4), given, 1.0, GroupSettings()) for given in (np.zeros(20, dtype=int), labels)
    )
    assert plain is not None
    assert told is not None
    assert told[1].mean[0] > plain[1].mean[0] + 0.1
    assert told[0] < plain[0]


def test_one_group_is_at_least_as_likely_as_a_normal():
    score = np.random.default_rng(0).normal(size=50)
    normal = -0.5 * (np.log(2 * np.pi * score.var()) + 1) * 50
    assert normal <= one_group(score, np.full(50, 1e-9)) < normal + 5


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
@pytest.mark.parametrize("noise", [1e-3, 0.3])
def test_one_group_finds_the_best_mode_and_spreads(kind, noise):
    rng = np.random.default_rng(3)
    score = {
        "normal": rng.normal(size=40),
        "skewed": -rng.gamma(1.5, size=40),
        "heavy tails": rng.standard_t(2, size=40),
        "two groups": np.concatenate([rng.normal(size=25), 6 + rng.normal(size=15)]),
        "one spike": np.concatenate([rng.normal(size=20), 3 + 0.05 * rng.normal(size=20)]),
    }[kind]
    variance = noise * score.var() * rng.gamma(2, size=40)
    found = one_group(score, variance)
    assert found >= best_two_piece_normal(score, variance) - 1e-9
    assert one_group(1e3 * score + 7, 1e6 * variance) == pytest.approx(found - 40 * np.log(1e3), abs=1e-4)
