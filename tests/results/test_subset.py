"""The audit of some of the demonstrations says of each what the audit of all says."""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import numpy as np

from audits import make_audit, make_traces
from rpil.inference.answers import Answers
from rpil.results.subset import select


def test_each_demonstration_keeps_what_was_found_among_all():
    audit = make_audit()
    chosen = [5, 0, 7]
    part = select(audit, chosen, ["a", "b", "c"])
    assert part.ids == ("a", "b", "c")
    assert part.finding == audit.finding
    assert part.reasons == tuple(audit.reasons[m] for m in chosen)
    assert part.verdicts == tuple(audit.verdicts[m] for m in chosen)
    for name in ("log_odds", "from_actions", "expert_proba", "reliability", "reliability_interval"):
        np.testing.assert_array_equal(getattr(part, name), getattr(audit, name)[chosen])
    for k, m in enumerate(chosen):
        np.testing.assert_array_equal(part.step_weight[part.steps(k)], audit.step_weight[audit.steps(m)])
        assert part.worst_steps(k) == audit.worst_steps(m)
    assert {row["id"] for row in part.to_dict()["demonstrations"]} == {"a", "b", "c"}


def test_names_of_demonstrations_that_are_left_out_are_left_out():
    audit = make_audit()
    known = Answers(np.array([1, 1, -1] + [0] * 7), np.array([[2, 3], [0, 2]]), np.arange(10.0), np.array([[3, 2]]))
    changes = {"answers": known, "pair": audit.ids[1:3], "contradicting": audit.ids[:3]}
    changes |= {"columns": np.arange(20.0).reshape(10, 2)}
    part = select(replace(audit, **changes), [2, 3])
    assert part.ids == audit.ids[2:4]
    assert part.labelled == part.contradicting == (audit.ids[2],)
    assert part.pair == ()  # one of a pair is no question
    np.testing.assert_array_equal(part.answers.labels, [-1, 0])
    np.testing.assert_array_equal(part.answers.pairs, [[0, 1]])
    np.testing.assert_array_equal(part.answers.tied, [[1, 0]])
    np.testing.assert_array_equal(part.answers.outcome, [2.0, 3.0])
    np.testing.assert_array_equal(part.columns, [[4.0, 5.0], [6.0, 7.0]])


def test_answers_about_those_that_are_left_out_count():
    """As the labels of a reference do, beside which the others were judged."""
    audit = make_audit(("typical",) * 2 + ("unlike",) * 8)
    audit.answers.labels[:2] = 1
    part = select(audit, range(2, 10))
    assert (part.answers.count, part.max_unlike) == (0, 1.0)
    assert part.choice.kept == ()
    assert len(select(make_audit(audit.verdicts), range(2, 10)).choice.kept) == 8


def test_traces_follow_their_names():
    audit = make_audit()
    audit = replace(audit, traces={audit.ids[m]: make_traces(9, seed=m) for m in (1, 2, 5)})
    part = select(audit, [5, 0, 1], ["a", "b", "c"])
    assert part.traces == {"a": audit.traces[audit.ids[5]], "c": audit.traces[audit.ids[1]]}


def test_copies_stay_copies_where_the_first_is_left_out():
    audit = make_audit(copy_of=np.array([0, 1, 2, 0, 4, 0, 6, 7, 8, 2]))
    assert select(audit, [9, 3, 5, 1]).copy_of.tolist() == [0, 1, 1, 3]


def test_many_demonstrations_are_selected_in_no_time():
    """Those of 20,000 are looked up in 20,000 steps, and not in 200 million."""
    n = 20_000
    audit = make_audit(("open",) * n, lengths=np.ones(n, int), copy_of=np.arange(n) // 2 * 2)
    object.__setattr__(audit, "reasons", ("",) * n)
    start = process_time()
    part = select(audit, range(n)[::-1])
    assert process_time() - start < 1
    np.testing.assert_array_equal(part.copy_of, np.arange(n) // 2 * 2)
