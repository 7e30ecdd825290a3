"""Answers to an audit are judged as answers to a fit are, and no policy is fitted again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from audits import make_audit
from problems import make, refused
from rpil import RPIL, DataError
from rpil.inference.answers import Answers
from rpil.results.answering import shown_proba, with_answers
from rpil.results.record import Audit

TOY = make("random", 2, n_good=9, n_bad=4, steps=(20, 20))
LABELS = {"d0": "good", "d1": "good", "d9": "bad", "d10": "bad"}


@pytest.fixture(scope="module")
def audit() -> Audit:
    """Nine that agree, and four outliers."""
    found = RPIL().fit(TOY.demonstrations).audit_
    assert TOY.is_judged_right(found)
    return found


@pytest.mark.parametrize(
    ("labels", "pairs"), [({}, np.array([["d0", "d9"], ["d3", "d8"]])), ({"d2": "good"}, [("d5", "d9")])]
)
def test_answers_to_an_audit_are_those_of_a_fit(audit, labels, pairs):
    later = audit.answered(labels, pairs)
    words = {**labels, **{better: f"better than {worse}" for better, worse in pairs}}
    if len(words) == len(labels) + len(pairs):  # a mapping has one word for each
        assert audit.answered(words).verdicts == later.verdicts
    together = [*labels.items(), *((better, f"better than {worse}") for better, worse in pairs)]
    fitted = RPIL().fit(TOY.demonstrations, labels=together).audit_
    assert later.verdicts == fitted.verdicts
    assert later.finding == fitted.finding == "answered"
    assert later.anchor == fitted.anchor == "answers"
    assert set(later.assumptions) == set(fitted.assumptions)
    assert (later.notes, later.doubts) == (fitted.notes, fitted.doubts) == ((), ())
    for name in ("log_odds", "from_actions", "from_label", "expert_proba"):
        np.testing.assert_allclose(getattr(later, name), getattr(fitted, name), atol=1e-9)
    np.testing.assert_allclose(sum(later.evidence.values()), later.log_odds, atol=1e-9)
    assert (later.prior.low, later.prior.mean, later.prior.high) == pytest.approx(
        (fitted.prior.low, fitted.prior.mean, fitted.prior.high)
    )
    np.testing.assert_allclose(later.step_weight, fitted.step_weight, rtol=1e-9)


def test_ties_of_an_audit_are_those_of_a_fit(audit):
    words = [("d0", "same as d9"), ("d3", "better than d8"), ("d4", "better than d12")]
    later, model = audit.answered(words), RPIL().fit(TOY.demonstrations, labels=words)
    assert later.answers.tied.tolist() == [[0, 9]]
    assert "P(good) is learned from 3 pairs, each of which may be wrong." in later.assumptions
    without = audit.answered(words[1:])
    assert np.ptp(later.log_odds[[0, 9]]) < np.ptp(without.log_odds[[0, 9]])
    pairs = {("d0", "d9"): "same as", ("d3", "d8"): "better than"}
    in_turn = audit.answered(pairs=pairs).answered(pairs=[("d4", "d12")])
    for same in (model.audit_, in_turn):
        np.testing.assert_allclose(same.log_odds, later.log_odds, atol=1e-9)
        assert same.answers.tied.tolist() == [[0, 9]]
    with pytest.raises(DataError, match="'d9' and 'd0': two answers contradict each other; keep one answer"):
        later.answered(pairs=[("d9", "d0")])
    for wrong in (("d0", "d9"), {"d0": "better than"}, {("d0", "d9"): "better"}, [("d0", "d9", "d8")]):
        with pytest.raises(DataError, match="the pairs must be two ids each, the better one first, as"):
            audit.answered(pairs=wrong)
    with pytest.raises(DataError, match="A named adversary learns from labels alone"):
        RPIL(adversary="uniform").fit(TOY.demonstrations, labels=words[:1])


def test_one_answer_alone_gives_other_demonstrations_no_word(audit):
    one, pair = audit.answered({"d0": "bad"}), audit.answered(pairs=[("d0", "d9")])
    assert one.verdicts == ("bad", *audit.verdicts[1:])
    assert pair.verdicts == audit.verdicts
    assert one.reasons[9].startswith("Different ")
    assert pair.reasons[9].startswith("You called it worse than d0")
    for found in (one, pair):
        assert found.doubts == ("One answer alone does not make other demonstrations good or bad; give a second one.",)
        assert found.claimed.tolist() == audit.claimed.tolist() == [0] * 9 + [-1] * 4
        assert found.notes == audit.notes
    assert one.verdict_counts() == {"good": 0, "open": 8, "outlier": 4, "bad": 1}


def test_of_one_side_outliers_stay_and_once_answers_contrast_nothing_of_before_does(audit):
    same = audit.answered({"d1": "bad", "d9": "bad"})
    assert same.verdicts == ("open", "bad", *["open"] * 7, "bad", *["outlier"] * 3)
    assert (same.doubts, same.identifiable) == ((), True)
    assert {*audit.answered({"d1": "bad", "d9": "good"}).verdicts[2:]} == {"good", "open"}
    by_answers = audit.answered(pd.Series(LABELS))
    assert {*by_answers.verdicts} == {"good", "bad", "open"}
    assert [by_answers.verdicts[m] for m in (0, 1, 9, 10)] == ["good", "good", "bad", "bad"]


def test_a_named_adversary_learns_from_labels_in_a_fit_alone():
    with pytest.raises(DataError, match=r"give the labels to fit\(\)"):
        make_audit(anchor="named adversary", finding="mixture").answered({0: "good"})


def test_a_probability_claims_no_more_than_the_words():
    log_odds, words = np.array([5.0, 5.0, 1.0, -0.5, -7.0, -7.0]), np.array([1, 0, 0, -1, 0, -1])
    proba = shown_proba(log_odds, words, "outliers", 0.9)
    by_hand = 1 / (1 + np.exp(-log_odds))
    np.testing.assert_allclose(proba, [by_hand[0], 0.9, by_hand[2], by_hand[3], 0.1, by_hand[5]])
    assert proba[1] < 0.9  # so that none without a word is among those of .9 or more
    assert proba[4] > 1 - 0.9
    np.testing.assert_array_equal(shown_proba(log_odds, words, "answered", 0.9), proba)
    assert shown_proba(log_odds, words, "answered", 0.8)[1] == pytest.approx(0.8)
    for finding in ("a group apart", "two groups", "no outliers", "nothing could be learned"):
        assert shown_proba(log_odds, words * 0, finding, 0.9).tolist() == [0.5] * 6


def test_answers_that_take_the_place_of_all_are_not_none(audit):
    """Labels that stayed would look as if they had been taken back."""
    one = audit.answered(LABELS)
    again = one.answered({"d3": "good", "d12": "bad"}, instead=True)
    assert {name for name, label in zip(again.ids, again.labels, strict=True) if label} == {"d3", "d12"}
    with refused("No answer would be left; take the audit before answered\\(\\), or call rpil.audit without any"):
        one.answered({}, instead=True)
    assert one.answered() is not audit
    assert audit.answered({}, []) is audit.answered({}, instead=True) is audit, "no answer changes nothing"


def test_outcomes_alone_are_no_answers_of_yours(audit):
    """Bare numbers have no name, and one outcome counts once."""
    outcome = np.r_[np.ones(9), np.full(4, 2.0)]
    model = RPIL().fit(TOY.demonstrations, outcome=outcome)
    assert [doubt for doubt in model.audit_.doubts if "outcome outcome" in doubt] == []
    assert model.audit_.told == "the outcomes"
    assert model.audit_.answered({"d0": "good"}).told == "your answers"
    known = Answers.none(13)
    for names, twice in ((("a", "-a"), "'a'"), (("-b", "a", "b"), "'b'")):
        several = replace(known, outcomes=np.zeros((13, len(names))), names=names)
        with refused(f"The outcome {twice} is given with and without a minus; leave one of them out"):
            with_answers(audit, several)
