"""EM over demonstrations: pure steps on frozen states.

The model (docs/model.md): demonstration m is an expert's with probability p; its reliability rho_m comes from the
group's Beta; each of its actions is the expert's with probability rho_m, else the adversary's:

    p(D_m) = sum_z p(z) sum_j P(rho_j | z) prod_n [ rho_j pi(a_n|s_n) + (1 - rho_j) psi(a_n|s_n) ]

The paper's mixture (eq. 7, 9, 11) is this with point masses at rho = 1 and 0. Everything is in logs. Where bad steps
come in runs the product becomes a sum over Markov chains, see `rpil.chains`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from rpil import chains
from rpil.adversaries import Adversary
from rpil.passes import Array, logsumexp
from rpil.policies import Policy
from rpil.priors import Prior
from rpil.reliability import ADVERSARY, EXPERT, Reliability

MStep = Literal["joint", "expert_only"]

_LARGE = 700.0
"""Log-ratios beyond this are no different to a double."""

_STEADY = 1e-3
"""Changes of a responsibility or reliability, in one iteration, that no verdict notices."""

_BLOCK_STEPS = 2048
"""Steps whose mixtures over the whole grid of reliabilities are in memory, and in cache, at a time."""


@dataclass(frozen=True, eq=False)
class Problem:
    """The data of one fit.

    Attributes
    ----------
    features : (N, D) array
        Design matrix, constant in the last column.
    actions : (N,) int array
        Codes 0..K-1 of the actions taken.
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    n_actions : int
    labels : (M,) int array
        1 known expert, -1 known adversary, 0 unknown.
    weight : (N,) array or None
        Weight of each step, 1 where None.
    """

    features: Array
    actions: Array
    offsets: Array
    n_actions: int
    labels: Array
    weight: Array | None = None

    @property
    def n_demonstrations(self) -> int:
        return len(self.offsets) - 1

    @property
    def lengths(self) -> Array:
        return np.diff(self.offsets)

    @cached_property
    def segments(self) -> list[tuple[slice, slice, Array]]:
        """Blocks of steps: the steps, the demonstrations they belong to, and where each begins within the block."""
        found = []
        for start in range(0, len(self.actions), _BLOCK_STEPS):
            stop = min(start + _BLOCK_STEPS, len(self.actions))
            first = int(np.searchsorted(self.offsets, start, side="right")) - 1
            last = int(np.searchsorted(self.offsets, stop, side="left"))
            begins = np.maximum(self.offsets[first:last] - start, 0)
            found.append((slice(start, stop), slice(first, last), begins))
        return found

    def sum_steps(self, values: Array) -> Array:
        """Sums over the steps of each demonstration, (N, ...) -> (M, ...)."""
        return np.add.reduceat(values, self.offsets[:-1], axis=0)

    def spread(self, values: Array) -> Array:
        """A value of each demonstration, repeated for its steps, (M, ...) -> (N, ...)."""
        return np.repeat(values, self.lengths, axis=0)

    def taken(self, log_proba: Array) -> Array:
        """Log-probability of the action taken, (N, K) -> (N,)."""
        return np.take_along_axis(log_proba, self.actions[:, None], axis=1)[:, 0]

    def one_hot(self, weight: Array) -> Array:
        """Targets (N, K) with `weight` (N,) on the action taken."""
        targets = np.zeros((len(self.actions), self.n_actions))
        np.put_along_axis(targets, self.actions[:, None], weight[:, None], axis=1)
        return targets

    def select(self, demonstrations: Array, unlabelled: bool = False) -> Problem:
        """The same problem with some of the demonstrations only."""
        steps = np.concatenate([np.arange(self.offsets[m], self.offsets[m + 1]) for m in demonstrations])
        offsets = np.concatenate([[0], np.cumsum(self.lengths[demonstrations])])
        weight = None if self.weight is None else self.weight[steps]
        return replace(
            self,
            features=self.features[steps],
            actions=self.actions[steps],
            offsets=offsets,
            labels=np.zeros(len(demonstrations), dtype=int) if unlabelled else self.labels[demonstrations],
            weight=weight,
        )


@dataclass(frozen=True, eq=False)
class State:
    """The parameters: policy, adversary, P(expert), reliabilities; and how far steps go on as the step before."""

    policy: Policy
    adversary: Adversary
    prior: Prior
    reliability: Reliability
    stickiness: float = 0.0


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
    log_proba : (N, K) array
        The policy's, carried along so that no M-step computes it twice.
    """

    log_odds: Array
    joint: Array
    step: Array
    log_evidence: Array
    log_ratio: Array
    log_proba: Array

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


