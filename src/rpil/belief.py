"""What EM's point estimates leave out: how uncertain the shares and the reliabilities themselves are.

From thirty demonstrations nobody can tell exactly how reliable experts are, nor how many there are. EM picks the most
likely values, and is as sure of its verdicts as if they were known. Given policy and adversary, though, all of it is a
finite sum: over every pair of Betas in the table, and a grid of shares. A belief is that posterior.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit, log_expit

from rpil.demonstrators import Demonstrators, intervals
from rpil.em import Result, State, evidence_by_reliability
from rpil.passes import Array, logsumexp
from rpil.priors import Prior
from rpil.problem import Problem
from rpil.reliability import Alternatives

_NEGLIGIBLE = 12.0
"""Nats by which a pair of Betas may be worse than the best before it is left out."""

_ROUNDS = 20
_STEADY = 1e-3
_LEAST = -1e5
_RARE = 1e-9


@dataclass(frozen=True, eq=False)
class Belief:
    """Posterior over what `State` holds a point estimate of; policy and adversary are taken as they are.

    Attributes
    ----------
    prior : Prior
        How P(expert) depends on the length.
    shift : (P,) array
        Log-odds to add to those of `prior`.
    expert, adversary : (Q, J) arrays
        log P(rho_j | group) under each pair of Betas.
    weight : (P, Q) array
        Posterior of each combination.
    people : (U, 3) array
        P(expert) of what each demonstrator gives: its mean, and the ends of its 95 % interval; nobody where it is not
        known who gave what.
    """

    prior: Prior
    shift: Array
    expert: Array
    adversary: Array
    weight: Array
    people: Array = field(default_factory=lambda: np.empty((0, 3)))

    def log_odds(self, evidence: Array, lengths: Array) -> Array:
        """Log-odds of expert against adversary, (M,), of demonstrations with `evidence` (M, J) at each reliability."""
        ratio = _marginal(evidence, self.expert) - _marginal(evidence, self.adversary)
        return _log_odds(ratio, self.prior.log_odds(lengths), self)

    def share(self, lengths: Array) -> tuple[float, float, float]:
        """P(expert) of a demonstration drawn from these: its mean, and the ends of its 95 % interval."""
        offset = self.prior.log_odds(lengths)
        shares = np.array([expit(offset + s).mean() for s in self.shift])
        weight = self.weight.sum(axis=1)
        low, high = np.interp([0.025, 0.975], np.cumsum(weight) - 0.5 * weight, shares)
        return float(weight @ shares), float(low), float(high)


def evidence(problem: Problem, state: State, outputs: Array) -> Array:
    """log p(D_m | rho_j) of every demonstration, (M, J)."""
    log_psi = state.adversary.log_prob(problem.features, outputs, problem.actions)
    log_pi, nodes = state.policy.log_prob(outputs, problem.actions), state.reliability.nodes
    return evidence_by_reliability(problem, log_pi, log_psi, nodes, state.stickiness)


def believe(problem: Problem, result: Result) -> tuple[Belief, Array]:
    """The belief after a fit, and the log-odds (M,) under it, labels not counted.

    How trust depends on the length is fitted once more, by EM with everything else summed out.
    """
    state, labels, lengths = result.state, problem.labels, problem.lengths
    by_node = evidence(problem, state, result.posterior.outputs)
    prior = state.prior
    alternatives = _plausible(state.reliability.alternatives, by_node, prior.log_odds(lengths), labels)
    expert, adversary = (alternatives.log_weight[rows] for rows in alternatives.pairs.T)
    log_adversary = _marginal(by_node, adversary)
    ratio = _marginal(by_node, expert) - log_adversary
    fixed = alternatives.log_prior + log_adversary.sum(axis=0)
    for _ in range(_ROUNDS):
        offset, (shift, log_share) = prior.log_odds(lengths), prior.alternatives(lengths)
        log_posterior = np.stack([_over_adversary(ratio, offset + s, labels) for s in shift])
        log_posterior += fixed + log_share[:, None]
        weight = np.exp(log_posterior - log_posterior.max())
        belief = Belief(prior, shift, expert, adversary, weight / weight.sum())
        proba = sum(expit(ratio + (offset + s)[:, None]) @ w for s, w in zip(shift, belief.weight, strict=True))
        prior = prior.fit(np.where(labels == 0, proba, labels > 0), lengths)
        if np.ptp(prior.log_odds(lengths) - offset) < _STEADY:
            break
    if isinstance(problem.company, Demonstrators):
        return _in_company(problem.company, problem.labels, ratio, offset, belief)
    return belief, _log_odds(ratio, offset, belief)


def _in_company(
    demonstrators: Demonstrators, labels: Array, ratio: Array, offset: Array, belief: Belief
) -> tuple[Belief, Array]:
    """The belief and the log-odds (M,) where it is known who gave what.

    For each share the pairs of Betas are summed out first, as if the demonstrations had nothing to do with each other;
    the sum over demonstrators is exact.
    """
    log_weight, odds, people = [], [], []
    kept = np.flatnonzero(belief.weight.sum(axis=1) > _RARE)
    for s, row in zip(belief.shift[kept], belief.weight[kept], strict=True):
        prior, one = offset + s, replace(belief, shift=np.array([s]), weight=row[None])
        alone = _log_odds(ratio, offset, one)
        lent = demonstrators.borrow(alone - prior, prior, labels)
        strangers = _over_adversary((alone - prior)[:, None], prior, labels)[0]
        log_weight.append(np.log(row.sum()) + lent.log_evidence - strangers)
        odds.append(alone - prior + lent.log_odds)
        people.append(lent)
    log_share = np.array(log_weight) - logsumexp(np.array(log_weight), 0)
    share, z = np.exp(log_share), np.array(odds).T
    weight = np.zeros(belief.weight.shape)
    weight[kept] = belief.weight[kept] * (share / belief.weight[kept].sum(axis=1))[:, None]
    trust = intervals(
        np.concatenate([lent.share for lent in people], axis=1),
        np.concatenate([w * lent.weight for w, lent in zip(share, people, strict=True)], axis=1),
    )
    log_odds = logsumexp(log_share + log_expit(z), 1) - logsumexp(log_share + log_expit(-z), 1)
    return replace(belief, weight=weight, people=trust), log_odds


def _plausible(alternatives: Alternatives, by_node: Array, offset: Array, labels: Array) -> Alternatives:
    """The pairs that are not negligible at the fitted share."""
    each = _marginal(by_node, alternatives.log_weight)
    score = alternatives.log_prior.copy()
    for q, (expert, adversary) in enumerate(alternatives.pairs):
        ratio = each[:, [expert]] - each[:, [adversary]]
        score[q] += _over_adversary(ratio, offset, labels)[0] + each[:, adversary].sum()
    keep = score > score.max() - _NEGLIGIBLE
    return replace(alternatives, pairs=alternatives.pairs[keep], log_prior=alternatives.log_prior[keep])


def _marginal(by_node: Array, log_weight: Array) -> Array:
    """log sum_j P(rho_j) p(D_m | rho_j) under each distribution, (M, J) x (T, J) -> (M, T)."""
    top = by_node.max(axis=1, keepdims=True)
    with np.errstate(divide="ignore"):
        total = np.log(np.exp(by_node - top) @ np.exp(log_weight).T)
    return np.maximum(total, _LEAST) + top  # a node of no weight may hold all of the evidence


def _over_adversary(ratio: Array, prior_log_odds: Array, labels: Array) -> Array:
    """log prod_m p(D_m, label) / p(D_m | adversary) for each pair, (M, Q) -> (Q,)."""
    posterior = ratio + prior_log_odds[:, None]
    mixture = np.logaddexp(0.0, posterior)
    mixture[labels > 0] = posterior[labels > 0]
    mixture[labels < 0] = 0.0
    return (mixture - np.logaddexp(0.0, prior_log_odds)[:, None]).sum(axis=0)


def _log_odds(ratio: Array, offset: Array, belief: Belief) -> Array:
    """log P(expert | D_m) - log P(adversary | D_m), each summed over all combinations, (M,)."""
    log_expert, log_adversary = np.full((2, len(ratio)), -np.inf)
    with np.errstate(divide="ignore"):
        log_weight = np.log(belief.weight)
    for s, row in zip(belief.shift, log_weight, strict=True):
        z = ratio + (offset + s)[:, None]
        log_expert = np.logaddexp(log_expert, logsumexp(row - np.logaddexp(0.0, -z), 1))
        log_adversary = np.logaddexp(log_adversary, logsumexp(row - np.logaddexp(0.0, z), 1))
    return log_expert - log_adversary
