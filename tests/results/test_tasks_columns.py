"""Every field of an audit is cut and joined."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from audits import make_audit
from rpil import Audit
from rpil.inference.answers import Answers
from rpil.results.judged import Demonstrator, Interval, Judged, table_fields
from rpil.results.reasons import FIFTHS
from rpil.results.tasks import first_of, join_audits

IDS = tuple(f"d{k}" for k in range(10))


def full_audit() -> Audit:
    """An audit in which no field is empty."""
    rng, n = np.random.default_rng(0), 10
    pairs = {"pairs": np.array([[0, 1], [3, 4]]), "tied": np.array([[2, 3]])}
    ends = np.column_stack([np.where(np.arange(n) % 2, np.nan, 1.0), np.arange(n) / 2])
    return make_audit(
        ids=IDS,
        lengths=[80, *range(31, 40)],
        answers=Answers(np.array([0, 1, -1] + [0] * 7), outcomes=ends, **pairs, names=("a", "-b")),
        competing=(IDS[:4], IDS[4:]),
        pair=("d1", "d3"),
        demonstrators=(
            Demonstrator("ann", Interval(0.8, 0.5, 0.9), IDS[:5]),
            Demonstrator(3, Interval(0.4, 0.1, 0.9), IDS[5:]),
        ),
        taken_over=rng.integers(-1, 2, 395).astype(float),
        contradicting=("d2",),
        doubts=("A doubt.",),
        notes=("A note.", "The two groups: differ."),
        columns=rng.normal(size=(n, 5)),
        claimed=np.arange(n) % 3 - 1,
        part=(np.arange(n) % 5 - 2) / 2,
        copy_of=np.array([0, 1, 2, 0, 4, 0, 6, 7, 8, 2]),
        deviations=("It drops.", *[""] * 9),
        sessions=("mon",) * 5 + ("tue",) * 5,
        order=np.arange(10.0)[::-1],
        own_reasons=tuple(f"For {name}." for name in IDS),
        within="tasks",
        task_of=np.append(1 - np.arange(9) % 2, -1),
        fps=30.0,
        provenance={"rpil": "1", "settings": {"x": ("a", 1, None)}},
        rejected_by=("", "", "labels", "outcome", "answers", "adversary", "", "", "", ""),
        **{name: rng.random(n) for name in ("from_actions", "from_label")},
    )


def test_no_field_of_the_full_audit_is_its_default():
    audit, default = full_audit(), make_audit()
    given = ("offsets", "finding", "prior", "adversary", "method", "settings", "anchor", "identifiable")
    changed = [one.name for one in fields(audit) if repr(getattr(audit, one.name)) == repr(getattr(default, one.name))]
    assert set(changed) <= {*given, "verdicts"}


def some_of(audit: Audit, rows: list[int]) -> Audit:
    """The audit of some demonstrations, as if they were a task."""
    steps = np.concatenate([np.r_[audit.steps(m)] for m in rows])
    columns = {
        name: np.array(getattr(audit, name))[rows if axis == "M" else steps] for name, axis, _ in table_fields(Judged)
    }
    columns = {name: tuple(own) if isinstance(getattr(audit, name), tuple) else own for name, own in columns.items()}
    ids, offsets = tuple(audit.ids[m] for m in rows), np.cumsum([0, *audit.lengths[rows]])
    answers, copies = audit.answers.select(rows), np.arange(len(rows))
    return replace(audit, **columns, ids=ids, offsets=offsets, answers=answers, copy_of=copies)


@pytest.mark.parametrize(("name", "axis", "nothing"), [*table_fields(Judged)])
def test_a_column_is_cut_and_joined(name, axis, nothing):
    audit = full_audit()
    rows = {"M": [[m] for m in range(10)], "N": [np.r_[audit.steps(m)] for m in range(10)]}[axis]
    column = np.array(getattr(audit, name))
    taken = getattr(first_of(audit, ["a", "b", "c"]), name)
    assert type(taken) is type(getattr(audit, name))
    np.testing.assert_array_equal(np.array(taken), column[np.concatenate(rows[:3])])
    parts = {"odd": some_of(audit, [1, 3, 5, 7]), "even": some_of(audit, [0, 2, 4, 6, 8])}
    places = {"odd": [1, 3, 5, 7], "even": [0, 2, 4, 6, 8], "alone": [9]}
    joined = getattr(join_audits(parts, places, IDS, audit.offsets, Answers.none(10)), name)
    if name == "order":
        assert joined is None
    else:
        last = np.concatenate([rows[m] for m in range(9)])
        np.testing.assert_array_equal(np.array(joined)[last], column[last])
        assert np.all(np.array(joined)[rows[9]] == nothing)


def test_names_of_demonstrations_that_are_left_out_are_left_out():
    audit = full_audit()
    part = first_of(audit, ["a", "b", "c"])
    assert part.ids == ("a", "b", "c")
    assert part.offsets.tolist() == [0, 80, 111, 143]
    assert (part.pair, part.competing, part.contradicting) == ((), (("a", "b", "c"), ()), ("c",))  # no pair of one
    assert part.demonstrators == (replace(audit.demonstrators[0], demonstrations=("a", "b", "c")),)
    assert part.answers.labels.tolist() == [0, 1, -1]
    assert (part.answers.pairs.tolist(), part.answers.tied.tolist()) == ([[0, 1]], [])
    assert first_of(audit, IDS[:4]).copy_of.tolist() == [0, 1, 2, 0]
    assert first_of(audit, "abcd").pair == ("b", "d")
    assert first_of(replace(audit, order=None), IDS[:4]).order is None


def test_answers_about_those_that_are_left_out_count():
    """As the labels of a reference do, beside which the others were judged."""
    audit = make_audit(("bad",) * 8 + ("good",) * 2, labels={9: 1, 0: -1}, anchor="answers")
    part = first_of(audit, range(8))
    assert (part.answers.count, part.choice.kept) == (1, ())
    assert len(first_of(make_audit(audit.verdicts, labels={9: 1}), range(8)).choice.kept) == 8


def test_places_in_the_ranking_do_not_count_those_that_are_left_out():
    """A reference that ranks above all would leave nobody in the highest fifth, and count among the places."""
    scores = np.array([0.0, 1, 2, 3, 4, 90, 91, 92, 93, 94])
    audit = make_audit(
        ("open",) * 10, lengths=[9] * 10, log_odds=scores, step_log_ratio=np.zeros(90), finding="no outliers"
    )
    alone = first_of(audit, range(5))
    assert [reason.partition(" of")[0] for reason in alone.reasons] == [*FIFTHS]
    answered = first_of(replace(audit, finding="answered", anchor="answers"), range(5))
    assert "place 1 of 5" in answered.reasons[4]
