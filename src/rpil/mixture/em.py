"""EM for the paper's mixture (eq. 7, 9, 11): pure steps on frozen states.

A demonstration is an expert's with probability p, and then all of its steps are; otherwise they are an adversary's:

    p(D_m) = p prod_n pi(a_n|s_n) + (1 - p) prod_n psi(a_n|s_n)

Everything is in logs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import logsumexp

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.expert_prior import Share
from rpil.numerics.types import Array
from rpil.policies.protocol import Policy

MStep = Literal["joint", "expert_only"]

_STEADY = 1e-3
"""Changes of a responsibility, in one iteration, that no verdict notices."""


@stored()
@dataclass(frozen=True, eq=False)
class State:
    """The parameters: policy, adversary, P(expert)."""

    policy: Policy
    adversary: Adversary
    prior: Share


@dataclass(frozen=True, eq=False)
class Posterior:
    """What an E-step finds.

    Attributes
    ----------
    log_odds : (M,) array
        Of expert against adversary; labels not counted.
    expert : (M,) array
        Responsibilities P(expert | D_m), labels counted.
    log_evidence : (M,) array
        log p(D_m), or log p(D_m, label) where there is one.
    log_ratio : (N,) array
        log pi - log psi of the action taken.
    outputs : (N, ...) array
        The policy's, see `rpil.policies.Policy`, carried along so that no M-step computes them twice.
    """

    log_odds: Array
    expert: Array
    log_evidence: Array
    log_ratio: Array
    outputs: Array


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


def e_step(data: FitData, state: State, outputs: Array) -> Posterior:
    """Posterior over the two groups."""
    log_pi = state.policy.log_prob(outputs, data.actions)
    log_psi = state.adversary.log_prob(data.features, outputs, data.actions)
    log_joint = state.prior.log + np.stack([data.sum_steps(log_pi), data.sum_steps(log_psi)], axis=1)
    log_odds = log_joint[:, 0] - log_joint[:, 1]
    log_joint[data.labels > 0, 1] = -np.inf
    log_joint[data.labels < 0, 0] = -np.inf
    log_evidence = logsumexp(log_joint, 1)
    expert = np.exp(log_joint[:, 0] - log_evidence)
    return Posterior(log_odds, expert, log_evidence, log_pi - log_psi, outputs)


def lower_bound(state: State, posterior: Posterior) -> float:
    """The penalised observed-data log-likelihood at `state`, which the bound touches after an E-step."""
    own = state.adversary.log_prior() - state.policy.penalty()
    return float(posterior.log_evidence.sum() + state.prior.log_prior() + own)


def m_step(
    data: FitData, state: State, posterior: Posterior, mode: MStep = "joint", max_iter: int = 1, max_cg: int = 10
) -> tuple[State, Array]:
    """One convex problem for the policy, closed forms for the rest; also the new policy's outputs (N, ...).

    ``mode="expert_only"`` drops the adversary's term from the policy's problem, as the paper's own code does.
    """
    expert, soft_targets = data.per_step(posterior.expert), None
    adversary = 1 - expert
    if mode == "joint":
        intended = state.adversary.intended(posterior.outputs, data.actions)
        soft_targets = None if intended is None else adversary[:, None] * intended
    policy, outputs = state.policy.fit(data, expert, soft_targets, max_iter=max_iter, max_cg=max_cg)
    fitted = state.adversary.fit(data, posterior.outputs, adversary)
    return State(policy, fitted, state.prior.fit(posterior.expert)), outputs


def run(
    data: FitData,
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
    responsibility changes by `_STEADY`: then only the policy's confidence still grows.
    """
    outputs = state.policy.outputs(data.features) if outputs is None else outputs
    posterior = e_step(data, state, outputs)
    history = [lower_bound(state, posterior)]
    converged = False
    for _ in range(max_iter):
        before = posterior.expert
        state, outputs = m_step(data, state, posterior, mode, m_iter, m_cg)
        posterior = e_step(data, state, outputs)
        history.append(lower_bound(state, posterior))
        gain = abs(history[-1] - history[-2]) / data.n_demonstrations
        converged = gain <= tol or (gain <= 10 * tol and np.abs(posterior.expert - before).max() <= _STEADY)
        if converged:
            break
    return Result(state, posterior, np.array(history), converged)
