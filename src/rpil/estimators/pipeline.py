"""Every fit of `RPIL`: find features, decide which demonstrations to trust, fit the final policy.

By `fit_full` the decision reads all demonstrations, in memory; by `fit_sampled` a sample, and then passes go over
everything. The judge decides, or the mixture with a named adversary. The final policy is linear, or the user's.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.archive import settings_record
from rpil.data.arrays import check_squares
from rpil.data.copies import Copies, copies_among
from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space
from rpil.estimators.task import Task
from rpil.inference.answers import Answers, check_copied_labels
from rpil.inference.held_out import HeldOutPolicy, HeldOutRidge, HeldOutSoftmax, held_out_model
from rpil.inference.parts import judged_parts
from rpil.inference.settings import JudgeSettings
from rpil.inference.trust import Judgement, judge, repeated
from rpil.mixture.settings import MixtureSettings
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.settings import CrossFitSettings, SelectionSettings
from rpil.results import summary
from rpil.results.judged import AuditSettings, Interval
from rpil.results.record import Audit
from rpil.results.step_weights import of_demonstrations, weights_of
from rpil.scale.settings import AscentSettings, SampleSettings

if TYPE_CHECKING:
    from rpil.estimators.cloning import LinearPolicySpec
    from rpil.estimators.task import Features, FinalPolicy
    from rpil.mixture.adversaries.protocol import Adversary
    from rpil.mixture.em import State
    from rpil.policies.cross_fitted import CrossFittedPolicy
    from rpil.scale.fit import JudgedSample
    from rpil.scale.protocol import Engine, Shards


@settings_record(min_feature_weight="[0, 1)", single_precision="[0, inf)")
class Settings:
    """Settings of every stage of a fit.

    Examples
    --------
    >>> from rpil import RPIL, MixtureSettings, Settings
    >>> model = RPIL(adversary="uniform", settings=Settings(mixture=MixtureSettings(prior=0.5)))
    """

    judge_features: str = "auto"
    """Features of the judge: a kind, or "auto": the kind of the final policy, but "folded" instead of "raw" and "auto".
    A straight line takes an expert in a rare situation for an adversary. benchmarks/ablations.py ("raw features")."""
    min_feature_weight: float = 0.5
    """Weight of a step, divided by 1 or by the largest weight where that is smaller, above which the feature map of the
    final policy is fitted to it. Chosen by hand, not tuned."""
    single_precision: int = 50_000
    """Entries of observations above which the judge reads discrete actions in single precision. By hand, not tuned."""
    judge: JudgeSettings = JudgeSettings()
    mixture: MixtureSettings = MixtureSettings()
    """Settings of a named adversary: the M-step, and when EM stops; the prior is that of the learner, too."""
    audit: AuditSettings = AuditSettings()
    """Settings of verdicts and weights of steps."""
    selection: SelectionSettings = SelectionSettings()
    """Settings of feature maps, and of the choice of one where features are "auto"."""
    cross_fit: CrossFitSettings = CrossFitSettings()
    """Settings of the folds of an estimator that is given as `policy`."""
    sample: SampleSettings = SampleSettings()
    ascent: AscentSettings = AscentSettings()
    """Settings of the fit of the final policy."""


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

    @property
    def judges(self) -> bool:
        """Whether the judge decides, and not the mixture with a named adversary."""
        return isinstance(self.adversary, str) and self.adversary == "auto"

    @property
    def linear(self) -> LinearPolicySpec:
        """The linear final policy."""
        from rpil.estimators.cloning import LinearPolicySpec

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
        if not isinstance(self.settings, Settings):
            raise DataError(f"settings= is a {type(self.settings).__name__}; give rpil.Settings(...).")
        if self.policy is not None:
            self.cross_fitted(task.space, int(task.source.offsets[-1]))  # refuses an unsuitable estimator
        if not self.judges and (task.demonstrators.informative or self.policy is not None):
            raise DataError("A named adversary knows no demonstrators and no policy of the user; leave out one.")
        self.check_answers(task.answers)

    def check_answers(self, answers: Answers) -> None:
        """Refuse answers from which a named adversary does not learn."""
        if not self.judges and (len(answers.compared) or answers.has_outcome.any()):
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

    def judged(self, data: FitData) -> FitData:
        """The data with the parts of continuous actions that the judge sees; the user's policy needs all of them."""
        if self.policy is not None or not data.space.has_density:
            return data
        return replace(data, judged=judged_parts(data.actions, data.offsets))


