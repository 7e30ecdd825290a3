"""Answers to made-up audits: what is known without them, what is asked, and the words, by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

from audits import make_audit
from rpil import DataError
from rpil.data.fit_data import Demonstrators
from rpil.inference.answered import Answered
from rpil.inference.answers import Answers
from rpil.inference.findings import FINDINGS
from rpil.inference.witnesses import Witnesses
from rpil.results.answering import (
    NOTHING_FOLLOWED,
    doubts_of_answers,
    looking_order,
    rank_demonstrators,
    rejecting_rules,
    where_to_look,
)
from rpil.results.judged import Demonstrator
from rpil.results.reasons import TWO_GROUPS, worst_stretch
from rpil.results.vocabulary import VOCABULARIES

OF_GROUPS, OF_ALL = f"{TWO_GROUPS}B is shorter.", "Part 3 rests."
TRUSTS = "The policy trusts 3 of 6 that agree; two labels can change this."
ONE_ANSWER = "One answer alone does not make other demonstrations good or bad; give a second one."
COLUMNS = np.linspace(1, -1, 6)[:, None] * np.ones((6, 2))
"""From which the first demonstrations seem good."""


def two_groups(**changes):
    """Six demonstrations, of which the first three are one group and the others another."""
    known = {"finding": "two groups", "identifiable": False, "competing": ((0, 1, 2), (3, 4, 5)), "pair": (0, 3)}
    known |= {"notes": (OF_GROUPS, OF_ALL, TRUSTS), "doubts": ("Slow.",), "method": ()}
    return make_audit(("open",) * 6, lengths=[2] * 6, **({"columns": COLUMNS} | known | changes))


def sentence(counts):
    return f"P(good) is learned from {counts}, each of which may be wrong."


@pytest.mark.parametrize("labels", [{0: "good"}, {0: "bad", 4: "bad"}])
def test_two_groups_are_told_until_answers_contrast(labels):
    audit, words = two_groups(), (FINDINGS["answered"], VOCABULARIES["answers"].explanation)
    before = FINDINGS["two groups"], VOCABULARIES["none"].explanation
    assert audit.assumptions == (*before, "Lengths and rewards were not used.")
    one = audit.answered(labels)
    assert (one.identifiable, one.competing, one.notes) == (False, audit.competing, audit.notes)
    count = "1 label" if len(labels) == 1 else "2 labels"
    assert one.assumptions == (*words, sentence(count))
    for two in (audit.answered({0: "good", 3: "bad"}), audit.answered({0: "good"}).answered({3: "bad"})):
        assert (two.identifiable, two.competing, two.notes) == (True, (), (OF_ALL,))
        assert two.assumptions == (*words, sentence("2 labels"))
    assert two_groups(identifiable=True).answered({0: "good"}).identifiable
    of_one = two_groups(notes=("All outliers are of one operator, Ann: perhaps a style.",))
    assert (len(of_one.answered({0: "bad"}).notes), of_one.answered({0: "bad", 1: "good"}).notes) == (1, ())


def test_a_demonstrator_with_bad_demonstrations_is_evidence_and_trusted_less():
    """Ann has one demonstration that seems good, and others that are labelled bad."""
    columns = np.repeat([1.0, 0.5, 1.0, -1.0], [1, 1, 4, 6])[:, None] * np.ones((12, 2))
    people = Demonstrator("Ann", None, (1, *range(6, 12))), Demonstrator("Bob", None, (0, *range(2, 6)))
    labels = dict.fromkeys(range(2, 6), "good") | dict.fromkeys(range(6, 12), "bad")
    audit = make_audit(("open",) * 12, lengths=[2] * 12, columns=columns)
    alone = audit.answered(labels)
    of_ann = make_audit(("open",) * 12, lengths=[2] * 12, columns=columns, demonstrators=people).answered(labels)
    np.testing.assert_allclose(sum(of_ann.evidence.values()), of_ann.log_odds)
    assert (alone.verdicts[1], of_ann.verdicts[0]) == ("good", "good")
    assert of_ann.log_odds[1] < 0.7 * alone.log_odds[1]
    assert [one.name for one in of_ann.demonstrators] == ["Bob", "Ann"]
    given = make_audit(("open",) * 12, lengths=[2] * 12, columns=columns, demonstrators=people)
    assert [one.trust for one in given.answered({2: "good"}).demonstrators] == [None, None]


@pytest.mark.parametrize(
    ("count", "contrast", "follows", "doubts"),
    [
        (1, False, False, (ONE_ANSWER,)), (8, True, False, (NOTHING_FOLLOWED,)),
        (2, True, False, ()), (7, True, False, ()), (8, False, False, ()), (8, True, True, ()),
    ],
)  # fmt: skip
def test_doubts_of_answers(count, contrast, follows, doubts):
    """And of the outcomes that these do not confirm, or turn, or outweigh."""
    none, known = np.zeros(4, dtype=int), replace(Answers.none(4), outcomes=np.zeros((4, 4)), names=("a", "-b", *"cd"))
    alone = "No answer and no other outcome confirms the outcome {}, so it counts for little."
    turned = "The outcome d contradicts what else is known: less of it counts as better."
    more = () if count == 1 else (alone.format("-b"), alone.format("c"), turned)
    said = Witnesses(np.zeros((4, 4)), np.array([0.5, 0.4, 0.49, 0.51]), np.array([1.0, 1.0, -1.0, -1.0]))
    found = Answered(np.zeros(4), none, none[:0], count, follows, said)
    assert [*doubts_of_answers(found, known, contrast)] == [*doubts, *more]
    flag = replace(known, labels=np.array([1, -1, 0, 0]), outcomes=np.array([[0.0, 0.0, 1.0, 0.0]]).T, names=("win",))
    spared, last = replace(found, log_odds=np.ones(4)), "What else is known outweighs win = 0 of 1 demonstration."
    assert [*doubts_of_answers(spared, flag, contrast)] == [*doubts, *[last] * (count > 1)]
    unsure = replace(found, witnesses=replace(said, confirmed=np.full(4, 0.4)))
    own = [alone.format("win").replace("little", "its own failures alone")] * (count > 1)
    assert [*doubts_of_answers(unsure, replace(flag, labels=none), contrast)] == [*doubts, *own]


def asking(ratio=(), **changes):
    """Two demonstrations of ten steps, of which the second one's log-ratios are 1 but for those of `ratio`."""
    steps = np.ones(20)
    for step, value in ratio:
        steps[10 + step] = value
    made = {"verdicts": ("open", "outlier"), "lengths": [10, 10], "step_log_ratio": steps, "pair": (0, 1)}
    return make_audit(**(made | changes))