def evidence_by_reliability(
    problem: Problem, log_pi: Array, log_psi: Array, nodes: Array, stickiness: float = 0.0
) -> Array:
    """log prod_n [rho pi + (1 - rho) psi] of every demonstration at every rho of the grid, (M, J).

    With a stickiness it is the sum over chains instead, of likelihoods to the power of the weights.
    """
    if stickiness:
        log_pi, log_psi = _weighted(problem, log_pi), _weighted(problem, log_psi)
        return chains.log_evidence(log_pi, log_psi, problem.offsets, nodes, stickiness)
    total = np.zeros((len(nodes), problem.n_demonstrations))
    top = np.maximum(log_pi, log_psi)
    share, rest = np.exp(log_pi - top), np.exp(log_psi - top)
    for steps, demonstrations, begins in problem.segments:
        mixture = nodes[:, None] * (share[steps] - rest[steps])
        mixture += rest[steps]
        with np.errstate(divide="ignore"):
            np.log(mixture, out=mixture)
        mixture += top[steps]
        # At the ends the mixture is one of the two, to the last bit and below the smallest number there is.
        mixture[nodes == 1.0] = log_pi[steps]
        mixture[nodes == 0.0] = log_psi[steps]
        if problem.weight is not None:
            mixture *= problem.weight[steps]
        total[:, demonstrations] += np.add.reduceat(mixture, begins, axis=1)
    return total.T


def expert_steps(problem: Problem, log_ratio: Array, by_node: Array, nodes: Array, stickiness: float = 0.0) -> Array:
    """P(the step is the expert's), (N,), with the posterior `by_node` (M, J) over the reliabilities of the grid."""
    if stickiness:
        return chains.expert_steps(_weighted(problem, log_ratio), problem.offsets, by_node, nodes, stickiness)
    inside = (nodes > 0.0) & (nodes < 1.0)  # at 0 no step is the expert's, at 1 every one is
    out = problem.spread(by_node[:, nodes == 1.0].sum(axis=1))
    if not inside.any():
        return out
    # rho pi / (rho pi + (1 - rho) psi) = 1 / (1 + (1 - rho) / rho * psi / pi)
    odds_against = (1 - nodes[inside]) / nodes[inside]
    weight = by_node[:, inside].T
    ratio = np.exp(np.minimum(-log_ratio, _LARGE))
    for steps, demonstrations, begins in problem.segments:
        share = odds_against[:, None] * ratio[steps]
        share += 1.0
        lengths = np.diff(np.append(begins, steps.stop - steps.start))
        np.divide(np.repeat(weight[:, demonstrations], lengths, axis=1), share, out=share)
        out[steps] += share.sum(axis=0)
    return np.clip(out, 0.0, 1.0)


def _weighted(problem: Problem, values: Array) -> Array:
    return values if problem.weight is None else values * problem.weight


