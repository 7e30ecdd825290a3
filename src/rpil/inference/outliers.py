"""Demonstrations that differ from most others: outliers, a group apart that acts alike, or two groups.

The lower part of M demonstrations, by their scores y_m and the groups of these (`rpil.inference.groups`), are those

    far below     y_m < median - `min_gap` robust deviations,  and two groups explain the scores better than one
    or of a lower group, where P(two groups) >= `min_p_two`, which lies apart:  P(upper group | m) <= 1 - `min_proba`

Of up to half of all, they are outliers where their own policy explains them less well than `max_own_gain` times as the
policy of the others explains these, each held out, in nats a step above their own actions whatever the state: noise has
no policy. The policy is linear, or takes the actions of the nearest states, if that explains more. Those far below must
be so by sqrt(d^2 + u_m), too: d is the deviation, and u_m the variance of y_m because steps are few, or depend on their
neighbours, as where the policy fits some states badly. Else they act alike, and nobody can say without an answer
whether they are worse: up to `max_share` of all they are a group apart, and more are one of two groups. Nothing here
says who is good.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logit

from rpil.data.copies import Copies
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.findings import Finding
from rpil.inference.held_out import HeldOutModel, frequencies, indicators, log_densities, log_reference, with_lapses
from rpil.inference.scores import Scores, Scoring
from rpil.inference.settings import HeldOutSettings, OutlierSettings
from rpil.numerics.regression import MIN_WEIGHT
from rpil.numerics.types import Array, Bool, Float, Int

N_NEIGHBOURS, MAX_SEARCHED = 5, 1_000  # chosen by hand, not tuned


@dataclass(frozen=True, eq=False)
class Claims:
    """Finding that the scores of M demonstrations support without answers."""

    finding: Finding
    lower: Bool[Array, " M"]
    """The outliers, the group apart, or the lower of two groups; nobody with other findings."""

    @property
    def verdicts(self) -> Int[Array, " M"]:
        """-1 outlier, 0 open."""
        return -self.lower.astype(int) if self.finding == "outliers" else np.zeros(len(self.lower), dtype=int)

    @property
    def groups(self) -> tuple[Int[Array, " A"], Int[Array, " B"]] | None:
        """The members of the upper and of the lower group, where both may be good."""
        if self.finding not in ("a group apart", "two groups"):
            return None
        return np.flatnonzero(~self.lower), np.flatnonzero(self.lower)

    def repeated(self, copies: Copies) -> Claims:
        """The same about demonstrations of which these are the different ones; nothing where all are copies of one."""
        if copies.all_same:
            return Claims("nothing could be learned", np.zeros(len(copies.place), dtype=bool))
        return replace(self, lower=self.lower[copies.place])


def claim(scoring: Scoring, scores: Scores) -> Claims:
    """The claims that `scores` support."""
    nobody, settings = np.zeros(len(scores.score), dtype=bool), scoring.settings.outliers
    if scoring.data.space.has_density and not scores.state_predicts_action:
        return Claims("nothing could be learned", nobody)
    lower = lower_part(scores, settings)
    if 2 * lower.sum() <= len(lower) and lower.any():
        given = scoring.data, scoring.model, scores.fit.ridge, scoring.settings.held_out
        linear = [own_gain(group, *given) for group in (~lower, lower)]
        if linear[0] <= 0:
            return Claims("nothing could be learned", nobody)
        nearest = [neighbour_gain(group, scoring.data, scoring.settings.held_out) for group in (~lower, lower)]
        gain_upper, own = np.maximum(linear, nearest)
        if own <= settings.max_own_gain * gain_upper:
            lower = lower_part(scores, settings, sure=True)
            if lower.any():
                return Claims("outliers", lower)
        elif lower.sum() <= settings.max_share * len(lower):
            return Claims("a group apart", lower)
    if lower.any() and is_apart(scores, settings):
        return Claims("two groups", ~scores.groups.upper(scores.score, scores.variance))
    return Claims("no outliers" if scores.state_predicts_action else "nothing could be learned", nobody)


def lower_part(scores: Scores, settings: OutlierSettings, sure: bool = False) -> Bool[Array, " M"]:
    """Mask of those far below the middle, or of a lower group apart; nobody where these are too few, or all. To be
    `sure`, the deviation grows where a score varies more than others."""
    away = scores.score - np.median(scores.score)
    deviation = 1.4826 * float(np.median(np.abs(away)))  # of a normal distribution
    spread = np.sqrt(deviation**2 + sure * scores.excess)
    far = (away < -settings.min_gap * spread) & (scores.groups.log_bayes_factor > 0)
    lower = far | ((scores.log_odds <= -logit(settings.min_proba)) & is_apart(scores, settings))
    return np.asarray(lower & (settings.min_group <= lower.sum() < len(lower)))


def is_apart(scores: Scores, settings: OutlierSettings) -> bool:
    """Whether the scores are two groups, of which the lower one lies apart."""
    return bool(scores.groups.p_two >= settings.min_p_two and scores.groups.distance >= settings.min_distance)


def widened(claims: Claims, scores: Scores, settings: OutlierSettings) -> Claims:
    """The claims about a sample as claims about all demonstrations, which have these `scores`."""
    if claims.finding == "two groups":
        return replace(claims, lower=~scores.groups.upper(scores.score, scores.variance))
    lower = lower_part(scores, settings, sure=claims.finding == "outliers") & claims.lower.any()
    is_lost = claims.lower.any() and not lower.any()
    return Claims("no outliers", lower) if is_lost else replace(claims, lower=lower)


def own_gain(
    group: Bool[Array, " M"], data: FitData, model: HeldOutModel, ridge: float, settings: HeldOutSettings
) -> float:
    """The median gain, in nats a step, of a `group` by its own policy, held out, against its own reference."""
    log_prob = model.evaluate(data.per_step(group.astype(float)), ridge)
    return float(np.median(data.mean_steps(log_prob - log_reference(data, group, settings))[group]))


def neighbour_gain(group: Bool[Array, " M"], data: FitData, settings: HeldOutSettings) -> float:
    """`own_gain` by the mean action in the `N_NEIGHBOURS` nearest states of the other members, in place of a linear
    policy; of many steps, by some, evenly spaced. -inf where only one member has such steps."""
    rows = np.flatnonzero(data.per_step(group))
    # Not at a whole distance, at which demonstrations of one length would have the same few steps.
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MAX_SEARCHED)).astype(int)]
    owner = data.per_step(np.arange(len(group)))[rows]
    k = min(N_NEIGHBOURS, len(rows) - int(np.bincount(owner).max()))
    if k == 0:
        return -np.inf
    states, actions = data.features[rows].astype(float), indicators(data)[rows]
    states -= states.mean(axis=0)  # of large numbers the differences below would lose digits
    apart = (states**2).sum(axis=1) - 2 * states @ states.T  # squared distances, but for a constant of each row
    distance = np.where(owner[:, None] == owner, np.inf, apart)
    mean = actions[np.argpartition(distance, k - 1, axis=1)[:, :k]].mean(axis=1)
    if isinstance(data.space, Discrete):
        log_proba = np.log(np.maximum(mean, MIN_WEIGHT))
        log_prob = with_lapses(log_proba, frequencies(data), data.actions[rows], settings.lapse)
    else:
        log_prob = log_densities(actions - mean, np.ones(len(rows)), settings).sum(axis=1)
    gain = np.bincount(owner, log_prob - log_reference(data, group, settings)[rows], len(group))
    n_steps = np.bincount(owner, minlength=len(group))
    return float(np.median(gain[n_steps > 0] / n_steps[n_steps > 0]))


def telling_pair(claims: Claims, log_odds: Float[Array, " M"]) -> tuple[int, int] | None:
    """Two demonstrations, of which an answer says most which is better: the 90 % and the 10 % points of the ranking, or
    the middle members of two groups. Extremes are often odd in other ways. None where all are the same."""
    if claims.groups is not None:
        first, second = (int(group[np.argsort(log_odds[group])[len(group) // 2]]) for group in claims.groups)
        return first, second
    order, last = np.argsort(log_odds, kind="stable"), len(log_odds) - 1
    if not np.ptp(log_odds) > 0:
        return None
    return int(order[round(0.9 * last)]), int(order[round(0.1 * last)])