@pytest.mark.parametrize(
    ("ratio", "look_at", "where", "seconds"),
    [
        ([(4, -6.0)], [4, 4], "at step 4", "at 0.4 s"),
        ([(4, -6.0), (5, -6.0), (6, -6.0)], [4, 6], "at steps 4 to 6", "from 0.4 to 0.7 s"),
        ([(0, -60.0), (1, -np.inf)], [0, 1], "at steps 0 to 1", "from 0.0 to 0.2 s"),
        # -60 is no more than -50: else the steps between would be a part of the stretch.
        ([(1, -60.0), (2, 40.0), (3, 15.0), (4, -50.0)], [1, 1], "at step 1", "at 0.1 s"),
        ([(4, -4.9)], None, "", ""),
        ([(m, -6.0) for m in range(7)], [0, 6], "at steps 0 to 6", "from 0.0 to 0.7 s"),
        ([(m, -6.0) for m in range(8)], [0, 7], "", ""),  # nearly all of it is no place
    ],
)
def test_where_to_look(ratio, look_at, where, seconds):
    audit = asking(ratio)
    assert [worst_stretch(audit.log_ratio(m)) for m in (0, 1)] == [None, look_at and tuple(look_at)]
    assert where_to_look(audit, 1) == (f"1 (look {where})" if where else "1")
    assert where_to_look(replace(audit, fps=10.0), 1) == (f"1 (look {seconds})" if where else "1")


@pytest.mark.parametrize(
    ("changes", "is_asked"),
    [
        ({}, True),
        ({"finding": "two groups"}, True),
        ({"finding": "nothing could be learned"}, True),
        ({"pair": ()}, False),
        ({"pair": (), "finding": "nothing could be learned"}, False),
        ({"labels": {0: 1}}, False),  # as of tasks, of which one has answers
        ({"anchor": "answers"}, False),
        ({"anchor": "answers", "labels": {0: 1}}, False),
    ],
)
def test_the_pair_is_asked_about_before_any_answer(changes, is_asked):
    text = "Which is better: 0 or 1 (look at step 4)?"
    audit = asking([(4, -6.0)], **changes)
    asked = audit.to_dict()["question"]
    assert (audit.question, asked and asked["text"]) == ((text, text) if is_asked else (None, None))
    if is_asked:
        assert json.loads(json.dumps(asked)) == {"pair": [0, 1], "look_at": [None, [4, 4]], "text": text}


