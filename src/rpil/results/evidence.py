"""Which parts of an action hold the evidence about a demonstration: its actions beside those of the rest.

The log-ratio of a step is a sum over the parts j of a continuous action, and discrete actions are one part:

    d_j(n) = log pi_j(a_nj|s_n) - log q_j(a_nj)

with Student's densities pi_j around the mean of the policy, q_j whatever the state. The evidence of a part about
demonstration m is what it adds more than in the median one of the rest, sum_n d_j(n) - N_m median_T(mean_n d_j).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from rpil.data.copies import Copies
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.data.text import printable
from rpil.inference.findings import DECIDED
from rpil.inference.held_out import HeldOutRidge, HeldOutSoftmax
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings
from rpil.inference.trimming import choose_ridge
from rpil.inference.trust import Judgement
from rpil.numerics.regression import error_scale, student_log_densities
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.reasons import worst_stretch
from rpil.results.record import Audit
from rpil.results.vocabulary import SIDES

COMPARED = (*DECIDED, "a group apart")
"""The findings with which there is a rest to compare with."""

BAND = 0.05, 0.95
"""Quantiles of what the rest do, which are named."""

MAX_STEPS = 20
"""Steps of a stretch that are compared, those with the lowest log-ratios: enough to name an action."""

MIN_NATS = 1e-6
"""Evidence that is more than rounding."""

MIN_SHARE = 0.3
"""Share of these steps with one other action from which that action is named."""


@dataclass(frozen=True, eq=False)
class StepEvidence:
    """The steps of K demonstrations, beside what the rest do there; J parts of the action."""

    data: FitData
    members: Int[Array, " K"]
    """The numbers of the demonstrations among those of the audit."""
    value: Float[Array, "N J"]
    """The action, or the probability of the discrete action taken."""
    low: Float[Array, "N J"]
    high: Float[Array, "N J"]
    """The band of the rest."""
    nats: Float[Array, "N J"]
    """The log-ratio of each part, less that of the median one of the rest a step, in nats; the last three are empty
    where actions are discrete."""

    @classmethod
    def of(
        cls,
        data: FitData,
        members: Int[Array, " K"],
        expected: Float[Array, "N ..."],
        rest: Bool[Array, " K"],
        settings: HeldOutSettings,
    ) -> StepEvidence:
        """Compare with the means `expected` of a policy, (N, A), or the log-probabilities of the actions, (N,)."""
        if isinstance(data.space, Discrete):
            none = np.empty((0, 1))
            return cls(data, members, np.exp(expected)[:, None], none, none, none)
        # d_j, with the scale of the errors of the rest
        scaling, errors = ActionScale.of(data), settings.errors
        actions = scaling(data.actions)
        away, middle = actions - (expected - scaling.location) / scaling.spread, np.median(actions, axis=0)
        scale = error_scale(away, data.per_step(rest.astype(float)), errors)
        width = error_scale(actions - middle, np.ones(len(actions)), errors)
        log_ratio = student_log_densities(away, scale, errors) - student_log_densities(actions - middle, width, errors)
        ends = np.quantile((data.actions - expected)[data.per_step(rest)], BAND, axis=0)
        low, high = (np.clip(expected + end, data.space.low, data.space.high) for end in ends)  # nobody acts beyond
        usual = np.median((data.sum_steps(log_ratio) / data.lengths[:, None])[rest], axis=0)
        return cls(data, members, data.actions, low, high, log_ratio - usual)


def by_held_out_policies(
    judgement: Judgement, model: HeldOutSoftmax | HeldOutRidge, copies: Copies, settings: HeldOutSettings
) -> StepEvidence:
    """By held-out policies of a linear `model` where actions are continuous, without `copies` of others."""
    fit, data, group = judgement.scores.fit, model.data, judgement.training_group
    if data.space.kind == "discrete":
        expected = fit.log_prob
    else:
        assert isinstance(model, HeldOutRidge)
        ridge = fit.ridge or choose_ridge(data, model, group)  # the user's policy has none
        expected = ActionScale.of(data).back(model.actions - model.errors(data.per_step(group.astype(float)), ridge))
    return StepEvidence.of(data, copies.judged, expected, ~judgement.claims.lower[copies.judged], settings)


def deviations(audit: Audit, evidence: StepEvidence, classes: Array) -> tuple[str, ...]:
    """A phrase for each demonstration with a stretch of bad steps, and "" for all others, (M,).

    Of discrete actions, codes of `classes`, it is the most frequent one of those that others mostly do not take there.
    Of continuous actions it is the part with most of the evidence. It takes a group to compare with.
    """
    has_rest = audit.anchor == "none" or "upper" in map(SIDES.get, audit.verdicts)
    if audit.finding not in COMPARED or not has_rest:
        return ()
    phrases, data = [], evidence.data
    for m, place in enumerate(np.searchsorted(evidence.members, audit.copy_of).tolist()):
        log_ratio = audit.log_ratio(m)
        stretch = worst_stretch(log_ratio)
        if stretch is None:
            phrases.append("")
            continue
        own = np.arange(stretch[0], stretch[1] + 1)
        steps = own[np.argsort(log_ratio[own], kind="stable")[:MAX_STEPS]]  # the worst ones
        rows = data.offsets[place] + steps
        if data.space.kind != "discrete":
            phrases.append(_far_part(evidence, rows, steps))
        else:
            phrases.append(_other_action(classes[data.actions[rows]], evidence.value[rows, 0]))
    return tuple(phrases)


def _other_action(taken: Array, proba: Float[Array, " R"]) -> str:
    """The most frequent of the actions taken whose probability by the policy of the rest is below 1/2."""
    found = Counter(taken[proba < 0.5].tolist()).most_common(1)
    if not found or found[0][1] < MIN_SHARE * len(taken):
        return ""
    own, count = found[0]
    share = f"{count} of its {len(taken)} worst steps"
    return f"it takes action {printable(own)} where others mostly take another ({share})"


def _far_part(evidence: StepEvidence, rows: Int[Array, " R"], steps: Int[Array, " R"]) -> str:
    """The part of the action with most of the evidence in these steps, in that step of them in which it leaves the band
    of the rest by the median distance; "" where it does not."""
    nats = evidence.nats[rows].sum(axis=0)
    toward = np.maximum(nats if nats.sum() > 0 else -nats, 0.0)
    if toward.sum() <= MIN_NATS:
        return ""
    j = int(np.argmax(toward))
    value, low, high = (each[rows, j] for each in (evidence.value, evidence.low, evidence.high))
    away = np.maximum(low - value, value - high)
    own = int(np.argsort(away, kind="stable")[len(away) // 2])
    if away[own] <= 0:
        return ""
    data = evidence.data
    name = data.action_name(j) if data.action_names else f"action part {j}" if data.space.n_parts > 1 else "action"
    its = f"at step {steps[own]}: {printable(name)} is"
    is_at, first, last = _digits(value[own], low[own], high[own])
    band = first if first == last else f"{first} to {last}"
    return f"{its} {is_at}; others there have {band}"


def _digits(value: float, low: float, high: float) -> tuple[str, ...]:
    """A value outside a band and both ends of the band, with the digits that tell them apart."""
    differences = [size for size in (high - low, max(low - value, value - high)) if size > 0]
    decimals = max(0, -math.floor(math.log10(min(differences))))
    return tuple(f"{round(number, decimals) + 0.0:.{decimals}f}" for number in (value, low, high))  # no minus zero
