"""What answers make of demonstrations: verdicts, contradictions, and what to ask next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit
from scipy.stats import norm

from hand_made import COLUMNS, answers_of
from rpil.inference import answered as module
from rpil.inference.answered import Answered, answer, columns_of, most_telling
from rpil.inference.answers import Answers, posterior
from rpil.inference.settings import AnswerSettings

NAN, SETTINGS = np.nan, AnswerSettings()
SURE = logit(1 - SETTINGS.min_proba_bound)
AGREED = [-1, 0, -1, 0, 0, 0, 0, 0, 0, 1, 0, 1]


def without(answers, m) -> Answers:
    """All labels but that of demonstration m."""
    return answers_of(np.where(np.arange(12) == m, 0, answers.labels))


def judged(columns, answers, settings=SETTINGS, claimed=None) -> Answered:
    claimed = np.zeros(len(columns), dtype=int) if claimed is None else np.array(claimed)
    return module.answer(columns, answers, settings, np.arange(len(columns)), claimed)


def log_odds_by(answers, m, settings=SETTINGS):
    return float(logit(posterior(COLUMNS, answers, settings).proba(COLUMNS[m : m + 1])[0]))


def test_columns_are_normal_scores_and_bounded_log_odds():
    found = columns_of(
        np.array([[3.0, 5.0], [9.0, 5.0], [1.0, 5.0]]),
        np.array([[0.1], [0.4], [0.2]]),
        np.array([7.0, -1.5, -9.0]),
        SETTINGS,
    )
    np.testing.assert_allclose(found[:, 0], norm.ppf([1 / 2, 5 / 6, 1 / 6]), atol=1e-12)
    np.testing.assert_allclose(found[:, 1], 0.0)
    np.testing.assert_allclose(found[:, 2], [0.1, 0.4, 0.2])
    np.testing.assert_allclose(found[:, 3], [1.0, -0.5, -1.0])


def test_two_answers_give_words():
    found = judged(COLUMNS, answers_of([-1] + [0] * 10 + [1]), SETTINGS)
    assert (found.verdicts[0], found.verdicts[11]) == (-1, 1)
    two_pairs = judged(COLUMNS, answers_of(pairs=[(11, 0), (10, 1)]), replace(SETTINGS, min_proba=0.6))
    assert (two_pairs.verdicts[0], two_pairs.verdicts[11]) == (-1, 1)


def test_words_begin_at_the_log_odds_of_the_limit():
    some = answers_of(AGREED)
    log_odds = judged(COLUMNS, some, SETTINGS).log_odds
    for m in (7, 4):  # one that is rather good, and one that is rather bad
        assert 0 < abs(log_odds[m]) < 6
        at = float(expit(abs(log_odds[m])))
        for min_proba, verdict in ((at - 1e-9, np.sign(log_odds[m])), (at + 1e-9, 0)):
            assert judged(COLUMNS, some, replace(SETTINGS, min_proba=min_proba)).verdicts[m] == verdict
    verdicts = judged(COLUMNS, some, SETTINGS).verdicts
    least = logit(SETTINGS.min_proba)
    np.testing.assert_array_equal(verdicts, (log_odds >= least) * 1 - (log_odds <= -least) * 1)


def test_a_label_is_the_word_of_its_own_demonstration_and_others_are_judged_by_it():
    some = answers_of(AGREED)
    found = judged(COLUMNS, some, SETTINGS)
    labelled, unlabelled = np.flatnonzero(some.labels), np.flatnonzero(some.labels == 0)
    np.testing.assert_array_equal(found.verdicts[labelled], some.labels[labelled])
    np.testing.assert_allclose(found.log_odds[labelled], some.labels[labelled] * SURE)
    expected = [log_odds_by(some, m) for m in unlabelled]
    np.testing.assert_allclose(found.log_odds[unlabelled], expected)
    assert found.contradicting.tolist() == []


WRONG = [-1, -1, -1, 0, 0, 0, 0, 0, 1, 1, 1, -1]


@pytest.mark.parametrize(("min_other_answers", "named"), [(4, [11]), (3, [0, 11]), (2, [0, 11])])
def test_only_the_most_improbable_labels_are_named(min_other_answers, named):
    """Two of eight labels are improbable by the others; each that is named leaves several that are not."""
    some = answers_of([1, -1, -1, -1, 0, 0, 0, 0, 1, 1, 1, -1])
    log_odds = {m: log_odds_by(without(some, m), m) for m in np.flatnonzero(some.labels).tolist()}
    improbable = sorted(m for m, value in log_odds.items() if expit(some.labels[m] * value) < 0.2)
    assert improbable == [0, 11]
    found = judged(COLUMNS, some, replace(SETTINGS, min_other_answers=min_other_answers))
    assert found.contradicting.tolist() == named


@pytest.mark.parametrize(("min_other_answers", "named"), [(6, [11]), (7, [])])
def test_a_label_contradicts_several_others_at_least(min_other_answers, named):
    found = judged(COLUMNS, answers_of(WRONG), replace(SETTINGS, min_other_answers=min_other_answers))
    assert found.contradicting.tolist() == named


def test_a_label_contradicts_below_the_limit_of_its_probability():
    some = answers_of(WRONG)
    proba = float(expit(-log_odds_by(without(some, 11), 11)))
    for limit, named in ((proba * 1.001, [11]), (proba * 0.999, [])):
        assert judged(COLUMNS, some, replace(SETTINGS, max_contradicted_proba=limit)).contradicting.tolist() == named


@pytest.mark.parametrize(("max_left_out", "named"), [(7, [11]), (6, [])])
def test_labels_of_many_are_not_left_out_one_by_one(max_left_out, named):
    settings = replace(SETTINGS, max_left_out=max_left_out)
    found = judged(COLUMNS, answers_of(WRONG), settings)
    assert found.contradicting.tolist() == named
    assert found.verdicts[11] == -1
    assert found.log_odds[11] == pytest.approx(-SURE)


def with_outcome(some, m, told):
    """Log-odds of demonstration m, of which an outcome with the log-odds `told` is known, by hand: each normal
    distribution has its own shares of wrong outcomes, which bound what one tells."""
    found, row = posterior(COLUMNS, some, SETTINGS), np.append(1.0, COLUMNS[m])
    proba = 0.0
    parts = np.exp(found.log_weight), found.mean, found.covariance, found.luck, found.error
    for weight, mean, covariance, luck, error in zip(*parts, strict=True):
        own = (mean[0] + SETTINGS.sharpness * row[1:] @ mean[1:]) / np.sqrt(1 + np.pi / 8 * row @ covariance @ row)
        least, most = np.log(error / (1 - luck)), np.log((1 - error) / luck)
        proba += weight * expit(own + min(max(told, least), most))
    return logit(proba)


def test_an_outcome_is_evidence_beside_what_the_columns_say():
    outcome = np.array([9.0, NAN, 7.0, NAN, 5.0, NAN, NAN, 3.0, NAN, 2.0, 1.0, NAN])
    some = answers_of([0] * 11 + [-1], outcome=outcome)
    found = judged(COLUMNS, some)
    for m, rank in zip(np.flatnonzero(np.isfinite(outcome)), np.array([11, 9, 7, 5, 3, 1]) / 12, strict=True):
        assert found.log_odds[m] == pytest.approx(with_outcome(some, m, logit(rank)))
    assert found.log_odds[1] == pytest.approx(log_odds_by(some, 1))


def test_flags_err_for_the_better_and_a_label_goes_first():
    outcome = np.array([1.0, 0.0, NAN, 1.0, 0.0] + [NAN] * 6 + [0.0])
    some = answers_of([0] * 11 + [1], outcome=outcome)
    found = judged(COLUMNS, some)
    for m in (0, 3):
        assert found.log_odds[m] == pytest.approx(with_outcome(some, m, 99.0))
    for m, sign in ((1, -1), (4, -1), (11, 1)):  # what failed is bad, unless a label says more
        assert found.log_odds[m] == pytest.approx(sign * SURE)
        assert found.verdicts[m] == sign


def test_a_flag_of_zero_is_said_of_its_demonstration_and_of_copies_without_one():
    known = answers_of([0, 0, 0, 1], outcome=[0.0, 1.0, NAN, 0.0])
    assert known.said.tolist() == [-1, 0, 0, 1]
    assert known.shared(np.array([0, 1, 0, 3])).said.tolist() == [-1, 0, -1, 1]
    assert answers_of([0] * 3, outcome=[0.0, 1.0, 2.0]).said.tolist() == [0] * 3, "no flag"
    assert answers_of([0] * 3, outcome=[0.0, 1.0, 2.0]).select([0, 1]).said.tolist() == [0] * 2, "nor are some of them"


# An answer alone, and what was said before.
CLAIMED = np.repeat([-1, 0, 1], 4)


def test_what_was_said_stays_until_answers_contradict_it():
    one_label, one_outcome = [0] * 11 + [1], answers_of(outcome=[NAN] * 11 + [1.0])
    for one in (answers_of(one_label), answers_of(-np.array(one_label)), answers_of(pairs=[(0, 11)]), one_outcome):
        found = judged(COLUMNS, one, claimed=CLAIMED)
        np.testing.assert_array_equal(found.verdicts, one.labels)
        np.testing.assert_array_equal(found.stays, CLAIMED * (one.labels == 0))
    agreed = judged(COLUMNS, answers_of(AGREED), claimed=CLAIMED)
    assert ((agreed.stays == CLAIMED) | (agreed.verdicts != 0)).all()
    assert not (agreed.stays * agreed.verdicts).any()
    turned = judged(COLUMNS, answers_of([-value for value in AGREED[:3]] + [0] * 6 + [-1, -1, -1]), claimed=CLAIMED)
    assert not turned.stays.any()


def test_nobody_is_bad_before_an_answer_says_so():
    columns = np.column_stack([np.linspace(-3, 3, 40), np.repeat([-1.0, 1.0], 20)])
    good, bad = ([0] * 30 + [1] * 10, [-1] * 10 + [0] * 30)
    assert judged(columns, answers_of(good, m=40)).verdicts.min() == 0
    assert judged(columns, answers_of(bad, m=40)).verdicts.max() == 0
    for pairs, outcome in (([(39, 0)], None), ([], [0.0] + [NAN] * 39)):
        assert judged(columns, answers_of(good, pairs, outcome, m=40)).verdicts.min() == -1


def test_probabilities_stay_away_from_certainty():
    settings = replace(SETTINGS, min_proba_bound=0.06)
    found = judged(COLUMNS, answers_of(pairs=[(a, b) for a in range(12) for b in range(a)]), settings)
    assert found.log_odds.max() == pytest.approx(logit(0.94))
    assert found.log_odds.min() == pytest.approx(-logit(0.94))


# What to ask next.
def places(columns, some):
    """Of each demonstration, the share of the others that are less probably good."""
    proba = posterior(columns, some, SETTINGS).proba(columns)
    return np.array([np.mean(np.delete(proba, m) < proba[m]) for m in range(len(proba))])


@pytest.mark.parametrize("seed", range(4))
def test_labels_are_asked_for_at_the_quantiles_of_the_ranking(seed):
    columns = np.random.default_rng(seed).normal(size=(101, 3))
    nothing = answers_of(m=101)
    chosen = most_telling(columns, nothing, SETTINGS, 8)
    at = places(columns, nothing)[chosen]
    np.testing.assert_allclose(at[:3], [0.9, 0.1, 0.5])
    np.testing.assert_allclose(np.abs(at[3:] - 0.5), [0.01, 0.01, 0.02, 0.02, 0.03])
    # once two are labelled, the third place is asked for, in the ranking that has become of them
    two = answers_of(np.isin(np.arange(101), chosen[0]) * 1 - np.isin(np.arange(101), chosen[1]) * 1, m=101)
    assert places(columns, two)[most_telling(columns, two, SETTINGS, 1)] == pytest.approx(0.5, abs=0.011)
    nearest = most_telling(columns, nothing, SETTINGS, 1, [chosen[0]])
    assert abs(places(columns, nothing)[nearest] - 0.9) == pytest.approx(0.01)


def test_nothing_is_asked_twice():
    some = answers_of([1, -1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1])
    assert sorted(most_telling(COLUMNS, some, SETTINGS, 20)) == list(range(2, 10))
    assert sorted(most_telling(COLUMNS, some, SETTINGS, 20, [3, 0])) == [2, 4, 5, 6, 7, 8, 9]
    assert most_telling(COLUMNS, answers_of([1] * 12), SETTINGS, 3) == []
    assert most_telling(COLUMNS, some, SETTINGS, 0) == []


# Copies.
EVERY = np.append(np.arange(12), [11, 11, 0])  # two copies of the best, one of the worst
COPY_OF = EVERY.copy()


def about_copies(labels=None, pairs=(), outcome=None):
    answers = answers_of(labels, pairs, outcome, m=15)
    return answer(COLUMNS[EVERY], answers, SETTINGS, COPY_OF, np.zeros(15, dtype=int))


def test_a_copy_confirms_nothing():
    labels = [0] * 11 + [1, 1, 1, 0]
    found, once = about_copies(labels), judged(COLUMNS, answers_of([0] * 11 + [1]), SETTINGS)
    np.testing.assert_array_equal(found.log_odds, once.log_odds[EVERY])
    assert found.count == 1
    np.testing.assert_array_equal(found.verdicts, EVERY == 11)
    pairs = about_copies(pairs=[(11, 0), (12, 0), (13, 14), (11, 12)])
    np.testing.assert_array_equal(
        pairs.log_odds, judged(COLUMNS, answers_of(pairs=[(11, 0)]), SETTINGS).log_odds[EVERY]
    )
    assert pairs.count == 1


def test_copies_that_are_labelled_are_named_and_others_are_not():
    found = about_copies([-1, -1, -1, 0, 0, 0, 0, 0, 1, 1, 1, 0, -1, -1, 0])
    assert found.contradicting.tolist() == [12, 13]
    assert found.verdicts[[11, 12, 13]].tolist() == [-1, -1, -1]


def test_the_outcome_of_copies_is_their_mean_and_a_label_of_one_goes_first():
    outcome = [0.0, NAN, 2.0, NAN, NAN, 5.0, NAN, NAN, 7.0, NAN, NAN, 6.0, 8.0, NAN, 2.0]
    once = [1.0, *outcome[1:11], 7.0]
    expected = judged(COLUMNS, answers_of(outcome=once), SETTINGS)
    np.testing.assert_array_equal(about_copies(outcome=outcome).log_odds, expected.log_odds[EVERY])
    labels = [0] * 14 + [1]
    expected = judged(COLUMNS, answers_of([1] + [0] * 11, outcome=once), SETTINGS)
    np.testing.assert_array_equal(about_copies(labels, outcome=outcome).log_odds, expected.log_odds[EVERY])
