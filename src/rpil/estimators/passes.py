"""The stages of a fit to more demonstrations than the judge reads: a sample, then passes over everything."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rpil.data.copies import copies_among
from rpil.data.fit_data import FitData
from rpil.estimators.pipeline import FitResult, FullFit, JudgeInput
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.trust import Judgement
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.linear import linear_policy
from rpil.results.step_weights import of_demonstrations, weights_of
from rpil.scale.fit import DesignMap, JudgedSample, WeightedMap, ascend, judge_everyone, policies_of_parts, score_block
from rpil.scale.local import LocalEngine, gathered


@dataclass(frozen=True, eq=False)
class SampledFit(FullFit):
    """The stages of a fit whose decision reads a sample, and which passes of an engine extend to everything."""

    def pose(self) -> JudgeInput:
        task, options = self.task, self.options
        options.progress("a sample")
        rng, settings = np.random.default_rng(options.random_state), options.settings.sample
        lengths, n_steps = np.diff(task.source.offsets), options.n_sampled_steps(task)
        indices = settings.draw(lengths, task.answers.labels, n_steps, rng)
        demonstrations = task.source.select(indices)
        copies = copies_among(demonstrations)
        if copies.any:
            indices, demonstrations = indices[copies.judged], demonstrations.select(copies.judged)
        features = options.judge_features(demonstrations)
        assert isinstance(features, FeatureMap)
        data = task.data(demonstrations, features, single=True)
        engine = options.engine or LocalEngine()
        blocks = engine.place(task.source.shards(engine.n_shards, settings.block_steps)).then(
            DesignMap(features, task.space, task.classes)
        )
        return JudgeInput(demonstrations, options.judged(data), features, indices, blocks)

    def extend(self, posed: JudgeInput, judgement: Judgement) -> tuple[Judgement, FitData, JudgedSample | None]:
        task, settings = self.task, self.options.settings.judge
        assert posed.blocks is not None
        assert posed.indices is not None
        sample = JudgedSample(posed.data, posed.indices, judgement, FittedJudge.of(judgement, posed.data, settings))
        self.options.progress("a pass over everything: scores")
        none, names = np.empty(0), posed.data.action_names
        everyone = FitData(
            none, none, task.source.offsets, task.space, demonstrators=task.demonstrators, action_names=names
        )
        parts = policies_of_parts(posed.data, judgement, settings)
        scores = posed.blocks.map(partial(score_block, judge=sample.judge, parts=parts, settings=settings))
        return judge_everyone(sample, everyone, scores, settings), everyone, sample

    def fit_policy(self, posed: JudgeInput, decided: FitResult) -> FitResult:
        task, options, sample, space = self.task, self.options, decided.sample, self.task.space
        assert posed.blocks is not None
        assert sample is not None
        assert decided.judgement is not None
        audit, trust, n_steps = decided.audit, of_demonstrations(decided.audit), int(task.source.offsets[-1])
        parts = 1 + n_steps // options.settings.sample.block_steps
        weights = map(np.repeat, np.array_split(trust, parts), np.array_split(audit.lengths, parts))
        audit = replace(audit, step_log_ratio=decided.judgement.log_ratio, step_weight=gathered(weights, n_steps))
        if audit.taken_over is not None:
            audit = replace(audit, step_weight=weights_of(audit))
        decided = replace(decided, audit=audit)
        if not self.keeps_policy:
            return decided
        data = sample.data
        weight, total = data.per_step(trust[sample.indices]), float(trust @ audit.lengths)
        choice = options.linear.choice(posed.demonstrations, data.actions, weight, space)
        observations = posed.demonstrations.observations
        features = options.linear.feature_map(choice, observations, weight)
        data = replace(data, features=features.design(observations, single=True))
        blocks = posed.blocks.then(WeightedMap(DesignMap(features, space, task.classes), trust))
        ridge, final_ridge = (ridge_of(features, options.C, float(n), space) for n in (weight.sum(), total))
        zero, final = linear_policy(space, ridge, weight.sum()), linear_policy(space, final_ridge, total)
        first, _ = zero.fit(data, weight)
        start, hessian = first.with_preconditioner(data, weight, final.ridge, total / weight.sum())
        policy = ascend(blocks.kept(n_steps), start, hessian, options.settings.ascent, options.progress)
        return replace(decided, features=features, policy=policy.with_temperature(choice.temperature))
