"""The mixture with one named adversary: EM from several starts.

The start decides which local optimum EM reaches. So EM makes a few iterations from every start, and the run with the
best objective goes on until it converges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.held_out import scorer
from rpil.inference.judgement import Settings, judge
from rpil.mixture.adversaries.named import adversary
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.em import MStep, Result, State, e_step, run
from rpil.mixture.expert_prior import Share
from rpil.numerics.parallel import in_parallel
from rpil.numerics.types import Array
from rpil.policies.protocol import Policy

_SINGLE = 8
"""Demonstrations of which each is a start."""

_SHORT = 18
"""EM iterations after which starts are compared."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What does not change during a fit.

    Attributes
    ----------
    policy : Policy
        The policy before it has seen data.
    prior : Share
    mode : {"joint", "expert_only"}
    seed : int
        Of the judge that proposes a start.
    max_iter : int
    tol : float
        Nats a demonstration.
    """

    policy: Policy
    prior: Share
    mode: MStep = "joint"
    seed: int = 0
    max_iter: int = 200
    tol: float = 1e-3


Progress = Callable[[str], None]


def fit(
    data: FitData,
    setting: Setting,
    which: str | Adversary,
    progress: Progress = lambda _: None,
) -> Result:
    """The best run of EM with the adversary `which`.

    A run that contradicts fewer labels is better, whatever its objective: the likelihood prefers the larger of two
    groups, and a label says which group is right.
    """

    def begin(named: tuple[str, Array]) -> Result:
        start, weight = named
        progress(f"start: {start}")
        return _begin(data, setting, which, weight, grow=(weight > 0).mean() < 0.5)

    def rank(result: Result) -> tuple[int, float]:
        return _contradicted(data, setting, result), -result.objective

    begun = in_parallel(begin, starts(data, setting).items(), data.features)
    best = min(begun, key=rank)
    if best.converged:
        return best
    mode, max_iter, tol = setting.mode, setting.max_iter, setting.tol
    more = run(data, best.state, outputs=best.posterior.outputs, mode=mode, max_iter=max_iter, tol=tol)
    return replace(more, history=np.concatenate([best.history, more.history[1:]]))


def starts(data: FitData, setting: Setting) -> dict[str, Array]:
    """Weights of the demonstrations (M,) from which the policy of each start is fitted.

    Without a known expert, the demonstrations that agree best, as the default judge finds them, are a start, and so is
    each of the `_SINGLE` that they explain best.
    """
    labels = data.labels
    possible = (labels >= 0).astype(float)
    found = {"pooled": possible, "equal": possible * data.lengths.mean() / data.lengths}
    if (labels < 0).any():
        found |= _unlike(data, setting, labels < 0)
    if (labels > 0).any():
        return {"known experts": (labels > 0).astype(float), **found}
    judged = judge(data, scorer(data, setting.seed), Settings(setting.seed))
    best = np.argsort(-judged.scores.score, kind="stable")[:_SINGLE]
    single = {f"single {m}": (np.arange(len(labels)) == m).astype(float) for m in best}
    return found | {"agreeing": judged.teachers.astype(float)} | single


def _unlike(data: FitData, setting: Setting, adversaries: Array) -> dict[str, Array]:
    """Weight 1 for the demonstrations that the policy of the known `adversaries` (M,) explains worst: half of the
    others, and, because experts may be few, only one."""
    policy, outputs = _taught(data, setting, adversaries.astype(float))
    explained = data.sum_steps(policy.log_prob(outputs, data.actions)) / data.lengths
    explained[adversaries] = np.inf
    half = explained <= np.median(explained[~adversaries])
    return {"unlike known adversaries": half.astype(float), "most unlike": (explained == explained.min()).astype(float)}


def _begin(data: FitData, setting: Setting, which: str | Adversary, weight: Array, grow: bool) -> Result:
    """A few iterations of EM from the policy of demonstrations weighted by `weight` (M,).

    With `grow`, demonstrations that this policy explains join them first: a few alone teach too little.
    """
    policy, outputs = _taught(data, setting, weight)
    first = adversary(which, data.space, setting.policy)
    state = State(policy, first, setting.prior)
    if grow:
        agreeing = np.maximum(weight, e_step(data, state, outputs).expert)
        policy, outputs = _taught(data, setting, agreeing)
        state = replace(state, policy=policy)
    return run(data, state, outputs=outputs, mode=setting.mode, max_iter=_SHORT, tol=setting.tol)


def _contradicted(data: FitData, setting: Setting, result: Result) -> int:
    """How many labels a run disagrees with, when labelled experts do not teach the policy that judges them."""
    if not data.labels.any():
        return 0
    others = np.where(data.labels > 0, 0.0, result.posterior.expert)
    policy, outputs = _taught(data, setting, others)
    log_odds = e_step(data, replace(result.state, policy=policy), outputs).log_odds
    return int((data.labels * np.sign(log_odds) < 0).sum())


def _taught(data: FitData, setting: Setting, weight: Array) -> tuple[Policy, Array]:
    """The policy of demonstrations weighted by `weight` (M,), roughly, and its outputs (N, ...)."""
    return setting.policy.fit(data, data.per_step(weight), tol=1e-3, max_iter=20, max_cg=20)
