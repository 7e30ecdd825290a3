"""Every fit of `RPIL`, by one path: code the actions, pose, decide which demonstrations to trust, fit the final policy.

The parts of the path are exchanged. In a `FullFit` (here) the decision reads all demonstrations, in memory; in a
`SampledFit` (`rpil.estimators.passes`) it reads a sample of many. The judge decides, or the mixture with a named
adversary. The final policy is linear, or the user's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Indices, check_squares
from rpil.data.copies import Copies, copies_among
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space
from rpil.estimators.settings import Settings
from rpil.estimators.task import Task
from rpil.inference.answers import check_copied_labels
from rpil.inference.held_out import HeldOutModel, HeldOutPolicy, held_out_model
from rpil.inference.parts import judged_parts
from rpil.inference.trust import Judgement, judge, repeated
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, ridge_of
from rpil.results.evidence import COMPARED, by_held_out_policies, deviations
from rpil.results.record import Audit, Interval
from rpil.results.step_weights import weights_of
from rpil.results.summary import audit_from_judgement, audit_from_mixture, parts_not_judged

if TYPE_CHECKING:
    from rpil.estimators.final_policy import LinearPolicySpec
    from rpil.estimators.task import ActionBox, Features, FinalPolicy
    from rpil.mixture.adversaries.protocol import Adversary
    from rpil.mixture.em import State
    from rpil.policies.cross_fitted import CrossFittedPolicy
    from rpil.scale.fit import JudgedSample
    from rpil.scale.protocol import Engine, Shards

Progress = Callable[[str], None]

MAX_COLUMNS = 200
"""Observations of a user's policy, above which the parts that a learner trusts are found by projections of them."""


@dataclass(frozen=True)
class FitOptions:
    """The constructor parameters of `RPIL` that decide a fit; `RPIL` documents them."""

    features: str
    adversary: str | Adversary
    random_state: int
    settings: Settings
    progress: Progress
    engine: Engine | None = None
    policy: object = None
    C: float | None = None
    action_box: ActionBox | None = None

    @property
    def judges(self) -> bool:
        """Whether the judge decides, and not the mixture with a named adversary."""
        return isinstance(self.adversary, str) and self.adversary == "auto"

    @property
    def linear(self) -> LinearPolicySpec:
        """The linear final policy."""
        from rpil.estimators.final_policy import LinearPolicySpec

        settings = self.settings
        return LinearPolicySpec(
            self.features, self.C, settings.ascent.tol, settings.selection, settings.min_feature_weight
        )

    def cross_fitted(self, space: Space, n_steps: int) -> CrossFittedPolicy:
        """The user's policy before it is fitted."""
        from rpil.policies.cross_fitted import cross_fitted_policy

        return cross_fitted_policy(self.policy, space, n_steps, self.settings.cross_fit)

    def check(self, task: Task) -> None:
        """Refuse options that are unknown, or that do not fit the demonstrations, before any work."""
        if self.policy is not None:
            self.cross_fitted(task.space, int(task.source.offsets[-1]))  # refuses an unsuitable estimator
        if not self.judges and (task.demonstrators.informative or self.policy is not None):
            raise DataError("A named adversary knows no demonstrators and no policy of the user; leave out one.")
        if not self.judges and (len(task.answers.compared) or task.answers.has_outcome.any()):
            raise DataError("A named adversary learns from labels alone; leave out pairs and the outcome.")

    def n_sampled_steps(self, task: Task) -> int:
        """Steps of the sample that the judge reads of large data."""
        # Enough demonstrations to count the columns of the features.
        first = int(np.searchsorted(task.source.offsets, self.settings.selection.maps.n_landmarks))
        features = self.judge_features(task.source.select(slice(0, first)))
        assert isinstance(features, FeatureMap)
        return self.settings.sample.steps(features.n_columns * task.space.n_parts)

    def judge_features(self, demonstrations: Demonstrations) -> Features:
        """The feature map while trust is decided."""
        if self.policy is not None:
            from rpil.policies.cross_fitted import IdentityMap

            return IdentityMap()
        kind = self.settings.judge_features
        if kind == "auto":
            kind = self.features if self.features not in ("raw", "auto") else "folded"
        offsets = demonstrations.offsets if self.judges else None  # the paper's mixture sees what its policy sees
        seen, what = demonstrations.observations, f"{demonstrations.source}: observation"
        check_squares([seen.min(axis=0), seen.max(axis=0)], what, demonstrations.observation_names)
        return FeatureMap.fit(kind, seen, offsets=offsets, settings=self.settings.selection.maps)

    def linear_data(self, posed: JudgeInput) -> FitData:
        """The data of the judge, with features of a linear policy where the policy is the user's."""
        if self.policy is None:
            return posed.data
        seen, settings = posed.demonstrations.observations, self.settings.selection.maps
        if seen.shape[1] > MAX_COLUMNS:  # as of pictures
            rng = np.random.default_rng(0)
            seen = seen @ rng.normal(size=(seen.shape[1], MAX_COLUMNS)) / np.sqrt(seen.shape[1])
        features = FeatureMap.fit("folded", seen, offsets=posed.demonstrations.offsets, settings=settings)
        return replace(posed.data, features=features.design(seen))

    def judged(self, data: FitData) -> FitData:
        """The data with the parts of continuous actions that the judge sees; the user's policy needs all of them."""
        if self.policy is not None or not data.space.has_density:
            return data
        return replace(data, judged=judged_parts(data.actions, data.offsets))


