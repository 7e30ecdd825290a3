"""Which parts of an action hold the evidence about a demonstration: its actions beside those of the typical.

The log-ratio of a step is a sum over the parts j of a continuous action, and discrete actions are one part:

    d_j(n) = log pi_j(a_nj|s_n) - log q_j(a_nj)

The evidence of a part about demonstration m is what it adds more than in the median typical demonstration,
sum_n d_j(n) - N_m median_T(mean_n d_j), in nats. Its share is among the parts that point where the sum over all points.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from rpil.data.copies import Copies
from rpil.data.fit_data import FitData
from rpil.inference.fitted_judge import SoftmaxRatio, StudentRatio
from rpil.inference.held_out import HeldOutRidge, held_out_model, log_reference
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings
from rpil.inference.trust import Judgement
from rpil.numerics.blocks import linear
from rpil.numerics.regression import error_scale, student_log_densities
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.groups import MAX_PARTS
from rpil.results.record import Audit
from rpil.results.text import printable
from rpil.results.traces import Part, Traces, least_points, point_width, points
from rpil.results.words import SIDES

MAX_DRAWN = 300
"""Demonstrations with traces."""
N_SUGGESTED = 10
"""Demonstrations to label, which are drawn."""
BAND = 0.05, 0.95
BAND_STEPS = 20_000
"""Steps of the typical that the band comes from."""
SCALE_STEPS = 100_000
"""Steps that the scales come from."""
MAX_TYPICAL = 1_000
"""Typical demonstrations that the usual log-ratio of a part comes from."""


class Look(NamedTuple):
    """Some steps beside the policy of the typical; J parts of the action."""

    value: Float[Array, "R J"]
    """As `rpil.results.traces.Part.value`."""
    mean: Float[Array, "R J"]
    """Of the policy in these states; 0 where the value is a probability."""
    log_ratio: Float[Array, "R J"]


View = Callable[[Int[Array, " R"]], Look]
"""Looks at some rows."""
Means = Callable[[Int[Array, " R"]], Float[Array, "R A"]]
"""The means of a policy in some rows, in the units of the data."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """M demonstrations beside the policy of the typical: the upper group of the scores, or all where these are one.

    The means are held out: of policies that learned from those who agree best, and not from the demonstration itself.
    There are exceptions. They are those of the final policy, which learned from all that are `trusted`, where the
    adversary was named, and of continuous actions where the policy is the user's. With more demonstrations than the
    judge reads, they are those of the policy of its sample.
    """

    data: FitData
    """The demonstrations that can be looked at."""
    place: Int[Array, " M"]
    """The number of each demonstration of the audit among them; -1 where it cannot be looked at."""
    view: View
    typical: Typical
    compared_with: Literal["typical", "trusted"] = "typical"

    def rows(self, index: int) -> Int[Array, " n"]:
        """The rows of `data` of demonstration `index` of the audit."""
        own = self.place[index]
        return np.arange(self.data.offsets[own], self.data.offsets[own + 1])


@dataclass(frozen=True, eq=False)
class Typical:
    """What the typical do."""

    low: Float[Array, " J"]
    high: Float[Array, " J"]
    """Quantiles of their values less the means."""
    log_ratio: Float[Array, " J"]
    """Of the median one, nats a step."""

    @classmethod
    def of(cls, view: View, data: FitData, group: Bool[Array, " M"]) -> Typical:
        """From a `group` of the demonstrations of `data`."""
        seen = view(thinned(np.flatnonzero(data.per_step(group)), BAND_STEPS))
        low, high = np.quantile(seen.value - seen.mean, BAND, axis=0)
        chosen = thinned(np.flatnonzero(group), MAX_TYPICAL)
        means = [view(np.arange(data.offsets[m], data.offsets[m + 1])).log_ratio.mean(axis=0) for m in chosen]
        return cls(low, high, np.median(means, axis=0))


def thinned(rows: Int[Array, " N"], size: int) -> Int[Array, " R"]:
    """About `size` of the rows, evenly."""
    return rows[:: 1 + len(rows) // size]


@dataclass(frozen=True, eq=False)
class Scales:
    """The densities of the parts of continuous actions, which are scaled by `scaling`."""

    scaling: ActionScale
    scale: Float[Array, " A"]
    """Of the errors."""
    center: Float[Array, " A"]
    width: Float[Array, " A"]
    """Location and scale of the actions, whatever the state."""
    settings: HeldOutSettings

    @classmethod
    def of(
        cls, data: FitData, mean: Means, scaling: ActionScale, group: Bool[Array, " M"], settings: HeldOutSettings
    ) -> Scales:
        """From all demonstrations, and the errors of a `group`."""
        rows = thinned(np.arange(len(data.actions)), SCALE_STEPS)
        weight, actions = data.per_step(group.astype(float))[rows], scaling(data.actions[rows])
        errors, center = actions - (mean(rows) - scaling.location) / scaling.spread, np.median(actions, axis=0)
        scale = error_scale(errors, weight, settings.errors)
        width = error_scale(actions - center, np.ones(len(rows)), settings.errors)
        return cls(scaling, scale, center, width, settings)

    def view(self, data: FitData, mean: Means) -> View:
        """Of `data`, around the `mean` of a policy."""

        def view(rows: Array) -> Look:
            actions, expected, errors = data.actions[rows], mean(rows), self.settings.errors
            scaled = self.scaling(actions)
            own = scaled - (expected - self.scaling.location) / self.scaling.spread
            of_policy = student_log_densities(own, self.scale, errors)
            return Look(actions, expected, of_policy - student_log_densities(scaled - self.center, self.width, errors))

        return view


def view_of_proba(log_prob: Callable[[Array], Array], log_ratio: Callable[[Array], Array]) -> View:
    """Of discrete actions, by the log-probabilities and the log-ratios of those taken in some rows."""

    def view(rows: Array) -> Look:
        proba = np.exp(log_prob(rows))[:, None]
        return Look(proba, np.zeros_like(proba), log_ratio(rows)[:, None])

    return view


def typical_group(judgement: Judgement, members: Int[Array, " S"]) -> Bool[Array, " S"]:
    """Which of these `members` are typical: the upper group of the scores, or all where the scores are one group."""
    lower = judgement.claims.lower
    upper = np.isin(members, members if lower is None else lower.upper)
    return upper if upper.any() else ~upper


def held_out_comparison(
    judgement: Judgement, data: FitData, copies: Copies | None, seed: int, settings: HeldOutSettings
) -> Comparison:
    """By the held-out policies of the judge, which read `data`: without `copies` of others."""
    fit, learned = judgement.scores.fit, judgement.training_group
    own = np.arange(data.n_demonstrations)
    place, members = (own, own) if copies is None else (copies.place, copies.judged)
    if data.space.kind == "discrete":
        log_prob = fit.held_out.log_prob
        log_ratio = log_prob - log_reference(data, np.ones_like(learned), settings)
        view = view_of_proba(log_prob.__getitem__, log_ratio.__getitem__)
    else:
        model, scaling = held_out_model(data, seed, settings), ActionScale.of(data)
        assert isinstance(model, HeldOutRidge)
        fitted = model.actions - model.errors(data.per_step(learned.astype(float)), fit.ridge)

        def mean(rows: Array) -> Array:
            return scaling.back(fitted[rows])

        view = Scales.of(data, mean, scaling, learned, settings).view(data, mean)
    return Comparison(data, place, view, Typical.of(view, data, typical_group(judgement, members)))


def final_comparison(
    audit: Audit, judgement: Judgement | None, data: FitData, outputs: Means, settings: HeldOutSettings
) -> Comparison:
    """By the final policy, which has these `outputs` in some rows: means, or log-probabilities. Without a `judgement`
    the typical are the trusted."""
    members, trusted = np.arange(len(audit.ids)), np.array([SIDES[verdict] == "upper" for verdict in audit.verdicts])
    group = trusted if trusted.any() else ~trusted
    group = group if judgement is None else typical_group(judgement, members)

    def log_prob(rows: Array) -> Array:
        return np.take_along_axis(outputs(rows), data.actions[rows, None], axis=1)[:, 0]

    if data.space.kind == "discrete":
        view = view_of_proba(log_prob, audit.step_log_ratio.__getitem__)
    else:
        view = Scales.of(data, outputs, ActionScale.of(data), group, settings).view(data, outputs)
    return Comparison(data, members, view, Typical.of(view, data, group), "trusted")


def sample_comparison(
    ratio: SoftmaxRatio | StudentRatio,
    typical: tuple[FitData, Bool[Array, " S"]],
    read: FitData,
    place: Int[Array, " M"],
    settings: HeldOutSettings,
) -> Comparison:
    """Of demonstrations that were `read` to be drawn, by the policy of a judge of a sample: data and training group."""

    def view_of(data: FitData) -> View:
        if isinstance(ratio, SoftmaxRatio):

            def steps(k: int) -> Callable[[Array], Array]:
                return lambda rows: ratio.step_ratios(data.features[rows], data.actions[rows], settings)[k]

            return view_of_proba(steps(0), steps(1))
        scales = Scales(ratio.scaling, ratio.scale, ratio.center, ratio.width, settings)
        return scales.view(data, lambda rows: ratio.scaling.back(linear(data.features[rows], ratio.weights)))

    return Comparison(read, place, view_of(read), Typical.of(view_of(typical[0]), *typical))


def worth_a_look(audit: Audit, size: int = MAX_DRAWN) -> Int[Array, " K"]:
    """Up to `size` demonstrations: those with the lower word, those in question, and then the others; of each, the
    least trusted first."""
    asked = {*audit.contradicting, *audit.pair, *audit.suggest_labels(N_SUGGESTED)}
    lower = np.array([SIDES[verdict] == "lower" for verdict in audit.verdicts])
    in_question = np.array([name in asked for name in audit.ids])
    return np.lexsort([audit.log_odds, ~in_question, ~lower])[:size]


def part_name(data: FitData, j: int) -> str:
    """The name of a part of the action; discrete actions are one."""
    if data.space.n_parts == 1 and (data.space.kind == "discrete" or not data.action_names):
        return "action"
    return printable(data.action_name(j)) if data.action_names else f"action part {j}"


def shares(nats: Float[Array, " J"]) -> Float[Array, " J"]:
    """Share of each part among those that point where their sum points."""
    toward = np.maximum(nats * (1 if nats.sum() > 0 else -1), 0.0)
    return np.asarray(toward / max(float(toward.sum()), 1e-300))


def traces(audit: Audit, compared: Comparison, drawn: Int[Array, " K"]) -> dict[Hashable, Traces]:
    """The traces of the demonstrations `drawn`, by their ids; of those that can be looked at."""
    able = (m for m in drawn.tolist() if compared.place[m] >= 0)
    found = {audit.ids[m]: _traces(compared, compared.rows(m)) for m in able}
    return {name: own for name, own in found.items() if own.parts}


def _traces(compared: Comparison, rows: Int[Array, " n"]) -> Traces:
    data, typical, seen, width = compared.data, compared.typical, compared.view(rows), point_width(len(rows))
    nats = (seen.log_ratio - typical.log_ratio).sum(axis=0)
    share = shares(nats)
    top = [j for j in np.argsort(-share, kind="stable")[:MAX_PARTS].tolist() if share[j] > 0]
    discrete = data.space.kind == "discrete"
    parts = tuple(
        Part(
            name=part_name(data, j),
            share=float(share[j]),
            nats=float(nats[j]),
            value=points(seen.value[:, j], width),
            low=points(seen.mean[:, j] + typical.low[j], width),
            high=points(seen.mean[:, j] + typical.high[j], width),
        )
        for j in top
    )
    chosen = rows[least_points(seen.value[:, 0], width)] if discrete else rows[:0]
    taken = tuple(printable(data.action_name(code)) for code in data.actions[chosen].tolist())
    return Traces("discrete" if discrete else "continuous", parts, width, taken, compared.compared_with)