@dataclass(frozen=True, eq=False)
class FitResult:
    """The audit of the demonstrations, and the policy; the estimator copies it onto itself."""

    audit: Audit
    features: Features
    """Features of the final policy; those of the judge where no policy is kept."""
    policy: FinalPolicy | None = None
    state: State | None = None
    """State of the mixture with a named adversary."""
    n_iter: int = 0
    lower_bound: float = 0.0
    """Objective of the mixture, or mean held-out log-likelihood of a step of the training group, in nats."""
    converged: bool = True
    p_two: float | None = None
    """The probability of two groups of scores, where the judge decided."""


def decide_by_mixture(data: FitData, features: Features, ids: Sequence[Hashable], options: FitOptions) -> FitResult:
    """The decision of the paper's mixture with a named adversary."""
    from rpil.mixture.search import SearchSettings, fit_mixture
    from rpil.policies.linear import linear_policy

    settings, n_steps = options.settings, len(data.actions)
    assert isinstance(features, FeatureMap)
    start = linear_policy(data.space, ridge_of(features, options.C, n_steps, data.space), n_steps)
    search = SearchSettings(start, settings.mixture, partial(judged_starts, data, settings))
    result = fit_mixture(data, search, options.adversary, options.progress)
    share = Interval(*result.state.prior.interval(result.posterior.expert))
    audit = summary.audit_from_mixture(data, result, share, ids, settings.audit)
    fitted = FitResult(audit, features, state=result.state, converged=bool(result.converged))
    return replace(fitted, n_iter=max(1, len(result.history) - 1), lower_bound=float(result.history[-1]))


def judged_starts(data: FitData, settings: Settings) -> dict[str, Array]:
    """Starts of EM that the judge proposes: its training group, and each of the demonstrations with the best scores."""
    judged = judge(data, held_out_model(data, settings.judge.held_out), settings.judge)
    best = np.argsort(-judged.scores.score, kind="stable")[: settings.mixture.single_starts]
    single = {f"single {m}": (np.arange(data.n_demonstrations) == m).astype(float) for m in best}
    return {"agreeing": judged.scores.fit.group.astype(float)} | single


def judge_by_options(
    demonstrations: Demonstrations, data: FitData, options: FitOptions, learns: bool
) -> tuple[Judgement, HeldOutSoftmax | HeldOutRidge]:
    """Judge demonstrations; also return the held-out linear policies, which find the part that a learner trusts."""
    settings, seen_linearly, model = options.settings.judge, data, None
    if options.policy is not None:
        model = HeldOutPolicy(data, options.cross_fitted(data.space, len(data.actions)), settings.held_out)
        seen, maps = demonstrations.observations, options.settings.selection.maps
        if seen.shape[1] > MAX_COLUMNS:  # as of pictures
            rng = np.random.default_rng(0)
            seen = seen @ rng.normal(size=(seen.shape[1], MAX_COLUMNS)) / np.sqrt(seen.shape[1])
        features = FeatureMap.fit("folded", seen, offsets=demonstrations.offsets, settings=maps)
        seen_linearly = replace(data, features=features.design(seen))
    linear = held_out_model(seen_linearly, settings.held_out)
    with_prior = replace(settings, parts=replace(settings.parts, prior=options.settings.mixture.prior))
    return judge(data, model or linear, with_prior, options.progress, linear.data if learns else None), linear


def decided(task: Task, options: FitOptions, judgement: Judgement, features: Features, learns: bool) -> FitResult:
    """The audit of a judgement of all demonstrations, with the answers that were given."""
    # An audit answers like the judge, and without a policy its weights are for other trainings.
    settings = replace(options.settings.audit, judge=options.settings.judge, weighs_for_learner=learns)
    audit = summary.audit_from_judgement(judgement, task.source, task.answers, task.demonstrators, settings)
    fit, p_two = judgement.scores.fit, judgement.scores.groups.p_two
    return FitResult(audit, features, n_iter=len(fit.history), lower_bound=float(fit.history[-1]), p_two=p_two)


