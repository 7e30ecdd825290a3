"""Weights of steps in the passes over everything."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from problems import make
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import step_shares
from rpil.results.step_weights import of_demonstrations, step_weight
from rpil.scale.fit import JudgedSample, StepWeights
from small import small_rpil


def demonstrations(kind="random", seed=0, n_good=80, n_bad=40, maker=make):
    toy = maker(kind, seed, n_good=n_good, n_bad=n_bad, steps=(20, 60))
    return toy, Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets, toy.ids)


def test_a_pass_weighs_steps_by_the_policies_of_the_sample():
    _, data = demonstrations("noisy")
    model = small_rpil().fit(data)
    audit, settings = model.audit_, JudgeSettings()
    design = model.judge_features_.design(data.observations)
    problem = FitData(design, data.actions, data.offsets, model.space_, np.zeros(120, int))
    group = np.arange(120) < 80
    judgement = SimpleNamespace(
        training_group=group,
        scores=SimpleNamespace(fit=SimpleNamespace(ridge=1e-3)),
        claims=SimpleNamespace(do_steps_tell=True),
        step_trust=SimpleNamespace(whole_from=0.6),
    )
    weigh = StepWeights.of(audit, JudgedSample(problem, np.arange(120), judgement, model.judge_), settings)
    log_ratio, share, weight = weigh.steps(problem, slice(0, 120))
    kind, of_others = type(model.judge_.ratio), problem.per_step((~group).astype(float))
    others = kind.fit(problem, of_others, 1e-3, settings.held_out)
    log_prob, expected, _ = model.judge_.ratio.step_ratios(problem.features, problem.actions, settings.held_out)
    against = log_prob - others.step_ratios(problem.features, problem.actions, settings.held_out)[0]
    np.testing.assert_array_equal(log_ratio, expected)
    np.testing.assert_array_equal(share, step_shares(problem, against, settings, 0.6))
    np.testing.assert_array_equal(weight, step_weight(data.lengths, *of_demonstrations(audit), share))


def test_without_others_the_steps_of_a_demonstration_weigh_the_same():
    _, data = demonstrations("noisy")
    model = small_rpil().fit(data)
    design = model.judge_features_.design(data.observations)
    problem = FitData(design, data.actions, data.offsets, model.space_, np.zeros(120, int))
    judgement = SimpleNamespace(
        training_group=np.ones(120, dtype=bool),
        claims=SimpleNamespace(do_steps_tell=False),
        step_trust=SimpleNamespace(whole_from=0.6),
    )
    weigh = StepWeights.of(
        model.audit_, JudgedSample(problem, np.arange(120), judgement, model.judge_), JudgeSettings()
    )
    np.testing.assert_allclose(weigh.steps(problem, slice(0, 120))[1], 0.5, atol=1e-6)


def test_shards_hold_every_demonstration_once_in_order():
    _, data = demonstrations()
    for n_shards in (1, 3, 1000):
        shards = data.shards(n_shards)
        blocks = [block for shard in shards for block in shard]
        assert len(shards) == min(n_shards, len(blocks))
        np.testing.assert_array_equal(np.concatenate([p.actions for p in blocks]), data.actions)
        np.testing.assert_array_equal(np.concatenate([np.diff(p.offsets) for p in blocks]), data.lengths)
        assert all(after.demonstrations.start == before.demonstrations.stop for before, after in pairwise(blocks))
        assert blocks[0].first == 0
