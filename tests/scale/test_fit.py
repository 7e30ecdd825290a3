"""What passes over everything say of demonstrations outside the sample, and the weights of their steps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from problems import make
from rpil.inference.fitted_judge import fit_ratio
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import JudgeSettings
from rpil.inference.trust import judge
from rpil.scale.fit import JudgedSample, ascend, judge_everyone, policies_of_sample, score_block
from rpil.scale.settings import AscentSettings
from small import SMALL, small_rpil

SETTINGS = JudgeSettings()


def of_sample(kind, indices):
    """Everything about demonstrations of which those at `indices` are the sample."""
    toy = make(kind, 0, n_good=24, n_bad=12, steps=(40, 60))
    every = toy.problem()
    rows = np.concatenate([np.arange(*every.offsets[m : m + 2]) for m in indices])
    offsets = np.append(0, np.cumsum(every.lengths[indices]))
    sampled = replace(every, features=every.features[rows], actions=every.actions[rows], offsets=offsets, labels=[])
    judged = judge(sampled, held_out_model(sampled, SETTINGS.held_out), SETTINGS, learner=sampled)
    return toy, every, JudgedSample(sampled, indices, judged)


def scored(data, judged, policies):
    return score_block(data, policies, judged.spread, SETTINGS)


@pytest.mark.parametrize(("kind", "value"), [("random", 1.0), ("flipped", 1.0), ("none", 0.0)])
def test_parts_outside_the_sample_are_by_the_policies_of_its_parts(kind, value):
    indices = np.sort(np.random.default_rng(0).permutation(36)[:20])
    toy, every, sample = of_sample(kind, indices)
    judged, ridge = sample.judgement, sample.judgement.scores.fit.ridge
    policies = policies_of_sample(sample.data, judged, SETTINGS)
    block = scored(every, judged, policies)
    found = judge_everyone(sample, every, [block], SETTINGS)
    np.testing.assert_array_equal(found.part, value * np.where(toy.is_good, 1, -1))
    np.testing.assert_array_equal(found.part[indices], judged.part)
    np.testing.assert_array_equal(found.claims.lower, ~toy.is_good & (value > 0))
    assert found.claims.finding == judged.claims.finding
    np.testing.assert_array_equal(found.scores.score[indices], judged.scores.score)
    few = judged.scores.step_variance * np.maximum(1 / every.lengths - 1 / np.median(every.lengths), 0)
    np.testing.assert_allclose(found.scores.excess, block.dependence + few)
    np.testing.assert_array_equal(found.copy_of, np.arange(36))
    np.testing.assert_array_equal(np.argsort(found.columns[:, 0]), np.argsort(found.scores.log_odds))
    if not value:
        assert (len(policies), block.side.any()) == (1, False)
        return
    parts = [fit_ratio(sample.data, judged.part == sign, ridge, SETTINGS.held_out) for sign in (1, -1)]
    explained = [every.mean_steps(p.step_ratios(every.features, every.actions, SETTINGS.held_out)[0]) for p in parts]
    np.testing.assert_allclose(block.side, explained[0] - explained[1])


def test_blocks_are_joined_in_order():
    _, every, sample = of_sample("random", np.arange(36))
    halves = [replace(every, **cut(every, slice(*ends))) for ends in ((0, 10), (10, 36))]
    policies = policies_of_sample(sample.data, sample.judgement, SETTINGS)[:1]
    blocks = [[scored(each, sample.judgement, policies) for each in some] for some in (halves, [every])]
    joined, whole = (judge_everyone(sample, every, iter(some), SETTINGS) for some in blocks)
    np.testing.assert_allclose(joined.scores.log_odds, whole.scores.log_odds)
    for name in ("columns", "reliability", "log_ratio"):
        np.testing.assert_allclose(getattr(joined, name), getattr(whole, name))
    expected = policies[0].step_ratios(every.features, every.actions, SETTINGS.held_out)[1]
    np.testing.assert_array_equal(whole.log_ratio, expected)
    np.testing.assert_allclose(whole.reliability, every.mean_steps(expected > 0))


def cut(data, some):
    offsets = data.offsets[some.start : some.stop + 1]
    rows = slice(offsets[0], offsets[-1])
    of_rows = {"features": data.features[rows], "actions": data.actions[rows]}
    return of_rows | {"offsets": offsets - offsets[0], "labels": data.labels[some]}


def test_a_radius_falls_with_the_objective_and_doubles_after_and_a_gradient_must_halve():
    for most, tol, n in ((200, 1e-9, 17), (12, 1e-9, 14), (200, 0.2, 5)):  # it ends below 0.2 for each of 4 steps
        radii, values, policy = [], iter([0, -1, -1, 1, 2, 3, 4, *[5] * 99]), SimpleNamespace(penalty=lambda: 0.0)
        policy.gradient_norm = lambda _, radii=radii: 0.95 ** len(radii)
        policy.m_step = lambda _, radius, *__, radii=radii, policy=policy: (radii.append(radius) or policy, None)
        shards = SimpleNamespace(total=lambda _, values=values: (next(values), None, 4.0))
        assert ascend(shards, policy, None, AscentSettings(max_passes=most, tol=tol), print) is policy
        assert radii == [np.inf, 2, 0.25, 0.5, 1, 2, *[np.inf] * 11][:n]


def test_an_ascent_without_progress_ends():
    said = []
    settings = replace(SMALL, ascent=AscentSettings(tol=0.0))
    toy = make("random", 0, n_good=80, n_bad=40, steps=(20, 60))
    small_rpil(settings=settings, progress=said.append).fit(toy.demonstrations)
    assert 10 < sum("over everything, objective" in line for line in said) < 40