@dataclass(frozen=True, eq=False)
class JudgeInput:
    """The demonstrations that the decision reads: all but copies of others, or a sample."""

    demonstrations: Demonstrations
    data: FitData
    features: Features
    indices: Array | None = None
    """The demonstrations of a sample among all."""
    blocks: Shards[tuple[Block, FitData]] | None = None
    """All demonstrations as an engine holds them, where the decision reads a sample."""
    copies: Copies | None = None
    """The copies among all demonstrations, where the decision reads the others."""


@dataclass(frozen=True, eq=False)
class FitResult:
    """The audit of the demonstrations, and the policy; the estimator copies it onto itself."""

    audit: Audit
    features: Features
    """Features of the final policy; those of the judge where no policy is kept."""
    policy: FinalPolicy | None = None
    sample: JudgedSample | None = None
    """By which all others were judged, where the decision read a sample."""
    state: State | None = None
    """State of the mixture with a named adversary."""
    n_iter: int = 0
    lower_bound: float = 0.0
    """Objective of the mixture, or mean held-out log-likelihood of a step of the training group, in nats."""
    converged: bool = True
    judgement: Judgement | None = None


def decide_by_mixture(posed: JudgeInput, options: FitOptions) -> FitResult:
    """The decision of the paper's mixture with a named adversary."""
    from rpil.mixture.search import SearchSettings, fit_mixture
    from rpil.policies.linear import linear_policy

    data, settings, n_steps = posed.data, options.settings, len(posed.data.actions)
    assert isinstance(posed.features, FeatureMap)
    ridge = ridge_of(posed.features, options.C, n_steps, data.space)
    start = linear_policy(data.space, ridge, n_steps)
    search = SearchSettings(start, settings.mixture, partial(judged_starts, data, settings))
    result = fit_mixture(data, search, options.adversary, options.progress)
    share = Interval(*result.state.prior.interval(result.posterior.expert))
    audit = audit_from_mixture(data, result, share, posed.demonstrations.ids, settings.audit)
    fitted = FitResult(audit, posed.features, state=result.state, converged=bool(result.converged))
    return replace(fitted, n_iter=max(1, len(result.history) - 1), lower_bound=result.objective)


def judged_starts(data: FitData, settings: Settings) -> dict[str, Array]:
    """Starts of EM that the judge proposes: its training group, and each of the demonstrations with the best scores."""
    judged = judge(data, held_out_model(data, settings.judge.held_out), settings.judge)
    best = np.argsort(-judged.scores.score, kind="stable")[: settings.mixture.single_starts]
    single = {f"single {m}": (np.arange(data.n_demonstrations) == m).astype(float) for m in best}
    return {"agreeing": judged.training_group.astype(float)} | single


