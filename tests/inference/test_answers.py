"""Bayesian logistic regression on answers, against numerical optimisation and integration, and hand-made answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, logit, softmax
from scipy.stats import spearmanr

from hand_made import answers_of
from rpil.inference.answers import NOTHING, Answers, explained, posterior, predicted
from rpil.inference.channels import CHANNELS
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


def test_answers_contrast_where_there_are_two_and_both_sides():
    for answers, contrast in (
        (answers_of([1, -1]), True),
        (answers_of([1, 1]), False),
        (answers_of(m=2, pairs=[(0, 1)]), False),
        (answers_of(m=3, pairs=[(0, 1), (1, 2)]), True),
        (answers_of([1, 0], outcome=[NAN, 0.0]), True),
        (answers_of(m=3, outcome=[1.0, 2.0, 3.0]), True),
        (answers_of([1, 1], tied=[(0, 1)]), False),
    ):
        assert answers.contrast is contrast


def test_a_flag_of_zero_is_said_of_its_demonstration_and_of_copies_without_one():
    known = answers_of([0, 0, 0, 1], outcome=[0.0, 1.0, NAN, 0.0])
    assert known.said.tolist() == [-1, 0, 0, 1]
    assert known.shared(np.array([0, 1, 0, 3])).said.tolist() == [-1, 0, -1, 1]
    assert answers_of([0] * 3, outcome=[0.0, 1.0, 2.0]).said.tolist() == [0] * 3, "no flag"
    assert answers_of([0] * 3, outcome=[0.0, 1.0, 2.0]).select([0, 1]).said.tolist() == [0] * 2, "nor are some of them"


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


ERROR = SETTINGS.error


def made(seed=0, m=14, columns=3, flags=False, labels=True):
    """Columns, and answers of all sorts: outcomes are flags, or ranked."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(m, columns))
    said = np.sign(values[:, 1 % columns] + 0.3 * rng.normal(size=m)) * (rng.random(m) < 0.4) * labels
    ended = values[:, 0] + rng.normal(size=m)
    outcome = np.where(rng.random(m) < 0.5, (ended > 0) if flags else ended, NAN)
    pairs, tied = ([(0, 1), (2, 3), (5, 4)], [(6, 7), (8, 3)]) if labels else ([], [])
    return values, answers_of(said, pairs, outcome, tied=tied)


def log_joint(w, columns, answers, luck=ERROR, precision=1.0):
    """Of w and the answers, up to the constant of the prior: written again from the formula."""
    rows, targets = answers.rows(columns)
    proba, wrong = expit(rows @ w), np.where(answers.are_outcomes, luck, ERROR)
    yes, no = wrong + (1 - wrong - ERROR) * proba, ERROR + (1 - wrong - ERROR) * (1 - proba)
    away = w.copy()
    away[1] -= 1.0
    away[-1] -= 0.5
    prior = 0.25 * away[0] ** 2 + precision * (away[1:] ** 2).sum()
    return targets @ np.log(yes) + (1 - targets) @ np.log(no) - 0.5 * prior


CASES = [
    (made(), [ERROR], 1.0),
    (made(1, flags=True), [ERROR, 0.5, 0.9], 1.0),  # labels of both sides beside them
    (made(2, flags=True, labels=False), [ERROR, 0.5, 0.9], 16.0),
    ((made()[0], answers_of([1] * 6 + [0] * 8)), [ERROR], NOTHING),
    ((made()[0], answers_of([0] * 14, outcome=[1.0] * 14)), [ERROR, 0.5, 0.9], NOTHING),
    ((made()[0], answers_of([-1] * 3 + [0] * 11, outcome=[NAN] * 3 + [1.0] * 3 + [0.0] * 8)), [ERROR, 0.5, 0.9], 16.0),
]


@pytest.mark.parametrize(("world", "lucks", "precision"), CASES)
def test_means_are_the_most_probable_weights_by_another_optimiser(world, lucks, precision):
    found = posterior(*world, SETTINGS)
    np.testing.assert_allclose(found.luck, lucks)
    scale = np.sqrt(np.array([0.25, precision, precision, precision]))
    for mean, luck in zip(found.mean, lucks, strict=True):

        def loss(v, luck=luck):
            return -log_joint(v / scale, *world, luck, precision)

        best = minimize(loss, np.array([0.0, 1.0, 0.0, 0.5]) * scale, method="Nelder-Mead", options=OPTIMISER)
        np.testing.assert_allclose(mean, best.x / scale, atol=2e-3)


OPTIMISER = {"maxiter": 20_000, "maxfev": 20_000, "xatol": 1e-7, "fatol": 1e-11}


