"""The reason for a verdict says what decided, and where the demonstration differs most; and the facts beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from audits import make_audit
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS, normal_scores
from rpil.results.reasons import (
    FIFTHS,
    MIN_STRETCH,
    RANKS,
    at_a_glance,
    groups_differ,
    known_facts,
    span,
    worst_stretch,
)

NO_STRETCH = {"step_log_ratio": np.ones(40), "lengths": [20, 20]}


def test_worst_stretch_has_the_lowest_sum_of_all_stretches() -> None:
    assert worst_stretch(np.array([1.0, -4.9, 1.0])) is None, "that is less than 150 to one"
    assert worst_stretch(np.array([1.0, -5.0, 1.0])) == (1, 1)
    assert worst_stretch(np.array([1.0, -6.0, 20.0])) == (1, 1), "what comes after it does not begin it"
    for seed in range(20):
        ratio = np.random.default_rng(seed).normal(0.2, 2.0, 25)
        sums = {(i, j): ratio[i : j + 1].sum() for i in range(25) for j in range(i, 25)}
        lowest = min(sums, key=sums.__getitem__)
        assert worst_stretch(ratio) == (None if sums[lowest] > -MIN_STRETCH else lowest)


def test_reason_names_the_stretch_of_the_audit() -> None:
    ratio = np.ones(40)
    ratio[25:29] = -3.0
    audit = make_audit(("open", "outlier"), step_log_ratio=ratio, lengths=[20, 20])
    assert audit.reasons == ("In the middle of the ranking.", "Different at steps 5 to 8.")
    assert replace(audit, fps=10.0).reasons[1] == "Different from 0.5 to 0.9 s."
    seen = replace(audit, fps=10.0, deviations=("", "at step 7: elbow is -70; others there have -9 to 12"))
    assert seen.reasons[1] == "Different from 0.5 to 0.9 s, most at 0.7 s: elbow is -70; others there have -9 to 12."
    ratio[22:40] = -3.0
    assert replace(audit, step_log_ratio=ratio).reasons[1] == "Different nearly throughout."
    ratio[3] = -9.0
    assert replace(audit, step_log_ratio=ratio).reasons[0] == "In the middle of the ranking; most different at step 3."


def test_reason_of_an_open_one_is_true_of_high_and_of_low_log_odds() -> None:
    limit = float(np.log(0.95 / 0.05))  # of the verdict good
    log_odds = np.array([limit + 0.01, limit - 0.01, 0.01 - limit, -0.01 - limit])
    audit = make_audit(
        ("open",) * 4, log_odds=log_odds, anchor="answers", finding="answered", **NO_STRETCH | {"lengths": [10] * 4}
    )
    between = "Its score is between those of good and bad ones."
    at_limit = replace(audit, log_odds=np.full(4, logit(audit.settings.min_proba("answers"))))
    assert {reason.partition(" (")[0] for reason in at_limit.reasons} == {"Looks good"}
    high, low = (f"Looks {one}; left open to be safe." for one in ("good (place 1 of 4)", "bad (place 4 of 4)"))
    assert audit.reasons == (high, between, between, low)


def test_label_is_the_reason_and_its_contradiction_with_the_other_answers_is_told() -> None:
    known = {"anchor": "answers", "finding": "answered", "labels": {0: 1, 1: -1}, "contradicting": (1,)}
    audit = make_audit(("good", "open"), log_odds=np.array([20.0, 1.0]), **known, **NO_STRETCH)
    assert audit.reasons == ("Labelled good.", "Labelled bad, which contradicts the other answers: look again.")


def test_learned_from_outcomes_alone_or_from_answers() -> None:
    answers = replace(Answers.none(4), outcomes=np.array([9.0, 5.0, 1.0, np.nan])[:, None])
    known = {"anchor": "answers", "finding": "answered", "log_odds": np.array([3.0, 0.0, -3.0, -3.0])}
    words = ("good", "open", "bad", "bad")
    alone = make_audit(words, **known, answers=answers, step_log_ratio=np.ones(80), lengths=[20] * 4)
    assert alone.reasons[0] == "Good by the outcomes about others like it."
    flag = replace(answers, outcomes=np.array([[0.0, 1, 0, 1]]).T, labels=np.array([0, 1, 0, -1]), heard=(1,))
    outweighed = replace(alone, answers=flag, log_odds=np.array([2.0, 3.0, -2.0, -3.0]))
    assert [", though outcome = 0." in reason for reason in outweighed.reasons] == [True, False, False, False]
    worse = replace(outweighed, answers=replace(flag, pairs=np.array([[1, 0]])), verdicts=("open", *words[1:]))
    assert worse.reasons[0] == "You called it worse than 1."
    told = make_audit(words, **known, answers=answers, labels={3: -1}, step_log_ratio=np.ones(80), lengths=[20] * 4)
    between = "Its score is between those of good and bad ones."
    good, bad = (f"{side} by your answers about others like it." for side in ("Good", "Bad"))
    assert told.reasons == (good, between, bad, "Labelled bad.")


def test_without_outliers_a_reason_is_the_place_in_the_ranking() -> None:
    plain = {"lengths": [4] * 10, "step_log_ratio": np.ones(40)}
    audit = make_audit(("open",) * 10, finding="no outliers", log_odds=np.arange(10.0), **plain)
    fifths = [reason.removesuffix(" of the ranking, not clearly different.") for reason in audit.reasons]
    assert fifths == [fifth for fifth in FIFTHS for _ in range(2)]
    ratios = {"step_log_ratio": np.full(40, -1.0), "lengths": [20, 20]}
    bad = make_audit(("open",) * 2, finding="no outliers", **ratios).reasons[0]
    assert bad.endswith("not clearly different; different nearly throughout.")
    nothing = make_audit(("open",) * 2, finding="nothing could be learned", **ratios)
    assert nothing.reasons == ("Nothing could be learned.",) * 2


@pytest.mark.parametrize("finding", ["a group apart", "two groups"])
def test_competing_groups_wait_for_a_label(finding: str) -> None:
    groups = {"competing": ((0,), (1,)), "pair": (0, 1), "identifiable": False, "finding": finding}
    audit = make_audit(("open",) * 3, lengths=[20, 20, 20], step_log_ratio=np.ones(60), **groups)
    acts = [f"Acts as group {letter} does; only an answer can tell which is good." for letter in "AB"]
    assert audit.reasons == (*acts, "In neither group.")


def test_a_span_is_in_steps_or_in_seconds():
    assert [span(3, last, None) for last in (3, 4)] == ["at step 3", "at steps 3 to 4"]
    assert [span(3, last, 10.0) for last in (3, 4)] == ["at 0.3 s", "from 0.3 to 0.5 s"]
    assert span(30, 31, 1000.0) == "at 0.0 s", "which no reader can tell apart"


def test_at_a_glance_what_it_does_or_else_why():
    """A failure says more than what differs; where nothing is seen, the reason stands alone."""
    ratio = np.ones(80)
    ratio[[25, 45, 65]] = -9.0
    seen = "at step 5: elbow is -70; others there have -9 to 12"
    flags = replace(Answers.none(4), outcomes=np.array([1.0, 1, 0, 1])[:, None], names=("success",))
    words = ("open", "outlier", "bad", "outlier")
    audit = make_audit(words, lengths=[20] * 4, step_log_ratio=ratio, deviations=("", seen, seen, ""), answers=flags)
    assert audit.reasons[2] == "success 0; most different at step 5: elbow is -70; others there have -9 to 12."
    shown = [at_a_glance(audit, audit.reasons[m], m) for m in range(4)]
    does = "elbow is -70; others there have -9 to 12"
    assert shown == [("", "Above the middle of the ranking"), ("step 5", does), ("step 5", "success 0"), ("step 5", "")]
    assert at_a_glance(replace(audit, fps=10.0), audit.reasons[1], 1) == ("0.5 s", does)
    assert at_a_glance(replace(audit, rejected_by=()), audit.reasons[2], 2) == ("step 5", does)


def test_what_was_said_is_the_reason_unless_others_speak_for_it():
    pairs = replace(Answers.none(3), pairs=np.array([[0, 1], [0, 2]]))
    known = {"anchor": "answers", "finding": "answered", "answers": pairs, "log_odds": np.array([1.0, -4.0, 4.0])}
    audit = make_audit(("open", "bad", "good"), lengths=[9] * 3, step_log_ratio=np.ones(27), **known)
    assert audit.reasons[1:] == ("You called it worse than 0.", "Good by your answers about others like it.")


def columns(n=4, **channels):
    """The columns of demonstrations: channels that are named, others of 0, and the group of scores."""
    values = np.zeros((n, len(CHANNELS)))
    for name, column in channels.items():
        values[:, CHANNELS.index(name.replace("_", " "))] = column
    return np.column_stack([normal_scores(values), np.full(n, 9.0)])


@pytest.mark.parametrize(
    ("channel", "fact", "ranks"),
    [
        ("length", "length", [0.125, 0.375, 0.625, 0.875]),
        ("smoothness", "smoothness", [0.125, 0.375, 0.625, 0.875]),
        ("short_path", "path", [0.875, 0.625, 0.375, 0.125]),
    ],
)
def test_a_fact_is_the_rank_of_its_channel_and_grows_with_its_name(channel, fact, ranks):
    found = known_facts(columns(**{channel: [1.0, 2.0, 3.0, 50.0]}), None)
    assert set(found) == set(RANKS)
    assert found[fact] == tuple(ranks), "to six digits"
    assert all(values == pytest.approx([0.5] * 4) for name, values in found.items() if name != fact)


GROUPS, UP = (np.arange(8), np.arange(8, 14)), np.arange(14.0)


def differ(lengths=UP, **channels):
    (sentence,) = groups_differ(GROUPS, columns(14, **channels), lengths)
    assert sentence.startswith("The two groups: ")
    assert sentence.endswith(".")
    return sentence[16:-1]


def test_how_two_groups_differ():
    lengths = np.repeat([140, 1210], [8, 6])
    found = differ(lengths=lengths, length=UP, smoothness=UP, short_path=-UP)
    assert found == "B takes longer (median 1,210 against 140 steps), is smoother and has a longer path"


@pytest.mark.parametrize(
    ("groups", "values"),
    [
        (GROUPS, [0, 2, 4, 6, 8, 10, 12, 13, 1, 3, 5, 7, 9, 11]),
        ((np.arange(2), np.arange(2, 4)), UP),  # few: so by chance
        ((np.arange(5), np.arange(5, 9)), np.arange(9.0)),  # by chance in 2 of 126 orders
        ((np.arange(40), np.arange(40, 80)), np.append(np.arange(40), np.arange(40) + 14)),  # certain and small
        (GROUPS, [0] * 14),
    ],
)
def test_what_may_be_chance_or_is_small_is_not_said(groups, values):
    found = groups_differ(groups, columns(len(values), length=values), np.arange(len(values)))
    assert found == ("The two groups: in length, smoothness and path they hardly differ.",)


@pytest.mark.parametrize(
    ("channel", "sign", "phrase"),
    [
        ("length", -1, "is shorter (median 10 against 4 steps)"),
        ("smoothness", 1, "is smoother"),
        ("smoothness", -1, "is less smooth"),
        ("short_path", 1, "has a shorter path"),
    ],
)
def test_directions_of_facts(channel, sign, phrase):
    assert differ(**{channel: sign * UP}) == f"B {phrase}"
    swapped = np.r_[UP[:7], 8, 7, UP[9:]]
    assert differ(**{channel: sign * swapped}) == f"B {phrase}", "one pair of 48 is the other way round"