def e_step(problem: Problem, state: State, log_proba: Array, beta: float = 1.0) -> Posterior:
    """Posterior over groups, reliabilities and steps, with the likelihood to the power `beta`."""
    log_pi = problem.taken(log_proba)
    log_psi = state.adversary.log_prob(problem.features, log_proba, problem.actions)
    nodes = state.reliability.nodes
    evidence = evidence_by_reliability(problem, log_pi, log_psi, nodes, state.stickiness)
    log_joint = state.prior.log(problem.lengths)[:, :, None] + state.reliability.log_weight + beta * evidence[:, None]
    by_group = logsumexp(log_joint, 2)
    log_odds = by_group[:, EXPERT] - by_group[:, ADVERSARY]
    log_joint[problem.labels > 0, ADVERSARY] = -np.inf
    log_joint[problem.labels < 0, EXPERT] = -np.inf
    log_evidence = logsumexp(log_joint, (1, 2))
    joint = np.exp(log_joint - log_evidence[:, None, None])
    step = expert_steps(problem, log_pi - log_psi, joint.sum(axis=1), nodes, state.stickiness)
    return Posterior(log_odds, joint, step, log_evidence, log_pi - log_psi, log_proba)


def lower_bound(state: State, posterior: Posterior, beta: float = 1.0) -> float:
    """The penalised observed-data log-likelihood at `state`, which the bound touches after an E-step."""
    prior = state.prior.log_prior() + state.reliability.log_prior()
    own = state.adversary.log_prior() - state.policy.penalty()
    return float((posterior.log_evidence.sum() + prior) / beta + own)


def m_step(
    problem: Problem, state: State, posterior: Posterior, mode: MStep = "joint", max_iter: int = 1, max_cg: int = 10
) -> tuple[State, Array]:
    """One convex problem for the policy, closed forms for the rest; also the new log-probabilities (N, K).

    ``mode="expert_only"`` drops the adversary's term from the policy's problem, as the paper's own code does.
    """
    expert = posterior.step if problem.weight is None else posterior.step * problem.weight
    adversary = (1 - posterior.step) if problem.weight is None else (1 - posterior.step) * problem.weight
    targets = problem.one_hot(expert)
    intended = None
    if mode == "joint":
        intended = state.adversary.intended(posterior.log_proba, problem.actions)
    if intended is not None:
        targets += adversary[:, None] * intended
    policy, log_proba = state.policy.fit(problem.features, targets, max_iter=max_iter, max_cg=max_cg)
    counts = posterior.joint.sum(axis=0)
    new = State(
        policy,
        state.adversary.fit(problem.features, posterior.log_proba, problem.actions, adversary),
        state.prior.fit(posterior.expert, problem.lengths),
        state.reliability.fit(counts),
        state.stickiness,
    )
    return new, log_proba


def run(
    problem: Problem,
    state: State,
    *,
    mode: MStep = "joint",
    beta: float = 1.0,
    max_iter: int = 100,
    tol: float = 1e-4,
    log_proba: Array | None = None,
    m_iter: int = 1,
    m_cg: int = 10,
) -> Result:
    """EM from `state` until nothing moves, ending on an E-step.

    Nothing moves when the objective gains less than `tol` nats a demonstration; or less than ten times that while no
    responsibility and no reliability changes by `_STEADY`: then only the policy's confidence still grows.
    """
    log_proba = state.policy.log_proba(problem.features) if log_proba is None else log_proba
    posterior = e_step(problem, state, log_proba, beta)
    history = [lower_bound(state, posterior, beta)]
    converged = False
    for _ in range(max_iter):
        before = posterior
        state, log_proba = m_step(problem, state, posterior, mode, m_iter, m_cg)
        posterior = e_step(problem, state, log_proba, beta)
        history.append(lower_bound(state, posterior, beta))
        gain = abs(history[-1] - history[-2]) / problem.n_demonstrations
        converged = gain <= tol or (gain <= 10 * tol and _moved(before, posterior, state.reliability.nodes) <= _STEADY)
        if converged:
            break
    return Result(state, posterior, np.array(history), converged)


def _moved(before: Posterior, after: Posterior, nodes: Array) -> float:
    """Largest change of a responsibility or of a mean reliability."""
    difference = after.joint - before.joint
    return float(max(np.abs(difference[:, EXPERT].sum(axis=1)).max(), np.abs(difference.sum(axis=1) @ nodes).max()))
