"""Bayesian logistic regression on answers, against numerical integration and hand-made answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.special import expit, logit
from scipy.stats import rankdata

from hand_made import answers_of
from rpil.data.errors import DataError
from rpil.inference import answers as module
from rpil.inference.answers import Answers, check_copied_labels, posterior
from rpil.inference.settings import AnswerSettings

NAN, SETTINGS = np.nan, AnswerSettings()


def test_what_is_known_is_counted():
    assert not Answers.none(0).count
    assert not answers_of([0, 0]).count
    some = answers_of([1, 0, -1, 0], [(0, 1)], [NAN, 2.0, 3.0, NAN])
    assert some.count == 4  # the outcome of one that is labelled is no answer more
    assert answers_of([1, 0, -1, 0], [(0, 1)], tied=[(0, 2), (1, 3)]).count == 5
    labelled = Answers.of_labels(np.array([1, 0, -1]))
    assert labelled.count == 2
    assert labelled.pairs.shape == (0, 2)


def test_answers_about_some_of_the_demonstrations():
    some = answers_of([1, 0, -1, 0], [(0, 1), (3, 2), (2, 0)], [NAN, 2.0, 3.0, 4.0], tied=[(0, 3), (1, 3)])
    some = some.select([2, 0, 3])
    assert some.labels.tolist() == [-1, 1, 0]
    assert some.pairs.tolist() == [[2, 0], [0, 1]]
    assert some.tied.tolist() == [[1, 2]]
    np.testing.assert_array_equal(some.outcome, [3.0, NAN, 4.0])
    assert answers_of([1, 0], [(0, 1)]).select([1]).pairs.shape == (0, 2)


def test_some_of_the_answers_in_the_order_of_rows():
    some = answers_of([1, 0, -1, 0], [(0, 1), (3, 2)], [NAN, 2.0, 3.0, 1.0], tied=[(1, 2), (0, 3)])
    assert len(some.rows(np.eye(4))[1]) == some.count == len(some.are_outcomes) == 8
    assert some.are_outcomes.tolist() == [False, False, True, True, False, False, False, False]
    less = some.only(np.array([False, True, True, False, False, True, False, True]))
    assert less.labels.tolist() == [0, 0, -1, 0]
    np.testing.assert_array_equal(less.outcome, [NAN, 2.0, 3.0, NAN])
    assert (less.pairs.tolist(), less.tied.tolist()) == ([[3, 2]], [[0, 3]])
    assert some.labels.tolist() == [1, 0, -1, 0]


def test_sides_of_answers():
    assert answers_of(m=3).sides == set()
    assert answers_of([1, 0, 1]).sides == {1}
    assert answers_of(m=2, outcome=[0.0, 0.0]).sides == {-1}
    assert answers_of([1, 0], outcome=[NAN, 0.0]).sides == {1, -1}
    assert answers_of([1, 0], outcome=[0.0, NAN]).sides == {1}  # a label goes first
    assert answers_of(m=2, pairs=[(0, 1)]).sides == {1, -1}
    assert answers_of(m=2, tied=[(0, 1)]).sides == set()
    assert answers_of([1, 0], tied=[(0, 1)]).sides == {1}


def test_ranks_of_an_outcome_are_shares_that_are_lower_ties_half_and_flags_are_themselves():
    for outcome, ranks in (
        ([5.0, NAN, 1.0, 5.0, 3.0, 9.0], np.array([6, NAN, 1, 6, 3, 9]) / 10),
        ([-3, 8, NAN, 8, 8], np.array([1, 5, NAN, 5, 5]) / 8),
        ([4.0, NAN], [0.5, NAN]),
        ([0, 1, NAN, 1, 1], [0, 1, NAN, 1, 1]),
        ([NAN] * 3, [NAN] * 3),
    ):
        np.testing.assert_allclose(answers_of(m=len(outcome), outcome=outcome).ranks(), ranks)


def test_rows_are_labels_then_outcomes_then_differences_of_pairs():
    channels = np.array([[1.0, 2.0], [3.0, 5.0], [7.0, 11.0], [13.0, 17.0]])
    some = answers_of([0, -1, 0, 1], [(0, 2), (3, 1)], [4.0, 5.0, 6.0, NAN], tied=[(1, 0)])
    rows, targets = some.rows(channels)
    assert rows.tolist() == [
        [1, 3, 5],
        [1, 13, 17],
        [1, 1, 2],
        [1, 7, 11],
        [0, 2, 3],
        [0, -6, -9],
        [0, 10, 12],
    ]
    # 1 is labelled: its outcome is known, and counts in the ranks of the others alone
    np.testing.assert_allclose(targets, [0, 1, 1 / 6, 5 / 6, 0.5, 1, 1])


def made(seed=0, m=14, columns=3):
    """Channels, and answers of all sorts."""
    rng = np.random.default_rng(seed)
    channels = rng.normal(size=(m, columns))
    labels = np.where(rng.random(m) < 0.4, np.sign(channels[:, 1] + 0.3 * rng.normal(size=m)), 0).astype(np.int64)
    outcome = np.where(rng.random(m) < 0.4, channels[:, 0] + rng.normal(size=m), NAN)
    return channels, answers_of(labels, [(0, 1), (2, 3), (5, 4)], outcome, tied=[(6, 7), (8, 3)])


def prior(columns, direction):
    """Mean and precision of w."""
    mean = np.zeros(columns + 1)
    mean[1], mean[-1] = 1.0, SETTINGS.group_weight
    precision = SETTINGS.precision if direction else module.NOTHING
    return direction * mean, np.append(SETTINGS.offset_precision, np.full(columns, precision))


def log_joint(w, rows, targets, mean, precision, error):
    """Of w and the answers, up to the constant of the prior: written again from the formula."""
    yes = (1 - 2 * error) * expit(rows @ w) + error
    return targets @ np.log(yes) + (1 - targets) @ np.log(1 - yes) - 0.5 * precision @ (w - mean) ** 2


def hypotheses(directions=(1.0, -1.0, 0.0)):
    """Direction and error rate of each normal distribution."""
    return [(direction, error) for direction in directions for error in SETTINGS.error_rates]


def test_means_have_no_slope_by_finite_differences():
    channels, some = made()
    found, (rows, targets) = posterior(channels, some, SETTINGS), some.rows(channels)
    for mean, (direction, error) in zip(found.mean, hypotheses(), strict=True):
        start, precision = prior(3, direction)
        slope = approx_fprime(mean, log_joint, 1e-6, rows, targets, start, precision, error)
        np.testing.assert_allclose(slope / np.sqrt(precision), 0.0, atol=1e-2 if direction == 0 else 1e-3)
        assert np.abs(mean - start).max() > (0.05 if direction else 0)


def test_covariances_are_inverse_expected_information():
    channels, some = made()
    found, (rows, _) = posterior(channels, some, SETTINGS), some.rows(channels)
    for k, (direction, error) in enumerate(hypotheses()):
        information = np.diag(prior(3, direction)[1])
        for row in rows:
            yes = (1 - 2 * error) * expit(row @ found.mean[k]) + error
            slope = approx_fprime(found.mean[k], lambda w, a=row, e=error: (1 - 2 * e) * expit(a @ w) + e, 1e-7)
            information = information + np.outer(slope, slope) / (yes * (1 - yes))
        np.testing.assert_allclose(found.covariance[k], np.linalg.inv(information), atol=1e-5)


PAIR_CHANNEL = np.array([0.9, -0.4, 0.3, -1.2, 0.5, 0.1])
PAIRS, TIED = [(0, 1), (2, 3), (1, 3), (5, 4), (0, 4)], [(0, 3), (4, 5)]


def integrated(rows, targets, direction, error):
    """Log-evidence of answers about pairs, where one weight is all there is."""
    grid = np.linspace(-12, 12, 2_001)
    joint = [
        log_joint(np.array([0.0, w]), rows, targets, np.array([0.0, direction * 2.0]), np.array([0.25, 1.0]), error)
        for w in grid
    ]
    return np.log(np.exp(joint).sum() * (grid[1] - grid[0]) / np.sqrt(2 * np.pi))


def test_evidence_is_that_of_numerical_integration():
    rows, targets = answers_of(m=6, pairs=PAIRS, tied=TIED).rows(PAIR_CHANNEL[:, None])
    tried = hypotheses((1.0, -1.0))
    anchor, error = np.array([[0.0, direction * 2.0] for direction, _ in tried]), np.array([[e] for _, e in tried])
    precision, luck = np.tile([0.25, 1.0], (len(tried), 1)), np.repeat(error, len(rows), axis=1)
    evidence = module._laplace(rows, targets, anchor, precision, luck, error)[2]
    np.testing.assert_allclose(evidence, [integrated(rows, targets, *each) for each in tried], atol=0.2)
    nothing = module._laplace(rows[:0], targets[:0], anchor, precision, luck[:, :0], error)[2]
    np.testing.assert_allclose(nothing, 0.0, atol=1e-9)


def test_posterior_of_directions_and_error_rates():
    some = answers_of(m=6, pairs=PAIRS)
    rows, targets = some.rows(PAIR_CHANNEL[:, None])
    found = posterior(PAIR_CHANNEL[:, None], some, SETTINGS)
    log_weight = np.array([integrated(rows, targets, *each) for each in hypotheses((1.0, -1.0))])
    log_weight = np.append(log_weight + np.log(np.repeat([0.425, 0.075], 2)), np.log([0.5] * 2) + 5 * np.log(0.5))
    weight = np.exp(log_weight) / np.exp(log_weight).sum()
    np.testing.assert_allclose(np.exp(found.log_weight), weight, atol=0.015)
    assert np.exp(found.log_weight).sum() == pytest.approx(1.0)
    assert found.p_nothing == pytest.approx(weight[4:].sum(), abs=0.01)


def test_without_answers_the_ranking_is_by_agreement():
    rng = np.random.default_rng(0)
    channels = np.column_stack([rng.normal(size=(9, 3)), np.zeros(9)])
    found = posterior(channels, answers_of(m=9), SETTINGS)
    # equally sure: the higher in agreement, the more likely good
    channels[:, 1:3] = 0.0
    np.testing.assert_array_equal(rankdata(found.proba(channels)), rankdata(channels[:, 0]))
    np.testing.assert_allclose(np.exp(found.log_weight), np.repeat([0.25, 0.25], 2))
    np.testing.assert_allclose(found.mean[0], [0, 1, 0, 0, SETTINGS.group_weight], atol=1e-6)
    np.testing.assert_allclose(found.covariance[0], np.diag([4, 1 / 16, 1 / 16, 1 / 16, 1 / 16]), atol=1e-9)


@pytest.mark.parametrize("sort", [1, -1])
def test_answers_of_one_side_never_turn_the_direction(sort):
    """However many good ones are at the bottom: with a bad one at the top they do."""
    channels = np.column_stack([np.linspace(-2, 2, 30), np.linspace(-1, 1, 30)])
    labels = sort * np.where(sort * channels[:, 0] < -0.5, 1, 0)
    one_side = posterior(channels, answers_of(labels), SETTINGS)
    assert (one_side.mean[:2, 1] > 0).all()
    assert len(one_side.mean) == 2 * len(SETTINGS.error_rates)  # the answers may follow nothing
    assert (one_side.mean[:2, 1] > 0).all()
    labels[sort * channels[:, 0] > 1.9] = -sort
    both = posterior(channels, answers_of(labels), SETTINGS)
    assert both.proba(channels)[-1] < both.proba(channels)[0]


def test_proba_by_hand():
    channels, some = made()
    found = posterior(channels, some, SETTINGS)
    by_hand = np.zeros(len(channels))
    for k, weight in enumerate(np.exp(found.log_weight)):
        for m, row in enumerate(np.column_stack([np.ones(len(channels)), channels])):
            told = found.mean[k][0] + SETTINGS.sharpness * row[1:] @ found.mean[k][1:]
            moderated = told / np.sqrt(1 + np.pi / 8 * (row @ found.covariance[k] @ row))
            by_hand[m] += weight * expit(moderated)
    np.testing.assert_allclose(found.proba(channels), by_hand)
    soft = posterior(channels, some, replace(SETTINGS, sharpness=0.5))
    assert np.abs(logit(soft.proba(channels))).max() < np.abs(logit(by_hand)).max()


def test_labels_of_one_sort_do_not_move_the_share():
    """Known good demonstrations were chosen for being good: the ones far below them may still be bad."""
    channels = np.column_stack([np.linspace(-2, 2, 21), np.repeat([-1.0, 0.0, 1.0], 7)])
    for sort in (1, -1):
        labels = sort * (sort * channels[:, 0] > 0.5).astype(int)
        one_sort = answers_of(labels.tolist(), [(20, 0)])
        rows, _ = one_sort.rows(channels)
        np.testing.assert_array_equal(rows[:, 0], 0.0)
        np.testing.assert_array_equal(rows[:-1, 1:], channels[labels != 0])
        found = posterior(channels, one_sort, SETTINGS)
        np.testing.assert_allclose(found.mean[:, 0], 0.0, atol=1e-6)
        assert found.proba(channels)[0] < 0.1 < 0.9 < found.proba(channels)[-1]
    labels[-1] = 1
    assert answers_of(labels.tolist()).rows(channels)[0][:, 0].all()  # both sorts
    with_outcome = answers_of([1, 1, 0], outcome=[NAN, NAN, 1.0])
    assert with_outcome.rows(channels[:3])[0][:, 0].all()  # an outcome was not chosen for its sort


def test_copies_with_labels_that_contradict_each_other_are_refused_in_one_sentence():
    copy_of, ids = np.array([0, 1, 0, 1]), ["a", "b", "c", "d"]
    check_copied_labels(Answers.of_labels(np.array([1, -1, 1, 0])), copy_of, ids)
    with pytest.raises(DataError) as error:
        check_copied_labels(Answers.of_labels(np.array([1, -1, 0, 1])), copy_of, ids, "f.csv")
    assert str(error.value) == "f.csv: 'd' is labelled good and 'b', a copy of it, bad; change one of the labels."


def test_copies_share_a_label_and_an_outcome():
    known = Answers(np.array([0, 0, 1, 0]), np.empty((0, 2), dtype=int), np.array([np.nan, 1.0, np.nan, 2.0]))
    shared = known.shared(np.array([0, 1, 0, 1]))
    assert shared.labels.tolist() == [1, 0, 1, 0]
    np.testing.assert_array_equal(shared.outcome, [np.nan, 1.0, np.nan, 2.0])
    of_three = known.shared(np.array([1, 1, 2, 1]))
    assert of_three.outcome[0] == 1.5, "the mean of its copies where its own is unknown"


def test_flags_of_copies_that_contradict_each_other_change_no_other_row():
    copy_of = np.array([0, 1, 2, 3, 0])
    one, other = (answers_of(m=5, outcome=[1, 0, 0, 1, last]).once(copy_of) for last in (1, 0))
    np.testing.assert_array_equal(one.ranks(), [1, 0, 0, 1])
    np.testing.assert_array_equal(other.ranks(), [0.5, 0, 0, 1])
    np.testing.assert_array_equal(other.only(np.arange(4) > 0).ranks()[1:], other.ranks()[1:])


def test_returns_of_copies_are_no_flag_where_their_means_are_0_and_1():
    np.testing.assert_array_equal(
        answers_of(m=4, outcome=[0, 2, 0, 0]).once(np.array([0, 0, 2, 3])).ranks(), np.array([5, 2, 2]) / 6
    )


def test_lucky_outcomes_are_flags_alone_and_bad_ones_are_often_lucky():
    """All succeed but the last five, by hand: P(1) = luck + (1 - luck - e) P(good)."""
    channels = np.column_stack([np.linspace(2, -2, 20), np.repeat([1.0, -1.0], 10)])
    flags = answers_of(m=20, outcome=[1.0] * 15 + [0.0] * 5)
    found, (rows, targets) = posterior(channels, flags, SETTINGS), flags.rows(channels)
    errors = SETTINGS.error_rates
    lucks = [max(luck, e) for luck in SETTINGS.luck for e in errors] * 3
    np.testing.assert_allclose(found.luck, lucks)
    np.testing.assert_allclose(found.error, errors * 9)
    precision = np.array([SETTINGS.offset_precision, SETTINGS.weak_precision, SETTINGS.weak_precision])
    for mean, luck, error, d in zip(
        found.mean[:12], found.luck[:12], found.error[:12], np.repeat([1, -1], 6), strict=True
    ):

        def log_joint_of_flags(w, luck=luck, error=error, d=d):
            yes = luck + (1 - luck - error) * expit(rows @ w)
            away = w - d * np.array([0.0, 1.0, SETTINGS.group_weight])
            return targets @ np.log(yes) + (1 - targets) @ np.log(1 - yes) - 0.5 * precision @ away**2

        np.testing.assert_allclose(approx_fprime(mean, log_joint_of_flags, 1e-6), 0.0, atol=1e-3)
    proba = found.proba(channels, flags.ranks())
    assert (np.diff(proba) < 0).all()
    ranked = posterior(channels, answers_of(m=20, outcome=np.arange(20.0)), SETTINGS)
    np.testing.assert_allclose(ranked.luck, ranked.error)
