"""EM for the paper's mixture (eq. 7, 9, 11): pure functions of frozen states.

All steps of a demonstration are an expert's, with probability p, or all are an adversary's:

    p(D_m) = p prod_n pi(a_n|s_n) + (1 - p) prod_n psi(a_n|s_n)

All probabilities are computed as logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.expert_prior import ExpertPrior
from rpil.mixture.settings import MixtureSettings
from rpil.numerics.types import Array, Float
from rpil.policies.linear import LinearPolicy


@stored()
@dataclass(frozen=True, eq=False)
class State:
    """The parameters of the mixture: policy pi, adversary psi and prior p."""

    policy: LinearPolicy
    adversary: Adversary
    prior: ExpertPrior


@dataclass(frozen=True, eq=False)
class Posterior:
    """The result of an E-step for M demonstrations of N steps."""

    log_odds: Float[Array, " M"]
    """Log-odds of expert against adversary, nats; labels are not counted."""
    expert: Float[Array, " M"]
    """Responsibilities P(expert | D_m); labels are counted."""
    log_evidence: Float[Array, " M"]
    """log p(D_m), or log p(D_m, label) where there is one."""
    log_ratio: Float[Array, " N"]
    """log pi - log psi of the action taken."""
    outputs: Float[Array, "N ..."]
    """Outputs of the policy (`rpil.policies.linear.LinearPolicy`), so that the M-step need not compute them again."""


@dataclass(frozen=True, eq=False)
class MixtureFit:
    """A run of EM: the last state and its posterior, the objective after each iteration, and whether it converged."""

    state: State
    posterior: Posterior
    history: Float[Array, " T"]
    converged: bool


def e_step(data: FitData, state: State, outputs: Float[Array, "N ..."]) -> Posterior:
    """Posterior of the demonstrations, where the policy has these `outputs`."""
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
    """The objective: the penalised log-likelihood at `state`, which equals its lower bound after an E-step."""
    log_priors = state.adversary.log_prior() - state.policy.penalty()
    return float(posterior.log_evidence.sum() + state.prior.log_prior() + log_priors)


def m_step(
    data: FitData, state: State, posterior: Posterior, settings: MixtureSettings
) -> tuple[State, Float[Array, "N ..."]]:
    """The next state, and the outputs of its policy: a convex problem for the policy, closed forms for the rest.

    The soft targets of the adversary's steps are the posterior of the action that the adversary intended.
    """
    expert, soft_targets = data.per_step(posterior.expert), None
    adversary = 1 - expert
    if settings.m_step == "joint":
        intended = state.adversary.intended_action_proba(posterior.outputs, data.actions)
        soft_targets = None if intended is None else adversary[:, None] * intended
    max_iter, max_cg = settings.newton_iter, settings.cg_iter
    policy, outputs = state.policy.fit(data, expert, soft_targets, max_iter=max_iter, max_cg=max_cg)
    fitted = state.adversary.fit(data, posterior.outputs, adversary)
    return State(policy, fitted, state.prior.fit(posterior.expert)), outputs


def run_em(
    data: FitData,
    state: State,
    settings: MixtureSettings,
    outputs: Float[Array, "N ..."] | None = None,
) -> MixtureFit:
    """EM from `state`, whose policy has these `outputs`, until it converges; the last step is an E-step.

    It has converged when the objective gains at most `tol` nats a demonstration, or at most ten times that while no
    responsibility changes by more than `steady`: then only the scale of the policy's weights still grows.
    """
    outputs = state.policy.outputs(data.features) if outputs is None else outputs
    posterior = e_step(data, state, outputs)
    history, converged, tol = [lower_bound(state, posterior)], False, settings.tol
    for _ in range(settings.max_iter):
        last = posterior.expert
        state, outputs = m_step(data, state, posterior, settings)
        posterior = e_step(data, state, outputs)
        history.append(lower_bound(state, posterior))
        gain = abs(history[-1] - history[-2]) / data.n_demonstrations
        change = float(np.abs(posterior.expert - last).max())
        converged = gain <= tol or (gain <= 10 * tol and change <= settings.steady)
        if converged:
            break
    return MixtureFit(state, posterior, np.array(history), converged)
