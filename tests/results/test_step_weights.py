"""Weights of steps: who weighs less, and which steps of a demonstration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rpil
from audits import make_audit
from episode_rows import N, T, episodes
from rpil.inference.answers import Answers
from rpil.results.settings import AuditSettings
from rpil.results.step_weights import of_demonstrations, step_weight, weights_of

LENGTHS = np.array([2, 1, 1])


def in_mean(audit):
    """The mean weight of a step of each demonstration."""
    return np.add.reduceat(audit.step_weight, audit.offsets[:-1]) / audit.lengths


def shared(audit, seed=0):
    """The audit with shares of steps whose mean over each demonstration is 1/2."""
    share = np.random.default_rng(seed).random(int(audit.offsets[-1]))
    mean = np.repeat(np.add.reduceat(share, audit.offsets[:-1]) / audit.lengths, audit.lengths)
    audit = replace(audit, step_share=0.5 + (share - mean) / 2)
    return replace(audit, step_weight=weights_of(audit))


def test_the_weight_of_a_step_is_that_of_its_demonstration_times_its_share():
    weight, sign, share = np.array([1.0, 0.2, 0.6]), np.array([1.0, -1.0, 0.0]), np.array([0.1, 0.9, 0.3, 0.8])
    found = step_weight(LENGTHS, weight, sign, share)
    assert found == pytest.approx([0.2, 1.8, 0.2 * 1.4, 0.6])


def test_without_steps_there_are_no_weights():
    assert step_weight(LENGTHS, np.ones(3), np.ones(3), np.empty(0)).size == 0


def test_who_is_unlike_weighs_less_and_all_others_the_same():
    audit = shared(make_audit())
    outlier = np.array([verdict == "outlier" for verdict in audit.verdicts])
    np.testing.assert_allclose(in_mean(audit), np.where(outlier, audit.expert_proba, 1.0))


@pytest.mark.parametrize(
    "changes",
    [
        {"finding": "in doubt", "verdicts": ("open",) * 10},
        {"finding": "two groups", "verdicts": ("open",) * 10, "identifiable": False, "competing": ((0, 1, 2), (3, 4))},
    ],
)
def test_else_all_demonstrations_weigh_the_same(changes):
    audit = shared(replace(make_audit(), **changes))
    np.testing.assert_allclose(in_mean(audit), 1.0)
    assert bool(np.ptp(audit.step_weight) > 0.5) is audit.identifiable


FOR_OTHERS = AuditSettings(weighs_for_learner=False)


def test_for_other_trainings_every_step_weighs_one_until_answers_contrast():
    for labels in ({}, {0: 1, 1: 1, 2: 1}, {7: -1, 8: -1}):
        audit = shared(make_audit(labels=labels, settings=FOR_OTHERS))
        np.testing.assert_array_equal(audit.step_weight, 1.0)


def test_after_answers_that_contrast_the_weights_are_p_good_with_a_mean_of_one():
    audit = shared(make_audit(labels={0: 1, 9: -1}, settings=FOR_OTHERS, anchor="answers"))
    assert audit.step_weight.mean() == pytest.approx(1)
    ratio = in_mean(audit) / audit.expert_proba
    np.testing.assert_allclose(ratio, ratio[0])
    within = [np.ptp(audit.step_weight[audit.steps(m)]) for m in range(10)]
    assert max(within) == 0, "no step weighs another one's"
    pair = replace(Answers.none(10), pairs=np.array([[0, 9]]))
    np.testing.assert_array_equal(shared(replace(audit, answers=pair)).step_weight, 1.0, "one answer")


def test_flags_are_answers_of_both_sides():
    for flags, contrast in (([1, 0], True), ([1, np.nan], False), ([np.nan, np.nan], False), ([0, 0], False)):
        assert replace(Answers.none(2), outcome=np.array(flags, dtype=float)).contrast is contrast


def test_one_label_changes_the_weight_of_its_own_demonstration_and_of_its_copies():
    audit = make_audit(("open",) * 4, labels={2: -1}, copy_of=np.array([0, 1, 2, 2]), anchor="answers")
    audit = replace(audit, verdicts=("open", "open", "bad", "bad"), expert_proba=np.array([0.1, 0.9, 1e-6, 1e-6]))
    assert of_demonstrations(audit)[0].tolist() == [1, 1, 1e-6, 1e-6]
    assert of_demonstrations(audit)[1].tolist() == [1] * 4


def test_after_two_answers_demonstrations_weigh_by_p_good_and_steps_as_far_as_the_training_group_is_good():
    proba, from_actions = np.array([0.9, 0.8, 0.1, 0.2]), np.array([2.0, 1.0, -1.0, -2.0])
    audit = make_audit(("open",) * 4, labels={0: 1, 3: -1}, anchor="answers", lengths=(9, 5, 9, 5))
    audit = shared(replace(audit, expert_proba=proba, from_actions=from_actions))
    np.testing.assert_allclose(in_mean(audit), proba)
    assert of_demonstrations(audit)[1] == pytest.approx(0.7)
    assert of_demonstrations(replace(audit, from_actions=-from_actions))[1] == pytest.approx(-0.7)
    # Once the ranking is right, no bad demonstration weighs more than a good one.
    assert in_mean(audit)[:2].min() > in_mean(audit)[2:].max()


def test_who_scores_neither_high_nor_low_is_not_in_the_training_group():
    audit = make_audit(("open",) * 3, labels={0: 1, 2: -1}, anchor="answers")
    audit = replace(audit, expert_proba=np.array([0.9, 0.4, 0.1]), from_actions=np.array([2.0, 0.0, -1.0]))
    assert of_demonstrations(audit)[1] == pytest.approx(0.9 - (0.4 + 0.1) / 2)


@pytest.mark.parametrize(("from_actions", "sign"), [((1.0, 2.0), 0.0), ((1.0, -1.0), 0.8)])
def test_without_two_groups_steps_are_no_evidence_after_answers(from_actions, sign):
    audit = make_audit(("open",) * 2, labels={0: 1, 1: -1}, anchor="answers", expert_proba=np.array([0.9, 0.1]))
    assert of_demonstrations(replace(audit, from_actions=np.array(from_actions)))[1] == pytest.approx(sign)


def test_a_named_adversary_weighs_by_p_expert():
    audit = shared(make_audit(("expert", "adversary"), anchor="named adversary"))
    np.testing.assert_array_equal(audit.step_weight, np.repeat(audit.expert_proba, audit.lengths))


def with_interventions(flags):
    """Episodes with a column of flags, in which nothing else speaks of a person."""
    return episodes(phase=None, is_human_intervention=np.tile(flags, N))


def test_a_person_who_takes_over_moves_the_weights_of_steps_and_no_verdict(tmp_path):
    flags = np.zeros(T, dtype=bool)
    flags[15:20] = True
    told, plain = rpil.audit(with_interventions(flags)), rpil.audit(episodes(phase=None))
    assert (told.verdicts, told.finding) == (plain.verdicts, plain.finding)
    np.testing.assert_array_equal(told.log_odds, plain.log_odds)
    signs = np.zeros(T)
    signs[5:15], signs[15:20] = -1, 1  # one second at ten steps a second
    np.testing.assert_array_equal(told.taken_over, np.tile(signs, N))
    means = told.step_weight.reshape(N, T).mean(axis=0)
    assert means[5:15].max() < means[:5].min() <= means[:5].max() < means[15:20].min()
    np.testing.assert_allclose(
        told.step_weight.reshape(N, T).mean(axis=1), plain.step_weight.reshape(N, T).mean(axis=1)
    )
    assert f"A person took over in {N} of {N}" in told.notes[-1]
    answered = told.answered({"e0": "bad", "e1": "good", "e2": "bad"})
    low = answered.step_weight.reshape(N, T)[:, 5:15].mean(axis=1)
    assert (low < answered.step_weight.reshape(N, T)[:, 15:20].mean(axis=1)).all()


@pytest.mark.parametrize(
    ("flags", "is_known"),
    [
        (np.zeros(T, dtype=bool), False),  # nobody took over
        (np.arange(T), False),  # amounts, which are observed
        ((np.arange(T) > 10).astype(int), True),
    ],
)
def test_which_columns_are_flags_of_interventions(flags, is_known):
    table = with_interventions(flags)
    assert (rpil.audit(table).taken_over is not None) == is_known
    named = rpil.open(table, observations=["x", "is_human_intervention"])
    assert named.interventions is None
    assert named.demonstrations.n_observations == 2


def test_a_policy_learns_from_what_a_person_did():
    flags = np.zeros(T, dtype=bool)
    flags[15:20] = True
    told = rpil.RPIL(random_state=0).fit(rpil.open(with_interventions(flags)))
    plain = rpil.RPIL(random_state=0).fit(rpil.open(episodes(phase=None)))
    x = np.zeros((1, 1))
    assert told.predict(x) != plain.predict(x)
