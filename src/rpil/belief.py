"""What EM's point estimates leave out: how uncertain the shares and the reliabilities themselves are.

From thirty demonstrations nobody can tell exactly how reliable experts are, nor how many there are. EM picks the most
likely values, and is as sure of its verdicts as if they were known. Given policy and adversary, though, all of it is a
finite sum: over every pair of Betas in the table, and a grid of shares. A belief is that posterior. It also knows what
a mixture of two does not: perhaps there is one group only, and everybody in it is alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit, log_expit, logit

from rpil.demonstrators import STRANGERS, Demonstrators, intervals
from rpil.em import State, evidence_by_reliability
from rpil.passes import Array, logsumexp
from rpil.priors import Prior
from rpil.problem import Problem
from rpil.reliability import Alternatives

_NEGLIGIBLE = 12.0
"""Nats by which a pair of Betas may be worse than the best before it is left out."""

_ROUNDS = 20
_STEADY = 1e-3
_LEAST = -1e5
_SCREENED = 2_000
_RARE = 1e-9
_MOST_ALIKE = 1 - 1e-12
_LARGEST = 20.0
"""Nats of a step's log-ratio beyond which it is no more surprising, when neighbours are compared."""


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
        Posterior of each combination, should there be two groups.
    alike : float
        P(there is one group only | data): then everybody is an expert, however reliable. One half beforehand; 0 where
        an adversary is known, or the share of experts is given.
    one : (J,) array
        log P(rho_j) of that one group.
    power : float
        To which likelihoods are raised, because the steps of a demonstration are not independent.
    people : (U, 3) array
        P(expert) of what each demonstrator gives: its mean, and the ends of its 95 % interval; nobody where it is not
        known who gave what.
    """

    prior: Prior
    shift: Array
    expert: Array
    adversary: Array
    weight: Array
    alike: float
    one: Array
    power: float
    people: Array = field(default_factory=lambda: np.empty((0, 3)))

    def log_odds(self, evidence: Array, lengths: Array) -> Array:
        """Log-odds of expert against adversary, (M,), of new demonstrations with `evidence` (M, J) at each reliability.

        How they look also says whether there is one group only.
        """
        evidence = self.power * evidence
        adversary = _marginal(evidence, self.adversary)
        ratio = _marginal(evidence, self.expert) - adversary
        offset = self.prior.log_odds(lengths)
        with np.errstate(divide="ignore"):
            log_weight = np.log(self.weight)
            two = np.full(len(ratio), -np.inf)  # log p(D | two groups)
            for s, row in zip(self.shift, log_weight, strict=True):
                prior = (offset + s)[:, None]
                each = row + adversary + np.logaddexp(0.0, ratio + prior) - np.logaddexp(0.0, prior)
                two = np.logaddexp(two, logsumexp(each, 1))
            one = _marginal(evidence, self.one[None])[:, 0]
            alike = np.minimum(expit(np.log(self.alike) - np.log1p(-self.alike) + one - two), _MOST_ALIKE)
        return _or_alike(*_log_shares(ratio, offset, self), alike)

    def share(self, lengths: Array) -> tuple[float, float, float]:
        """P(expert) of a demonstration drawn from these: its mean, and the ends of its 95 % interval."""
        offset = self.prior.log_odds(lengths)
        shares = np.array([expit(offset + s).mean() for s in self.shift])
        weight = (1.0 - self.alike) * self.weight.sum(axis=1)
        low, high = np.interp([0.025, 0.975], np.cumsum(weight) - 0.5 * weight, shares)
        if self.alike > 0.025:
            high = 1.0
        return float(weight @ shares) + self.alike, float(low), float(high)


def evidence(problem: Problem, state: State, outputs: Array) -> Array:
    """log p(D_m | rho_j) of every demonstration, (M, J)."""
    log_psi = state.adversary.log_prob(problem.features, outputs, problem.actions)
    log_pi, nodes = state.policy.log_prob(outputs, problem.actions), state.reliability.nodes
    return evidence_by_reliability(problem, log_pi, log_psi, nodes, state.stickiness)


def power(together: float, variance: float) -> float:
    """Effective over actual number of steps: (1 - r) / (1 + r), r being how far the log-ratio of a step resembles that
    of the step before, as in a first-order autoregression; no more than 1."""
    r = max(together / variance, 0.0) if variance > 0 else 0.0
    return (1.0 - r) / (1.0 + r)


def resemblance(problem: Problem, log_ratio: Array) -> tuple[float, float]:
    """Sums over steps of the log-ratio times that of the step before, and of its square, around each demonstration's
    mean."""
    x = np.clip(log_ratio, -_LARGEST, _LARGEST)
    x = x - problem.spread(problem.sum_steps(x) / problem.lengths)
    together = np.ones(len(x), dtype=bool)
    together[problem.offsets[:-1]] = False
    return float(x[1:] @ (x[:-1] * together[1:])), float(x @ x)


def believe(problem: Problem, state: State, outputs: Array, strict: Array | None = None) -> tuple[Belief, Array]:
    """The belief after a fit, and the log-odds (M,) under it, labels not counted.

    Parameters
    ----------
    problem, state
        The data and where EM ended.
    outputs : (N, ...) array
        What policies that did not see a demonstration say of its steps.
    strict : (N, ...) array, optional
        The same of policies that know nothing of it by hearsay either, see `rpil.crossfit.untold`: by these it is
        judged whether there are two groups at all.
    """
    log_ratio = state.policy.log_prob(outputs, problem.actions)
    log_ratio = log_ratio - state.adversary.log_prob(problem.features, outputs, problem.actions)
    tempering = power(*resemblance(problem, log_ratio))
    against_one = None if strict is None else evidence(problem, state, strict)
    return sum_out(problem, state, evidence(problem, state, outputs), tempering, against_one)


def sum_out(
    problem: Problem, state: State, by_node: Array, tempering: float, strict: Array | None = None
) -> tuple[Belief, Array]:
    """`believe`, given the evidence of every demonstration at each reliability, (M, J), its power, and, should that be
    another, the evidence (M, J) by which two groups are compared with one.

    How trust depends on the length is fitted once more, by EM with everything else summed out. Of `problem` only the
    demonstrations count, not their steps.
    """
    labels, lengths = problem.labels, problem.lengths
    by_node = tempering * by_node
    prior = state.prior
    alternatives = _plausible(state.reliability.alternatives, by_node, prior.log_odds(lengths), labels)
    expert, adversary = (alternatives.log_weight[rows] for rows in alternatives.pairs.T)
    log_adversary = _marginal(by_node, adversary)
    ratio = _marginal(by_node, expert) - log_adversary
    fixed = alternatives.log_prior + log_adversary.sum(axis=0)
    log_one, one = _one_group(state.reliability.alternatives, by_node)
    for _ in range(_ROUNDS):
        offset, (shift, log_share) = prior.log_odds(lengths), prior.alternatives(lengths)
        log_posterior = np.stack([_over_adversary(ratio, offset + s, labels) for s in shift])
        log_posterior += fixed + log_share[:, None]
        weight = np.exp(log_posterior - log_posterior.max())
        log_two = log_posterior.max() + np.log(weight.sum()) - logsumexp(log_share, 0)
        log_two -= logsumexp(state.reliability.alternatives.log_prior, 0)
        alike = 0.0 if (labels < 0).any() or prior.fixed else min(float(expit(log_one - log_two)), _MOST_ALIKE)
        belief = Belief(prior, shift, expert, adversary, weight / weight.sum(), alike, one, tempering)
        proba = sum(expit(ratio + (offset + s)[:, None]) @ w for s, w in zip(shift, belief.weight, strict=True))
        prior = prior.fit(np.where(labels == 0, proba, labels > 0), lengths)
        if np.ptp(prior.log_odds(lengths) - offset) < _STEADY:
            break
    if strict is not None:
        apart, _ = sum_out(replace(problem, company=STRANGERS), state, strict, tempering)
        belief = replace(belief, alike=apart.alike)
    if isinstance(problem.company, Demonstrators):
        belief, log_expert, log_adversary = _in_company(problem.company, labels, ratio, offset, belief)
    else:
        log_expert, log_adversary = _log_shares(ratio, offset, belief)
    return belief, _or_alike(log_expert, log_adversary, belief.alike)


def _one_group(alternatives: Alternatives, by_node: Array) -> tuple[float, Array]:
    """log p(all | everybody is alike), and that group's log P(rho_j), with any Beta of the table as likely.

    That experts are reliable only tells them from adversaries; without these anything goes.
    """
    total = _marginal(by_node, alternatives.log_weight).sum(axis=0)
    weight = np.exp(total - total.max())
    with np.errstate(divide="ignore"):
        mixture = np.log((weight / weight.sum()) @ np.exp(alternatives.log_weight))
    return float(total.max() + np.log(weight.mean())), mixture


def _in_company(
    demonstrators: Demonstrators, labels: Array, ratio: Array, offset: Array, belief: Belief
) -> tuple[Belief, Array, Array]:
    """The belief where it is known who gave what, and log P(expert), log P(adversary) as of `_log_shares`.

    For each share the pairs of Betas are summed out first, as if the demonstrations had nothing to do with each other;
    the sum over demonstrators is exact.
    """
    log_weight, odds, people = [], [], []
    kept = np.flatnonzero(belief.weight.sum(axis=1) > _RARE)
    for s, row in zip(belief.shift[kept], belief.weight[kept], strict=True):
        prior = offset + s
        alone = np.subtract(*_log_shares(ratio, offset, replace(belief, shift=np.array([s]), weight=row[None])))
        lent = demonstrators.borrow(alone - prior, prior, labels)
        strangers = _over_adversary((alone - prior)[:, None], prior, labels)[0]
        log_weight.append(np.log(row.sum()) + lent.log_evidence - strangers)
        odds.append(alone - prior + lent.log_odds)
        people.append(lent)
    log_share, z = np.array(log_weight), np.array(odds).T
    gain = float(logsumexp(log_share, 0))
    log_share -= gain
    share = np.exp(log_share)
    weight = np.zeros(belief.weight.shape)
    weight[kept] = belief.weight[kept] * (share / belief.weight[kept].sum(axis=1))[:, None]
    trust = intervals(
        np.concatenate([lent.share for lent in people], axis=1),
        np.concatenate([w * lent.weight for w, lent in zip(share, people, strict=True)], axis=1),
    )
    alike = belief.alike and float(expit(logit(belief.alike) - gain))
    trust[:, 0] += alike * (1.0 - trust[:, 0])  # if everybody is alike, so are all demonstrators
    if alike > 0.025:
        trust[:, 2] = 1.0
    new = replace(belief, weight=weight, people=trust, alike=alike)
    return new, logsumexp(log_share + log_expit(z), 1), logsumexp(log_share + log_expit(-z), 1)


def _plausible(alternatives: Alternatives, by_node: Array, offset: Array, labels: Array) -> Alternatives:
    """The pairs that are not negligible at the fitted share; of many demonstrations, first by some of them."""
    if len(by_node) > 2 * _SCREENED:
        some = np.linspace(0, len(by_node) - 1, _SCREENED).astype(int)
        alternatives = _plausible(alternatives, by_node[some], offset[some], labels[some])
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


def _or_alike(log_expert: Array, log_adversary: Array, alike: Array | float) -> Array:
    """Log-odds where everybody is an expert with probability `alike`, and else as the shares have it, (M,)."""
    with np.errstate(divide="ignore"):
        log_two = np.log1p(-alike)
        log_odds: Array = np.logaddexp(log_two + log_expert, np.log(alike)) - log_two - log_adversary
    return log_odds


def _log_shares(ratio: Array, offset: Array, belief: Belief) -> tuple[Array, Array]:
    """log P(expert | D_m) and log P(adversary | D_m) in two groups, each summed over all combinations, (M,)."""
    log_expert, log_adversary = np.full((2, len(ratio)), -np.inf)
    with np.errstate(divide="ignore"):
        log_weight = np.log(belief.weight)
    for s, row in zip(belief.shift, log_weight, strict=True):
        z = ratio + (offset + s)[:, None]
        log_expert = np.logaddexp(log_expert, logsumexp(row - np.logaddexp(0.0, -z), 1))
        log_adversary = np.logaddexp(log_adversary, logsumexp(row - np.logaddexp(0.0, z), 1))
    return log_expert, log_adversary
