"""What the operators of demonstrations say: with answers, of their other demonstrations; without, only why to doubt."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from rpil.data.demonstrators import Demonstrators
from rpil.inference.answers import Answers
from rpil.mixture.demonstrator_prior import demonstrator_posterior
from rpil.mixture.settings import DemonstratorSettings
from rpil.numerics.types import Array, Float, Int


def trust_by_operator(
    demonstrators: Demonstrators,
    log_odds: Float[Array, " M"],
    answers: Answers,
    copy_of: Int[Array, " M"],
    settings: DemonstratorSettings,
) -> tuple[Float[Array, " M"], Float[Array, "U 3"]]:
    """Log-odds of each demonstration by the other demonstrations of its operator, nats, and the trust in each operator:
    the mean P of its demonstrations and its 95 % interval. Zeros, and no trust, where nothing was answered or the
    operators are not `informative`.

    A label says what its own demonstration is, and copies are one demonstration of each operator who gave them.
    """
    if not (demonstrators.informative and answers.once(copy_of).any):
        return np.zeros(len(log_odds)), np.empty((0, 3))
    index, labels = demonstrators.index, answers.shared(copy_of).labels
    key = copy_of * (1 + index.max()) + index
    _, once, place = np.unique(key, return_index=True, return_inverse=True)
    different = Demonstrators(index[once], demonstrators.names)
    posterior = demonstrator_posterior(different, log_odds[once], labels[once], settings)
    return np.where(labels, 0.0, posterior.log_odds[place]), posterior.intervals()


def operators_apart(
    demonstrators: Demonstrators, words: Int[Array, " M"], max_chance: float
) -> tuple[bool, tuple[Hashable, ...]]:
    """Whether one operator gave all unlike demonstrations (word -1; two at least), and this operator; or the operators
    who gave most of them, and none that is typical (word 1). Nobody where neither holds.

    Of the latter none is typical by chance: (1 - share of typical ones) ** (demonstrations of the operator) is below
    `max_chance`.
    """
    unlike = words < 0
    if not demonstrators.informative or unlike.sum() < 2:
        return False, ()
    n_typical, n_unlike = demonstrators.indicator @ (words > 0), demonstrators.indicator @ unlike
    if n_unlike.max() == unlike.sum():
        return True, (demonstrators.names[int(n_unlike.argmax())],)
    chance = (1 - (words > 0).mean()) ** demonstrators.counts
    apart = (n_typical == 0) & (n_unlike > 0) & (chance < max_chance)
    most = 2 * n_unlike[apart].sum() > unlike.sum()
    return False, tuple(demonstrators.names[u] for u in np.flatnonzero(apart)) if most else ()
