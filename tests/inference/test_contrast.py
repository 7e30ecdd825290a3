"""How two groups differ: the share of each part of the action in the evidence, by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hand_made import same_actions, scoring_of
from rpil.inference.rivals import MAX_PARTS, Lower, contrast, evidence_by_part
from rpil.inference.settings import JudgeSettings

UPPER, RIVAL = np.array([0, 1, 2]), np.array([3, 4])


LOWER = Lower(UPPER, RIVAL, gain_upper=1.0, is_rival=True, is_noise=False)


def scoring(discrete=False, of_upper=None, of_rival=None, lengths=None):
    """Six demonstrations; log-densities (M, A) of the parts of the action, by policies of either group."""
    data = same_actions(6, discrete, n_parts=3)
    if lengths is not None:
        data = replace(data, offsets=np.concatenate([[0], np.cumsum(lengths)]))
    made = scoring_of(data, lambda group: 0.0, JudgeSettings())

    def parts(weight, ridge):
        own = of_upper if weight[0] > 0 else of_rival
        assert sorted({*np.flatnonzero(data.mean_steps(weight) > 0)}) == (UPPER if weight[0] > 0 else RIVAL).tolist()
        return None if own is None else data.per_step(np.array(own, dtype=float))

    made.model.log_prob_of_parts = parts
    return made


def test_share_of_each_part_of_a_continuous_action():
    of_upper = [[2.0, 1.0, 0.0]] * 2 + [[-90.0, 1.0, 0.0]] + [[0.0, 1.0, 0.0]] * 3
    of_rival = [[0.0, 0.5, 1.0]] * 3 + [[1.0, 1.0, 0.5]] * 2 + [[50.0] * 3]
    found = contrast(scoring(of_upper=of_upper, of_rival=of_rival), LOWER, 0.01)
    # In the first part: 2 - 0 in the median demonstration of A, and 1 - 0 in B; the last part speaks for neither group.
    assert [j for j, _ in found.parts] == [0, 1]
    assert [share for _, share in found.parts] == pytest.approx([3 / 3.5, 0.5 / 3.5])
    np.testing.assert_allclose(found.use[0], found.use[1])  # all take the same actions
    assert found.use.shape == (2, 3)


def test_the_median_of_each_part_in_each_group():
    made = scoring()
    actions = made.data.actions.copy()
    steps = made.data.per_step(np.arange(6))
    actions[steps == 3], actions[steps == 4], actions[steps == 5] = 5.0, 7.0, 100.0
    made = replace(made, data=replace(made.data, actions=actions))
    found = contrast(made, LOWER, 0.01)
    np.testing.assert_allclose(found.use[1], 6.0)
    np.testing.assert_allclose(found.use[0], np.median(actions[steps < 3], axis=0))
    near = np.abs(actions[steps < 3] - found.use[0]), np.abs(actions[(steps == 3) | (steps == 4)] - 6.0)
    np.testing.assert_allclose(found.spread, np.median(np.concatenate(near), axis=0))
    assert found.parts == ()  # the policy has no parts


def test_share_of_each_discrete_action():
    made = scoring(discrete=True)  # each demonstration takes 0, 1, 0, 1
    steps, action = made.data.per_step(np.arange(6)), made.data.actions
    own = np.where(action == 0, 3.0, 1.0)
    sides = [np.isin(steps, group) for group in (UPPER, RIVAL)]

    def evaluate(weight, ridge):
        log_prob = np.where(sides[int(weight[0] == 0)], own / 2, -own / 2)
        return sign * log_prob

    made.model.cold_copy = lambda: SimpleNamespace(evaluate=evaluate)
    sign = 1
    found = contrast(made, LOWER, 0.01)
    assert found.parts == ((0, 0.75), (1, 0.25))
    np.testing.assert_allclose(found.use, 0.5)
    sign = -1
    assert contrast(made, LOWER, 0.01).parts == ()


def test_median_lengths():
    lengths = [1, 2, 9, 3, 8, 7]
    found = contrast(scoring(lengths=lengths), LOWER, 0.01)
    assert found.length.tolist() == pytest.approx([2.0, 5.5])


def test_evidence_is_of_the_parts_that_point_where_the_sum_points():
    assert evidence_by_part(np.array([-6.0, 4.0, -2.0])) == ((0, 0.75), (2, 0.25))
    assert evidence_by_part(np.array([2.0, 6.0, -4.0])) == ((1, 0.75), (0, 0.25))
    assert evidence_by_part(np.array([1e-9, 0.0])) == ()
    assert len(evidence_by_part(np.ones(9))) == MAX_PARTS
