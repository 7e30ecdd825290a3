"""Several tasks: what was found within each comes back at the right place, and single demonstrations stay open."""

from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit, make_traces
from rpil.results.tasks import ALONE, join_audits, split_by_task


def test_each_demonstration_keeps_what_its_own_task_says():
    lift, turn = make_audit(), make_audit(ids=[f"t{m}" for m in range(10)])
    ids = [name for pair in zip(lift.ids, turn.ids, strict=True) for name in pair] + ["alone"]
    tasks = dict.fromkeys(map(str, lift.ids), "lift") | dict.fromkeys(turn.ids, "turn") | {"alone": "push"}
    places = split_by_task(ids, tasks)
    assert places == {"lift": [*range(0, 20, 2)], "turn": [*range(1, 20, 2)], "push": [20]}
    lengths = [*np.ravel([lift.lengths, turn.lengths], order="F"), 7]
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    audit = join_audits({"lift": lift, "turn": turn}, places, ids, offsets)
    assert audit.ids == tuple(ids)
    assert audit.columns_within.shape == (21, 0)
    for part, rows in ((lift, places["lift"]), (turn, places["turn"])):
        assert [audit.verdicts[m] for m in rows] == [*part.verdicts]
        assert [audit.reasons[m] for m in rows] == [*part.reasons]
        np.testing.assert_array_equal(audit.log_odds[rows], part.log_odds)
        np.testing.assert_array_equal(audit.reliability_interval[rows], part.reliability_interval)
        for k, m in enumerate(rows):
            np.testing.assert_array_equal(audit.step_weight[audit.steps(m)], part.step_weight[part.steps(k)])
            assert audit.worst_steps(m) == part.worst_steps(k)
    assert (audit.verdicts[20], audit.expert_proba[20], audit.reasons[20]) == ("open", 0.5, ALONE)
    assert audit.finding == lift.finding
    assert audit.assumptions[0] == (
        f"Demonstrations are judged within their tasks: lift (10: {lift.finding}), turn (10: {turn.finding}), "
        "push (1: not judged)."
    )


@pytest.mark.parametrize(("counts", "n_kept"), [((0, 0), 12), ((1, 1), 12), ((0, 2), 12), ((2, 0), 8), ((2, 2), 8)])
def test_unlike_ones_are_kept_until_their_own_task_has_two_answers(counts, n_kept):
    """4 of 12 are unlike, all of the first task."""
    words = ("typical",) * 2 + ("unlike",) * 4
    parts = [make_audit(own, ids=ids) for own, ids in ((words, "abcdef"), (("typical",) * 6, "uvwxyz"))]
    for part, count in zip(parts, counts, strict=True):
        part.answers.labels[:count] = 1
    offsets = np.concatenate([[0], np.cumsum(np.concatenate([part.lengths for part in parts]))])
    places = {"one": [*range(6)], "other": [*range(6, 12)]}

    def joined(*of):
        return join_audits(dict(zip(places, of, strict=True)), places, "abcdefuvwxyz", offsets)

    assert len(joined(*parts).choice.kept) == n_kept
    one, other = (replace(part, identifiable=False) for part in parts)
    assert joined(parts[0], other).choice == joined(*parts).choice, "the groups of one task say nothing of another"
    assert joined(one, parts[1]).choice.reason.count("a policy of their own") == (n_kept == 12)


def test_facts_stay_with_their_tasks():
    steps = {"lengths": [1, 1]}
    one = make_audit(
        ("open",) * 2, **steps, beside={"dynamics": np.array([0.75, 0.25]), "time limit": np.array([0.0, 1.0])}
    )
    other = make_audit(("open",) * 2, **steps, ids="ab", beside={"dynamics": np.array([0.25, 0.75])})
    places = {"one": [0, 2], "other": [1, 3], "alone": [4]}
    audit = join_audits({"one": one, "other": other}, places, [0, "a", 1, "b", "c"], np.arange(6))
    assert audit.facts == {"dynamics": (0.75, 0.25, 0.25, 0.75, 0.5), "time limit": (0, 0, 1, 0, 0)}


def test_traces_stay_with_their_demonstrations():
    steps = {"lengths": [1, 1]}
    one = make_audit(("open",) * 2, **steps, traces={1: make_traces(1)})
    other = make_audit(("open",) * 2, **steps, ids="ab", traces={"a": make_traces(1, seed=1)})
    places = {"one": [0, 2], "other": [1, 3], "alone": [4]}
    audit = join_audits({"one": one, "other": other}, places, [0, "a", 1, "b", "c"], np.arange(6))
    assert audit.traces == {**one.traces, **other.traces}


def test_without_any_audit_nothing_is_known():
    audit = join_audits({}, {"a": [0], "b": [1]}, ["x", "y"], np.array([0, 2, 5]))
    assert audit.finding == "nothing could be learned"
    assert audit.verdicts == ("open", "open")
    assert audit.to_dict()["n_steps"] == 5


def test_copies_and_notes_keep_their_tasks():
    steps, same = {"lengths": [1, 1]}, "One demonstration is a copy of 1 other: each is judged once."
    one = make_audit(("open",) * 2, **steps, notes=(same, "Part 3 rests."), copy_of=np.array([0, 0]))
    other = make_audit(("open",) * 2, **steps, ids="ab", notes=(same,), copy_of=np.array([0, 0]))
    places = {"one": [0, 2], "other": [1, 3], "alone": [4]}
    audit = join_audits({"one": one, "other": other}, places, [0, "a", 1, "b", "c"], np.arange(6))
    assert audit.copy_of.tolist() == [0, 1, 0, 1, 4]
    assert audit.notes == (same, "one: Part 3 rests.")


def test_a_note_names_five_tasks_at_most():
    noted = make_audit(("open",), lengths=[1], notes=("Part 3 rests.",))
    audits = {f"block\x1b {k}": noted for k in range(9)} | {"other": make_audit(("open",), lengths=[1])}
    audit = join_audits(audits, {task: [m] for m, task in enumerate(audits)}, range(10), np.arange(11))
    names = ", ".join(rf"block\x1b {k}" for k in range(5))
    assert audit.notes == (f"{names} and 4 more: Part 3 rests.",)
