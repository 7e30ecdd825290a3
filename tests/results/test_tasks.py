"""Several tasks: what was found within each comes back at the right place, and single demonstrations stay open."""

from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit
from rpil.estimators.within_tasks import split_by_task
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS
from rpil.results.judged import ALONE, Interval
from rpil.results.tasks import join_audits

IDS, NAN = (0, "a", 1, "b", "c"), np.nan
PLACES = {"one": [0, 2], "other": [1, 3], "alone": [4]}


def joined(one=None, other=None, what="tasks", answers=None, **more):
    """The audit of two tasks of two demonstrations each, of one and three steps, and of one that is alone."""
    steps = {"verdicts": ("open",) * 2, "lengths": [1, 3]}
    parts = {"one": make_audit(**(steps | (one or {}))), "other": make_audit(**(steps | {"ids": "ab"} | (other or {})))}
    return join_audits(parts, PLACES, IDS, np.array([0, 1, 2, 5, 8, 10]), answers or Answers.none(5), what, **more)


@pytest.mark.parametrize(("labels", "n_kept"), [((), 12), ("ub", 11), ("av", 11), ("ab", 8)])
def test_bad_ones_are_kept_until_the_answers_of_their_own_task_contrast(labels, n_kept):
    """4 of 12 are bad, all of the first task; the first label calls one good, the second one bad."""
    words = ("open", "bad", "bad", "bad", "bad", "open")
    signs = dict(zip(labels, (1, -1), strict=False))
    parts = [
        make_audit(own, ids=ids, anchor="answers", labels={m: signs[m] for m in ids if m in signs})
        for own, ids in ((words, "abcdef"), (("open",) * 6, "uvwxyz"))
    ]
    offsets = np.concatenate([[0], np.cumsum(np.concatenate([part.lengths for part in parts]))])
    places = {"one": [*range(6)], "other": [*range(6, 12)]}
    known = Answers.of_labels(np.concatenate([part.answers.labels for part in parts]))
    audit = join_audits(dict(zip(places, parts, strict=True)), places, "abcdefuvwxyz", offsets, known)
    assert len(audit.choice.kept) == n_kept


def test_columns_that_all_tasks_have_stay():
    wide = np.arange(2.0 * (len(CHANNELS) + 4)).reshape(2, -1)
    fewer = np.delete(wide, len(CHANNELS), axis=1)
    audit = joined({"columns": wide}, {"columns": fewer})
    assert audit.columns[0].tolist() == [*range(len(CHANNELS)), len(CHANNELS) + 3]
    nothing = join_audits({}, {"": [0]}, [0], np.arange(2), Answers.none(1))
    assert (nothing.columns.shape, nothing.finding) == ((1, 0), "nothing could be learned")


def test_answers_of_all_stay_but_for_pairs_of_different_tasks():
    """An outcome is heard as in the task that hears it most; one that is alike in all of a task is none of it."""
    ends = np.array([[np.nan, 7, 1], [2, 8, 1], [0.5, 1, 1], [3, 1, 1], [4, 1, 1]])
    pairs, tied = np.array([[2, 0], [0, 1], [1, 3], [4, 0]]), np.array([[0, 2], [3, 1], [3, 4]])
    given = Answers(np.array([1, 0, 0, -1, 0]), pairs, ends, tied, ("-b", "a", "c"))
    one = replace(Answers.none(2), names=("-b", "a"), heard=(0, -1))
    other = replace(Answers.none(2), names=("-b",), heard=(1,))
    answers = joined({"answers": one}, {"answers": other}, answers=given).answers
    assert (answers.names, answers.heard) == (given.names, (1, -1, 1))
    assert (answers.pairs.tolist(), answers.tied.tolist()) == ([[2, 0], [1, 3]], [[0, 2], [3, 1]])
    np.testing.assert_array_equal(answers.outcomes.T, [ends.T[0], [7, NAN, 1, NAN, 1], [NAN, NAN, NAN, NAN, 1]])
    assert answers.labels.tolist() == [1, 0, 0, -1, 0]
    assert joined(answers=given).answers.heard is None, "nothing was learned of them"


def test_groups_pair_finding_and_anchor_of_all_tasks():
    opposed = {"identifiable": False, "competing": (("a",), ("b",)), "pair": ("a", "b")}
    audit = joined({}, opposed)
    assert (audit.identifiable, audit.competing, audit.pair) == (False, (("a",), ("b",)), ("a", "b"))
    assert joined({"pair": (1, 0)}, opposed).pair == (1, 0)
    audit = joined()
    assert (audit.identifiable, audit.competing, audit.pair) == (True, (), ())
    audit = joined({"finding": "two groups"}, {"finding": "a group apart"})
    assert (audit.finding, audit.anchor) == ("a group apart", "none")
    assert joined({"anchor": "answers"}, {"anchor": "answers"}).anchor == "answers"
    assert joined({"anchor": "answers"}, {}).anchor == "none"


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


@pytest.mark.parametrize(("label", "sign"), [("good", 1), ("bad", -1), ("", 0)])
def test_a_demonstration_that_is_alone_has_the_word_of_its_label_and_as_certain_as_an_answer_is(label, sign):
    parts, labels = ({"labels": {0: 1}}, {"labels": {"b": -1}}), np.array([1, 0, 0, -1, 0])
    before = joined(*parts, answers=Answers.of_labels(labels))
    after = [
        joined(*parts, answers=Answers.of_labels(labels + np.eye(5, dtype=int)[4] * sign), for_learner=learns)
        for learns in (True, False)
    ]
    odds = 1e6 - 1  # P(good) is 1 - 1e-6 (`AnswerSettings.min_proba_bound`)
    for audit, learns in zip(after, (True, False), strict=True):
        assert audit.log_odds[4] == audit.from_label[4] == pytest.approx(sign * np.log(odds))
        assert audit.expert_proba[4] == pytest.approx({1: odds / (1 + odds), 0: 0.5, -1: 1 / (1 + odds)}[sign])
        assert audit.step_weight[8:] == pytest.approx([audit.expert_proba[4] if sign and learns else 1.0] * 2)
        assert (audit.verdicts[4], audit.reasons[4]) == ((label, f"Labelled {label}.") if sign else ("open", ALONE))
        assert audit.rejected_by[4] == ("labels" if sign < 0 else "")
        for name in ("log_odds", "from_label", "expert_proba", "verdicts", "reasons", "rejected_by"):
            assert list(getattr(audit, name)[:4]) == list(getattr(before, name)[:4]), "those of tasks stay"
        np.testing.assert_array_equal(audit.step_weight[:8], before.step_weight[:8])


def test_a_demonstration_that_is_alone_and_failed_is_bad():
    flags = replace(Answers.none(5), outcomes=np.array([1.0, 1, 0, 1, 0])[:, None], names=("success",))
    audit = joined({"answers": flags.select([0, 2])}, answers=flags)
    assert (audit.verdicts[4], audit.reasons[4], audit.rejected_by[4]) == ("bad", "success = 0.", "outcome")
    assert audit.verdicts[2] == "open", "of those that were judged their tasks decide"


def test_a_note_names_five_tasks_at_most():
    noted = make_audit(("open",), lengths=[1], notes=("Part 3 rests.",))
    audits = {f"block\x1b {k}": noted for k in range(9)} | {"other": make_audit(("open",), lengths=[1])}
    places = {task: [m] for m, task in enumerate(audits)}
    audit = join_audits(audits, places, range(10), np.arange(11), Answers.none(10))
    names = ", ".join(rf"block\x1b {k}" for k in range(5))
    assert audit.notes == (f"{names} and 4 more: Part 3 rests.",)
