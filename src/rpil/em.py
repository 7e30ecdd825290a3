"""EM over demonstrations: pure steps on frozen states.

The model (docs/model.md): demonstration m is an expert's with probability p; its reliability rho_m comes from the
group's Beta; each of its actions is the expert's with probability rho_m, else the adversary's:

    p(D_m) = sum_z p(z) sum_j P(rho_j | z) prod_n [ rho_j pi(a_n|s_n) + (1 - rho_j) psi(a_n|s_n) ]

The paper's mixture (eq. 7, 9, 11) is this with point masses at rho = 1 and 0. Everything is in logs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rpil.adversaries import Adversary
from rpil.passes import Array, logsumexp
from rpil.policies import Policy
from rpil.priors import Share
from rpil.problem import Problem
from rpil.reliability import ADVERSARY, EXPERT, Reliability

MStep = Literal["joint", "expert_only"]

_LARGE = 80.0
"""Log-ratios beyond this are no different: e^80 times the odds of any reliability is a number in single precision."""

_STEADY = 1e-3
"""Changes of a responsibility or reliability, in one iteration, that no verdict notices."""


@dataclass(frozen=True, eq=False)
class State:
    """The parameters: policy, adversary, P(expert), reliabilities."""

    policy: Policy
    adversary: Adversary
    prior: Share
    reliability: Reliability


@dataclass(frozen=True, eq=False)
class Posterior:
    """What an E-step finds.

    Attributes
    ----------
    log_odds : (M,) array
        Of expert against adversary; labels not counted.
    joint : (M, 2, J) array
        P(group, rho_j | D_m), labels counted.
    step : (N,) array
        P(the step is the expert's | data).
    log_evidence : (M,) array
        log p(D_m), or log p(D_m, label) where there is one.
    log_ratio : (N,) array
        log pi - log psi of the action taken.
    outputs : (N, ...) array
        The policy's, see `rpil.policies.Policy`, carried along so that no M-step computes them twice.
    """

    log_odds: Array
    joint: Array
    step: Array
    log_evidence: Array
    log_ratio: Array
    outputs: Array

    @property
    def expert(self) -> Array:
        """Responsibilities P(expert | D_m), labels counted, (M,)."""
        return self.joint[:, EXPERT].sum(axis=1)


@dataclass(frozen=True, eq=False)
class Result:
    """Where EM ended: state, posterior, the objective at every iteration, and whether it had converged."""

    state: State
    posterior: Posterior
    history: Array
    converged: bool

    @property
    def objective(self) -> float:
        return float(self.history[-1])


def evidence_by_reliability(problem: Problem, log_pi: Array, log_psi: Array, nodes: Array) -> Array:
    """log prod_n [rho pi + (1 - rho) psi] of every demonstration at every rho of the grid, (M, J)."""
    out = np.empty((problem.n_demonstrations, len(nodes)))
    # At the ends the mixture is one of the two, to the last bit and below the smallest number there is.
    out[:, nodes == 1.0] = problem.sum_steps(log_pi)[:, None]
    out[:, nodes == 0.0] = problem.sum_steps(log_psi)[:, None]
    inside = (nodes > 0.0) & (nodes < 1.0)
    if not inside.any():
        return out
    top = np.maximum(log_pi, log_psi)
    precision = problem.features.dtype
    mine, other = (np.exp(a - top).astype(precision, copy=False) for a in (log_pi, log_psi))
    rho, against = (a.astype(precision)[:, None] for a in (nodes[inside], 1 - nodes[inside]))
    total = np.zeros((len(rho), problem.n_demonstrations))
    for steps, demonstrations, begins in problem.segments:
        mixture = rho * mine[steps]
        mixture += against * other[steps]
        np.log(mixture, out=mixture)
        total[:, demonstrations] += np.add.reduceat(mixture, begins, axis=1, dtype=float)
    out[:, inside] = total.T + problem.sum_steps(top)[:, None]
    return out


def expert_steps(problem: Problem, log_ratio: Array, by_node: Array, nodes: Array) -> Array:
    """P(the step is the expert's), (N,), with the posterior `by_node` (M, J) over the reliabilities of the grid."""
    inside = (nodes > 0.0) & (nodes < 1.0)  # at 0 no step is the expert's, at 1 every one is
    out = problem.spread(by_node[:, nodes == 1.0].sum(axis=1))
    if not inside.any():
        return out
    # rho pi / (rho pi + (1 - rho) psi) = 1 / (1 + (1 - rho) / rho * psi / pi)
    ratio = np.exp(np.minimum(-log_ratio, _LARGE))
    odds_against, weight, ratio = (
        a.astype(problem.features.dtype, copy=False)
        for a in ((1 - nodes[inside]) / nodes[inside], by_node[:, inside].T, ratio)
    )
    for steps, demonstrations, begins in problem.segments:
        share = odds_against[:, None] * ratio[steps]
        share += 1.0
        lengths = np.diff(np.append(begins, steps.stop - steps.start))
        np.divide(np.repeat(weight[:, demonstrations], lengths, axis=1), share, out=share)
        out[steps] += share.sum(axis=0)
    return np.clip(out, 0.0, 1.0)


def e_step(problem: Problem, state: State, outputs: Array) -> Posterior:
    """Posterior over groups, reliabilities and steps."""
    log_pi = state.policy.log_prob(outputs, problem.actions)
    log_psi = state.adversary.log_prob(problem.features, outputs, problem.actions)
    nodes = state.reliability.nodes
    evidence = evidence_by_reliability(problem, log_pi, log_psi, nodes)
    log_joint = state.prior.log[:, None] + state.reliability.log_weight + evidence[:, None]
    by_group = logsumexp(log_joint, 2)
    log_odds = by_group[:, EXPERT] - by_group[:, ADVERSARY]
    log_joint[problem.labels > 0, ADVERSARY] = -np.inf
    log_joint[problem.labels < 0, EXPERT] = -np.inf
    log_evidence = logsumexp(log_joint, (1, 2))
    joint = np.exp(log_joint - log_evidence[:, None, None])
    step = expert_steps(problem, log_pi - log_psi, joint.sum(axis=1), nodes)
    return Posterior(log_odds, joint, step, log_evidence, log_pi - log_psi, outputs)


def lower_bound(state: State, posterior: Posterior) -> float:
    """The penalised observed-data log-likelihood at `state`, which the bound touches after an E-step."""
    prior = state.prior.log_prior() + state.reliability.log_prior()
    own = state.adversary.log_prior() - state.policy.penalty()
    return float(posterior.log_evidence.sum() + prior + own)


def m_step(
    problem: Problem, state: State, posterior: Posterior, mode: MStep = "joint", max_iter: int = 1, max_cg: int = 10
) -> tuple[State, Array]:
    """One convex problem for the policy, closed forms for the rest; also the new policy's outputs (N, ...).

    ``mode="expert_only"`` drops the adversary's term from the policy's problem, as the paper's own code does.
    """
    expert, adversary, lesson = posterior.step, 1 - posterior.step, None
    if mode == "joint":
        intended = state.adversary.intended(posterior.outputs, problem.actions)
        lesson = None if intended is None else adversary[:, None] * intended
    policy, outputs = state.policy.learn(problem, expert, lesson, max_iter=max_iter, max_cg=max_cg)
    counts = posterior.joint.sum(axis=0)
    new = State(
        policy,
        state.adversary.fit(problem, posterior.outputs, adversary),
        state.prior.fit(posterior.expert),
        state.reliability.fit(counts),
    )
    return new, outputs


def run(
    problem: Problem,
    state: State,
    *,
    mode: MStep = "joint",
    max_iter: int = 100,
    tol: float = 1e-4,
    outputs: Array | None = None,
    m_iter: int = 1,
    m_cg: int = 10,
) -> Result:
    """EM from `state` until nothing moves, ending on an E-step.

    Nothing moves when the objective gains less than `tol` nats a demonstration; or less than ten times that while no
    responsibility and no reliability changes by `_STEADY`: then only the policy's confidence still grows.
    """
    outputs = state.policy.outputs(problem.features) if outputs is None else outputs
    posterior = e_step(problem, state, outputs)
    history = [lower_bound(state, posterior)]
    converged = False
    for _ in range(max_iter):
        before = posterior
        state, outputs = m_step(problem, state, posterior, mode, m_iter, m_cg)
        posterior = e_step(problem, state, outputs)
        history.append(lower_bound(state, posterior))
        gain = abs(history[-1] - history[-2]) / problem.n_demonstrations
        converged = gain <= tol or (gain <= 10 * tol and _moved(before, posterior, state.reliability.nodes) <= _STEADY)
        if converged:
            break
    return Result(state, posterior, np.array(history), converged)


def _moved(before: Posterior, after: Posterior, nodes: Array) -> float:
    """Largest change of a responsibility or of a mean reliability."""
    difference = after.joint - before.joint
    return float(max(np.abs(difference[:, EXPERT].sum(axis=1)).max(), np.abs(difference.sum(axis=1) @ nodes).max()))
