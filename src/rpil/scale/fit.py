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
from rpil.inference.channels import channels, components, summaries
from rpil.inference.claims import doubts_of_operators, extended, telling_pair
from rpil.inference.fitted_judge import FittedJudge, Ratio, fit_ratio
from rpil.inference.groups import fit_groups
from rpil.inference.scores import mean_variance
from rpil.inference.settings import JudgeSettings
from rpil.inference.step_trust import StepTrust, reliability_of, step_shares
from rpil.inference.trust import Judgement
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap
from rpil.results.record import Audit
from rpil.results.step_weights import of_demonstrations, step_weight


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
        return block, FitData(design, codes, block.offsets, self.space)


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
    summaries: Array
    """In single precision: a hundred numbers or more for each demonstration."""

    @classmethod
    def join(cls, blocks: Iterable[BlockScores], n_demonstrations: int) -> BlockScores:
        """Those of all blocks, which come in order, each let go when it is copied."""
        joined, first = None, 0
        for block in blocks:
            joined = joined or cls(*(np.empty((n_demonstrations, *v.shape[1:]), v.dtype) for v in block))
            last = first + len(block.score)
            for everyone, values in zip(joined, block, strict=True):
                everyone[first:last] = values
            first = last
        assert joined is not None
        return joined


def score_block(prepared: tuple[Block, FitData], judge: FittedJudge, settings: JudgeSettings) -> BlockScores:
    """Score the demonstrations of a block by the policy of the sample."""
    data, ratio = prepared[1], judge.ratio
    assert ratio is not None
    log_prob, log_ratio, scored = ratio.step_ratios(data.features, data.actions, settings.held_out)
    score, squares = judge.score(data, scored, settings)
    actions = ratio.indicators(data.actions)
    described = channels(data, score, log_prob, log_ratio, actions, judge.states, settings.held_out.errors)
    summed = summaries(data, actions).astype(np.float32)
    return BlockScores(score, squares, *reliability_of(data, log_ratio, settings), described, summed)


@dataclass(frozen=True, eq=False)
class JudgedSample:
    """The sample and the judgement of it."""

    data: FitData
    indices: Array
    """The demonstrations of the sample among all."""
    judgement: Judgement
    judge: FittedJudge


def judge_everyone(
    sample: JudgedSample, data: FitData, blocks: Iterable[BlockScores], settings: JudgeSettings
) -> Judgement:
    """The judgement of all demonstrations, without their steps in `data`, by the scores of the blocks in order.

    The finding is that of the sample; outside it, groups and verdicts are by the scores alone.
    """
    score, squares, reliability, interval, described, summed = BlockScores.join(blocks, data.n_demonstrations)
    judge, lengths, judged = sample.judge, data.lengths, sample.judgement
    score[sample.indices] = judged.scores.score  # held out, as the scores of all others are
    variance = mean_variance(squares, lengths, judge.step_variance, settings.variance_steps)
    groups = fit_groups(score, variance, lengths, settings.groups)
    scores = replace(judged.scores, score=score, variance=variance, groups=groups)
    claims = extended(judged.claims, scores, sample.indices, settings)
    if doubts := doubts_of_operators(data.demonstrators, claims.verdicts, settings.claims):
        claims = replace(claims, finding="in doubt", verdicts=0 * claims.verdicts, doubts=tuple(doubts))
    none = np.empty(0)
    seen = components(summed, settings.channels)
    columns = columns_of(described, seen, scores.log_odds, settings.answers)
    pair = telling_pair(claims, score)
    within = columns[:, :0]  # a group of the sample says nothing of ranks within a group of all
    steps = StepTrust(reliability, interval, none, judged.step_trust.whole_from)
    return Judgement(scores, columns, judged.states, claims, pair, np.arange(len(score)), within, steps, none)


class WeightedBlock(NamedTuple):
    """The steps of a block, from which the final policy learns."""

    features: Array
    """Of the final policy."""
    actions: Array
    log_ratio: Array
    share: Array
    weight: Array
    """Log-ratios of the steps in nats, their shares in their demonstrations, and their weights."""


@dataclass(frozen=True, eq=False)
class StepWeights:
    """A block to a `WeightedBlock`."""

    judge: FittedJudge
    others: Ratio | None
    """The policy of the demonstrations that are not in the training group; None where they are too few."""
    trust: Array
    sign: Array
    """W and c of all demonstrations (`rpil.results.step_weights`)."""
    whole_from: float
    """See `StepTrust`."""
    settings: JudgeSettings
    final: DesignMap | None = None
    """The map with the features of the final policy, where they are not the judge's."""

    @classmethod
    def of(cls, audit: Audit, sample: JudgedSample, settings: JudgeSettings) -> StepWeights:
        """The weights under an audit, by the policies of a sample."""
        judged, others = sample.judgement, None
        if judged.claims.do_steps_tell:
            weight = sample.data.per_step((~judged.training_group).astype(float))
            others = fit_ratio(sample.data, weight, judged.scores.fit.ridge, settings.held_out)
        return cls(sample.judge, others, *of_demonstrations(audit), judged.step_trust.whole_from, settings)

    def __call__(self, prepared: tuple[Block, FitData]) -> WeightedBlock:
        block, data = prepared
        steps = self.steps(data, block.demonstrations)
        features = self.final(block)[1].features if self.final else data.features
        return WeightedBlock(features, data.actions, *steps)

    def steps(self, data: FitData, demonstrations: slice | Array) -> tuple[Array, Array, Array]:
        """Log-ratios, shares and weights of the steps, (N,) each, of some of the demonstrations."""
        assert self.judge.ratio is not None
        log_prob, log_ratio, _ = self.judge.ratio.step_ratios(data.features, data.actions, self.settings.held_out)
        against = np.zeros(len(log_prob))
        if self.others is not None:
            against = log_prob - self.others.step_ratios(data.features, data.actions, self.settings.held_out)[0]
        share = step_shares(data, against, self.settings, self.whole_from)
        return log_ratio, share, step_weight(data.lengths, self.trust[demonstrations], self.sign[demonstrations], share)
