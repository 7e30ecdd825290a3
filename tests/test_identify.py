"""Coherent adversaries are found and named, incoherent ones are not, and labels settle it."""

from __future__ import annotations

import numpy as np
import pytest

from problems import Toy, make, ridge
from rpil.adversaries import AUTO
from rpil.identify import _compete, competing_groups
from rpil.policies import SoftmaxPolicy
from rpil.priors import Share
from rpil.reliability import TwoBetas
from rpil.search import Setting, fit

STEPS = (40, 60)


def groups_found(toy: Toy, seed: int = 0) -> list[set[int]]:
    problem = toy.problem()
    penalty = ridge(problem) / 100
    setting = Setting(SoftmaxPolicy.zero(problem.space.n, penalty), Share(), TwoBetas.start())
    rng = np.random.default_rng(seed)
    result, runs = fit(problem, setting, AUTO["discrete"], rng)
    return [set(group.tolist()) for group in competing_groups(problem, setting, result, runs, rng)]


def as_sets(groups) -> set[frozenset[int]]:
    return {frozenset(group) for group in groups}


HALVES = {frozenset(range(6)), frozenset(range(6, 12))}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("kind", "n_actions"), [("shifted", 2), ("shifted", 3), ("shifted", 4), ("flipped", 3)])
def test_two_groups_of_one_mind_each(kind, n_actions, seed):
    assert as_sets(groups_found(make(kind, seed, n_actions=n_actions, steps=STEPS))) == HALVES


@pytest.mark.parametrize(("n_good", "n_bad"), [(4, 8), (2, 10)])
def test_also_where_the_bad_are_many(n_good, n_bad):
    toy = make("shifted", 1, n_good=n_good, n_bad=n_bad, steps=STEPS)
    parts = {frozenset(range(n_good)), frozenset(range(n_good, 12))}
    assert as_sets(groups_found(toy)) == parts


def test_three_groups():
    """Experts, their actions shifted by one, and shifted by two."""
    toy = make("shifted", 1, n_good=5, n_bad=10, steps=STEPS)
    last = toy.actions[toy.offsets[10] :]
    last[:] = (last + 1) % 3
    assert as_sets(groups_found(toy)) == {frozenset(range(k, k + 5)) for k in (0, 5, 10)}


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", ["random", "noisy", "window", "none"])
def test_noise_is_no_group(kind, seed):
    assert groups_found(make(kind, seed, steps=STEPS)) == []


def test_noise_beside_two_groups_belongs_to_neither():
    toy = make("shifted", 1, n_good=6, n_bad=9, steps=STEPS)
    noise = toy.actions[toy.offsets[12] :]
    noise[:] = np.random.default_rng(0).integers(3, size=len(noise))
    assert as_sets(groups_found(toy)) == HALVES


def test_experts_who_visit_other_states_are_no_rivals():
    """Neither half can tell what the other does where it has never been; but one policy for both loses nothing."""
    for seed in range(3):
        toy = make("none", seed, steps=STEPS)
        place = np.where(toy.groups < 6, 3.0, -3.0)
        logits = np.column_stack([2 * np.cos(3 * place * toy.observations[:, 0]), toy.observations[:, 1], 0 * place])
        toy.observations[:, 0] += place
        toy.actions[:] = (5 * logits).argmax(axis=1)
        problem = toy.problem("spline")
        penalty = np.full(problem.features.shape[1], 1e-5 * len(toy.actions))
        setting = Setting(SoftmaxPolicy.zero(3, penalty), Share(), TwoBetas.start())
        halves = np.arange(6), np.arange(6, 12)
        assert not _compete(problem, setting, *halves, np.random.default_rng(0))


@pytest.mark.parametrize("labels", [{0: 1}, {6: -1}, {0: 1, 6: -1}, {11: 1}])
def test_one_label_settles_it(labels):
    assert groups_found(make("shifted", 1, steps=STEPS).labelled(labels)) == []


def test_a_label_that_rules_out_one_of_three_leaves_two():
    toy = make("shifted", 1, n_good=5, n_bad=10, steps=STEPS).labelled({12: -1})
    last = toy.actions[toy.offsets[10] :]
    last[:] = (last + 1) % 3
    assert as_sets(groups_found(toy)) == {frozenset(range(5)), frozenset(range(5, 10))}


def test_the_order_of_demonstrations_does_not_matter():
    toy = make("shifted", 2, steps=STEPS)
    assert as_sets(groups_found(toy, seed=5)) == HALVES