@dataclass(frozen=True, eq=False)
class FullFit:
    """The stages of a fit whose decision reads all demonstrations, in memory."""

    task: Task
    options: FitOptions
    keeps_policy: bool = True
    """Whether a final policy is fitted; an audit keeps none."""

    def run(self) -> FitResult:
        """Pose, decide, and fit the final policy, if it is kept."""
        options = self.options
        if self.keeps_policy and (self.task.answers.labels < 0).all():
            raise DataError(
                f"{self.task.source.source}: all demonstrations are labelled bad; leave one that may be good."
            )
        posed = self.pose()
        decided = self.decide(posed) if options.judges else decide_by_mixture(posed, options)
        if self.task.taken_over is not None:
            audit = replace(decided.audit, taken_over=self.task.taken_over)
            decided = replace(decided, audit=replace(audit, step_weight=weights_of(audit)))
        options.progress("the policy" if self.keeps_policy else "the weights of the steps")
        return self.fit_policy(posed, decided)

    def pose(self) -> JudgeInput:
        """The demonstrations that the decision reads, and their features."""
        task, options, every = self.task, self.options, self.task.demonstrations
        copies = copies_among(every) if options.judges else Copies.of(np.arange(len(every)))
        options.progress("features")
        check_copied_labels(task.answers, copies.copy_of, task.source.ids, task.source.source)
        different = every.select(copies.judged) if copies.any else every
        features = options.judge_features(different)
        data = options.judged(self._data(different, features, copies.judged))
        return JudgeInput(different, data, features, copies=copies if copies.any else None)

    def decide(self, posed: JudgeInput) -> FitResult:
        """The decision of the judge about all demonstrations, with the answers that were given."""
        task, options, copies, judge_settings = self.task, self.options, posed.copies, self.options.settings.judge
        linear = held_out_model(options.linear_data(posed), judge_settings.held_out)
        data, learner = posed.data, linear.data if self.keeps_policy else None
        with_prior = replace(judge_settings, parts=replace(judge_settings.parts, prior=options.settings.mixture.prior))
        model: HeldOutModel = linear
        if options.policy is not None:
            model = HeldOutPolicy(data, options.cross_fitted(data.space, len(data.actions)), judge_settings.held_out)
        judgement, data, sample = self.extend(posed, judge(data, model, with_prior, options.progress, learner))
        # An audit answers like the judge, and without a policy its weights are for other trainings.
        settings = replace(options.settings.audit, judge=judge_settings, weighs_for_learner=self.keeps_policy)
        told = judgement if sample is None else replace(judgement, log_ratio=np.empty(0))  # its steps are on disk
        audit = audit_from_judgement(told, data, task.source.ids, task.answers, settings)
        notes = *audit.notes, *parts_not_judged(posed.data), "" if copies is None else copies.sentence
        history, audit = judgement.scores.fit.history, replace(audit, notes=tuple(filter(None, notes)))
        if sample is None and audit.finding in COMPARED:
            evidence = by_held_out_policies(judgement, linear, copies, judge_settings.held_out)
            audit = replace(audit, deviations=deviations(audit, evidence, task.classes))
        decided = FitResult(audit, posed.features, sample=sample, judgement=judgement)
        return replace(decided, n_iter=len(history), lower_bound=float(history[-1]))

    def extend(self, posed: JudgeInput, judgement: Judgement) -> tuple[Judgement, FitData, JudgedSample | None]:
        """The judgement of all demonstrations, and their data; and the sample that was judged, if it was one."""
        if posed.copies is None:
            return judgement, posed.data, None
        every = self._data(self.task.demonstrations, posed.features)
        return repeated(judgement, posed.copies, every.offsets), every, None

    def _data(self, demonstrations: Demonstrations, features: Features, rows: Indices = slice(None)) -> FitData:
        """The data of the demonstrations at `rows`, with labels and demonstrators."""
        task, every = self.task, self.task.demonstrations
        large = every.n_steps * every.n_observations > self.options.settings.single_precision
        single = self.options.judges and task.space.kind == "discrete" and large
        data = task.data(demonstrations, features, single)
        numbers = np.arange(len(every))[rows]
        return replace(data, labels=task.answers.labels[rows], demonstrators=task.demonstrators.select(numbers))

    def fit_policy(self, posed: JudgeInput, decided: FitResult) -> FitResult:
        """Add the final policy, if one is kept, to what was decided."""
        if not self.keeps_policy:
            return decided
        features, policy = final_policy(self.task, self.options, decided.audit.step_weight)
        return replace(decided, features=features, policy=policy)


def final_policy(task: Task, options: FitOptions, weight: Array) -> tuple[Features, FinalPolicy]:
    """The final policy of demonstrations, in memory, by the `weight` (N,) of their steps, and its features."""
    every = task.demonstrations
    if options.policy is None:
        return options.linear.fit(every, task.codes(every), weight, task.space)
    features = options.judge_features(every)
    data = task.data(every, features)
    # Cross-fitted again by the final weights: the temperature of the policy comes from held-out steps.
    start, _ = options.cross_fitted(task.space, len(weight)).fit(data, weight)
    return features, start.fit_all(data, weight)
