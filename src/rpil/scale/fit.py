"""Steps of a fit to data larger than a sample: each is one pass over all blocks.

A few hundred demonstrations say as well as a million what an expert does. So the judge reads a sample. One pass scores
every demonstration by the policy of the sample; groups are fitted to all scores; further passes fit the final policy
to the weighted steps. An engine moves parameters, sums, a few numbers for each demonstration and one for each step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from rpil.data.demonstrations import Block
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space, encode_actions
from rpil.inference.channels import channels, columns_of, components, own_log_prob, summaries
from rpil.inference.fitted_judge import Ratio, fit_ratio
from rpil.inference.groups import fit_groups
from rpil.inference.held_out import indicators
from rpil.inference.outliers import widened
from rpil.inference.scores import fewer_steps, mean_variance, means, monotony
from rpil.inference.settings import JudgeSettings
from rpil.inference.trust import Judgement
from rpil.numerics.blocks import Sums
from rpil.numerics.newton import Preconditioner
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap
from rpil.policies.linear import LinearPolicy
from rpil.scale.local import gathered
from rpil.scale.protocol import Shards
from rpil.scale.settings import AscentSettings


@dataclass(frozen=True, eq=False)
class DesignMap:
    """A block of demonstrations to the data of a fit without labels, in single precision."""

    features: FeatureMap
    space: Space
    classes: Array
    """The discrete actions, or an empty array."""

    def __call__(self, block: Block) -> FitData:
        codes = encode_actions(self.classes, block.actions, "the demonstrations")
        # Parquet is read by columns; in the order of rows, sums round as they do in memory.
        design = self.features.design(np.ascontiguousarray(block.observations), single=True)
        return FitData(design, codes, block.offsets, self.space)


class BlockScores(NamedTuple):
    """Result of one pass for the M demonstrations of a block; log-ratios, their means and `own_log_prob` in nats."""

    mean: Array
    own: Array
    squares: Array
    dependence: Array
    """Sum over the steps of the squared difference from the mean, and variance because steps depend on each other."""
    reliability: Array
    channels: Array
    side: Array
    """Nats a step by which the policy of one of two parts explains the demonstration better than that of the other."""
    summaries: Array
    """In single precision: a hundred numbers or more for each demonstration."""
    log_ratio: Array


def score_block(data: FitData, policies: tuple[Ratio, ...], spread: Array, settings: JudgeSettings) -> BlockScores:
    """Score the demonstrations of a block by `policies_of_sample`."""
    ratio, *parts = policies
    log_prob, log_ratio = ratio.step_ratios(data.features, data.actions, settings.held_out)
    actions = indicators(data, ratio.scaling)
    own = own_log_prob(data, actions, settings.held_out.errors)
    mean, squares, dependent = means(data, log_prob if data.space.has_density else log_ratio)
    described = channels(data, log_ratio, actions, spread)
    by_part = [part.step_ratios(data.features, data.actions, settings.held_out)[0] for part in parts]
    side = data.mean_steps(by_part[0] - by_part[1]) if by_part else np.zeros(data.n_demonstrations)
    summed = summaries(data, actions).astype(np.float32)
    reliability = data.mean_steps(log_ratio > 0)
    return BlockScores(mean, own, squares, dependent, reliability, described, side, summed, log_ratio)


def policies_of_sample(data: FitData, judged: Judgement, settings: JudgeSettings) -> tuple[Ratio, ...]:
    """The policies of the training group of a sample, of the part that a learner trusts, and of the other, if any."""
    fit, parts = judged.scores.fit, (judged.part > 0, judged.part < 0) if judged.part.any() else ()
    return tuple(fit_ratio(data, group, fit.ridge, settings.held_out) for group in (fit.group, *parts))


@dataclass(frozen=True, eq=False)
class JudgedSample:
    """The sample and the judgement of it."""

    data: FitData
    indices: Array
    """The demonstrations of the sample among all."""
    judgement: Judgement


def judge_everyone(
    sample: JudgedSample, data: FitData, blocks: Iterable[BlockScores], settings: JudgeSettings
) -> Judgement:
    """The judgement of all demonstrations, without their steps in `data`, by the scores of the blocks in order.

    The finding is that of the sample; outside it, groups and verdicts are by the scores alone. The log-ratios of the
    steps are in a temporary file.
    """
    lengths, judged, rows = data.lengths, sample.judgement, list[tuple[Array, ...]]()

    def steps() -> Iterator[Array]:
        for *of_demonstrations, log_ratio in blocks:
            rows.append(tuple(of_demonstrations))
            yield log_ratio

    log_ratio = gathered(steps(), int(data.offsets[-1]))
    mean, own, squares, dependent, reliability, described, side, summed = map(np.concatenate, zip(*rows, strict=True))
    score = mean - monotony(own, judged.scores.typical_own, settings)
    score[sample.indices] = judged.scores.score  # held out, as the scores of all others are
    pooled = judged.scores.step_variance
    variance = mean_variance(squares, lengths, pooled, settings.variance_steps)
    groups, excess = fit_groups(score, variance, lengths, settings.groups), dependent + fewer_steps(lengths, pooled)
    scores = replace(judged.scores, score=score, variance=variance, excess=excess, groups=groups)
    claims = widened(judged.claims, scores, settings.outliers)
    columns = columns_of(scores.log_odds, described, components(summed, settings.channels), score)
    copy_of, part = np.arange(len(score)), np.abs(judged.part[0]) * np.where(side > 0, 1.0, -1.0)
    part[sample.indices] = judged.part
    return Judgement(scores, columns, judged.spread, claims, copy_of, reliability, log_ratio, part)


class WeightedBlock(NamedTuple):
    """The steps of a block, from which the final policy learns."""

    features: Array
    actions: Array
    weight: Array


@dataclass(frozen=True, eq=False)
class WeightedMap:
    """A block to a `WeightedBlock`."""

    design: DesignMap
    """With the features of the final policy."""
    trust: Array
    """Weight of each demonstration (`rpil.results.step_weights`)."""

    def __call__(self, block: Block) -> WeightedBlock:
        data = self.design(block)
        return WeightedBlock(data.features, data.actions, data.per_step(self.trust[block.demonstrations]))


def block_statistics(block: WeightedBlock, policy: LinearPolicy) -> Sums:
    """Log-likelihood, sufficient statistics and weight of the steps of a block."""
    log_prob, statistics = policy.collect_suff_stats(block.features, block.actions, block.weight)
    return block.weight @ log_prob, statistics, block.weight.sum()


def ascend(
    shards: Shards[WeightedBlock],
    policy: LinearPolicy,
    hessian: Preconditioner | None,
    settings: AscentSettings,
    progress: Callable[[str], None],
) -> LinearPolicy:
    """Maximise the penalised log-likelihood of all weighted steps, from a `policy` on; returns the policy.

    A step that lowers the objective, because the `hessian` of the sample (`SoftmaxPolicy.with_preconditioner`) is too
    small somewhere, is taken again within a radius (Levenberg and Marquardt), which grows with every success. The
    sample has fifty steps for each coefficient, so that each pass removes most of the remaining error.
    """

    def objective(policy: LinearPolicy) -> tuple[float, Sums]:
        sums = shards.total(partial(block_statistics, policy=policy))
        return float(sums[0]) - policy.penalty(), sums

    radius, curvature = np.inf, np.empty((0, 2, 0, 0))
    value, sums = objective(policy)
    least, reached, idle = np.inf, -np.inf, 0  # gradient and objective at the last progress, and the passes since then
    for n in range(1, settings.max_passes + 1):
        progress(f"pass {n} over everything, objective {value:.6g}")
        gradient, rounding = policy.gradient_norm(sums[1]), settings.rounding * abs(value)
        idle = 0 if gradient <= 0.5 * least or value - reached >= settings.patience * rounding else idle + 1
        if gradient <= settings.tol * sums[2] or idle == settings.patience:
            break
        if not idle:
            least, reached = min(least, gradient), value
        before = curvature
        candidate, curvature = policy.m_step(sums[1], radius, hessian, before)
        new_value, new_sums = objective(candidate)
        while not new_value >= value - rounding:
            radius = min(settings.radius, radius / 8)
            if radius < settings.min_radius:
                return policy
            candidate, curvature = policy.m_step(sums[1], radius, hessian, before)
            new_value, new_sums = objective(candidate)
        policy, value, sums = candidate, new_value, new_sums
        radius = 2.0 * radius if radius < settings.radius else np.inf
    return policy
