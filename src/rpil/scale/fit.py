"""A fit to more data than must be held in memory: a sample teaches the judge, passes over all data do the rest.

A few hundred demonstrations say what experts do as well as a million. So the judge reads a sample; one pass measures
every demonstration by the policy that it found; groups are fitted to the scores of all; a second pass weighs the steps;
and `rpil.scale.ascent` fits the final policy to them. Parameters, sums and a few numbers for each demonstration move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from rpil.audit.record import Audit
from rpil.audit.summary import is_anyone_trusted, longest_unlabelled, step_weight, typical_reliability
from rpil.data.coding import encode_actions
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.demonstrators import Demonstrators
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.groups import fit_groups
from rpil.inference.held_out import held_out_model
from rpil.inference.labels import Decision
from rpil.inference.scores import mean_variance
from rpil.inference.settings import JudgeSettings, Minority
from rpil.inference.step_trust import StepTrust, step_trust
from rpil.inference.trust import Judgement, conclude, judge
from rpil.numerics.types import Array
from rpil.policies.features import N_LANDMARKS, FeatureMap, ridge_of
from rpil.policies.linear import linear_policy
from rpil.policies.selection import Choice
from rpil.scale.ascent import AscentState, clone, gathered
from rpil.scale.memory import InMemory
from rpil.scale.protocol import Engine

SAMPLE_STEPS = 20_000
SAMPLE_DEMONSTRATIONS = 100
STEPS_PER_COEFFICIENT = 50
"""Of the sample that the judge reads, at least."""

_MOST_TIMES, _FEWEST = 10, 20
"""So many demonstrations are in it only if they have no more than so many times these steps, but for the fewest."""

TIMES = 10
"""How many samples there must be before the judge reads one only: its policy has seen little of what it judges then."""

REFIT_TOL = 1e-6
"""Gradient, a step, at which the final policy is done: its actions have long stopped changing."""


@runtime_checkable
class Source(Protocol):
    """Demonstrations in memory, or on disk."""

    @property
    def ids(self) -> tuple[Any, ...]: ...

    @property
    def offsets(self) -> Array: ...

    @property
    def source(self) -> str: ...

    def shards(self, n_shards: int = 1) -> list[Any]:
        """All demonstrations in order: shards, each to be iterated over for its blocks."""

    def select(self, indices: Any) -> Demonstrations:
        """Some of them, in memory."""


def sample_steps(n_coefficients: int) -> int:
    """Steps of the sample for a policy of so many coefficients."""
    return max(SAMPLE_STEPS, STEPS_PER_COEFFICIENT * n_coefficients)


def sample(lengths: Array, labels: Array, n_steps: int, rng: np.random.Generator) -> Array:
    """Demonstrations for the judge to read, in order: of known experts, known adversaries, and all others, at random
    until there are enough of each."""

    def enough(order: Array) -> Array:
        least, most = np.searchsorted(np.cumsum(lengths[order]), [n_steps, _MOST_TIMES * n_steps]) + 1
        return order[: max(least, min(SAMPLE_DEMONSTRATIONS, max(most, _FEWEST)))]

    order = rng.permutation(len(lengths))
    return np.sort(np.concatenate([enough(order[labels[order] == label]) for label in (1, -1, 0)]))


@dataclass(frozen=True, eq=False)
class Prepare:
    """A block of demonstrations as the data of a fit, in single precision; nothing here needs their labels.

    Attributes
    ----------
    features : FeatureMap
    space : Space
    classes : (K,) array
    """

    features: FeatureMap
    space: Space
    classes: Array

    def __call__(self, block: Block) -> tuple[Block, FitData]:
        codes = encode_actions(self.classes, block.actions, "the demonstrations")
        # Columns read from Parquet lie one after another; in the order of rows, sums round as they do in memory.
        design = self.features.design(np.ascontiguousarray(block.observations), single=True)
        return block, FitData(design, codes, block.offsets, self.space, np.zeros(len(block.offsets) - 1, dtype=int))


class Measured(NamedTuple):
    """What one pass says of some demonstrations: mean and sum of squares of their steps' measure, and the trust in
    their steps without the steps themselves; (M,) arrays."""

    score: Array
    squares: Array
    reliability: Array
    interval: Array


def measure(ready: tuple[Block, FitData], judge: FittedJudge) -> Measured:
    """The scores of demonstrations under the policy of a sample."""
    data = ready[1]
    worth, _, trust = _in_steps(data, judge)
    score = data.sum_steps(worth) / data.lengths
    squares = data.sum_steps((worth - data.per_step(score)) ** 2)
    return Measured(score, squares, trust.reliability, trust.interval)


def _in_steps(data: FitData, judge: FittedJudge) -> tuple[Array, Array, StepTrust]:
    """The measure of each step, its log-ratio, and the trust in it."""
    worth, log_ratio = judge.step_ratios(data.features, data.actions)
    power = np.full(data.n_demonstrations, min(judge.independent, 1.0))
    return worth, log_ratio, step_trust(data, log_ratio, power)


@dataclass(frozen=True, eq=False)
class Weigh:
    """What the final policy learns from a block, the weights of its steps, and their log-ratios.

    Attributes
    ----------
    judge : FittedJudge
    trust : (M,) array
        Of demonstrations from number `first` on.
    typical : float
        Reliability of an expert.
    final : Prepare or None
        With the features of the final policy, where they are others than the judge's.
    first : int
    """

    judge: FittedJudge
    trust: Array
    typical: float
    final: Prepare | None = None
    first: int = 0

    @classmethod
    def of(cls, audit: Audit, judge: FittedJudge) -> Weigh:
        """As the demonstrations are trusted; where none is, the steps that are most likely an expert's count."""
        trust = audit.expert_proba
        if not is_anyone_trusted(trust, audit.lengths):
            return cls(judge, np.ones(len(trust)), np.inf)
        return cls(judge, trust, typical_reliability(audit.reliability, trust, audit.lengths))

    def only(self, those: slice) -> Weigh:
        """The same for `those` demonstrations."""
        return replace(self, trust=self.trust[those], first=those.start)

    def __call__(self, ready: tuple[Block, FitData]) -> tuple[FitData, Array, Array]:
        block, data = ready
        begin = block.first - self.first
        weight, log_ratio = self.weight(data, self.trust[begin : begin + data.n_demonstrations])
        return (self.final(block)[1] if self.final else data), weight, log_ratio

    def weight(self, data: FitData, trust: Array) -> tuple[Array, Array]:
        """Weights of the steps of demonstrations with such `trust` (M,), and their log-ratios."""
        _, log_ratio, steps = _in_steps(data, self.judge)
        return step_weight(data.lengths, trust, steps.reliability, steps.step, self.typical), log_ratio


