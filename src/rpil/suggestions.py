"""Which labels would tell most about the other demonstrations.

The search finds several solutions: who is an expert, seen from different starts. Where they agree a label tells nothing
new; where they do not, its answer says which of them to believe, and with it what to think of everybody else. So the
labels asked for are those whose answers share most information with the question which solution is right (Lindley 1956;
query by committee, Seung et al. 1992), given the answers to those already asked for (BatchBALD, Kirsch et al. 2019).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import entr

from rpil.passes import Array

_DOUBT = 0.03
"""Probability with which a label surprises a solution that is certain: none of them is quite right."""

_APART = 0.5
"""Two solutions differ where they do so by this much on some demonstration."""

_MOST = 8
"""Solutions that are told apart, and labels that are chosen together: 2^8 answers."""

_OWN = 0.05
"""What the uncertainty of a verdict counts where the solutions agree, over what is learned about the solution."""

_LENGTH = 0.25
"""Power of its length with which a demonstration counts: the longer it is, the more there is to learn from."""


def opinions(proba: Array, others: Sequence[Array]) -> Array:
    """Those of P(expert) of each demonstration (M,) that differ, `proba` first, (H, M)."""
    found = [proba]
    for other in others:
        if len(found) < _MOST and all(np.abs(other - one).max() > _APART for one in found):
            found.append(other)
    return np.array(found)


def suggest(solutions: Array, groups: Sequence[Array], first: Sequence[int], lengths: Array, k: int) -> list[int]:
    """Up to `k` demonstrations to label, the most telling first.

    Parameters
    ----------
    solutions : (H, M) array
        P(expert), as `opinions` returns it; NaN where a demonstration is labelled already.
    groups : sequence of int arrays
        That compete for being the expert.
    first : sequence of int
        To be asked for before all others.
    lengths : (M,) array
    k : int
    """
    free = ~np.isnan(solutions[0])
    proba = np.where(free, np.clip(solutions, _DOUBT, 1 - _DOUBT), 0.5)
    leading = _each_an_expert(proba[0], groups)
    rest = proba[1:]
    proba = np.concatenate([leading, rest])
    weight = np.append(np.full(len(leading), 1 / len(leading)), np.full(len(rest), 1 / max(len(rest), 1)))
    joint = (weight / weight.sum())[None]  # of the answers so far and the solutions, (A, H)
    chosen: list[int] = []
    for asked in range(min(k, int(free.sum()))):
        if asked < len(first):
            best = first[asked]
        else:
            score = (_information(joint, proba) + _OWN * _entropy(weight @ proba / weight.sum())) * lengths**_LENGTH
            score[~free] = -np.inf
            best = int(np.argmax(score))
        chosen.append(best)
        free[best] = False
        if asked < _MOST:
            joint = np.concatenate([joint * proba[:, best], joint * (1 - proba[:, best])])
    return chosen


def _each_an_expert(proba: Array, groups: Sequence[Array]) -> Array:
    """`proba` if nobody competes, else once for each group, (G, M), with that group as the expert and no other."""
    out = np.tile(proba, (max(len(groups), 1), 1))
    for row, expert in zip(out, groups, strict=False):
        for group in groups:
            row[group] = 1 - _DOUBT if group is expert else _DOUBT
    return out


def _information(joint: Array, proba: Array) -> Array:
    """I(answer; solution | answers so far) in nats for each demonstration, (M,)."""
    of_answers = joint.sum(axis=1)
    expected = joint @ proba / of_answers[:, None]
    gain: Array = of_answers @ _entropy(expected) - joint.sum(axis=0) @ _entropy(proba)
    return gain


def _entropy(p: Array) -> Array:
    out: Array = entr(p) + entr(1 - p)
    return out
