"""Steps of a fit to data larger than a sample: each is one pass over all blocks.

A few hundred demonstrations say as well as a million what an expert does. So the judge reads a sample. One pass scores
every demonstration by the policy of the sample; groups are fitted to all scores; a second pass computes the step
weights; `rpil.scale.ascent` fits the final policy to the weighted steps. An engine moves parameters, sums and a few
numbers for each demonstration, and never the steps.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rpil.data.coding import encode_actions
from rpil.data.demonstrations import Block
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space
from rpil.inference.answered import columns_of
from rpil.inference.answers import Answers
from rpil.inference.claims import doubts_of_operators, extended, telling_pair
from rpil.inference.facts import TIME_LIMIT, at_time_limit
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.groups import fit_groups
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import StepTrust, step_trust
from rpil.inference.trust import Evidence, Judgement, conclude
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap
from rpil.results.record import Audit
from rpil.results.settings import AuditSettings
from rpil.results.step_weights import is_anyone_trusted, step_weight, typical_reliability


@dataclass(frozen=True, eq=False)
class DesignMap:
    """A block of demonstrations to the data of a fit without labels, in single precision."""

    features: FeatureMap
    space: Space
    classes: Array
    """The discrete actions, or an empty array."""

    def __call__(self, block: Block) -> tuple[Block, FitData]:
        codes = encode_actions(self.classes, block.actions, "the demonstrations")
        # Parquet is read by columns; in the order of rows, sums round as they do in memory.
        design = self.features.design(np.ascontiguousarray(block.observations), single=True)
        labels = np.zeros(len(block.offsets) - 1, dtype=int)
        return block, FitData(design, codes, block.offsets, self.space, labels)


class BlockScores(NamedTuple):
    """What one pass computes for the M demonstrations of a block."""

    score: Array
    """Mean log-ratio of the steps, in nats."""
    squares: Array
    """Sum over the steps of the squared difference from the mean."""
    reliability: Array
    interval: Array
    """The 95 % interval of the reliability."""
    channels: Array


def score_block(prepared: tuple[Block, FitData], judge: FittedJudge, settings: JudgeSettings) -> BlockScores:
    """Score the demonstrations of a block by the policy of the sample."""
    data = prepared[1]
    log_prob, log_ratio, trust = _step_ratios(data, judge, settings)
    scored = log_ratio if data.space.kind == "discrete" else log_prob
    score = data.mean_steps(scored)
    squares = data.sum_steps((scored - data.per_step(score)) ** 2)
    described = judge.channels(data, log_prob, log_ratio, settings)
    return BlockScores(score, squares, trust.reliability, trust.interval, described)


def _step_ratios(data: FitData, judge: FittedJudge, settings: JudgeSettings) -> tuple[Array, Array, StepTrust]:
    """Of each step: log pi and log pi - log q, (N,) each, and the trust in it."""
    log_prob, log_ratio = judge.step_ratios(data.features, data.actions, settings)
    temperature = np.full(data.n_demonstrations, min(judge.effective_per_step, 1.0))
    return log_prob, log_ratio, step_trust(data, log_ratio, temperature, settings)


@dataclass(frozen=True, eq=False)
class Sample:
    """The sample and the judgement of it."""

    data: FitData
    indices: Array
    """The demonstrations of the sample among all."""
    judgement: Judgement
    judge: FittedJudge


def judge_everyone(
    sample: Sample, data: FitData, blocks: Iterable[BlockScores], answers: Answers, settings: JudgeSettings
) -> Judgement:
    """The judgement of all demonstrations, without their steps in `data`, by the scores of the blocks in order.

    The finding is that of the sample; outside it, groups and words are by the scores alone.
    """
    score, squares, reliability, interval, described = map(np.concatenate, zip(*blocks, strict=True))
    judge, lengths, judged = sample.judge, data.lengths, sample.judgement
    score[sample.indices] = judged.scores.score  # held out, as the scores of all others are
    effective = judge.effective_per_step * lengths
    variance = judge.score_variance(squares, lengths, settings)
    groups = fit_groups(score, variance, effective, lengths, settings.groups)
    scores = replace(judged.scores, score=score, variance=variance, groups=groups, effective_steps=effective)
    claims = extended(judged.claims, scores, sample.indices, settings)
    if doubts := doubts_of_operators(data.demonstrators, claims.words, settings.claims):
        claims = replace(claims, finding="in doubt", words=0 * claims.words, doubts=tuple(doubts))
    none = np.empty(0)
    columns, pair = columns_of(described, scores.log_odds(settings), settings.answers), telling_pair(claims, score)
    limit = at_time_limit(lengths)
    beside = {} if limit is None else {TIME_LIMIT: limit}
    missing, own = judged.missing_steps, np.arange(len(score))
    evidence = Evidence(scores, columns, judged.states, claims, pair, missing, beside, own)
    return conclude(data, evidence, answers, StepTrust(reliability, interval, none), none, settings)


class WeightedBlock(NamedTuple):
    """A block from which the final policy learns."""

    data: FitData
    """With the features of the final policy."""
    weight: Array
    log_ratio: Array
    """Weights of the steps, and their log-ratios in nats."""


@dataclass(frozen=True, eq=False)
class StepWeights:
    """A block to a `WeightedBlock`."""

    judge: FittedJudge
    trust: Array
    """P(expert) of the demonstrations from number `first` on."""
    typical: float
    """Reliability of a typical expert."""
    settings: JudgeSettings
    audit_settings: AuditSettings
    final: DesignMap | None = None
    """The map with the features of the final policy, where they are not the judge's."""
    first: int = 0

    @classmethod
    def of(
        cls,
        audit: Audit,
        judge: FittedJudge,
        settings: JudgeSettings,
        audit_settings: AuditSettings,
    ) -> StepWeights:
        """The weights under an audit; where it trusts nobody, those of the steps that are most likely an expert's."""
        trust = audit.expert_proba
        if not is_anyone_trusted(trust, audit.lengths):
            return cls(judge, np.ones(len(trust)), np.inf, settings, audit_settings)
        typical = typical_reliability(audit.reliability, trust, audit.lengths)
        return cls(judge, trust, typical, settings, audit_settings)

    def only(self, demonstrations: slice) -> StepWeights:
        """The same for some of the demonstrations."""
        return replace(self, trust=self.trust[demonstrations], first=demonstrations.start)

    def __call__(self, prepared: tuple[Block, FitData]) -> WeightedBlock:
        block, data = prepared
        begin = block.first - self.first
        weight, log_ratio = self.weight(data, self.trust[begin : begin + data.n_demonstrations])
        return WeightedBlock(self.final(block)[1] if self.final else data, weight, log_ratio)

    def weight(self, data: FitData, trust: Array) -> tuple[Array, Array]:
        """Weights and log-ratios of the steps, (N,) each, of demonstrations with P(expert) `trust` (M,)."""
        _, log_ratio, steps = _step_ratios(data, self.judge, self.settings)
        of_trust = steps.reliability, steps.step, self.audit_settings
        return step_weight(data.lengths, trust, *of_trust, self.typical), log_ratio
