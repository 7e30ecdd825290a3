"""The mixture with one named adversary: EM from several starts.

The start decides which local optimum EM reaches. So EM makes a few iterations from every start, and the run with the
best objective goes on until it converges.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.named import adversary
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.em import MixtureFit, State, e_step, run_em
from rpil.mixture.expert_prior import as_prior
from rpil.mixture.settings import MixtureSettings
from rpil.numerics.newton import NewtonSettings
from rpil.numerics.parallel import in_parallel
from rpil.numerics.types import Array, Float
from rpil.policies.linear import LinearPolicy


@dataclass(frozen=True, eq=False)
class SearchSettings:
    """Settings that stay the same in all runs of EM."""

    policy: LinearPolicy
    """Before it has been fitted."""
    mixture: MixtureSettings
    proposed: Callable[[], Mapping[str, Float[Array, " M"]]]
    """Weights of the demonstrations in further starts, where no demonstration is labelled an expert's."""


def fit_mixture(
    data: FitData, settings: SearchSettings, which: str | Adversary, progress: Callable[[str], None] = lambda _: None
) -> MixtureFit:
    """The best run of EM with the adversary `which`: the one that contradicts fewest labels, then the one with the best
    objective.

    Labels come first because the likelihood prefers the larger of two groups, whichever is the expert's.
    """

    def begin(start: tuple[str, Array]) -> MixtureFit:
        name, weight = start
        progress(f"fitting, from the start {name}")
        return _first_iterations(data, settings, which, weight)

    def rank(result: MixtureFit) -> tuple[int, float]:
        return _contradicted_labels(data, settings, result), -float(result.history[-1])

    best = min(in_parallel(begin, starts(data, settings).items(), data.features), key=rank)
    if best.converged:
        return best
    last = run_em(data, best.state, settings.mixture, best.posterior.outputs)
    return replace(last, history=np.concatenate([best.history, last.history[1:]]))


def starts(data: FitData, settings: SearchSettings) -> dict[str, Float[Array, " M"]]:
    """Weights of the demonstrations to which the policy of each start is fitted.

    Where no demonstration is labelled an expert's, the `proposed` ones are starts too.
    """
    labels = data.labels
    possible = (labels >= 0).astype(float)
    weights = {"pooled": possible, "equal": possible * data.lengths.mean() / data.lengths}
    if (labels < 0).any():
        weights |= _unlike_labelled_adversaries(data, settings)
    if (labels > 0).any():
        return {"labelled experts": (labels > 0).astype(float), **weights}
    return {**weights, **settings.proposed()}


def _unlike_labelled_adversaries(data: FitData, settings: SearchSettings) -> dict[str, Array]:
    """Weight 1 for the demonstrations that the policy of the labelled adversaries explains worst. Two starts: half of
    the others, and the single worst explained one, because experts may be rare."""
    labelled = data.labels < 0
    policy, outputs = _fit_start(data, settings, labelled.astype(float))
    explained = data.mean_steps(policy.log_prob(outputs, data.actions))
    explained[labelled] = np.inf
    half = explained <= np.median(explained[~labelled])
    return {
        "unlike labelled adversaries": half.astype(float),
        "most unlike": (explained == explained.min()).astype(float),
    }


def _first_iterations(data: FitData, settings: SearchSettings, which: str | Adversary, weight: Array) -> MixtureFit:
    """The first iterations of EM from the policy fitted to demonstrations of `weight` (M,).

    Where that is fewer than half of the demonstrations, the policy is fitted once more, to those that it explains too.
    """
    policy, outputs = _fit_start(data, settings, weight)
    start = adversary(which, data.space, settings.policy)
    state = State(policy, start, as_prior(settings.mixture.prior))
    if (weight > 0).mean() < 0.5:
        policy, outputs = _fit_start(data, settings, np.maximum(weight, e_step(data, state, outputs).expert))
        state = replace(state, policy=policy)
    return run_em(data, state, replace(settings.mixture, max_iter=settings.mixture.start_iter), outputs)


def _contradicted_labels(data: FitData, settings: SearchSettings, result: MixtureFit) -> int:
    """Labels that the log-odds of a run contradict, by a policy that is refitted without labelled experts."""
    if not data.labels.any():
        return 0
    policy, outputs = _fit_start(data, settings, np.where(data.labels > 0, 0.0, result.posterior.expert))
    log_odds = e_step(data, replace(result.state, policy=policy), outputs).log_odds
    return int((data.labels * np.sign(log_odds) < 0).sum())


def _fit_start(data: FitData, settings: SearchSettings, weight: Array) -> tuple[LinearPolicy, Array]:
    """The policy fitted to demonstrations of `weight` (M,), and its outputs (N, ...)."""
    return settings.policy.fit(data, data.per_step(weight), **vars(NewtonSettings()))
