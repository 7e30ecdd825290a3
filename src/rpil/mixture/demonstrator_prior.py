"""Who gave which demonstration: what the others of the same person say about one of them.

Demonstrator u has a tendency b_u, added to the log-odds of P(expert) of every demonstration that u gave:

    logit P(expert | m, u) = o_m + b_u,     b_u ~ N(0, tau^2)

At o_m = 0, one half, the population's share is what it was without tendencies; a person who gave one demonstration is
judged as if the demonstrators were unknown. tau says how alike the demonstrations of one person are; it is the same for
all persons, and summed out over a table that begins at 0, where it does not matter who gave what. So demonstrators that
mean nothing do next to no harm.

b is on a grid, so that everything is a finite sum, and a demonstration borrows from the *others* of its demonstrator:
its own actions are left out exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_expit, logsumexp

from rpil.data.demonstrators import Demonstrators
from rpil.numerics.types import Array

SPREADS = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
"""tau: from 0, persons do not differ, to 8, all demonstrations of a person are alike; equally likely a priori."""

_POINTS = np.linspace(-3.0, 3.0, 25)
_LOG_WEIGHT = -0.5 * _POINTS**2 - np.log(np.exp(-0.5 * _POINTS**2).sum())
_CERTAIN = 1e5
"""Log-ratios beyond this are no different."""


@dataclass(frozen=True, eq=False)
class Borrowed:
    """What demonstrations say of one another.

    Attributes
    ----------
    log_odds : (M,) array
        Of expert against adversary before a demonstration's own actions, but after those of its demonstrator's others.
    share, weight : (U, T * G) arrays
        P(expert), averaged over what each demonstrator gave, for every tau and tendency; and their posterior.
    """

    log_odds: Array
    share: Array
    weight: Array


def borrow(demonstrators: Demonstrators, log_ratio: Array, log_odds: Array, labels: Array) -> Borrowed:
    """What the demonstrations of each person say of one another.

    Parameters
    ----------
    log_ratio : (M,) array
        log p(D_m | expert) - log p(D_m | adversary).
    log_odds : (M,) array
        Of P(expert), the population's.
    labels : (M,) int array
        1 known expert, -1 known adversary, 0 unknown.
    """
    ratio = np.clip(log_ratio, -_CERTAIN, _CERTAIN)
    z = log_odds[:, None, None] + SPREADS[:, None] * _POINTS  # (M, T, G)
    log_p = log_expit(z)
    expert, adversary = log_p + ratio[:, None, None], log_p - z
    own = np.logaddexp(expert, adversary)
    own[labels > 0], own[labels < 0] = expert[labels > 0], adversary[labels < 0]
    each = np.tensordot(demonstrators.indicator, own, axes=1) + _LOG_WEIGHT  # (U, T, G)
    together = logsumexp(each, 2)  # (U, T)
    of_spread = together.sum(axis=0)  # (T,)
    # The others of the same demonstrator: everything but the demonstration's own factor.
    others = (of_spread - together)[demonstrators.index][:, :, None] + each[demonstrators.index] - own
    log_expert, log_adversary = (logsumexp(others + part, (1, 2)) for part in (log_p, adversary))
    alone = (
        demonstrators.counts[demonstrators.index] == 1
    )  # whose others are strangers: the population's share, to the last bit
    lent = np.where(alone, log_odds, log_expert - log_adversary)
    weight = (of_spread - together)[:, :, None] + each
    weight = np.exp(weight - logsumexp(weight, (1, 2))[:, None, None])
    share = np.tensordot(demonstrators.indicator, np.exp(log_p), axes=1) / demonstrators.counts[:, None, None]
    return Borrowed(lent, *(a.reshape(len(a), -1) for a in (share, weight)))


def intervals(value: Array, weight: Array) -> Array:
    """Mean, and the ends of the 95 % interval, of each row of `value` (U, S) under the distribution `weight` (U, S):
    (U, 3)."""
    order = np.argsort(value, axis=1)
    value, weight = (np.take_along_axis(array, order, axis=1) for array in (value, weight))
    middle = np.cumsum(weight, axis=1) - 0.5 * weight
    ends = [np.interp([0.025, 0.975], *row) for row in zip(middle, value, strict=True)]
    return np.column_stack([(value * weight).sum(axis=1), ends])