def fit_full(task: Task, options: FitOptions, learns: bool) -> FitResult:
    """Judge all demonstrations, in memory, copies of others once, and fit the final policy unless nobody `learns`."""
    every = task.demonstrations
    copies = copies_among(every) if options.judges else Copies.of(np.arange(len(every)))
    options.progress("features")
    check_copied_labels(task.answers, copies.copy_of, task.source.ids, task.source.source)
    different = every.select(copies.judged) if copies.any else every
    features = options.judge_features(different)
    large = every.n_steps * every.n_observations > options.settings.single_precision
    single = options.judges and every.is_discrete and large
    data = options.judged(task.data(different, features, single))
    if options.judges:
        judgement, linear = judge_by_options(different, data, options, learns)
        if copies.any:
            judgement = repeated(judgement, copies, every.offsets)
        result = decided(task, options, judgement, features, learns)
        notes = *result.audit.notes, *summary.parts_not_judged(data), *filter(None, [copies.sentence])
        audit = replace(result.audit, notes=notes)
        if audit.finding in summary.COMPARED:
            evidence = summary.by_held_out_policies(judgement, linear, copies, options.settings.judge.held_out)
            audit = replace(audit, deviations=summary.deviations(audit, evidence, task.classes))
    else:
        result = decide_by_mixture(replace(data, labels=task.answers.labels), features, every.ids, options)
        audit = result.audit
    if task.taken_over is not None:
        audit = replace(audit, taken_over=task.taken_over)
        audit = replace(audit, step_weight=weights_of(audit))
    result = replace(result, audit=audit)
    options.progress("the policy" if learns else "the weights of the steps")
    if not learns:
        return result
    features, policy = final_policy(task, options, audit.step_weight)
    return replace(result, features=features, policy=policy)


def final_policy(task: Task, options: FitOptions, weight: Array) -> tuple[Features, FinalPolicy]:
    """The final policy of demonstrations, in memory, by the `weight` (N,) of their steps, and its features."""
    every = task.demonstrations
    if options.policy is None:
        return options.linear.fit(every, task.codes(every), weight, task.space)
    from rpil.policies.cross_fitted import fit_model

    features = options.judge_features(every)
    data = task.data(every, features)
    # Cross-fitted again by the final weights: the temperature of the policy comes from held-out steps.
    start, _ = options.cross_fitted(task.space, len(weight)).fit(data, weight)
    return features, replace(start, models=(fit_model(start, data.features, data.actions, weight),))


def fit_sampled(task: Task, options: FitOptions, learns: bool) -> FitResult:
    """Judge a sample, then everything by what was learned from it, and fit the final policy unless nobody `learns`."""
    from rpil.scale.fit import DesignMap, JudgedSample, judge_everyone, policies_of_sample, score_block
    from rpil.scale.local import LocalEngine, gathered

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
    sample = JudgedSample(data, indices, judgement)
    options.progress("a pass over everything: scores")
    everyone = FitData(np.empty(0), np.empty(0), task.source.offsets, task.space)
    policies = policies_of_sample(data, judgement, judging)
    score = partial(score_block, policies=policies, spread=judgement.spread, settings=judging)
    judgement = judge_everyone(sample, everyone, blocks.map(score), judging)
    # The log-ratios of the steps are on disk.
    result = decided(task, options, replace(judgement, log_ratio=np.empty(0)), features, learns)
    options.progress("the policy" if learns else "the weights of the steps")
    trust, n_steps = of_demonstrations(result.audit), int(task.source.offsets[-1])
    n_parts = 1 + n_steps // settings.block_steps
    weights = map(np.repeat, np.array_split(trust, n_parts), np.array_split(result.audit.lengths, n_parts))
    notes = *result.audit.notes, *summary.parts_not_judged(data)
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
    from rpil.policies.linear import linear_policy
    from rpil.scale.fit import DesignMap, WeightedMap, ascend

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