@pytest.mark.parametrize(("world", "lucks", "precision"), CASES)
def test_covariances_and_weights_are_those_of_the_expected_information(world, lucks, precision):
    found, (rows, _), evidence = posterior(*world, SETTINGS), world[1].rows(world[0]), []
    for mean, covariance, luck in zip(found.mean, found.covariance, lucks, strict=True):
        proba, wrong = expit(rows @ mean), np.where(world[1].are_outcomes, luck, ERROR)
        yes = wrong + (1 - wrong - ERROR) * proba
        slope = ((1 - wrong - ERROR) * proba * (1 - proba))[:, None] * rows
        own = np.array([0.25, precision, precision, precision])
        information = np.diag(own) + (slope / (yes * (1 - yes))[:, None]).T @ slope
        np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-12)
        log_det = np.log(np.linalg.det(information / np.sqrt(np.outer(own, own))))
        evidence.append(log_joint(mean, *world, luck, precision) - 0.5 * log_det)
    np.testing.assert_allclose(found.weight, softmax(evidence), rtol=1e-5)


def test_shares_of_luck_and_probabilities_are_those_of_numerical_integration():
    """Of an offset and one column, whose prior mean is that of the group."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(40, 1))
    flags = answers_of(m=40, outcome=columns[:, 0] + rng.normal(size=40) > -0.5)
    labels = answers_of(np.where(np.arange(40) < 12, np.sign(columns[:, 0] + rng.normal(size=40)), 0))
    new = np.column_stack([np.ones(5), np.linspace(-2, 2, 5)])
    grids = np.linspace(-9, 9, 181), np.linspace(-5, 6, 221)
    weights = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 2)
    for known, lucks, precision in ((labels, [ERROR], 1.0), (flags, [ERROR, 0.5, 0.9], 16.0)):
        found, away = posterior(columns, known, SETTINGS), weights - [0.0, 0.5]
        (rows, targets), total, probas = known.rows(columns), [], []
        for luck in lucks:
            wrong = np.where(known.are_outcomes, luck, ERROR)
            yes = wrong + (1 - wrong - ERROR) * expit(weights @ rows.T)
            joint = np.exp(
                np.log(yes) @ targets + np.log(1 - yes) @ (1 - targets) - 0.5 * away**2 @ np.array([0.25, precision])
            )
            total.append(joint.sum())
            probas.append(joint @ expit(weights @ new.T) / joint.sum())
        exact = np.array(total) / np.sum(total)
        np.testing.assert_allclose(found.weight, exact, atol=0.03)
        np.testing.assert_allclose(found.proba(new), exact @ probas, atol=0.03)


def test_without_answers_good_are_those_that_agree():
    columns = np.random.default_rng(0).normal(size=(9, 4))
    found = posterior(columns, answers_of(m=9), SETTINGS)
    np.testing.assert_allclose(found.mean, [[0, 1, 0, 0, 0.5]])
    np.testing.assert_allclose(found.covariance[0], np.diag([4, *[1 / NOTHING] * 4]), atol=1e-12)
    rows = np.column_stack([np.ones(9), columns])
    assert spearmanr(found.proba(rows), columns[:, 0] + 0.5 * columns[:, 3]).statistic == pytest.approx(1.0)


@pytest.mark.parametrize("sort", [1, -1])
def test_answers_of_one_side_move_the_offset_and_never_turn_the_direction(sort):
    """However many good ones are at the bottom: with a bad one at the top they do."""
    columns = np.column_stack([np.linspace(-2, 2, 30), np.linspace(-1, 1, 30)])
    rows = np.column_stack([np.ones(30), columns])
    labels = sort * np.where(sort * columns[:, 0] < -0.5, 1, 0)
    found = posterior(columns, answers_of(labels), SETTINGS)
    np.testing.assert_allclose(found.mean[0, 1:], [1, 0.5], atol=1e-4)
    assert sort * found.mean[0, 0] > 1
    labels[sort * columns[:, 0] > 1.5] = -sort
    both = posterior(columns, answers_of(labels), SETTINGS)
    assert both.proba(rows)[-1] < both.proba(rows)[0]


@pytest.mark.parametrize("seed", range(2))
def test_columns_count_as_far_as_answers_support_them(seed):
    """Quality is in the second of three components, and in nothing else."""
    rng = np.random.default_rng(seed)
    columns, at = rng.normal(size=(48, len(CHANNELS) + 4)), len(CHANNELS) + 1
    good = columns[:, at] > 0
    columns[:, at] += np.where(good, 1.0, -1.0)
    labels = np.where(np.arange(48) < 16, 2 * good - 1, 0)
    rows = np.column_stack([np.ones(48), columns])
    found = posterior(columns, answers_of(labels), SETTINGS)
    rest = found.proba(rows)[16:]
    assert np.mean(rest[good[16:]][:, None] > rest[~good[16:]]) > 0.85
    assert found.mean[0].argmax() == 1 + at


def moderated(found, row, k):
    return row @ found.mean[k] / np.sqrt(1 + np.pi / 8 * row @ found.covariance[k] @ row)


def test_probabilities_of_right_and_of_given_answers_by_hand():
    """An outcome is evidence beside the columns, of which wrong ones bound what it tells."""
    columns, some = made(1, flags=True)
    rows, found = np.column_stack([np.ones(14), columns]), posterior(columns, some, SETTINGS)
    is_outcome = np.arange(14) % 2 == 0
    for told in (np.full(14, NAN), np.tile([0.0, 1.0], 7), np.linspace(0.01, 0.99, 14)):
        right, given = np.zeros(14), np.zeros(14)
        for k, luck in enumerate((0.02, 0.5, 0.9)):
            least, most = np.log(0.02 / (1 - luck)), np.log(0.98 / luck)
            for m, row in enumerate(rows):
                with np.errstate(divide="ignore"):
                    says = 0.0 if np.isnan(told[m]) else min(max(logit(told[m]), least), most)
                right[m] += found.weight[k] * expit(moderated(found, row, k) + says)
                wrong = luck if is_outcome[m] else 0.02
                given[m] += found.weight[k] * (wrong + (0.98 - wrong) * expit(moderated(found, row, k)))
        np.testing.assert_allclose(found.proba(rows, told), right)
        np.testing.assert_allclose(found.proba_given(rows, is_outcome), given)
    np.testing.assert_allclose(found.proba(rows), found.proba(rows, np.full(14, NAN)))


def test_lucky_outcomes_are_flags_alone():
    """All succeed but the last five: bad ones may have been lucky, and the higher in the ranking the less so."""
    columns = np.column_stack([np.linspace(2, -2, 20), np.repeat([1.0, -1.0], 10)])
    flags = answers_of(m=20, outcome=[1.0] * 15 + [0.0] * 5)
    proba = posterior(columns, flags, SETTINGS).proba(np.column_stack([np.ones(20), columns]), flags.ranks())
    assert (np.diff(proba) < 0).all()
    assert proba[14] > 3 * proba[15]
    ranked = posterior(columns, answers_of(m=20, outcome=np.arange(20.0)), SETTINGS)
    assert ranked.luck.tolist() == [ERROR]


# Whether answers predict each other.
def left_out(answers, out):
    """All answers but those of the numbers `out`, in the order of the rows."""
    return answers.only(~np.isin(np.arange(answers.count), out))


@pytest.mark.parametrize("max_folds", [16, 4])
@pytest.mark.parametrize("flags", [False, True])
def test_each_answer_is_predicted_by_the_others_or_by_other_folds(flags, max_folds):
    columns, some = made(1, flags=flags)
    settings = replace(SETTINGS, max_folds=max_folds)
    assert max_folds == 4 or some.count <= 16
    targets, by_others, share = predicted(columns, some, settings)
    rows, expected = some.rows(columns)
    np.testing.assert_array_equal(targets, expected)
    n_single = len(rows) - 5  # three pairs, and two without a difference
    for r in range(len(rows)):
        out = [r] if max_folds == 16 else [s for s in range(len(rows)) if s % 4 == r % 4]
        found = posterior(columns, left_out(some, out), settings)
        assert by_others[r] == pytest.approx(found.proba_given(rows[[r]], some.are_outcomes[[r]])[0])
        others = [targets[s] for s in range(n_single) if s not in out]
        assert share[r] == pytest.approx((sum(others) + 0.5) / (len(others) + 1) if r < n_single else 0.5)


def test_one_answer_is_predicted_by_nothing():
    targets, by_others, share = predicted(made()[0], answers_of([1] + [0] * 13), SETTINGS)
    assert (targets.tolist(), share.tolist()) == ([1.0], [0.5])
    assert 0 < by_others[0] < 1


def test_what_the_others_explain_is_a_share_of_the_log_loss_by_hand_with_bounded_probabilities():
    for t, p, q, expected in (
        (1.0, 0.8, 0.5, np.log(0.8) / np.log(0.5)),
        (0.0, 0.8, 0.5, np.log(0.2) / np.log(0.5)),
        (0.5, 0.8, 0.6, np.log(0.8 * 0.2) / np.log(0.6 * 0.4)),
        (1.0, 0.999, 0.5, np.log(0.98) / np.log(0.5)),
        (1.0, 0.001, 0.5, np.log(0.02) / np.log(0.5)),
        (0.0, 0.5, 1.0, np.log(0.5) / np.log(0.02)),
        (1.0, 0.5, 0.999, np.log(0.5) / np.log(0.98)),
    ):
        assert explained(*np.array([[t], [p], [q]])) == pytest.approx(1 - expected)
    both = explained(np.ones(2), np.array([0.8, 0.4]), np.array([0.5, 0.7]))
    assert both == pytest.approx(1 - np.log(0.8 * 0.4) / np.log(0.5 * 0.7))
