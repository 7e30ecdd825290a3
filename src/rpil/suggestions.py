"""Which labels would tell most about the other demonstrations.

The search finds several solutions: who is an expert, seen from different starts. Where they agree a label tells nothing
new; where they do not, it says which of them to believe, and with it what to think of everybody else. So the labels
asked for are those whose answers share most information with the question which solution is right (Lindley 1956; query
by committee, Seung et al. 1992; all k jointly, as BatchBALD does, Kirsch et al. 2019).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpil.passes import Array

_DOUBT = 0.03
"""Probability with which a label surprises a solution that is certain: none of them is quite right."""

_APART = 0.5
"""Solutions are different where they differ by so much on some demonstration."""

_MOST = 8
"""Solutions, and labels that are chosen jointly: 2^8 answers; after that one at a time."""


def opinions(proba: Array, others: Sequence[Array]) -> Array:
    """Distinct ones among P(expert) of each demonstration (M,), the winner's first: (H, M)."""
    found = [proba]
    for other in others:
        if len(found) < _MOST and all(np.abs(other - one).max() > _APART for one in found):
            found.append(other)
    return np.array(found)


def information(joint: Array) -> float:
    """I(answers; solution) in nats, from the joint probabilities of answers and solutions, (A, H)."""
    return _entropy(joint.sum(axis=0)) + _entropy(joint.sum(axis=1)) - _entropy(joint.ravel())


def _entropy(p: Array) -> float:
    p = p[p > 0]
    return float(-(p @ np.log(p)))
