"""A rival group: whether the demonstrations that score lower have a policy of their own.

Noise has none: a policy fitted to it explains nothing. Let A be the upper group of the scores, and B the lower ones
that a policy fitted to B explains better than that of A. B is a rival of A if the gain of its own policy is above 0 by
two standard errors, and above `max_noise` times that of A, and the policy of A does not explain B, not even at the
noise of B:

    gain = median over B of  mean_n [log pi_B - log q_B]
    max over l of  median over B of  mean_n [log((1 - l) pi_A' + l q_B) - log q_B]  <  max_shared_gain * gain

pi_A and pi_B are fitted to one of the groups, and held out; pi_A' has the errors' scale of B; q_B is the distribution
of the actions of B whatever the state. Then two groups are described, and neither is one of outliers. Noisy
versions of the policy of A, and noise, are no rivals.

Two groups are described by their contrast, which judges neither: the log-ratio of their policies, log pi_A - log pi_B
in the steps of A and log pi_B - log pi_A in those of B, summed over each part of a continuous action, or over the steps
with each discrete action. That of part j, in nats a step, is

    e_j = max(0, median over B of mean_n d_nj - median over A of mean_n d_nj),
    d_nj = log pi_B(a_nj|s_n) - log pi_A(a_nj|s_n)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.held_out import HeldOutModel, held_out_model, log_reference
from rpil.inference.scores import Scoring
from rpil.inference.settings import HeldOutSettings, JudgeSettings, RivalSettings
from rpil.inference.trimming import TrimmedFit, choose_ridge
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.policies.folds import deal

MAX_PARTS = 3
"""Parts of the action that are named or drawn."""
MIN_NATS = 1e-6
"""Evidence that is more than rounding."""


@dataclass(frozen=True, eq=False)
class Lower:
    """The demonstrations below the upper group, against those in it."""

    upper: Int[Array, " A"]
    rival: Int[Array, " B"]
    """The lower demonstrations that their own policy explains better than that of the upper group."""
    gain_upper: float
    """Nats a step by which the policy of the upper group explains it better than the frequencies of its actions."""
    is_rival: bool
    """Whether the rival group has a policy of its own."""
    is_noise: bool
    """Whether a policy of all lower demonstrations explains nothing."""


def look_below(
    data: FitData, model: HeldOutModel, upper: Bool[Array, " M"], fit: TrimmedFit, settings: JudgeSettings
) -> Lower:
    """Look for a policy of their own among the demonstrations that are not in the `upper` group; `fit` is that of the
    scores."""
    limits, ridge, members = settings.rivals, fit.ridge, np.flatnonzero(upper)
    log_pi = fit.log_prob if (fit.group == upper).all() else _log_prob(data, model, upper, ridge)
    gain_upper = float(np.median(gains(data, log_pi, upper, settings.held_out)))
    below, score = model.cold_copy(), data.mean_steps(log_pi)
    of_all = gains(data, _log_prob(data, below, ~upper, ridge), ~upper, settings.held_out)
    is_noise = not is_credible(of_all, limits.standard_errors) and np.median(of_all) <= limits.max_noise * gain_upper
    rival = ~upper & (score <= np.median(score[~upper]))
    log_pi_rival = _log_prob(data, below, rival, ridge)
    rival = ~upper & (data.mean_steps(log_pi_rival) > score)
    if rival.sum() < settings.claims.min_group:
        return Lower(members, np.flatnonzero(rival), gain_upper, False, bool(is_noise))
    own = gains(data, log_pi_rival, rival, settings.held_out)
    has_policy = is_credible(own, limits.standard_errors) and bool(np.median(own) > limits.max_noise * gain_upper)
    if has_policy:
        of_upper, of_rival = (data.per_step(group.astype(float)) for group in (upper, rival))
        shared = shared_gains(data, model.log_prob_at(of_upper, of_rival, ridge), rival, settings)
        has_policy = float(np.median(shared)) < limits.max_shared_gain * float(np.median(own))
    return Lower(members, np.flatnonzero(rival), gain_upper, has_policy, bool(is_noise))


def is_learnable(
    data: FitData, model: HeldOutModel, group: Bool[Array, " M"], size: int, ridge: float, settings: JudgeSettings
) -> bool:
    """Whether `size` demonstrations of a `group`, in a random order, suffice for a policy that explains them.

    If even that many members of the upper group are too few to learn from, a lower group of that size proves nothing.
    The order follows from the contents of the demonstrations, so that their places in the data decide nothing.
    """
    in_random_order = np.argsort(deal(data, data.n_demonstrations, seed=0), kind="stable")
    few = np.zeros_like(group)
    few[in_random_order[group[in_random_order]][:size]] = True
    log_prob = _log_prob(data, model.cold_copy(), few, ridge)
    return is_credible(gains(data, log_prob, few, settings.held_out), settings.rivals.standard_errors)


def do_steps_tell(data: FitData, fit: TrimmedFit, settings: JudgeSettings) -> bool:
    """Whether a step that the policy of the training group explains better than that of the others is the better one.

    It is not where the others are too few to have a policy, or may follow one of their own: then there are two ways.
    """
    others = ~fit.group
    if others.sum() < settings.claims.min_group:
        return False
    return not SecondWay.of(data, fit.group, others, settings).is_strong


@dataclass(frozen=True, eq=False)
class SecondWay:
    """How well policies that can bend (of Nystroem's features) explain the `lower` of two groups, held out.

    To the features of the scores a rule that they cannot express looks like noise.
    """

    gain: float
    """Median gain of the lower group by its own policy, nats a step."""
    of_upper: float
    """That of the upper group by its own, or 0."""
    shared: float
    """The largest gain of the lower group by the policy of the upper one, mixed with its own reference."""
    is_worse: bool
    """Whether the lower demonstrations gain credibly less by their own policy than by that of the upper group: they are
    noisy versions of it."""
    is_credible: bool
    """Whether the gain is above 0 by its standard errors, and above the share of it that noise has."""
    limits: RivalSettings

    @classmethod
    def of(
        cls, data: FitData, upper: Bool[Array, " M"], lower: Bool[Array, " M"], settings: JudgeSettings
    ) -> SecondWay:
        """Fitted to a sample of the demonstrations, where the groups have many steps."""
        limits = settings.rivals
        few, is_lower = _sample(data, upper, lower, min(limits.max_steps, limits.max_entries // data.features.shape[1]))
        features = FeatureMap.fit("nystroem", few.features, offsets=few.offsets, settings=FeatureSettings())
        few = replace(few, features=features.design(few.features, single=few.features.dtype == np.float32))
        # Few folds: the columns are many, and a softmax policy keeps a matrix of their squares for each fold.
        several = settings.held_out.max_folds if isinstance(few.space, Box) else 2
        model = held_out_model(few, 0, replace(settings.held_out, max_folds=several, max_left_out=0))
        ridge_a, ridge_b = (choose_ridge(few, model.cold_copy(), group) for group in (~is_lower, is_lower))

        def own_gains(group: Array, ridge: float) -> Array:
            return gains(few, _log_prob(few, model.cold_copy(), group, ridge), group, settings.held_out)

        own, of_upper = own_gains(is_lower, ridge_b), max(float(np.median(own_gains(~is_lower, ridge_a))), 0.0)
        of_others, of_own = few.per_step((~is_lower).astype(float)), few.per_step(is_lower.astype(float))
        shared = shared_gains(few, model.cold_copy().log_prob_at(of_others, of_own, ridge_a), is_lower, settings)
        gain, is_worse = float(np.median(own)), is_credible(shared - own, limits.standard_errors)
        credible = is_credible(own, limits.standard_errors) and gain > limits.max_noise * of_upper
        return cls(gain, of_upper, float(np.median(shared)), is_worse, credible, limits)

    @property
    def is_strong(self) -> bool:
        """Whether it explains the lower group about as well as that of the upper group explains that, and no worse than
        that of the upper group explains the lower."""
        return self.is_credible and not self.is_worse and self.gain > self.limits.min_own_gain * self.of_upper

    @property
    def is_there(self) -> bool:
        """Whether it is strong, or explains what the policy of the upper group does not."""
        return self.is_strong or (self.is_credible and self.shared < self.limits.max_shared_gain * self.gain)


def _sample(
    data: FitData, upper: Bool[Array, " M"], lower: Bool[Array, " M"], max_steps: int
) -> tuple[FitData, Bool[Array, " S"]]:
    """Demonstrations of either group with `max_steps` at most, in a random order that follows from their contents, and
    which of them are of the `lower` group."""
    order = np.argsort(deal(data, data.n_demonstrations, seed=0), kind="stable")
    chosen = np.zeros(len(order), dtype=bool)
    for group in (upper, lower):
        members = order[group[order]]
        chosen[members[np.cumsum(data.lengths[members]) - data.lengths[members] < max_steps]] = True
    return data.select(np.flatnonzero(chosen)), lower[chosen]


def gains(
    data: FitData, log_prob: Float[Array, " N"], group: Bool[Array, " M"], settings: HeldOutSettings
) -> Float[Array, " G"]:
    """Mean log-ratios of the members of a `group` against its own reference, in nats a step."""
    return np.asarray(data.mean_steps(log_prob - log_reference(data, group, settings))[group])


def is_credible(gain: Float[Array, " G"], standard_errors: float) -> bool:
    """Whether the median gain is above 0 by so many robust standard errors."""
    middle = np.median(gain)
    error = 1.2533 * 1.4826 * np.median(np.abs(gain - middle)) / np.sqrt(len(gain))
    return bool(middle > standard_errors * error)


def shared_gains(
    data: FitData, log_prob: Float[Array, " N"], group: Bool[Array, " M"], settings: JudgeSettings
) -> Float[Array, " G"]:
    """Gains of the members of a `group` by a mixture of another group's policy and the group's own reference: those of
    the share of lapses with the largest median."""
    reference = log_reference(data, group, settings.held_out)
    ratio = log_prob - reference
    lapses = np.linspace(0.0, 0.95, settings.rivals.n_lapses)
    mixed = (np.logaddexp(np.log1p(-lapse) + ratio, np.log(max(lapse, 1e-12))) for lapse in lapses)
    return max((data.mean_steps(each)[group] for each in mixed), key=lambda each: float(np.median(each)))


def _log_prob(data: FitData, model: HeldOutModel, group: Array, ridge: float) -> Array:
    return model.evaluate(data.per_step(group.astype(float)), ridge)


@dataclass(frozen=True, eq=False)
class Contrast:
    """How two groups A and B differ; J parts of a continuous action, or J discrete actions."""

    parts: tuple[tuple[int, float], ...]
    """The parts with most of the evidence and their shares of it; none where the policy has no parts."""
    use: Float[Array, "2 J"]
    """The median of each part in the steps of A and of B, or how often each action is taken there."""
    spread: Float[Array, " J"]
    """The median distance of each part from the median of its group; 0 for discrete actions."""
    length: Float[Array, " 2"]
    """Steps of the median demonstration of A and of B."""


def evidence_by_part(nats: Float[Array, " J"]) -> tuple[tuple[int, float], ...]:
    """The parts of the action with most of the evidence, the largest first, and their shares of it.

    The shares are among the parts that point where the sum of the `nats` points. There are `MAX_PARTS` at most, and
    none where there is nothing but rounding.
    """
    toward = np.maximum(nats if nats.sum() > 0 else -nats, 0.0)
    total = float(toward.sum())
    order = np.argsort(-toward, kind="stable")[:MAX_PARTS].tolist()
    return tuple((j, float(toward[j]) / total) for j in order if total > MIN_NATS and toward[j] > 0)


def contrast(scoring: Scoring, lower: Lower, ridge: float) -> Contrast:
    """The contrast of the upper group, A, with its rival, B, by policies with a `ridge` a step."""
    data, groups, every = scoring.data, (lower.upper, lower.rival), np.arange(scoring.data.n_demonstrations)
    inside = [data.per_step(np.isin(every, group)) for group in groups]
    weights = [steps.astype(float) for steps in inside]
    if isinstance(data.space, Discrete):
        taken = data.actions[:, None] == np.arange(data.space.n)
        log_pi_a, log_pi_b = (scoring.model.cold_copy().evaluate(weight, ridge)[:, None] * taken for weight in weights)
        use, spread = [taken[steps].mean(axis=0) for steps in inside], np.zeros(data.space.n)
    else:
        parts = [scoring.model.log_prob_of_parts(weight, ridge) for weight in weights]
        log_pi_a, log_pi_b = (np.zeros(data.actions.shape) if each is None else each for each in parts)
        use = [np.median(data.actions[steps], axis=0) for steps in inside]
        away = [np.abs(data.actions[steps] - middle) for steps, middle in zip(inside, use, strict=True)]
        spread = np.median(np.concatenate(away), axis=0)
    means = data.sum_steps(log_pi_b - log_pi_a) / data.lengths[:, None]
    nats = np.maximum(np.median(means[lower.rival], axis=0) - np.median(means[lower.upper], axis=0), 0.0)
    length = np.array([np.median(data.lengths[group]) for group in groups])
    return Contrast(evidence_by_part(nats), np.stack(use).astype(float), spread, length)
