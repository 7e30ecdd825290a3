"""Answers to made-up audits: what is known without them, what is asked, and the words, by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit
from rpil import DataError
from rpil.data.demonstrator_groups import Demonstrators
from rpil.inference.answered import Answered
from rpil.inference.answers import Answers
from rpil.inference.findings import FINDINGS
from rpil.results.answering import (
    NOT_USED,
    doubts_of_answers,
    known_demonstrators,
    rank_demonstrators,
    stretch_of,
    verdicts_of,
    where_to_look,
)
from rpil.results.facts import TWO_GROUPS
from rpil.results.record import Demonstrator, Interval
from rpil.results.vocabulary import VOCABULARIES

OF_GROUPS, OF_ALL = f"{TWO_GROUPS}A has 3 demonstrations and B 3.", "Part 3 rests."
COLUMNS = np.linspace(1, -1, 6)[:, None] * np.ones((6, 2))
"""From which the first demonstrations seem good."""


def two_groups(**changes):
    """Six demonstrations, of which the first three are one group and the others another."""
    known = {"finding": "two groups", "identifiable": False, "competing": ((0, 1, 2), (3, 4, 5)), "pair": (0, 3)}
    said = FINDINGS["two groups"], VOCABULARIES["none"].explanation, OF_GROUPS, OF_ALL, "Slow.", NOT_USED
    known |= {"notes": (OF_GROUPS, OF_ALL), "doubts": ("Slow.",), "assumptions": said}
    return make_audit(("open",) * 6, lengths=[2] * 6, **({"columns": COLUMNS} | known | changes))


def sentence(counts):
    return f"P(good) is learned from {counts}, each of which may be wrong."


def test_two_groups_are_told_until_a_second_answer():
    audit, words = two_groups(), (FINDINGS["answered"], VOCABULARIES["answers"].explanation)
    one = audit.answered({0: "good"})
    assert (one.identifiable, one.competing, one.notes) == (False, audit.competing, audit.notes)
    assert one.assumptions == (*words, OF_GROUPS, OF_ALL, sentence("1 label"))
    for two in (audit.answered({0: "good", 3: "bad"}), one.answered({3: "bad"})):
        assert (two.identifiable, two.competing, two.notes) == (True, (), (OF_ALL,))
        assert two.assumptions == (*words, OF_ALL, sentence("2 labels"))
    assert two_groups(identifiable=True).answered({0: "good"}).identifiable


@pytest.mark.parametrize(
    ("labels", "pairs", "outcome", "counts"),
    [
        ({0: "good"}, [], [], "1 label"),
        ({}, [(0, 3)], [], "1 pair"),
        ({}, [(0, 3), (1, 4)], [], "2 pairs"),
        ({0: "good", 1: "good"}, [(0, 3)], [1.0], "2 labels, 1 pair, 1 outcome"),
        ({0: "good"}, [], [0.0, 1.0], "1 label, 2 outcomes"),
    ],
)
def test_answers_are_counted(labels, pairs, outcome, counts):
    """Outcomes are those of the last demonstrations; they stay when answers come."""
    known = Answers.of_labels(np.zeros(6, dtype=np.int64))
    known.outcome[6 - len(outcome) :] = outcome
    audit = two_groups(answers=known).answered(labels, pairs)
    assert audit.assumptions[-1] == sentence(counts)
    np.testing.assert_array_equal(audit.answers.outcome, known.outcome)
    assert audit.answers.pairs.tolist() == [list(pair) for pair in pairs]
    assert audit.answers.labels.tolist() == [int(m in labels) for m in range(6)]


def test_the_other_demonstrations_of_a_person_are_evidence_and_a_word_agrees_with_all_of_it():
    """Ann has one demonstration that seems good, and others that are labelled bad."""
    columns = np.repeat([1.0, 0.6, 1.0, -1.0], [1, 1, 4, 6])[:, None] * np.ones((12, 2))
    people = Demonstrator("Ann", None, (1, *range(6, 12))), Demonstrator("Bob", None, (0, *range(2, 6)))
    labels = dict.fromkeys(range(2, 6), "good") | dict.fromkeys(range(6, 12), "bad")
    audit = make_audit(("open",) * 12, lengths=[2] * 12, columns=columns)
    alone = audit.answered(labels)
    of_ann = make_audit(("open",) * 12, lengths=[2] * 12, columns=columns, demonstrators=people).answered(labels)
    np.testing.assert_allclose(sum(of_ann.evidence.values()), of_ann.log_odds)
    assert (alone.verdicts[1], of_ann.verdicts[1], of_ann.verdicts[0]) == ("good", "open", "good")
    assert alone.log_odds[1] > 0 > of_ann.log_odds[1]
    assert of_ann.log_odds[1] == alone.log_odds[1] + of_ann.from_demonstrator[1]
    assert [one.name for one in of_ann.demonstrators] == ["Bob", "Ann"]


def test_words_of_answers_stand_above_those_that_stay():
    words, stays = np.array([1, 1, 0, 0, 0, -1, -1]), np.array([0, -1, 1, 0, -1, 1, 0])
    found = verdicts_of(words, "answers", stays)
    assert found == ("good", "good", "similar", "open", "outlier", "bad", "bad")
    assert verdicts_of(np.array([1, 0, -1]), "none") == ("similar", "open", "outlier")
    assert verdicts_of(np.array([1, 0, -1]), "answers") == ("good", "open", "bad")


def test_doubts_of_answers():
    odds, none = np.zeros(4), np.zeros(4, dtype=int)

    def doubts(count, p_nothing=0.4):
        return doubts_of_answers(Answered(odds, none, none, none[:0], count, p_nothing))

    assert ["One answer alone does not" in doubt for doubt in doubts(1)] == [True]
    assert doubts(2) == doubts(7, p_nothing=0.6) == doubts(8) == ()
    assert ["No measured fact" in doubt for doubt in doubts(8, p_nothing=0.6)] == [True]


def asking(ratio=(), **changes):
    """Two demonstrations of ten steps, of which the second one's log-ratios are 1 but for those of `ratio`."""
    steps = np.ones(20)
    for step, value in ratio:
        steps[10 + step] = value
    made = {"verdicts": ("similar", "outlier"), "lengths": [10, 10], "step_log_ratio": steps, "pair": (0, 1)}
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
        ([(m, -6.0) for m in range(8)], [0, 7], "", ""),  # nearly all of it is no place
    ],
)
def test_where_to_look(ratio, look_at, where, seconds):
    audit = asking(ratio)
    assert stretch_of(audit, 0) is None
    assert stretch_of(audit, 1) == look_at
    assert where_to_look(audit, 1) == (f"1 (look {where})" if where else "1")
    assert where_to_look(replace(audit, fps=10.0), 1) == (f"1 (look {seconds})" if where else "1")


