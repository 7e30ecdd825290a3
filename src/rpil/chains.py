"""Bad steps come in runs: who takes the steps of a demonstration, as a Markov chain of two states.

The first step is the expert's with probability rho. Whoever took a step takes the next one too with probability s, the
*stickiness*; else it is anybody's again, the expert's with probability rho. So rho is the expected share of the
expert's steps whatever s is, and s = 0 is the independent mixture of `rpil.em`.

Demonstrations are sorted by length and go side by side: the loop is over time, an array holds all demonstrations and
all reliabilities. Filtered probabilities are normalised at every step, so that no length under- or overflows
(Rabiner, "A Tutorial on Hidden Markov Models", 1989, section V.A).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rpil.passes import Array

_ENTRIES = 1 << 18
"""Steps times reliabilities whose probabilities are in memory at a time."""

_ABREAST = 1 << 13
"""Demonstrations times reliabilities in one array: it stays in cache."""

_LOGS_EVERY = 16
"""Steps whose likelihoods are multiplied before a logarithm is taken; each is at least (1 - s) min(rho, 1 - rho)."""

_NEGLIGIBLE = 1e-12
"""Probability of a reliability below which nothing is averaged over it."""


@dataclass(frozen=True, eq=False)
class _Abreast:
    """A few demonstrations side by side, the longest first.

    Attributes
    ----------
    demonstrations : (A,) int array
    alive : (T,) int array
        How many of them, the first ones, have a step t.
    steps : (T, A) int array
        Row of the data for each step; of no meaning beyond the end of a demonstration.
    """

    demonstrations: Array
    alive: Array
    steps: Array


def log_evidence(log_pi: Array, log_psi: Array, offsets: Array, nodes: Array, stickiness: float) -> Array:
    """log p(D_m | rho_j), summed over who took which step, (M, J).

    Parameters
    ----------
    log_pi, log_psi : (N,) arrays
        Log-likelihoods of the action taken under expert and adversary.
    offsets : (M + 1,) int array
    nodes : (J,) array
        Values of rho.
    stickiness : float
        s in [0, 1).
    """
    inside, out = _inside(nodes), np.empty((len(offsets) - 1, len(nodes)))
    # At the ends every step is one of the two's, to the last bit.
    out[:, nodes == 1.0] = np.add.reduceat(log_pi, offsets[:-1])[:, None]
    out[:, nodes == 0.0] = np.add.reduceat(log_psi, offsets[:-1])[:, None]
    if not inside.any():
        return out
    pi, psi, top = _scaled(log_pi, log_psi)
    rho = nodes[inside]
    fresh = (1 - stickiness) * rho
    total = np.repeat(np.add.reduceat(top, offsets[:-1])[:, None], len(rho), axis=1)
    for group in _side_by_side(offsets, len(rho)):
        product = np.ones((len(group.demonstrations), len(rho)))
        expected = np.tile(rho, (len(product), 1))
        found = np.zeros(product.shape)
        for t, (alive, steps) in enumerate(zip(group.alive, group.steps, strict=True)):
            mine, other = pi[steps[:alive], None], psi[steps[:alive], None]
            expert = expected[:alive] * mine
            likelihood = 1.0 - expected[:alive]
            likelihood *= other
            likelihood += expert
            product[:alive] *= likelihood
            expert /= likelihood
            expert *= stickiness
            np.add(expert, fresh, out=expected[:alive])
            if t % _LOGS_EVERY == _LOGS_EVERY - 1:
                found += np.log(product)
                product[:] = 1.0
        total[group.demonstrations] += found + np.log(product)
    out[:, inside] = total
    return out


def expert_steps(log_ratio: Array, offsets: Array, by_node: Array, nodes: Array, stickiness: float) -> Array:
    """P(the step is the expert's | its whole demonstration), (N,).

    Parameters
    ----------
    log_ratio : (N,) array
        log pi - log psi of the action taken.
    offsets, nodes, stickiness
        As in `log_evidence`.
    by_node : (M, J) array
        Posterior of the reliabilities.
    """
    out = np.repeat(by_node[:, nodes == 1.0].sum(axis=1), np.diff(offsets))
    pi, psi, _ = _scaled(log_ratio, np.zeros(len(log_ratio)))
    for group in _side_by_side(offsets, len(nodes)):
        used = _inside(nodes) & (by_node[group.demonstrations].max(axis=0) > _NEGLIGIBLE)
        if used.any():
            weight = by_node[np.ix_(group.demonstrations, used)]
            _smooth(pi, psi, group, weight, nodes[used], stickiness, out)
    return np.clip(out, 0.0, 1.0)


def _smooth(pi: Array, psi: Array, group: _Abreast, weight: Array, rho: Array, stickiness: float, out: Array) -> None:
    """Add what `group` has at the reliabilities `rho`, averaged with `weight` (A, J), to the steps `out` (N,)."""
    fresh = (1 - stickiness) * rho
    expected = np.empty((len(group.alive) + 1, *weight.shape))  # P(expert at t | before t)
    expected[0] = rho
    filtered = np.empty((len(group.alive), *weight.shape))  # P(expert at t | until t)
    for now, then, after, alive, steps in zip(
        filtered, expected[:-1], expected[1:], group.alive, group.steps, strict=True
    ):
        expert = np.multiply(then[:alive], pi[steps[:alive], None], out=now[:alive])
        likelihood = 1.0 - then[:alive]
        likelihood *= psi[steps[:alive], None]
        likelihood += expert
        expert /= likelihood
        np.multiply(expert, stickiness, out=after[:alive])
        after[:alive] += fresh
    # Backwards, P(expert at t | everything) from that at t + 1: those that end at t are as filtered.
    stay, leave = stickiness + fresh, (1 - stickiness) * (1 - rho)
    everything = np.empty(weight.shape)
    later = 0
    for now, after, alive, steps in zip(
        filtered[::-1], expected[:0:-1], group.alive[::-1], group.steps[::-1], strict=True
    ):
        if later:
            smoothed, after = everything[:later], after[:later]
            against = 1.0 - smoothed
            against /= 1.0 - after
            against *= leave
            smoothed /= after
            smoothed *= stay
            smoothed += against
            smoothed *= now[:later]
        everything[later:alive] = now[later:alive]
        out[steps[:alive]] += np.einsum("aj,aj->a", everything[:alive], weight[:alive])
        later = alive


def _inside(nodes: Array) -> Array:
    inside: Array = (nodes > 0.0) & (nodes < 1.0)
    return inside


def _scaled(log_pi: Array, log_psi: Array) -> tuple[Array, Array, Array]:
    """Likelihoods of each step over the larger of the two, and the logarithm of that."""
    top = np.maximum(log_pi, log_psi)
    return np.exp(log_pi - top), np.exp(log_psi - top), top


def _side_by_side(offsets: Array, n_nodes: int) -> Iterator[_Abreast]:
    """All demonstrations, as many abreast as memory and cache hold."""
    lengths = np.diff(offsets)
    order = np.argsort(-lengths, kind="stable")
    start = 0
    while start < len(order):
        longest = int(lengths[order[start]])
        abreast = max(1, min(_ABREAST // n_nodes, _ENTRIES // (n_nodes * longest)))
        chosen = order[start : start + abreast]
        alive = np.searchsorted(-lengths[chosen], -np.arange(longest), side="left")
        steps = np.minimum(offsets[chosen] + np.arange(longest)[:, None], offsets[-1] - 1)
        yield _Abreast(chosen, alive, steps)
        start += abreast