def is_large(model: Any, data: Source) -> bool:
    """Whether a sample of `data` is enough for the judge."""
    n_steps, budget = int(data.offsets[-1]), _budget(model, data)
    least = max(budget, min(SAMPLE_DEMONSTRATIONS * n_steps / (len(data.offsets) - 1), _MOST_TIMES * budget))
    return n_steps > max(TIMES * budget, 2 * least)


def _budget(model: Any, data: Source) -> int:
    enough = int(np.searchsorted(data.offsets, N_LANDMARKS))  # to see how many columns the features have
    columns = model.judge_map(data.select(slice(0, enough))).n_columns
    return sample_steps(columns * model.space_.n_parts)


@dataclass(frozen=True, eq=False)
class Sampled:
    """The sample and what the judge says of it.

    Attributes
    ----------
    few : Demonstrations
    data : FitData
    chosen : (S,) int array
        Their numbers among all.
    judge : FittedJudge
    judgement : Judgement
    """

    few: Demonstrations
    data: FitData
    chosen: Array
    judge: FittedJudge
    judgement: Judgement


def judge_all(sampled: Sampled, data: FitData, measured: list[Measured], minority: Minority) -> Judgement:
    """The judgement of all demonstrations, `data` without their steps, from what was `measured` of them."""
    score, squares, reliability, interval = map(np.concatenate, zip(*measured, strict=True))
    judge, lengths, settings = sampled.judge, data.lengths, JudgeSettings()
    score[sampled.chosen] = sampled.judgement.scores.score  # held out, as the scores of all others are
    effective = judge.independent * lengths
    variance = mean_variance(squares, lengths, judge.pooled, effective, settings.variance_steps)
    groups = fit_groups(score, variance, data.labels, effective, lengths)
    rival = sampled.judgement.rival
    if rival is not None and not sampled.judgement.groups.told_apart():  # nothing says which style the others have
        rival = replace(rival, trusted=sampled.chosen[rival.trusted], rival=sampled.chosen[rival.rival])
    elif rival is not None:  # of the others nothing says more than on which side of the boundary they are
        upper = groups.log_odds(score, variance) > 0
        upper[sampled.chosen[rival.trusted]], upper[sampled.chosen[rival.rival]] = True, False
        rival = replace(rival, trusted=np.flatnonzero(upper), rival=np.flatnonzero(~upper))
    none = np.empty(0)
    scores = replace(sampled.judgement.scores, score=score, variance=variance, groups=groups, effective_steps=effective)
    teachers = np.zeros(len(score), dtype=bool)
    decision = Decision(scores, rival, minority)
    return conclude(data, decision, StepTrust(reliability, interval, none), none, teachers, settings)


