"""Several tasks: what was found within each comes back at the right place, and single demonstrations stay open."""

import numpy as np
import pytest

from audits import make_audit
from rpil.estimators.within_tasks import split_by_task
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.results.judged import Interval
from rpil.results.tasks import join_audits

IDS, NAN = (0, "a", 1, "b", "c"), np.nan
PLACES = {"one": [0, 2], "other": [1, 3], "alone": [4]}


def joined(one=None, other=None, what="tasks", answers=None, **more):
    """The audit of two tasks of two demonstrations each, of one and three steps, and of one that is alone."""
    steps = {"verdicts": ("open",) * 2, "lengths": [1, 3]}
    parts = {"one": make_audit(**(steps | (one or {}))), "other": make_audit(**(steps | {"ids": "ab"} | (other or {})))}
    return join_audits(parts, PLACES, IDS, np.array([0, 1, 2, 5, 8, 10]), answers or Answers.none(5), what, **more)


def test_what_was_said_before_any_answer_and_columns_stay_with_their_tasks():
    """A demonstration that is alone is in the middle of each column, of which all tasks have the same."""
    one = {"claimed": np.array([0, -1]), "columns": np.array([[1.0, 2.0], [3.0, 4.0]])}
    audit = joined(one, {"claimed": np.array([-1, 0]), "columns": np.array([[5.0, 6.0], [7.0, 8.0]])})
    assert audit.claimed.tolist() == [0, -1, -1, 0, 0]
    assert audit.columns.tolist() == [[1, 2], [5, 6], [3, 4], [7, 8], [0, 0]]
    audit = joined({"columns": np.arange(1.0, 9.0).reshape(2, 4)}, {"columns": np.array([[1.0, 2.0], [3.0, 4.0]])})
    assert audit.columns.tolist() == [[1, 2, 3, 4], [1, 0, 0, 2], [5, 6, 7, 8], [3, 0, 0, 4], [0] * 4]
    assert audit.task_of.tolist() == [0, 1, 0, 1, -1]
    nothing = join_audits({}, {"": [0]}, [0], np.arange(2), Answers.none(1))
    assert (nothing.columns.shape, nothing.finding) == ((1, len(CHANNELS) + 1), "nothing could be learned")


def test_groups_pair_finding_and_anchor_of_all_tasks():
    opposed = {"identifiable": False, "competing": (("a",), ("b",)), "pair": ("a", "b")}
    audit = joined({}, opposed)
    assert (audit.identifiable, audit.competing, audit.pair) == (False, (("a",), ("b",)), ("a", "b"))
    assert joined({"pair": (1, 0)}, opposed).pair == (1, 0)
    audit = joined()
    assert (audit.identifiable, audit.competing, audit.pair) == (True, (), ())
    audit = joined({"finding": "two groups"}, {"finding": "a group apart"})
    assert (audit.finding, audit.anchor) == ("a group apart", "none")


def test_the_prior_is_the_mean_over_demonstrations_of_tasks_that_are_judged():
    one = make_audit(("open",), lengths=[1], prior=Interval(0.1, 0.0, 0.2))
    three = make_audit(("open",) * 3, lengths=[1] * 3, prior=Interval(0.5, 0.4, 0.8))
    places = {"one": [0], "three": [1, 2, 3]}
    prior = join_audits({"one": one, "three": three}, places, range(4), np.arange(5), Answers.none(4)).prior
    assert (prior.mean, prior.low, prior.high) == pytest.approx((0.4, 0.3, 0.65))
    assert join_audits({}, {"": [0]}, [0], np.arange(2), Answers.none(1)).prior == Interval(0.5, 0.0, 1.0)
    alone = join_audits({"one": one}, {"one": [0], "other": [1]}, range(2), np.arange(3), Answers.none(2))
    assert (alone.prior, alone.adversary, alone.settings) == (one.prior, one.adversary, one.settings)


@pytest.mark.parametrize(
    ("tasks", "sessions", "places"),
    [
        ({}, (), {"": [0, 1, 2]}),
        ({"0": "lift", "1": "lift", "2": "lift"}, (), {"lift": [0, 1, 2]}),
        ({"0": "lift", "2": "lift"}, (), {"lift": [0, 2], "": [1]}),
        ({}, ("Ann", "Bob", "Ann"), {"Ann": [0, 2], "Bob": [1]}),
        ({"0": "lift", "1": "lift", "2": "lift"}, ("Ann", "Ann", "Bob"), {"Ann": [0, 1], "Bob": [2]}),
        ({"0": "lift", "1": "lift"}, ("Ann", "Bob", "Bob"), {"lift, Ann": [0], "lift, Bob": [1], "no task, Bob": [2]}),
    ],
)
def test_the_names_of_tasks_and_sessions(tasks, sessions, places):
    """A session is named alone where there is one task."""
    assert split_by_task([0, 1, 2], tasks, sessions) == places


def test_a_note_names_five_tasks_at_most():
    noted = make_audit(("open",), lengths=[1], notes=("Part 3 rests.",))
    audits = {f"block\x1b {k}": noted for k in range(9)} | {"other": make_audit(("open",), lengths=[1])}
    places = {task: [m] for m, task in enumerate(audits)}
    audit = join_audits(audits, places, range(10), np.arange(11), Answers.none(10))
    names = ", ".join(rf"block\x1b {k}" for k in range(5))
    assert audit.notes == (f"{names} and 4 more: Part 3 rests.",)
