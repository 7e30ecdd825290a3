"""A fit to more demonstrations than the judge reads: a sample, then passes over everything."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from rpil.data.copies import copies_among
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.fit_data import FitData
from rpil.estimators.pipeline import FitOptions, FitResult, decided, judge_by_options
from rpil.estimators.task import Task
from rpil.inference.fitted_judge import FittedJudge
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.linear import linear_policy
from rpil.results.step_weights import of_demonstrations, weights_of
from rpil.results.summary import parts_not_judged
from rpil.scale.fit import DesignMap, JudgedSample, WeightedMap, ascend, judge_everyone, policies_of_parts, score_block
from rpil.scale.local import LocalEngine, gathered
from rpil.scale.protocol import Shards


def fit_sampled(task: Task, options: FitOptions, learns: bool = True) -> FitResult:
    """Judge a sample, then everything by what was learned from it, and fit the final policy unless nobody `learns`."""
    options.progress("a sample")
    settings, judging = options.settings.sample, options.settings.judge
    rng = np.random.default_rng(options.random_state)
    indices = settings.draw(np.diff(task.source.offsets), task.answers.labels, options.n_sampled_steps(task), rng)
    demonstrations = task.source.select(indices)
    copies = copies_among(demonstrations)
    if copies.any:
        indices, demonstrations = indices[copies.judged], demonstrations.select(copies.judged)
    features = options.judge_features(demonstrations)
    assert isinstance(features, FeatureMap)
    data = options.judged(task.data(demonstrations, features, single=True))
    engine = options.engine or LocalEngine()
    shards = engine.place(task.source.shards(engine.n_shards, settings.block_steps))
    blocks = shards.then(DesignMap(features, task.space, task.classes))
    judgement, _ = judge_by_options(demonstrations, data, options, learns)
    sample = JudgedSample(data, indices, judgement, FittedJudge.of(judgement, data, judging))
    options.progress("a pass over everything: scores")
    everyone = FitData(np.empty(0), np.empty(0), task.source.offsets, task.space)
    parts = policies_of_parts(data, judgement, judging)
    scores = blocks.map(partial(score_block, judge=sample.judge, parts=parts, settings=judging))
    judgement = judge_everyone(sample, everyone, scores, judging)
    # The log-ratios of the steps are on disk.
    result = decided(task, options, replace(judgement, log_ratio=np.empty(0)), features, learns)
    options.progress("the policy" if learns else "the weights of the steps")
    trust, n_steps = of_demonstrations(result.audit), int(task.source.offsets[-1])
    n_parts = 1 + n_steps // settings.block_steps
    weights = map(np.repeat, np.array_split(trust, n_parts), np.array_split(result.audit.lengths, n_parts))
    notes = *result.audit.notes, *parts_not_judged(data)
    audit = replace(
        result.audit, notes=notes, step_log_ratio=judgement.log_ratio, step_weight=gathered(weights, n_steps)
    )
    if task.taken_over is not None:
        audit = replace(audit, taken_over=task.taken_over)
        audit = replace(audit, step_weight=weights_of(audit))
    result = replace(result, audit=audit)
    return learned(task, options, demonstrations, sample, shards, trust, result) if learns else result


def learned(
    task: Task,
    options: FitOptions,
    demonstrations: Demonstrations,
    sample: JudgedSample,
    shards: Shards[Block],
    trust: Array,
    result: FitResult,
) -> FitResult:
    """Add the linear policy that is fitted in passes to all steps, by the `trust` (M,) in their demonstrations."""
    n_steps, space, data = int(task.source.offsets[-1]), task.space, sample.data
    weight, total = data.per_step(trust[sample.indices]), float(trust @ result.audit.lengths)
    choice = options.linear.choice(demonstrations, data.actions, weight, space)
    features = options.linear.feature_map(choice, demonstrations.observations, weight)
    data = replace(data, features=features.design(demonstrations.observations, single=True))
    weighted = shards.then(WeightedMap(DesignMap(features, space, task.classes), trust))
    ridge, final_ridge = (ridge_of(features, options.C, float(n), space) for n in (weight.sum(), total))
    zero, final = linear_policy(space, ridge, weight.sum()), linear_policy(space, final_ridge, total)
    first, _ = zero.fit(data, weight)
    start, hessian = first.with_preconditioner(data, weight, final.ridge, total / weight.sum())
    policy = ascend(weighted.kept(n_steps), start, hessian, options.settings.ascent, options.progress)
    return replace(result, features=features, policy=policy.with_temperature(choice.temperature))