def fit_large(model: Any, data: Source, labels: Array, demonstrators: Demonstrators, engine: Engine) -> None:
    """`RPIL.fit`, of which `model` has the settings and gets the attributes.

    Parameters
    ----------
    model : RPIL
    data : Source
    labels : (M,) array
        Of all demonstrations.
    demonstrators : Demonstrators
        Which demonstrator gave which of them.
    engine : Engine
        Runs the passes.
    """
    progress = model.progress or (lambda _: None)
    sampled, prepare = _read_sample(model, data, labels, progress)
    ready = engine.place(data.shards(engine.n_parts)).then(prepare)
    progress("a pass over everything: scores")
    none = np.empty(0)
    everybody = FitData(none, none, data.offsets, model.space_, labels, demonstrators=demonstrators)
    measured = list(ready.map(partial(measure, judge=sampled.judge)))
    judgement = judge_all(sampled, everybody, measured, model.minority)
    # Their steps are weighed in the next pass; until then the audit is of demonstrations without steps.
    stepless = replace(everybody, offsets=np.zeros_like(data.offsets))
    model.keep_judgement(judgement, replace(sampled.judge, groups=judgement.groups), stepless, data.ids)
    model.audit_ = replace(model.audit_, offsets=np.asarray(data.offsets, dtype=np.int64))
    if judgement.rival is not None:
        model.audit_ = replace(model.audit_, to_label=_longest_of_groups(sampled))
    model.judge_features_ = prepare.features
    progress("the policy")
    _fit_policy(model, data, sampled, prepare, ready, isinstance(engine, InMemory), progress)
    model.explain(everybody, data.source)


def _read_sample(model: Any, data: Source, labels: Array, progress: Callable[[str], None]) -> tuple[Sampled, Prepare]:
    progress("a sample")
    rng = np.random.default_rng(model.random_state)
    chosen = sample(np.diff(data.offsets), labels, _budget(model, data), rng)
    few, space = data.select(chosen), model.space_
    codes = encode_actions(model.classes_, few.actions, data.source)
    features = model.judge_map(few)
    fit_data = FitData(features.design(few.observations, single=True), codes, few.offsets, space, labels[chosen])
    # Which group to distrust is decided here; a group to trust is reported, and trusted among all demonstrations.
    minority: Minority = "ask" if model.minority == "trust" else model.minority
    held_out = held_out_model(fit_data, model.random_state)
    judgement = judge(fit_data, held_out, seed=model.random_state, minority=minority, progress=progress)
    fitted = FittedJudge.of(judgement, fit_data)
    return Sampled(few, fit_data, chosen, fitted, judgement), Prepare(features, space, model.classes_)


def _longest_of_groups(sampled: Sampled) -> tuple[Any, ...]:
    """Ids of one demonstration of each group, of those that were compared: all others may be in either."""
    rival = sampled.judgement.rival
    assert rival is not None
    return tuple(sampled.few.ids[m] for m in longest_unlabelled(sampled.data, (rival.trusted, rival.rival)))


def _fit_policy(
    model: Any, data: Source, sampled: Sampled, prepare: Prepare, ready: Any, in_memory: bool, progress: Any
) -> None:
    """Weigh all steps and fit the final policy to them."""
    space, few, some = model.space_, sampled.few, sampled.data
    weigh = Weigh.of(model.audit_, sampled.judge)
    weight = weigh.weight(some, weigh.trust[sampled.chosen])[0]
    choice, read = model._choice(few, some.actions, weight), prepare.features
    if choice != Choice(read.kind):
        trusted = weight > 0.5 * weight.max()
        read = FeatureMap.fit(choice.kind, few.observations[trusted], weight[trusted], choice.ridge)
        weigh = replace(weigh, final=replace(prepare, features=read))
        some = replace(some, features=read.design(few.observations, single=True))
    weighted_steps = ready.then(weigh)
    log_ratio, step_weights, total = gathered(weighted_steps.map(_of_steps), int(data.offsets[-1]), not in_memory)
    model.audit_ = replace(model.audit_, step_log_ratio=log_ratio, step_weight=step_weights)
    ridge, final_ridge = (ridge_of(read, model.C, steps, space) for steps in (weight.sum(), total))
    first: Any = linear_policy(space, ridge, weight.sum()).fit(some, weight)[0]

    with_preconditioner, hessian = first.with_preconditioner(some, weight, final_ridge, total / weight.sum())
    checkpoint = _checkpoint(model, data, few)
    start = (checkpoint.read() if checkpoint else None) or AscentState(with_preconditioner)
    keep = checkpoint.keep if checkpoint else lambda _: None
    policy = clone(weighted_steps, start, hessian, REFIT_TOL, model.max_iter, progress, keep)
    model.features_, model.policy_ = read, policy.with_temperature(choice.temperature)
    if checkpoint:
        checkpoint.done()


def _checkpoint(model: Any, data: Source, few: Demonstrations) -> Any:
    if model.checkpoint is None:
        return None
    from rpil.scale.checkpoint import Checkpoint  # it knows all that can be saved, which is more than a fit needs

    return Checkpoint.of(model.checkpoint, model, data.offsets, few, model.audit_.expert_proba)


def _of_steps(weighted: tuple[FitData, Array, Array]) -> tuple[Array, Array]:
    return weighted[2], weighted[1]
