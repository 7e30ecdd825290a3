"""What answers make of demonstrations: words, contradictions, and what to ask next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit
from scipy.stats import norm

from rpil.inference.answered import answer, answer_about_different, columns_of, information, most_telling
from rpil.inference.answers import Answers, posterior
from rpil.inference.settings import AnswerSettings

NAN, SETTINGS = np.nan, AnswerSettings()
SURE = logit(1 - SETTINGS.min_proba_bound)
COLUMNS = np.column_stack([np.linspace(-1.5, 1.5, 12), np.tile([0.5, -0.5, 0.1], 4), np.repeat([-1.0, 1.0], 6)])
AGREED = [-1, 0, -1, 0, 0, 0, 0, 0, 0, 1, 0, 1]


def answers_of(labels=None, pairs=(), outcome=None, m=12) -> Answers:
    labels = np.zeros(m, dtype=np.int64) if labels is None else np.array(labels, dtype=np.int64)
    outcome = np.full(m, NAN) if outcome is None else np.asarray(outcome, dtype=float)
    return Answers(labels, np.array(pairs, dtype=np.int64).reshape(-1, 2), outcome)


def log_odds_by(answers, m, settings=SETTINGS):
    return float(logit(posterior(COLUMNS, answers, settings).proba(COLUMNS[m : m + 1])[0]))


def test_columns_are_normal_scores_and_bounded_log_odds():
    found = columns_of(np.array([[3.0, 5.0], [9.0, 5.0], [1.0, 5.0]]), np.array([7.0, -1.5, -9.0]), SETTINGS)
    np.testing.assert_allclose(found[:, 0], norm.ppf([1 / 2, 5 / 6, 1 / 6]), atol=1e-12)
    np.testing.assert_allclose(found[:, 1], 0.0)
    np.testing.assert_allclose(found[:, 2], [1.0, -0.5, -1.0])


@pytest.mark.parametrize(
    "one", [answers_of([0] * 11 + [1]), answers_of(pairs=[(11, 0)]), answers_of(outcome=[NAN] * 11 + [1.0])]
)
def test_one_answer_gives_other_demonstrations_no_word(one):
    np.testing.assert_array_equal(answer_about_different(COLUMNS, one, SETTINGS).words, one.labels)


def test_two_answers_give_words():
    found = answer_about_different(COLUMNS, answers_of([-1] + [0] * 10 + [1]), SETTINGS)
    assert (found.words[0], found.words[11]) == (-1, 1)
    two_pairs = answer_about_different(COLUMNS, answers_of(pairs=[(11, 0), (10, 1)]), replace(SETTINGS, min_proba=0.6))
    assert (two_pairs.words[0], two_pairs.words[11]) == (-1, 1)


def test_words_begin_at_the_log_odds_of_the_limit():
    some = answers_of(AGREED)
    log_odds = answer_about_different(COLUMNS, some, SETTINGS).log_odds
    for m in (7, 4):  # one that is rather good, and one that is rather bad
        assert 0 < abs(log_odds[m]) < 6
        at = float(expit(abs(log_odds[m])))
        for min_proba, word in ((at - 1e-9, np.sign(log_odds[m])), (at + 1e-9, 0)):
            assert answer_about_different(COLUMNS, some, replace(SETTINGS, min_proba=min_proba)).words[m] == word
    words = answer_about_different(COLUMNS, some, SETTINGS).words
    np.testing.assert_array_equal(words, (log_odds >= SETTINGS.log_odds) * 1 - (log_odds <= -SETTINGS.log_odds) * 1)


def test_a_label_is_the_word_of_its_own_demonstration_and_others_are_judged_by_it():
    some = answers_of(AGREED)
    found = answer_about_different(COLUMNS, some, SETTINGS)
    labelled, unlabelled = np.flatnonzero(some.labels), np.flatnonzero(some.labels == 0)
    np.testing.assert_array_equal(found.words[labelled], some.labels[labelled])
    np.testing.assert_allclose(found.log_odds[labelled], some.labels[labelled] * SURE)
    expected = [log_odds_by(some, m) for m in unlabelled]
    np.testing.assert_allclose(found.log_odds[unlabelled], expected)
    assert found.contradicting.tolist() == []


WRONG = [-1, -1, -1, 0, 0, 0, 0, 0, 1, 1, 1, -1]


def test_a_label_that_contradicts_the_others_is_obeyed_and_named():
    found = answer_about_different(COLUMNS, answers_of(WRONG), SETTINGS)
    assert found.contradicting.tolist() == [11]
    assert found.log_odds[11] == pytest.approx(-SURE)
    assert found.words[11] == -1


@pytest.mark.parametrize(("min_other_answers", "named"), [(4, [11]), (3, [0, 11]), (2, [0, 11])])
def test_only_the_most_improbable_labels_are_named(min_other_answers, named):
    """Two of eight labels are improbable by the others; each that is named leaves several that are not."""
    some = answers_of([1, -1, -1, -1, 0, 0, 0, 0, 1, 1, 1, -1])
    log_odds = {m: log_odds_by(some.without(m), m) for m in np.flatnonzero(some.labels).tolist()}
    improbable = sorted(m for m, value in log_odds.items() if expit(some.labels[m] * value) < 0.2)
    assert improbable == [0, 11]
    found = answer_about_different(COLUMNS, some, replace(SETTINGS, min_other_answers=min_other_answers))
    assert found.contradicting.tolist() == named


@pytest.mark.parametrize(("min_other_answers", "named"), [(6, [11]), (7, [])])
def test_a_label_contradicts_several_others_at_least(min_other_answers, named):
    found = answer_about_different(COLUMNS, answers_of(WRONG), replace(SETTINGS, min_other_answers=min_other_answers))
    assert found.contradicting.tolist() == named


def test_a_label_contradicts_below_the_limit_of_its_probability():
    some = answers_of(WRONG)
    proba = float(expit(-log_odds_by(some.without(11), 11)))
    for limit, named in ((proba * 1.001, [11]), (proba, []), (proba * 0.999, [])):
        assert (
            answer_about_different(
                COLUMNS, some, replace(SETTINGS, max_contradicted_proba=limit)
            ).contradicting.tolist()
            == named
        )


@pytest.mark.parametrize(("max_left_out", "named"), [(7, [11]), (6, [])])
def test_labels_of_many_are_not_left_out_one_by_one(max_left_out, named):
    settings = replace(SETTINGS, max_left_out=max_left_out)
    found = answer_about_different(COLUMNS, answers_of(WRONG), settings)
    assert found.contradicting.tolist() == named
    assert found.words[11] == -1


def test_an_outcome_decides_where_it_is_known():
    outcome = np.array([9.0, NAN, 7.0, NAN, 5.0, NAN, NAN, 3.0, NAN, 2.0, 1.0, NAN])
    some = answers_of([0] * 11 + [-1], outcome=outcome)
    found = answer_about_different(COLUMNS, some, SETTINGS)
    known = np.isfinite(outcome)
    np.testing.assert_allclose(expit(found.log_odds[known]), (2 * np.array([6, 5, 4, 3, 2, 1]) - 1) / 12)
    assert found.log_odds[1] == pytest.approx(log_odds_by(some, 1))


def test_an_outcome_is_never_quite_certain_and_a_label_goes_first():
    outcome = np.array([1.0, 0.0, NAN, 1.0, 0.0] + [NAN] * 6 + [0.0])
    some = answers_of([0] * 11 + [1], outcome=outcome)
    found = answer_about_different(COLUMNS, some, SETTINGS)
    np.testing.assert_allclose(expit(found.log_odds[[0, 1, 3, 4]]), [0.98, 0.02, 0.98, 0.02])
    assert found.log_odds[11] == pytest.approx(SURE)


def test_probabilities_stay_away_from_certainty():
    settings = replace(SETTINGS, min_proba_bound=0.06)
    found = answer_about_different(COLUMNS, answers_of(pairs=[(11, 0)] * 30), settings)
    assert found.log_odds.max() == pytest.approx(logit(0.94))
    assert found.log_odds.min() == pytest.approx(-logit(0.94))


# What to ask next.
def entropy(proba):
    return -(proba * np.log(proba) + (1 - proba) * np.log(1 - proba))


def information_by_sampling(row, found):
    """Mutual information of a label and the weights, by very many draws of its logit."""
    draws = norm.ppf((np.arange(4000) + 0.5) / 4000)
    expected = entropies = 0.0
    for p, mean, covariance in zip(np.exp(found.log_weight), found.mean, found.covariance, strict=True):
        proba = expit(row @ mean + np.sqrt(row @ covariance @ row) * draws)
        expected, entropies = expected + p * proba.mean(), entropies + p * entropy(proba).mean()
    return entropy(expected) - entropies


def greedy(columns, some, k, excluded=()):
    """Each time the label with most information; a label that is known adds its Fisher information."""
    found, rows = posterior(columns, some, SETTINGS), np.column_stack([np.ones(len(columns)), columns])
    left, chosen = [m for m in range(len(columns)) if not some.labels[m] and m not in excluded], []
    for _ in range(min(k, len(left))):
        best = max(left, key=lambda m: information_by_sampling(rows[m], found))
        left.remove(best)
        chosen.append(best)
        proba = expit(found.mean @ rows[best])
        added = (proba * (1 - proba))[:, None, None] * np.outer(rows[best], rows[best])
        found = replace(found, covariance=np.linalg.inv(np.linalg.inv(found.covariance) + added))
    return chosen


def test_information_is_that_of_the_label_and_the_weights():
    columns = np.random.default_rng(0).normal(size=(6, 2))
    found = posterior(columns, answers_of([1, -1, 0, 0, 0, 0], m=6), SETTINGS)
    mean, variance = found.logits(columns)
    rows = np.column_stack([np.ones(6), columns])
    by_hand = [information_by_sampling(row, found) for row in rows]
    np.testing.assert_allclose(information(mean, variance, np.exp(found.log_weight), SETTINGS), by_hand, atol=1e-3)
    certain = information(np.array([[800.0], [0.0]]), np.zeros((2, 1)), np.ones(1), SETTINGS)
    np.testing.assert_allclose(certain, 0.0, atol=1e-12)  # nothing is unknown but chance
    two = information(np.array([[800.0, -800.0]]), np.zeros((1, 2)), np.full(2, 0.5), SETTINGS)
    np.testing.assert_allclose(two, np.log(2))  # everything is


@pytest.mark.parametrize("seed", range(4))
def test_most_telling_are_chosen_one_after_the_other(seed):
    columns = np.random.default_rng(seed).normal(size=(15, 3))
    some = answers_of([1, -1] + [0] * 13, [(3, 4)], m=15)
    chosen = most_telling(columns, some, SETTINGS, 8)
    assert chosen == greedy(columns, some, 8)
    assert len(set(chosen)) == 8
    excluded = chosen[:2]
    assert most_telling(columns, some, SETTINGS, 5, excluded) == greedy(columns, some, 5, excluded)
    assert some.labels[:2].tolist() == [1, -1]


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
    return answer(COLUMNS[EVERY], answers_of(labels, pairs, outcome, m=15), SETTINGS, COPY_OF)


def test_a_copy_confirms_nothing():
    labels = [0] * 11 + [1, 1, 1, 0]
    found, once = about_copies(labels), answer_about_different(COLUMNS, answers_of([0] * 11 + [1]), SETTINGS)
    np.testing.assert_array_equal(found.log_odds, once.log_odds[EVERY])
    assert found.count == 1
    np.testing.assert_array_equal(found.words, EVERY == 11)
    pairs = about_copies(pairs=[(11, 0), (12, 0), (13, 14), (11, 12)])
    np.testing.assert_array_equal(
        pairs.log_odds, answer_about_different(COLUMNS, answers_of(pairs=[(11, 0)]), SETTINGS).log_odds[EVERY]
    )
    assert pairs.count == 1


def test_different_demonstrations_with_the_same_columns_are_no_copies():
    columns = COLUMNS.copy()
    columns[10] = columns[11]
    found = answer(columns, answers_of(AGREED), SETTINGS, np.arange(12))
    assert found.log_odds[10] < found.log_odds[11]


def test_copies_that_are_labelled_are_named_and_others_are_not():
    found = about_copies([-1, -1, -1, 0, 0, 0, 0, 0, 1, 1, 1, 0, -1, -1, 0])
    assert found.contradicting.tolist() == [12, 13]
    assert found.words[[11, 12, 13]].tolist() == [-1, -1, -1]


def test_the_outcome_of_copies_is_their_mean_and_a_label_of_one_goes_first():
    outcome = [0.0, NAN, 2.0, NAN, NAN, 5.0, NAN, NAN, 7.0, NAN, NAN, 6.0, 8.0, NAN, 2.0]
    once = [1.0, *outcome[1:11], 7.0]
    expected = answer_about_different(COLUMNS, answers_of(outcome=once), SETTINGS)
    np.testing.assert_array_equal(about_copies(outcome=outcome).log_odds, expected.log_odds[EVERY])
    labels = [0] * 14 + [1]
    expected = answer_about_different(COLUMNS, answers_of([1] + [0] * 11, outcome=once), SETTINGS)
    np.testing.assert_array_equal(about_copies(labels, outcome=outcome).log_odds, expected.log_odds[EVERY])
