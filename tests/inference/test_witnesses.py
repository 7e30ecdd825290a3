"""Evidence of answers and witnesses, against another optimiser, enumerated answers, and planted witnesses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime, minimize
from scipy.special import expit, log_softmax, logit

from hand_made import answers_of
from rpil.inference.settings import AnswerSettings
from rpil.inference.witnesses import (
    NOTHING,
    held_out,
    is_contrast,
    laplace,
    levels_of,
    log_ratio,
    most_alike,
    prior_counts,
    regression,
    reliability,
    weigh,
)

NAN, SETTINGS = np.nan, AnswerSettings()
SURE = logit(1 - SETTINGS.error)
ONE_SIDED, ANCHOR = np.array([1.0, NOTHING, NOTHING, NOTHING]), np.array([0.0, 0.8, 0.0, 0.5])
WIDE = np.ones(4)


def made(labels=(), pairs=(), tied=(), strength=SURE, seed=0, m=14):
    """Rows of three columns, evidence of answers, and how many rows are pairs."""
    values = np.random.default_rng(seed).normal(size=(m, 3))
    some = answers_of([*labels, *[0] * (m - len(labels))], pairs, tied=tied)
    rows, n_pairs = some.rows(values)
    return rows, some.evidence(strength), n_pairs


MIXED = made([1, -1, 1], [(0, 1), (5, 4)], [(6, 7), (8, 3)])
CASES = [
    (MIXED, WIDE),
    ((MIXED[0], MIXED[1] + np.append(np.linspace(-2, 3, 14), np.zeros(6)), 6), WIDE),  # and witnesses
    (made(pairs=[(2, 9)]), WIDE),
    (made(), ONE_SIDED),  # those that agree are good
    (made([1] * 6), ONE_SIDED),
    (made([-1] * 6), ONE_SIDED),
    (made([1, 0, -1], strength=1.0), WIDE),
]


def log_joint(w, rows, evidence, precision):
    """Of w and the evidence, up to a constant: with a probability r evidence is right."""
    right, yes = expit(evidence), expit(rows @ w)
    return np.log(right * yes + (1 - right) * (1 - yes)).sum() - 0.5 * (precision * (w - ANCHOR) ** 2).sum()


@pytest.mark.parametrize(("world", "precision"), CASES)
def test_weights_are_the_most_probable_ones_by_another_optimiser_and_certain_by_what_is_expected(world, precision):
    """Evidence of one side moves the offset alone."""
    scale, start = np.sqrt(precision), ANCHOR * np.sqrt(precision)
    options = {"maxiter": 20_000, "maxfev": 20_000, "xatol": 1e-7, "fatol": 1e-11}
    method = {"method": "Nelder-Mead", "options": options}
    best = minimize(lambda v: -log_joint(v / scale, *world[:2], precision), start, **method)
    rows, evidence, _ = world
    (mean, covariance), information = laplace(rows, evidence, ANCHOR, precision), np.diag(precision)
    np.testing.assert_allclose(mean, best.x / scale, atol=2e-3)
    for row, one in zip(rows, evidence, strict=True):
        for answer in (one, -one):

            def log_proba(w, row=row, answer=answer):
                return np.log(expit(answer) * expit(row @ w) + expit(-answer) * expit(-row @ w))

            slope = approx_fprime(mean, log_proba, 1e-6)
            information = information + np.exp(log_proba(mean)) * np.outer(slope, slope)
    np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-4, atol=1e-6)
    expected = [row @ mean / np.sqrt(1 + np.pi / 8 * row @ covariance @ row) for row in rows]
    np.testing.assert_allclose(regression(*world, SETTINGS, slice(None)), expected)


@pytest.mark.parametrize(
    ("evidence", "n_pairs", "contrast"),
    [
        ([1.0, -0.1], 0, True), ([1.0, 0.0, 2.0], 0, False), ([-1.0, -2.0], 0, False), ([0.0, 0.0, 0.0], 1, False),
        ([0.0, 0.0, 1.0], 1, True), ([1.0, -1.0, 1.0], 3, True),
    ],
)  # fmt: skip
def test_contrast_is_evidence_of_both_sides_or_of_a_pair(evidence, n_pairs, contrast):
    assert is_contrast(np.array(evidence), n_pairs) is contrast


def test_held_out_log_odds_are_those_by_other_folds():
    rows, evidence, _ = made([1, -1] * 7)
    found = held_out(rows, evidence, SETTINGS)
    for m in range(14):
        others = np.where(np.arange(14) % 5 == m % 5, 0.0, evidence)
        assert found[m] == pytest.approx(regression(rows, others, 0, SETTINGS, slice(m, m + 1))[0])


@pytest.mark.parametrize(
    ("values", "most", "levels"),
    [
        ([5.0, NAN, 1.0, 5.0, 5.0, 3.0], 3, [2, -1, 0, 2, 2, 1]), ([5.0, NAN, 1.0, 5.0, 3.0], 2, [1, -1, 0, 1, 0]),
        ([*range(13)], 4, np.repeat(range(4), [3, 3, 4, 3])), ([0] * 8 + [1, 2, 3, 4], 4, [1] * 8 + [2, 3, 3, 3]),
        ([NAN, NAN], 9, [-1, -1]),
    ],
)  # fmt: skip
def test_levels_are_the_different_values_or_quantiles(values, most, levels):
    np.testing.assert_array_equal(levels_of(np.array(values, dtype=float), most), levels)


def test_counts_beforehand_are_four_demonstrations_of_each_sort_in_which_the_highest_speaks_for_good():
    counts = prior_counts(np.array([0, 0, 0, 1, 2, -1]), SETTINGS)
    np.testing.assert_allclose(counts.sum(axis=1), 4.0)
    ratio = log_ratio(counts)
    assert ratio[2] - ratio[0] == pytest.approx(2.0)
    assert ratio[1] - ratio[0] == pytest.approx(1.0)
    assert ratio[3] == 0.0
    middle = np.sqrt(counts[0] * counts[1])
    np.testing.assert_allclose(middle / middle[1], [3.5 / 1.5, 1, 1])
    other = replace(SETTINGS, prior_log_odds=0.0, prior_counts=9.0)
    np.testing.assert_allclose(prior_counts(np.array([0, 1, 1]), other), [[3.375, 5.625]] * 2)


def alike(levels):
    return [np.flatnonzero(own).tolist() for own in most_alike(levels)[0]]


def test_the_witness_that_is_most_correlated_either_way_is_not_asked_about_a_witness():
    first, second = np.repeat([0, 1, 2], 4), np.array([0, 1, 2, 0, 1, 2, 2, 0, 1, 2, 0, 2])
    opposed = np.append(2 - first[:-1], 1)
    assert alike([first, second, opposed]) == [[0, 2], [0, 1], [0, 2]]
    assert (alike([first, opposed]), alike([first])) == ([[0, 1], [0, 1]], [[0]])
    assert alike([first, np.zeros(12, dtype=int), second])[0] == [0, 2], "a constant is alike to nothing"


# How reliable a witness is.
def test_reliability_is_the_fixed_point_of_em_and_the_most_probable_by_another_optimiser():
    rng = np.random.default_rng(0)
    log_odds, level = rng.normal(0, 2, 30), rng.integers(-1, 3, 30)
    prior, known = prior_counts(level, SETTINGS), level >= 0
    ratio, gained = reliability(log_odds, level, prior, n_iter=3000)
    proba = expit(log_odds + ratio[level])[known]
    counts = prior + np.stack([np.bincount(level[known], each, 3) for each in (1 - proba, proba)])
    np.testing.assert_allclose(ratio, log_ratio(counts), atol=1e-9)

    def loss(v):
        bad, good = log_softmax(v.reshape(2, 3), axis=1)
        each = np.logaddexp(good[level] - np.logaddexp(0, -log_odds), bad[level] - np.logaddexp(0, log_odds))
        return -each[known].sum() - (prior * np.stack([bad, good])).sum()

    best = log_softmax(minimize(loss, np.zeros(6)).x.reshape(2, 3), axis=1)
    np.testing.assert_allclose(ratio[:3], best[1] - best[0], atol=1e-4)
    shares = np.bincount(level[known]) + 0.5
    gain = -loss(best.ravel()) - (prior * best).sum() - np.log(shares / shares.sum())[level[known]].sum()
    assert gained == pytest.approx(gain, rel=1e-4)
    some = reliability(log_odds[known], level[known], prior)
    np.testing.assert_allclose(some[0], reliability(log_odds, level, prior)[0])


# Witnesses beside answers, and beside each other.
def world(*right, m=80, n_labels=30, seed=0):
    """Rows in which one column tells quality a little, labels of some, and flags that are `right` so often."""
    rng = np.random.default_rng(seed)
    good = rng.random(m) < 0.6
    sign = 2.0 * good - 1
    columns = np.column_stack([0.8 * sign + rng.normal(size=m), rng.normal(size=m), rng.normal(size=m)])
    flags = np.stack([np.where(rng.random(m) < each, good, ~good) for each in right], axis=1).astype(float)
    labels = np.where(np.arange(m) < n_labels, SURE * sign, 0.0)
    return np.column_stack([np.ones(m), columns]), labels, 0, flags


@pytest.mark.parametrize(("right", "sign"), [(0.85, 1), (0.15, -1), (0.5, 0)])
def test_answers_confirm_a_planted_witness_or_turn_it_and_a_coin_counts_for_nothing(right, sign):
    rows, labels, n_pairs, flags = world(right, m=600, n_labels=500)
    low, high = int(flags.argmin()), int(flags.argmax())
    flags[[3, 170]] = NAN
    found = weigh(rows, labels, n_pairs, flags, SETTINGS)
    assert found.evidence[[3, 170], 0].tolist() == [0, 0]
    np.testing.assert_allclose(found.evidence[[low, high], 0], [-logit(right), logit(right)], atol=0.5 if sign else 0.1)
    assert (found.confirmed[0] > 0.99 and found.sign[0] == sign) if sign else found.confirmed[0] < 0.1


def test_the_evidence_of_one_witness_is_its_reliability_given_answers_and_columns():
    rows, labels, n_pairs, flags = world(0.8, n_labels=12)
    level = flags[:, 0].astype(int)
    log_odds = regression(rows, labels, n_pairs, SETTINGS, slice(None)) + labels
    prior = prior_counts(level, SETTINGS)
    ratio, gain = reliability(log_odds, level, prior)
    found = weigh(rows, labels, n_pairs, flags, SETTINGS)
    beforehand = reliability(held_out(rows, labels + log_ratio(prior)[level], SETTINGS), level, prior)[1]
    confirmed = max(expit(gain - np.log(len(rows))), expit(beforehand - 2.5))
    assert found.confirmed[0] == pytest.approx(confirmed)
    np.testing.assert_allclose(found.evidence[:, 0], confirmed * ratio[level])


@pytest.mark.parametrize(("right", "confirmed"), [(0.95, True), (0.5, False)])
def test_a_flag_alone_has_its_prior_strength_if_columns_confirm_it(right, confirmed):
    rows, labels, n_pairs, flags = world(right, n_labels=0)
    found, level = weigh(rows, labels, n_pairs, flags, SETTINGS), flags[:, 0].astype(int)
    prior = prior_counts(level, SETTINGS)
    strength = log_ratio(prior)[level]
    np.testing.assert_allclose(found.evidence[:, 0], found.confirmed[0] * strength * confirmed)
    gain = reliability(held_out(rows, strength, SETTINGS), level, prior)[1]
    assert found.confirmed[0] == pytest.approx(expit(gain - 2.5))
    assert ((found.confirmed[0] > 0.5), found.heard) == (confirmed, (int(confirmed),))


@pytest.mark.parametrize("n_known", [160, 40])
def test_equal_witnesses_count_as_one_and_two_that_err_by_themselves_as_two(n_known):
    rows, labels, n_pairs, flags = world(0.85, 0.85, m=160, n_labels=30)
    flags[n_known:] = np.nan
    said = [weigh(rows, labels, n_pairs, flags[:, own], SETTINGS).evidence.sum(axis=1) for own in ([0], [0, 0], [0, 1])]
    np.testing.assert_allclose(said[1], said[0], atol=0.3)
    assert np.abs(said[2]).max() > 1.3 * np.abs(said[0]).max()


@pytest.mark.parametrize(("n_labels", "beside"), [(0, True), (30, True), (30, False)])
def test_two_witnesses_that_err_together_do_not_confirm_each_other(n_labels, beside):
    """Beside labels, or a witness that is right."""
    rows, labels, n_pairs, flags = world(0.85, m=160, n_labels=n_labels)
    rng = np.random.default_rng(1)
    fashion = rng.random(160) < 0.5
    twins = np.stack([fashion ^ (rng.random(160) < 0.05) for _ in range(2)], axis=1)
    found = weigh(rows, labels, n_pairs, np.column_stack([twins, flags])[:, : 2 + beside], SETTINGS)
    assert (found.confirmed > 0.5).tolist() == [False, False, True][: 2 + beside]
    assert np.abs(found.evidence[:, :2]).max() < 0.2


def test_two_witnesses_that_contradict_each_other_are_not_confirmed_without_an_answer():
    rising, tiled = np.repeat([0, 1], 8), np.tile([0, 1], 8)
    for one, other, opposed in ((rising, 1 - rising, True), (rising, rising, False), (rising, tiled, False)):
        assert most_alike([one, other])[1].tolist() == [opposed] * 2
    assert not most_alike([np.zeros(16, dtype=int), tiled])[1].any()
    rng = np.random.default_rng(0)
    good = np.arange(80) % 2
    rows = np.column_stack([np.ones(80), 2.0 * good + rng.normal(size=80), np.zeros(80)])
    grade = good + 0.3 * rng.normal(size=80)
    for sign, sure in ((1, True), (-1, False)):
        both = np.column_stack([grade, sign * good])
        found = weigh(rows, np.zeros(80), 0, both, SETTINGS)
        assert ((found.confirmed > 0.5) == sure).all()


def test_witnesses_that_are_nearly_one_are_all_left_out():
    coin = np.random.default_rng(1).integers(0, 2, 60)
    other = np.random.default_rng(2).integers(0, 2, 60)
    assert alike([coin, coin, coin, other])[:3] == [[0, 1, 2]] * 3
    known = np.where(np.arange(60) < 30, coin, -1)
    assert alike([known, np.where(np.arange(60) < 30, other, -1), coin])[0] == [0, 2], "where both are known"
    rows = np.column_stack([np.ones(60), np.random.default_rng(3).normal(size=(60, 2))])
    labels = np.zeros(60)
    labels[:4] = 3.9, -3.9, 3.9, -3.9
    assert (weigh(rows, labels, 0, np.column_stack([coin] * 3).astype(float), SETTINGS).confirmed < 0.5).all()
