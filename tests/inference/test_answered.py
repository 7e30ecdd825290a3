"""What answers make of demonstrations: P(good), verdicts, contradictions, and what to ask next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit

from hand_made import COLUMNS, answers_of
from rpil.inference.answered import Answered, agreement, answer, contradicting, places_to_ask, predicted
from rpil.inference.settings import AnswerSettings
from rpil.inference.witnesses import regression, weigh

NAN, SETTINGS = np.nan, AnswerSettings()
SURE = logit(1 - SETTINGS.min_proba_bound)
ERROR, EVERYTHING = SETTINGS.error, np.arange(12)
AGREED = [-1, 0, -1, 0, -1, 0, 0, 1, 0, 1, 0, 1]
AS_NOTHING_SAYS = [1, -1, 1, 0, -1, 0, 1, -1, 0, 1, 0, -1]
"""Labels that no column predicts."""


def judged(answers, columns=COLUMNS, **settings) -> Answered:
    return answer(columns, answers, replace(SETTINGS, **settings), np.arange(len(columns)))


def evidence_of(answers):
    """Rows, the evidence of answers, and with that of witnesses, how many rows are pairs, and of witnesses alone."""
    rows, n_pairs = answers.rows(COLUMNS)
    evidence = answers.evidence(logit(1 - ERROR))
    by_witnesses = weigh(rows, evidence, n_pairs, answers.outcomes, SETTINGS).evidence.sum(axis=1)
    return rows, evidence, evidence + np.append(by_witnesses, np.zeros(n_pairs)), n_pairs, by_witnesses


def by_columns(answers):
    rows, _, total, n_pairs, _ = evidence_of(answers)
    return regression(rows, total, n_pairs, SETTINGS, slice(12))


def trust_in(answers):
    rows, evidence, total, n_pairs, _ = evidence_of(answers)
    answered, right = predicted(rows, evidence, total, n_pairs, len(answers.tied), SETTINGS)
    told = slice(len(answered) - 2 * len(answers.tied))
    return max(agreement(evidence[answered][told], right[told], len(answers.pairs)), SETTINGS.min_trust)


def log_odds_by(answers):
    """By the columns as far as answers agree, and by witnesses."""
    factor = SETTINGS.sharpness * min(trust_in(answers) / SETTINGS.full_trust, 1) ** 2
    return factor * by_columns(answers) + evidence_of(answers)[-1]


def test_a_label_decides_about_its_own_demonstration_and_others_are_judged_by_it():
    some = answers_of(AGREED)
    found, is_said = judged(some), some.labels != 0
    np.testing.assert_array_equal(found.verdicts[is_said], some.labels[is_said])
    np.testing.assert_allclose(found.log_odds[is_said], some.labels[is_said] * SURE)
    np.testing.assert_allclose(found.log_odds[~is_said], log_odds_by(some)[~is_said])
    assert (found.contradicting.tolist(), found.count, found.follows) == ([], 6, True)
    np.testing.assert_array_equal(judged(some, precision=1).log_odds, found.log_odds, "a whole number")


def test_verdicts_begin_at_the_limit_of_the_probability():
    some, log_odds = answers_of(AGREED), judged(answers_of(AGREED)).log_odds
    for m in (8, 1):
        at, sign = float(expit(abs(log_odds[m]))), int(np.sign(log_odds[m]))
        assert [judged(some, min_proba=at + more).verdicts[m] for more in (-1e-9, 1e-9)] == [sign, 0]
    found, free = judged(some, sharpness=2.0), some.labels == 0
    expected = (found.log_odds >= logit(0.95)).astype(int) - (found.log_odds <= -logit(0.95))
    np.testing.assert_array_equal(found.verdicts[free], expected[free])
    assert {-1, 0, 1} == set(expected[free])


def test_answers_act_as_far_as_they_predict_each_other():
    some = answers_of(AGREED)
    assert trust_in(some) > 0.5
    for limit, follows in ((trust_in(some) - 1e-9, True), (trust_in(some) + 1e-9, False)):
        found = judged(some, min_trust=limit)
        assert found.follows is follows
        assert found.verdicts[some.labels == 0].any() == follows
        np.testing.assert_array_equal(found.verdicts[some.labels != 0], some.labels[some.labels != 0])
    free, nothing = np.array(AS_NOTHING_SAYS) == 0, judged(answers_of(AS_NOTHING_SAYS))
    assert (nothing.follows, nothing.verdicts[free].any()) == (False, False)
    assert trust_in(answers_of(AS_NOTHING_SAYS)) == SETTINGS.min_trust
    np.testing.assert_allclose(nothing.log_odds[free], log_odds_by(answers_of(AS_NOTHING_SAYS))[free])


@pytest.mark.parametrize(
    ("evidence", "right", "n_pairs", "expected"),
    [
        ([1, 1, 1, -1], [0.9, 0.8, 0.7, 0.3], 0, (0.6 - 0.4) / 2),
        ([1] * 15 + [-1], [0.9] * 15 + [0.1], 0, 0.0),  # as their share says
        ([1, -1, 1, 1], [0.9, 0.6, 0.8, 0.7], 2, (0.6 + 0.4) / 2),  # a pair is both
        ([1, 1], [0.7, 0.8], 2, 0.5), ([1], [0.9], 0, 0.4), ([], [], 0, 0.0),
    ],
)  # fmt: skip
def test_the_agreement_of_answers_by_hand(evidence, right, n_pairs, expected):
    assert agreement(np.array(evidence, dtype=float), np.array(right), n_pairs) == pytest.approx(expected)


@pytest.mark.parametrize(
    "one",
    [
        *[answers_of([0] * (12 - n) + [label] * n) for n in (1, 6) for label in (1, -1)],
        answers_of(pairs=[(11, 0)]),
        answers_of(outcome=[NAN] * 6 + [1.0] * 6),
        answers_of(tied=[(0, 11), (3, 4)]),
    ],
)
def test_answers_without_contrast_give_no_other_verdict(one):
    found = judged(one, min_trust=1e-9, min_proba=0.51)
    assert not found.follows
    np.testing.assert_array_equal(found.verdicts, one.labels)


def test_two_answers_that_contrast_give_words_and_two_pairs():
    two = judged(answers_of([-1] + [0] * 10 + [1]), min_proba=0.7)
    assert (two.follows, two.verdicts[2], two.verdicts[9]) == (True, -1, 1)
    pairs = judged(answers_of(pairs=[(11, 0), (10, 1)]), min_proba=0.7)
    assert (pairs.verdicts[0], pairs.verdicts[11]) == (-1, 1)


# Outcomes.
ENDED = [9.0, NAN, 7.0, NAN, 5.0, NAN, NAN, 3.0, NAN, 2.0, 1.0, NAN]


@pytest.mark.parametrize("outcome", [ENDED, [ENDED, [float(m % 3) for m in range(12)]]])
def test_witnesses_are_evidence_beside_what_the_columns_say(outcome):
    some = answers_of(AGREED, outcome=outcome)
    found, free = judged(some), some.labels == 0
    np.testing.assert_allclose(found.log_odds[free], log_odds_by(some)[free])
    rows, evidence, _, n_pairs, _ = evidence_of(some)
    expected = weigh(rows, evidence, n_pairs, some.outcomes, SETTINGS)
    np.testing.assert_array_equal(found.witnesses.confirmed, expected.confirmed)
    assert found.witnesses.evidence[1, 0] == 0


def flagged(right, m=60):
    """Columns that tell quality, and flags without failures that are said, which are `right` so often."""
    rng = np.random.default_rng(0)
    good = rng.random(m) < 0.5
    columns = np.column_stack([2.0 * good - 1, rng.normal(size=m), rng.normal(size=m)]) + 0.5 * rng.normal(size=(m, 3))
    return columns, np.where(rng.random(m) < right, good, ~good) + 0.5, 2 * good - 1


def test_an_outcome_alone_gives_words_where_columns_confirm_it():
    columns, outcome, truth = flagged(0.95)
    found = judged(answers_of(m=60, outcome=outcome), columns)
    assert found.follows
    assert (set(found.verdicts * truth), set(found.verdicts)) == ({0, 1}, {-1, 0, 1})
    columns, coin, _ = flagged(0.5)
    found = judged(answers_of(m=60, outcome=coin), columns)
    assert (found.follows, found.verdicts.any()) == (False, False)
    assert judged(answers_of(m=60, outcome=[coin, outcome]), columns).follows, "one is enough"
    some = answers_of(outcome=[float(m) for m in range(12)])
    assert judged(some).follows
    np.testing.assert_allclose(judged(some).log_odds, SETTINGS.sharpness / 2 * by_columns(some) + evidence_of(some)[-1])


def test_what_failed_is_bad_in_its_order_and_a_label_goes_before_its_flag():
    some = answers_of([0] * 11 + [1], outcome=[1.0, 0.0, NAN, 1.0, 0.0] + [NAN] * 6 + [0.0])
    found, alone = judged(some), by_columns(some) + evidence_of(some)[-1]
    expected = np.append(alone[0], np.log(ERROR / (1 - ERROR) * expit(alone[[1, 4]])))
    np.testing.assert_allclose(found.log_odds[[0, 1, 4, 11]], np.append(expected, SURE))
    assert (found.verdicts[[0, 1, 4, 11]].tolist(), found.count) == ([0, -1, -1, 1], 5)


def test_a_flag_that_labels_contradict_is_not_obeyed():
    some = answers_of([0, 0, 0, -1] + [0] * 7 + [1], outcome=[1.0, 0.0, NAN, 1.0, 0.0] + [NAN] * 6 + [0.0])
    found = judged(some, min_proba=0.999)
    assert (found.witnesses.heard, found.verdicts[[0, 1, 4]].tolist()) == ((0,), [0, 0, 0])
    np.testing.assert_allclose(found.log_odds[[0, 1, 4]], log_odds_by(some)[[0, 1, 4]])


def test_probabilities_stay_away_from_certainty():
    pairs = [(a, b) for a in range(12) for b in range(a)]
    found = judged(answers_of([0] * 11 + [1], pairs), min_proba_bound=0.07)
    assert (found.log_odds.min(), found.log_odds.max()) == pytest.approx((-logit(0.93), logit(0.93)))
    assert found.log_odds[10] == pytest.approx(logit(0.93))  # by the columns


# Contradictions.


def test_labels_are_named_that_the_others_make_improbable():
    some = answers_of([-1, -1, -1, 0, 0, 0, 0, 0, 1, 1, 1, -1])
    assert judged(some).contradicting.tolist() == [11]
    assert judged(answers_of([1, -1, -1, 0, 0, 0, 0, 0, 1, 1, 1, 0])).contradicting.tolist() == [0]
    without = replace(some, labels=np.where(EVERYTHING == 11, 0, some.labels))
    proba = ERROR + (1 - 2 * ERROR) * expit(-by_columns(without)[11])
    for limit, named in ((proba * 1.001, [11]), (proba * 0.999, [])):
        assert judged(some, max_contradicted_proba=limit).contradicting.tolist() == named
    for least, named in ((6, [11]), (7, [])):  # of seven
        assert judged(some, min_other_answers=least).contradicting.tolist() == named
    assert (judged(some).verdicts[11], judged(some).log_odds[11]) == (-1, pytest.approx(-SURE))


@pytest.mark.parametrize(("n_answers", "named"), [(4, []), (5, [7]), (9, [7]), (10, [2, 7]), (15, [2, 7])])
def test_only_the_most_improbable_labels_are_named_and_each_has_four_other_answers(n_answers, named):
    labels = np.array([0, 0, 1, 0, -1, 0, 0, 1] + [0] * 4)
    some = answers_of(labels, pairs=[(8, 9)] * (n_answers - 3))
    expected = np.array([0.19, 0.21, 0.05])
    assert contradicting(some, expected, SETTINGS).tolist() == named
    at_limit = replace(SETTINGS, max_contradicted_proba=0.19)
    assert contradicting(some, expected, at_limit).tolist() == [m for m in named if m == 7]


# Whether answers predict each other.
@pytest.mark.parametrize("max_folds", [16, 4])
@pytest.mark.parametrize("outcome", [None, ENDED])
def test_each_answer_is_predicted_by_all_else_or_by_other_folds(outcome, max_folds):
    some = answers_of(AGREED, [(0, 1), (3, 2), (5, 4), (6, 7), (7, 8)], outcome)
    rows, evidence, total, n_pairs, _ = evidence_of(some)
    answered, right = predicted(rows, evidence, total, n_pairs, 0, replace(SETTINGS, max_folds=max_folds))
    assert answered.tolist() == [0, 2, 4, 7, 9, 11, *range(12, 17)]
    for place, r in enumerate(answered):
        others = total.copy()
        own = answered[place % max_folds :: max_folds]
        others[own] = total[own] - evidence[own]
        log_odds = regression(rows, others, n_pairs, SETTINGS, slice(r, r + 1))[0] + others[r]
        assert right[place] == pytest.approx(ERROR + (1 - 2 * ERROR) * expit(np.sign(evidence[r]) * log_odds))
    assert (outcome is None) == (total == evidence).all()


def test_the_two_rows_of_a_pair_without_a_difference_are_left_out_together():
    some = answers_of(AGREED, [(0, 1)], tied=[(3, 5), (6, 8)])
    rows, evidence, total, n_pairs, _ = evidence_of(some)
    answered, right = predicted(rows, evidence, total, n_pairs, 2, SETTINGS)
    for first in (-4, -3):
        own = answered[[first, first + 2]]
        others = np.where(np.isin(np.arange(len(total)), own), 0.0, total)
        log_odds = regression(rows, others, n_pairs, SETTINGS, own)
        np.testing.assert_allclose(right[[first, first + 2]], ERROR + (1 - 2 * ERROR) * expit(log_odds))


# What to ask next.
def places(log_odds, chosen):
    return (np.argsort(np.argsort(log_odds))[chosen] / (len(log_odds) - 1)).tolist()


def asked(ranking, labels, k, said=None, now=None):
    """The demonstrations that are asked about next; `said` are those of which something else is known."""
    labels = np.array(labels, dtype=np.int64)
    is_said = (labels != 0) | (False if said is None else said)
    return places_to_ask(ranking, ranking if now is None else now, labels, is_said, SETTINGS, k)


def test_labels_are_asked_for_at_fixed_places_of_the_ranking():
    log_odds, labels = np.random.default_rng(0).permutation(101).astype(float), np.zeros(101, dtype=np.int64)
    chosen = asked(log_odds, labels, 14)
    # 2 to 13 times .618, modulo 1
    by_golden = [0.24, 0.85, 0.47, 0.09, 0.71, 0.33, 0.94, 0.56, 0.18, 0.80, 0.42, 0.03]
    assert places(log_odds, chosen) == pytest.approx([0.05, 0.95, *by_golden])
    for n, sign in enumerate([-1, 1, -1, 1]):
        labels[chosen[n]] = sign
        assert asked(log_odds, labels, 2) == chosen[n + 1 : n + 3]
    beside = asked(log_odds, np.zeros(101), 1, log_odds == 5)
    assert places(log_odds, beside) in ([0.04], [0.06])


def test_once_a_kind_leads_the_next_one_is_likely_of_the_other_kind():
    ranking, now = np.arange(101.0), np.arange(101.0)[::-1]  # the answers turn the ranking
    for sign, likely in ((1, 96), (-1, 4)):
        labels = np.zeros(101)
        labels[[10, 30, 95]] = sign  # of one kind alone: at fixed places
        assert asked(ranking, labels, 1, now=now) == [85]
        labels[85] = -sign
        assert asked(ranking, labels, 2, now=now) == [likely, 9]
        labels[likely] = -sign
        assert asked(ranking, labels, 1, now=now) == [9]


def test_nothing_is_asked_twice_and_what_is_given_stays_as_it_is():
    said = np.array([False, False, False, True, True])
    for labels, left in (([1, 0, 0, -1, 0], [1, 2]), ([1, 1, 0, 1, -1], [2]), ([1, 1, 1, 0, 0], [])):
        assert sorted(asked(np.arange(5.0), labels, 9, said)) == left
    assert said.tolist() == [False, False, False, True, True]
    assert asked(np.zeros(1), [0], 2) == [0]
    assert asked(np.arange(4.0), [0, 0, 1, -1], 1) == [1]  # nearest to .24


EVERY = np.append(np.arange(12), [11, 11, 0])  # two copies of the best, one of the worst


def about_copies(labels=None, pairs=(), outcome=None, tied=()):
    return answer(COLUMNS[EVERY], answers_of(labels, pairs, outcome, tied, m=15), SETTINGS, EVERY)


def test_a_copy_confirms_nothing():
    found, once = about_copies([0] * 11 + [1, 1, 1, 0]), judged(answers_of([0] * 11 + [1]))
    np.testing.assert_array_equal(found.log_odds, once.log_odds[EVERY])
    np.testing.assert_array_equal(found.verdicts, EVERY == 11)
    assert found.count == 1
    for copied, told in (
        ({"pairs": [(11, 0), (12, 0), (13, 14), (11, 12)]}, {"pairs": [(11, 0)]}),
        ({"tied": [(11, 0), (14, 13), (11, 12)]}, {"tied": [(0, 11)]}),
    ):
        found, once = about_copies(**copied), judged(answers_of(**told))
        np.testing.assert_array_equal(found.log_odds, once.log_odds[EVERY])
        assert found.count == 1


# Pairs without a difference.


def by_ties(tied, pairs=()):
    some = answers_of(None, pairs, None, tied, 9)
    rows, n_pairs = some.rows(np.linspace(-2, 2, 9)[:, None])
    return regression(rows, some.evidence(logit(1 - ERROR)), n_pairs, SETTINGS, slice(9))


@pytest.mark.parametrize("others", [[(7, 1)], [(7, 1), (6, 2)], [(7, 1), (1, 6)]])
def test_a_tie_is_between_a_win_and_a_loss_and_neither_is_the_first(others):
    win, tie, loss = by_ties([], [*others, (8, 0)]), by_ties([(8, 0)], others), by_ties([], [*others, (0, 8)])
    assert win[8] - win[0] > tie[8] - tie[0] > loss[8] - loss[0]
    np.testing.assert_allclose(by_ties([(0, 8)], others), tie, atol=1e-6)


def test_ties_across_take_words_that_ties_of_neighbours_leave():
    wins = [(11, 0), (10, 1)]
    cases = [], [(11, 0), (10, 1)], [(0, 1), (10, 11)]
    alone, across, beside = (judged(answers_of(pairs=wins, tied=tied)).log_odds[11] for tied in cases)
    assert across < 0.6 * alone < 0.9 * alone < beside
