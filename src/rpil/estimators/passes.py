"""The stages of a fit to more demonstrations than the judge reads: a sample, then passes over everything."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter

import numpy as np

from rpil.data.copies import copies_among
from rpil.data.fit_data import FitData
from rpil.estimators.pipeline import FitResult, FullFit, JudgeInput
from rpil.inference.fitted_judge import FittedJudge, SoftmaxRatio
from rpil.inference.trust import Judgement
from rpil.numerics.blocks import linear
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.linear import linear_policy
from rpil.results.evidence import StepEvidence, traces, worth_a_look
from rpil.results.judged import Traces
from rpil.results.record import Audit
from rpil.results.step_weights import weights_of
from rpil.scale.ascent import ascend, gather_steps
from rpil.scale.fit import (
    DesignMap,
    JudgedSample,
    StepWeights,
    WeightedBlock,
    judge_everyone,
    policies_of_parts,
    score_block,
)
from rpil.scale.local import LocalEngine
from rpil.scale.protocol import Shards

MAX_DRAWN_STEPS = 100_000
"""Steps that are read again for traces."""


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

    def extend(self, posed: JudgeInput, judgement: Judgement) -> tuple[Judgement, FittedJudge | None, FitData]:
        task, options = self.task, self.options
        assert posed.blocks is not None
        sample = _sample(posed, judgement, FittedJudge.of(judgement, posed.data, options.settings.judge))
        options.progress("a pass over everything: scores")
        none, names = np.empty(0), posed.data.action_names
        everyone = FitData(
            none, none, task.source.offsets, task.space, demonstrators=task.demonstrators, action_names=names
        )
        parts = policies_of_parts(posed.data, judgement, options.settings.judge)
        scores = posed.blocks.map(
            partial(score_block, judge=sample.judge, parts=parts, settings=options.settings.judge)
        )
        judgement = judge_everyone(sample, everyone, scores, options.settings.judge)
        return judgement, replace(sample.judge, groups=judgement.scores.groups), everyone

    def fit_policy(self, posed: JudgeInput, decided: FitResult) -> FitResult:
        task, options, data = self.task, self.options, posed.data
        assert posed.blocks is not None
        sample = _sample(posed, decided.judgement, decided.judge)
        weights = StepWeights.of(decided.audit, sample, options.settings.judge)
        if not self.keeps_policy:
            return replace(decided, audit=self._weigh(posed, decided, posed.blocks.then(weights))[0])
        weight, space = weights.steps(data, sample.indices)[-1], task.space
        choice = options.linear.choice(posed.demonstrations, data.actions, weight, space)
        observations = posed.demonstrations.observations
        features = options.linear.feature_map(choice, observations, weight)
        weights = replace(weights, final=DesignMap(features, task.space, task.classes))
        data = replace(data, features=features.design(observations, single=True))
        blocks = posed.blocks.then(weights).kept(int(task.source.offsets[-1]))
        audit, total = self._weigh(posed, decided, blocks)
        ridge, final_ridge = (ridge_of(features, options.C, float(n), space) for n in (weight.sum(), total))
        zero, final = linear_policy(space, ridge, weight.sum()), linear_policy(space, final_ridge, total)
        first, _ = zero.fit(data, weight)
        start, hessian = first.with_preconditioner(data, weight, final.ridge, total / weight.sum())
        policy = ascend(blocks, start, hessian, options.settings.ascent, options.progress)
        return replace(decided, audit=audit, features=features, policy=policy.with_temperature(choice.temperature))

    def _weigh(self, posed: JudgeInput, decided: FitResult, blocks: Shards[WeightedBlock]) -> tuple[Audit, float]:
        """The audit with the weights of all steps and with traces, and the sum of the weights."""
        found = blocks.map(attrgetter("log_ratio", "weight"))
        (log_ratio, step_weight), total = gather_steps(found, int(self.task.source.offsets[-1]))
        audit = replace(decided.audit, step_log_ratio=log_ratio, step_weight=step_weight)
        if audit.taken_over is not None:
            audit = replace(audit, step_weight=weights_of(audit))
        return replace(audit, traces=self._traces(posed, decided, audit)), total

    def _traces(self, posed: JudgeInput, decided: FitResult, audit: Audit) -> dict[Hashable, Traces]:
        """Those of the demonstrations most worth a look, as far as few steps are read for them."""
        task, settings = self.task, self.options.settings.judge.held_out
        sample = _sample(posed, decided.judgement, decided.judge)
        drawn = worth_a_look(audit)
        drawn = drawn[np.cumsum(audit.lengths[drawn]) <= MAX_DRAWN_STEPS]
        read = np.union1d(sample.indices, drawn)  # the sample says what is typical
        data = replace(task.data(task.source.select(read), posed.features, single=True), judged=posed.data.judged)
        ratio = sample.judge.ratio  # of policies that are not held out
        if isinstance(ratio, SoftmaxRatio):
            expected = ratio.step_ratios(data.features, data.actions, settings)[0]
        else:
            expected = ratio.scaling.back(linear(data.features, ratio.weights))
        evidence = StepEvidence.of(data, read, expected, ~sample.judgement.claims.lower[read], settings)
        return traces(audit, evidence, drawn)


def _sample(posed: JudgeInput, judgement: Judgement | None, judge: FittedJudge | None) -> JudgedSample:
    """The sample, as it was judged."""
    assert posed.indices is not None
    assert judgement is not None
    assert judge is not None
    return JudgedSample(posed.data, posed.indices, judgement, judge)
