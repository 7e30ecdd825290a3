"""The prior of demonstrators: a random intercept for each, which its other demonstrations estimate.

    logit P(expert | m, u) = b_u,     b_u ~ N(0, tau^2)

for demonstration m of demonstrator u, before the actions of m are looked at. tau says how alike the demonstrations of
one demonstrator are; it is the same for all demonstrators, and summed out over a table that begins at 0, where the
demonstrators make no difference. So where quality does not depend on the demonstrator, tau is near 0 and
log-odds hardly change. b_u is summed out over a grid.

The posterior is leave-one-out: a demonstration is judged by the *other* demonstrations of its demonstrator, so that its
own actions do not count twice. A demonstrator with one demonstration has the prior P(expert) = 1/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_expit, logsumexp

from rpil.data.fit_data import Demonstrators
from rpil.mixture.settings import DemonstratorSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class DemonstratorPosterior:
    """The posterior of U demonstrators of M demonstrations, on a grid of S pairs (tau, b)."""

    log_odds: Float[Array, " M"]
    """Log-odds of expert against adversary given the other demonstrations of the same demonstrator, nats."""
    proba: Float[Array, " S"]
    """P(expert | b) of each pair."""
    weight: Float[Array, "U S"]
    """Posterior probabilities of the pairs for each demonstrator, given all of its demonstrations."""

    def intervals(self) -> Float[Array, "U 3"]:
        """P(expert) of the demonstrations of each demonstrator: mean and ends of the 95 % interval."""
        order = np.argsort(self.proba)
        proba, weight = self.proba[order], self.weight[:, order]
        middle = np.cumsum(weight, axis=1) - 0.5 * weight
        ends = [np.interp([0.025, 0.975], row, proba) for row in middle]
        return np.column_stack([(weight * proba).sum(axis=1), ends])


def demonstrator_posterior(
    demonstrators: Demonstrators,
    log_ratio: Float[Array, " M"],
    labels: Int[Array, " M"],
    settings: DemonstratorSettings,
) -> DemonstratorPosterior:
    """The posterior of the demonstrators, given log p(D_m | expert) - log p(D_m | adversary) of the demonstrations and
    their labels: 1 expert, -1 adversary, 0 none."""
    index, counts = demonstrators.index, np.bincount(demonstrators.index)
    nodes = np.linspace(-settings.max_node, settings.max_node, settings.n_nodes)
    log_weight = -0.5 * nodes**2 - np.log(np.exp(-0.5 * nodes**2).sum())
    intercept = np.array(settings.spreads)[:, None] * nodes  # (T, G)
    log_expert = log_expit(intercept)
    log_adversary = log_expert - intercept
    ratio = np.clip(log_ratio, -settings.max_log_ratio, settings.max_log_ratio)[:, None, None]
    own = np.logaddexp(log_expert + ratio, log_adversary)  # log p(D_m | b), (M, T, G)
    own[labels > 0], own[labels < 0] = (log_expert + ratio)[labels > 0], log_adversary
    joint = np.tensordot(demonstrators.indicator, own, axes=1) + log_weight  # (U, T, G)
    by_spread = logsumexp(joint, 2)  # (U, T)
    other_demonstrators = (by_spread.sum(axis=0) - by_spread)[:, :, None]  # they estimate tau, too
    joint = joint + other_demonstrators
    others = joint[index] - own  # all demonstrations but m
    odds = logsumexp(others + log_expert, (1, 2)) - logsumexp(others + log_adversary, (1, 2))
    odds[counts[index] == 1] = 0.0
    flat = joint.reshape(len(counts), -1)
    weight = np.exp(flat - logsumexp(flat, 1)[:, None])
    return DemonstratorPosterior(odds, np.exp(log_expert).ravel(), weight)


def trust_by_demonstrator(
    demonstrators: Demonstrators,
    log_odds: Float[Array, " M"],
    labels: Int[Array, " M"],
    copy_of: Int[Array, " M"],
    settings: DemonstratorSettings,
) -> tuple[Float[Array, " M"], Float[Array, "U 3"]]:
    """The log-odds of each demonstration by the others of its demonstrator, 0 where it has a label, and the trust in
    each demonstrator, see `DemonstratorPosterior.intervals`. Zeros and nothing where they carry no information."""
    if not demonstrators.informative:
        return np.zeros(len(log_odds)), np.empty((0, 3))
    # Copies are one demonstration of each demonstrator who gave them.
    key = copy_of * len(demonstrators.names) + demonstrators.index
    _, once, place = np.unique(key, return_index=True, return_inverse=True)
    different = Demonstrators(demonstrators.index[once], demonstrators.names)
    posterior = demonstrator_posterior(different, log_odds[once], labels[once], settings)
    return np.where(labels, 0.0, posterior.log_odds[place]), posterior.intervals()