def test_nothing_is_to_see_where_steps_are_not_kept():
    kept = {"step_log_ratio": np.empty(0), "step_share": np.empty(0), "step_weight": np.empty(0)}
    assert stretch_of(asking(**kept), 1) is None


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


@pytest.mark.parametrize(
    ("log_odds", "order"),
    [
        ([0.3, -5, 9], [0, 1, 2]),
        ([7, 1, 3, 2, -1], [3, 1, 2, 0, 4]),
        ([4, 3, 2, 1], [1, 2, 0, 3]),  # those as near are in the order of the data
        ([8, 1, 7, 2, 6, 3, 5, 4], [6, 7, 4, 5, 2, 3, 0, 1]),
    ],
)
def test_without_columns_those_nearest_to_the_middle_are_asked_first(log_odds, order):
    audit = make_audit(("open",) * len(log_odds), log_odds=np.array(log_odds, dtype=float))
    assert audit.suggest_labels(len(order)) == tuple(order)
    assert audit.suggest_labels(1) == (order[0],)
    with pytest.raises(DataError, match="k=0 labels cannot be suggested; ask for one at least"):
        audit.suggest_labels(0)
    labelled = make_audit(("open",) * len(order), log_odds=np.array(log_odds, dtype=float), labels={order[0]: -1})
    assert labelled.suggest_labels(9) == tuple(order[1:])


def test_of_copies_the_first_is_suggested_and_none_of_a_labelled_one():
    copy_of, columns = np.array([0, 0, 2, 3, 2, 5]), COLUMNS[[0, 0, 2, 3, 2, 5]]
    audit = two_groups(copy_of=copy_of, columns=columns)
    assert {*audit.suggest_labels(9)} == {0, 2, 3, 5}
    assert {*two_groups(copy_of=copy_of, columns=columns, labels={4: 1}).suggest_labels(9)} == {0, 3, 5}


IDS = ("first", "second", "third", "fourth", "fifth")
NAMES = Demonstrators.from_names(["Ann", "Bob", "Ann", None, "Bob"])
TRUST = np.array([[0.2, 0.1, 0.3], [0.8, 0.7, 0.9], [0.5, 0.0, 1.0]])


def test_demonstrators_are_ranked_by_trust_and_counted_by_verdict():
    bob, ann = rank_demonstrators(NAMES, TRUST, IDS)
    assert (bob.name, bob.demonstrations) == ("Bob", (IDS[1], IDS[4]))
    assert (ann.name, ann.demonstrations) == ("Ann", (IDS[0], IDS[2]))
    audit = make_audit(("outlier", "similar", "open", "similar", "similar"), ids=IDS, demonstrators=(bob, ann))
    assert audit.verdict_counts(bob.demonstrations) == {"similar": 2, "open": 0, "outlier": 0}
    assert audit.verdict_counts(ann.demonstrations) == {"similar": 0, "open": 1, "outlier": 1}
    assert bob.trust == Interval(0.8, 0.7, 0.9)
    assert rank_demonstrators(Demonstrators(), TRUST, IDS) == ()


def test_without_trust_demonstrators_stand_in_the_order_of_the_data():
    found = rank_demonstrators(NAMES, np.empty((0, 3)), IDS)
    assert [(who.name, who.trust) for who in found] == [("Ann", None), ("Bob", None)]


def test_the_demonstrators_of_an_audit_are_those_that_it_was_given():
    found = known_demonstrators(rank_demonstrators(NAMES, TRUST, IDS), IDS)
    np.testing.assert_array_equal(found.indicator, NAMES.indicator)
    assert found.names == NAMES.names
    assert known_demonstrators((), IDS).names == ()
    assert known_demonstrators((Demonstrator("Ann", None, ("fifth",)),), IDS).names == (None, None, None, None, "Ann")