def test_labels_are_asked_for_at_fixed_places_of_the_ranking_without_answers():
    """The 21 places are 0, .05, .. 1, and the labels are those of 20, 19, .. 0."""
    made = {"log_odds": np.zeros(21), "from_actions": np.arange(20.0, -1, -1)}
    order = (19, 1, 15, 3, 11, 18, 6, 13)  # .05, .95, .24, .85, .47, .09, .71, .33
    audit = make_audit(("open",) * 21, **made)
    assert (audit.suggest_labels(1), audit.suggest_labels(8)) == (order[:1], order)
    assert {*audit.suggest_labels(99)} == {*range(21)}
    labelled = make_audit(("open",) * 21, labels={19: -1, 1: 1}, **made)
    assert labelled.suggest_labels(2) == order[2:4]
    rules = tuple("outcome" if m == 15 else "" for m in range(21))
    assert replace(labelled, rejected_by=rules).suggest_labels(2) == (16, 3), "of a failure is known enough"
    with pytest.raises(DataError, match="k=0 labels cannot be suggested; ask for one at least"):
        audit.suggest_labels(0)


def test_of_copies_the_first_is_suggested_and_none_of_a_labelled_one():
    copy_of, columns = np.array([0, 0, 2, 3, 2, 5]), COLUMNS[[0, 0, 2, 3, 2, 5]]
    audit = two_groups(copy_of=copy_of, columns=columns)
    assert {*audit.suggest_labels(9)} == {0, 2, 3, 5}
    assert {*two_groups(copy_of=copy_of, columns=columns, labels={4: 1}).suggest_labels(9)} == {0, 3, 5}


IDS = ("first", "second", "third", "fourth", "fifth")
NAMES = Demonstrators.from_names(["Ann", "Bob", "Ann", None, "Bob"])
PROBA = np.array([0.1, 0.9, 0.3, 0.5, 0.7])


def test_demonstrators_are_ranked_by_trust_and_without_it_stand_in_the_order_of_the_data():
    bob, ann = rank_demonstrators(NAMES, IDS, PROBA)
    assert (bob.name, bob.demonstrations, bob.trust.mean) == ("Bob", (IDS[1], IDS[4]), 0.8)
    assert (bob.trust.low, bob.trust.high) == pytest.approx(beta.ppf([0.025, 0.975], 2.6, 1.4))
    assert (ann.name, ann.demonstrations) == ("Ann", (IDS[0], IDS[2]))
    assert rank_demonstrators(Demonstrators(), IDS, PROBA) == ()
    found = rank_demonstrators(NAMES, IDS)
    assert [(who.name, who.trust) for who in found] == [("Ann", None), ("Bob", None)]


def test_contradicting_labels_are_looked_at_before_outliers_a_group_apart_and_the_lowest_of_the_others():
    log_odds = np.array([5.0, 3.0, -8.0, 1.0, 9.0, -2.0, -1.0, -1.0, 4.0, 0.0])
    words = ("open",) * 5 + ("outlier",) * 2 + ("bad", "good", "open")
    audit = make_audit(words, ids=[f"d{k}" for k in range(10)], log_odds=log_odds)
    assert looking_order(audit) == ([5, 7, 6, 2, 9, 3, 1, 0, 4, 8], 5), "of equal ones the last first"
    contradicted = replace(audit, contradicting=("d4", "d6"), competing=(("d0",), ("d9", "d3", "d8")))
    assert looking_order(contradicted) == ([4, 6, 5, 7, 2, 9, 3, 1, 0, 8], 5)
    assert looking_order(replace(contradicted, finding="a group apart")) == ([4, 6, 5, 7, 9, 3, 8, 2, 1, 0], 7)
    assert [looking_order(make_audit(("open",) * n))[1] for n in (4, 59, 60)] == [4, 5, 6]


def test_each_rule_rejects_its_own():
    """The labels of the first two, pairs in which 2 and 3 are worse than 0, a copy of 2, and two that failed."""
    words = ("bad", "bad", "open", "open", "bad", "open", "open", "open", "adversary")
    log_odds = np.array([-1.0, -1.0, -1.0, 1.0, -1.0, 0.0, -5.0, -1.0, -1.0])
    labels, pairs = np.array([1, -1, 0, 0, 0, 0, 0, 0, 0]), np.array([[0, 2], [0, 3]])
    flags = np.array([[0.0], [np.nan], *[[1.0]] * 4, [np.nan], [0.0], [1.0]])
    known = Answers(labels, pairs, flags, names=("success",))
    audit = make_audit(words, log_odds=log_odds, answers=known, copy_of=np.array([0, 1, 2, 3, 4, 2, 6, 7, 8]))
    expected = ("", "labels", "answers", "", "answers", "answers", "", "outcome", "adversary")
    assert rejecting_rules(audit) == expected
    assert rejecting_rules(replace(audit, log_odds=np.abs(log_odds)))[7] == "", "answers speak for it"
    alone = replace(audit, answers=Answers.of_labels(np.minimum(labels, 0)))
    assert rejecting_rules(alone) == ("", "labels", *[""] * 6, "adversary"), "until two answers contrast"
