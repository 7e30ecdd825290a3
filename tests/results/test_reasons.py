"""The reason for a verdict names the part of the evidence that decided, and the worst stretch of steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit
from rpil.inference.answers import Answers
from rpil.results.reasons import MIN_STRETCH, worst_stretch

NO_STRETCH = {"step_log_ratio": np.ones(40), "lengths": [20, 20]}


@pytest.mark.parametrize("seed", range(20))
def test_worst_stretch_has_the_lowest_sum_of_all_stretches(seed: int) -> None:
    ratio = np.random.default_rng(seed).normal(0.2, 2.0, 25)
    sums = {(i, j): ratio[i : j + 1].sum() for i in range(25) for j in range(i, 25)}
    lowest = min(sums, key=sums.__getitem__)
    stretch = worst_stretch(ratio)
    if sums[lowest] > -MIN_STRETCH:
        assert stretch is None
    else:
        assert stretch is not None
        assert (stretch.first, stretch.last) == lowest
        assert stretch.nats == pytest.approx(sums[lowest])


def test_steps_without_evidence_against_an_expert_do_not_stand_out() -> None:
    assert worst_stretch(np.ones(5)) is None
    assert worst_stretch(np.array([1.0, -MIN_STRETCH / 2, 1.0])) is None


def test_reason_names_the_stretch_of_the_audit() -> None:
    ratio = np.ones(40)
    ratio[25:29] = -3.0
    audit = make_audit(("typical", "unlike"), step_log_ratio=ratio, lengths=[20, 20])
    good, bad = audit.reasons
    assert good == "Judged by its actions: its mean log-ratio is +1.00 nats."
    assert "mean log-ratio is +0.20 nats, that of the typical ones +1.00" in bad
    assert "steps 5 to 8 are least like typical ones (-12.0 nats)." in bad


def test_demonstrator_is_the_reason_where_its_part_is_the_larger() -> None:
    parts = {"from_actions": np.array([3.0, 0.5]), "from_demonstrator": np.array([1.0, -4.0])}
    audit = make_audit(("typical", "unlike"), log_odds=np.array([4.0, -3.5]), **parts, **NO_STRETCH)
    assert audit.reasons[0].startswith("Judged by its actions")
    assert audit.reasons[1].startswith("Judged by its demonstrator's other demonstrations (-4.0 nats; +0.5 nats from")


def test_reason_of_an_open_one_is_true_of_high_and_of_low_log_odds() -> None:
    log_odds = np.array([5.0, 11.1, 1.0, -4.0])
    proba = {"expert_proba": 1 / (1 + np.exp(-log_odds))}
    audit = make_audit(
        ("typical", "open", "open", "open"), log_odds=log_odds, **proba, **NO_STRETCH | {"lengths": [10] * 4}
    )
    assert audit.reasons[1:] == (
        "Its log-odds are +11.1 nats, but only the better half of those that score high is called typical, if other "
        "folds agree.",
        "Its log-odds of +1.0 nats are too close to 0 to call it typical or unlike.",
        "Its log-odds are -4.0 nats, but it is called unlike only if other folds agree.",
    )
    known = {"anchor": "answers", "finding": "answered", "expert_proba": proba["expert_proba"][:2]}
    answered = make_audit(("good", "open"), log_odds=log_odds[:2], **known, **NO_STRETCH)
    assert answered.reasons[1] == "Its log-odds are +11.1 nats, but that alone gives no word."


def test_label_is_the_reason_and_its_contradiction_with_the_other_answers_is_told() -> None:
    known = {"anchor": "answers", "finding": "answered", "labels": {0: 1, 1: -1}, "contradicting": (1,)}
    audit = make_audit(("good", "open"), log_odds=np.array([20.0, 1.0]), **known, **NO_STRETCH)
    assert audit.reasons == ("Labelled good.", "Labelled bad, which contradicts the other answers: look again.")


def test_outcome_is_the_reason_where_it_decided() -> None:
    outcome = np.array([9.0, 5.0, 1.0, np.nan, 2.0])
    answers = Answers(np.array([0, 0, 0, 0, 1]), np.empty((0, 2), dtype=np.int64), outcome)
    log_odds = np.array([3.0, 0.0, -3.0, -3.0, 4.0])
    known = {"anchor": "answers", "finding": "answered", "answers": answers, "log_odds": log_odds}
    steps = {"step_log_ratio": np.ones(100), "lengths": [20] * 5}
    assert make_audit(("good", "open", "bad", "bad", "good"), **known, **steps).reasons == (
        "Its outcome is among the highest (+3.0 nats).",
        "Its log-odds of +0.0 nats are too close to 0 to call it good or bad.",
        "Its outcome is among the lowest (-3.0 nats).",
        "Judged by what the answers say of demonstrations like it (-3.0 nats).",
        "Labelled good.",
    )


def test_answers_about_others_are_the_reason_for_a_demonstration_without_one() -> None:
    known = {"anchor": "answers", "finding": "answered"}
    audit = make_audit(("good", "open"), log_odds=np.array([4.0, 1.0]), **known, **NO_STRETCH)
    assert audit.reasons[0].startswith("Judged by what the answers say of demonstrations like it (+4.0 nats)")
    assert audit.reasons[1] == "Its log-odds of +1.0 nats are too close to 0 to call it good or bad."


def test_doubt_leaves_no_word() -> None:
    audit = replace(make_audit(("open",) * 2, finding="in doubt", **NO_STRETCH), doubts=("Folds differ.", "More."))
    assert audit.reasons == ("No word, because of a doubt: folds differ.",) * 2


@pytest.mark.parametrize("finding", ["nobody stands out", "nothing could be learned"])
def test_without_two_groups_nothing_tells_a_demonstration_from_the_others(finding: str) -> None:
    audit = make_audit(("open",) * 2, finding=finding, **NO_STRETCH)
    assert all(reason.startswith("Nothing tells it from the others") for reason in audit.reasons)
    ratios = {"step_log_ratio": np.full(40, -1.0), "lengths": [20, 20]}
    bad = make_audit(("open",) * 2, finding=finding, **ratios).reasons[0]
    assert ("steps 0 to 19" in bad) == (finding == "nobody stands out")


def test_competing_groups_wait_for_a_label() -> None:
    groups = {"competing": ((0,), (1,)), "pair": (0, 1), "identifiable": False, "finding": "two groups"}
    audit = make_audit(("open",) * 3, lengths=[20, 20, 20], step_log_ratio=np.ones(60), **groups)
    assert [reason.partition(" does")[0] for reason in audit.reasons[:2]] == [
        "It acts as group A",
        "It acts as group B",
    ]
    assert audit.reasons[2] == "Only an answer can tell which group is good."


@pytest.mark.parametrize(
    ("others", "trusted", "ending"),
    [("typical", 0.6, " nats, that of the typical ones +0.60."), ("typical", -0.6, " nats."), ("open", 0.6, " nats.")],
)
def test_reason_compares_with_the_typical_where_there_are_some_and_they_score_higher(others, trusted, ending) -> None:
    ratio = np.repeat([trusted, -0.1], 20)
    audit = make_audit((others, "unlike"), step_log_ratio=ratio, lengths=[20, 20], log_odds=np.array([5.0, -5.0]))
    assert audit.reasons[1] == f"Judged by its actions: its mean log-ratio is -0.10{ending}"


def test_impossible_steps_do_not_make_a_reason_infinite() -> None:
    ratio = np.ones(40)
    ratio[30] = -np.inf
    reason = make_audit(("typical", "unlike"), step_log_ratio=ratio, lengths=[20, 20]).reasons[1]
    assert "inf" not in reason
    assert "step 10 is least like typical ones" in reason


def test_reasons_are_in_the_dict_in_the_order_of_the_ranking() -> None:
    audit = make_audit()
    rows = audit.to_dict()["demonstrations"]
    assert [row["reason"] for row in rows] == [audit.reasons[m] for m in audit.ranking()]
