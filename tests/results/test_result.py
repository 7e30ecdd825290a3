"""What an audit holds, and says in a few sentences: its methods give what its fields say."""

import json
from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit
from rpil.inference.findings import FINDINGS
from rpil.results.judged import Demonstrator, Interval
from rpil.results.result import MAX_NAMED_FIRST, first_sentence, headline, look_first
from rpil.results.vocabulary import short_id


def test_worst_steps_are_the_most_negative_and_never_positive():
    ratio = np.concatenate([[1.0, -2.0, 0.0], [5.0], [-1.0, -3.0, 2.0, -1.0], [-np.inf, 0.5], [-6, -2, -4, -3, -5]])
    audit = make_audit(("open",) * 5, ids=(4, 3, 2, 1, 0), lengths=[3, 1, 4, 2, 5], step_log_ratio=ratio)
    assert [*map(audit.worst_steps, (4, 3, 2, 1, 0))] == [[1], [], [1, 0, 3], [0], [0, 4, 2, 3, 1]]
    assert audit.worst_steps(0, k=2) == [0, 4]
    np.testing.assert_array_equal(audit.step_log_ratio[audit.steps(2)], [-1.0, -3.0, 2.0, -1.0])


def test_a_copy_of_what_is_labelled_has_its_reason():
    made = make_audit(("good",) * 4 + ("bad",) * 4, anchor="answers", finding="answered", labels={0: 1})
    copied = replace(made, copy_of=np.array([0, 0, *range(2, 8)]))
    assert copied.reasons[1].startswith("Labelled good")
    assert not made.reasons[1].startswith("Labelled good")


def test_demonstrators_are_told_with_their_words_and_their_trust_if_it_is_known():
    ann, bob = Demonstrator("Ann", Interval(0.8, 0.7, 0.9), (0, 1)), Demonstrator("Bob", None, (2, 3))
    audit = make_audit(("open", "open", "outlier", "open"), lengths=[10, 20, 30, 40], demonstrators=(ann, bob))
    first, second = json.loads(json.dumps(audit.to_dict()))["demonstrators"]
    assert first["trust"] == {"mean": 0.8, "low": 0.7, "high": 0.9}
    counts = {"n_demonstrations": 2, "verdicts": {"open": 1, "outlier": 1}}
    assert second == {"name": "Bob", "trust": None} | counts


def test_the_text_names_finding_doubts_words_and_the_question():
    audit = make_audit(ids=list("abcdefghij"), doubts=("One reason.", "Another."), pair=("a", "j"))
    words = f"10 demonstrations ({audit.offsets[-1]:,} steps): 6 open, 4 outliers."
    doubts = ["Doubt: One reason.", "Doubt: Another."]
    assert repr(audit).splitlines() == [first_sentence(audit), headline(audit), *doubts, words, audit.question]


def test_names_stay_in_one_short_line():
    assert short_id("a\nb\tc") == r"a\nb\tc"
    assert short_id(f"{'x' * 20}{'y' * 9}") == f"...{'x' * 16}{'y' * 9}", "the end tells which one it is"
    assert (short_id("x" * 28), short_id(7)) == ("x" * 28, "7")
    audit = make_audit(("open",) * 3, ids=["a\nb", "x" * 500, "\u202e"])
    assert len(repr(audit).splitlines()) == 3
    assert max(map(len, repr(audit).splitlines())) < 120


def ranked(n, **changes):
    """Open demonstrations, of which the first is the lowest."""
    return make_audit(("open",) * n, lengths=[2] * n, log_odds=np.arange(float(n)), **changes)


@pytest.mark.parametrize(("n", "size"), [(3, 3), (59, 5), (60, 6), (200, 20)])
def test_a_tenth_is_to_be_looked_at_first_and_five_at_least(n, size):
    assert look_first(ranked(n)) == [*range(size)]


def test_faulty_ones_come_first_and_labelled_ones_not_at_all():
    audit = ranked(20, labels={0: 1, 9: -1})
    assert look_first(audit, faulty=[17, 9, 2, "gone"]) == [17, 2, 1, 3, 4]
    assert first_sentence(audit, [17]) == "Look at these 5 first: 17, 1, 2, 3, 4."
    assert first_sentence(ranked(2, labels={1: 1})) == "Look at this 1 first: 0."
    assert first_sentence(ranked(2, labels={0: 1, 1: 1})) == "Every demonstration has a label."
    assert first_sentence(ranked(2)) == "Look at these 2 first: 0, 1."
    many = first_sentence(ranked(200))
    assert many == f"Look at these 20 first: {', '.join(map(str, range(MAX_NAMED_FIRST)))} and 8 more."


def test_the_finding_in_a_sentence():
    audit = make_audit(("open", "outlier", "outlier"), log_odds=np.array([1.0, -2.0, -1.0]))
    assert headline(audit) == "2 of 3 act differently from the rest: 1, 2."
    assert headline(audit, most=0) == "2 of 3 act differently from the rest."
    one = make_audit(("open", "outlier"), ids=("a", "b\x1b"))
    assert headline(one) == "1 of 2 acts differently from the rest: b\\x1b."
    named = make_audit(("expert", "adversary"), anchor="named adversary", finding="mixture")
    assert headline(named) == "1 of 2 acts like the adversary that was named: 1."
    answered = make_audit(("good", "bad", "open", "outlier"), anchor="answers", finding="answered")
    assert headline(answered) == "By your answers: 1 good, 1 open, 1 bad (1)."
    assert headline(answered, most=0) == "By your answers: 1 good, 1 open, 1 bad."


def test_groups_and_nothing_in_a_sentence():
    groups = {"competing": ((0, 1, 2), (3, 4)), "identifiable": False}
    apart = ranked(5, finding="a group apart", **groups)
    rest = "; without an answer nobody can say if they are worse."
    assert headline(apart) == f"2 of 5 act alike, and differ from the rest (3, 4){rest}"
    assert headline(apart, most=0) == f"2 of 5 act alike, and differ from the rest{rest}"
    assert headline(replace(apart, competing=())) == FINDINGS["a group apart"]
    own = replace(apart, competing=((0, 1), (3, 4)), within="tasks")
    assert headline(own, most=0) == f"2 of 4 in one of the tasks act alike, and differ from the rest{rest}"
    two = ranked(5, finding="two groups", **groups)
    assert headline(two) == "Two groups act differently: 3 and 2; without an answer nobody can say which is good."
    assert headline(ranked(2, finding="no outliers")) == "Nobody differs clearly."
    nothing = headline(ranked(2, finding="nothing could be learned"))
    assert nothing.startswith("Nothing could be learned: the observations do not help to predict the actions")
