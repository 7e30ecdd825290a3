"""Weights of steps in the passes over everything."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from problems import make
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import step_trust
from rpil.results.settings import AuditSettings
from rpil.scale.fit import StepWeights
from small import small_rpil


def demonstrations(kind="random", seed=0, n_good=80, n_bad=40, maker=make):
    toy = maker(kind, seed, n_good=n_good, n_bad=n_bad, steps=(20, 60))
    return toy, Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets, toy.ids)


def test_without_trusted_demonstrations_steps_are_weighted_by_their_own_probability():
    _, data = demonstrations("noisy")
    model = small_rpil().fit(data)
    audit = model.audit_
    assert StepWeights.of(audit, model.judge_, JudgeSettings(), AuditSettings()).typical < 1.0
    weigh = StepWeights.of(
        replace(audit, expert_proba=np.zeros(len(audit.ids))), model.judge_, JudgeSettings(), AuditSettings()
    )
    problem = FitData(
        model.judge_features_.design(data.observations), data.actions, data.offsets, model.space_, np.zeros(120, int)
    )
    weight, log_ratio = weigh.weight(problem, weigh.trust)
    assert weight.sum() > 1.0
    alone = step_trust(problem, log_ratio, np.ones(120), JudgeSettings())
    np.testing.assert_array_equal(weight, alone.step)
    for m in range(120):  # no demonstration is taken whole
        mine = slice(*data.offsets[m : m + 2])
        assert np.ptp(weight[mine]) > 0
        assert np.corrcoef(weight[mine], log_ratio[mine])[0, 1] > 0


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
