"""One pass over the data: sums over steps, computed in blocks of rows that stay in cache.

A pass reads the design matrix once, block by block. All other arrays of a pass are (N, K) with contiguous columns, so
that sums and maxima over a handful of actions are whole-array operations. The gradient and the Hessian products below
are those of weighted softmax regression on soft targets T (N, K), whose row sums are the weights of the steps:

    f(W) = - sum_nk T_nk log softmax(x_n W)_k + 1/2 sum_dk penalty_d W_dk^2
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rpil.numerics.types import Array, Float, Int

Sums = tuple[Any, ...]
"""Numbers, arrays and tuples of such that add up over parts of the data."""

BLOCK_BYTES = 1 << 19
"""Bytes of the design matrix in one block: half of a small second-level cache."""


def add(first: Sums, second: Sums) -> Sums:
    """The entrywise sums of two parts of the data."""
    return tuple(add(a, b) if isinstance(a, tuple) else a + b for a, b in zip(first, second, strict=True))


def blocks(features: Float[Array, "N D"]) -> Iterator[slice]:
    """Slices of whole rows, each about `BLOCK_BYTES` of `features`."""
    n_steps, n_features = features.shape
    rows = max(64, BLOCK_BYTES // (features.itemsize * n_features))
    for start in range(0, n_steps, rows):
        yield slice(start, min(start + rows, n_steps))


def linear(features: Float[Array, "N D"], weights: Float[Array, "D K"]) -> Float[Array, "N K"]:
    """The product X W in double precision with contiguous columns, each block in the precision of `features`."""
    out = np.empty((weights.shape[1], features.shape[0]))
    weights = weights.astype(features.dtype, copy=False)
    for block in blocks(features):
        out[:, block] = weights.T @ features[block].T
    return out.T


def log_softmax(logits: Float[Array, "*batch K"]) -> Float[Array, "*batch K"]:
    """``logits - logsumexp(logits)`` along the last axis."""
    shifted: Array = logits - logits.max(axis=-1, keepdims=True)
    shifted -= np.log(np.exp(shifted).sum(axis=-1, keepdims=True))
    return shifted


def one_hot(actions: Int[Array, " N"], weight: Float[Array, " N"], n_actions: int) -> Float[Array, "N K"]:
    """Targets with the weight of the step on the action taken, and 0 elsewhere."""
    targets = np.zeros((n_actions, len(actions)))
    targets[actions, np.arange(len(actions))] = weight
    return targets.T


def at_actions(log_proba: Float[Array, "N K"], actions: Int[Array, " N"]) -> Float[Array, " N"]:
    """The entry of each row that belongs to the action taken."""
    return np.take_along_axis(log_proba, actions[:, None], axis=1)[:, 0]


def gradient(features: Float[Array, "N D"], residual: Float[Array, "N K"]) -> Float[Array, "D K"]:
    """The product X^T R."""
    total = np.zeros((features.shape[1], residual.shape[1]))
    residual = residual.astype(features.dtype, copy=False)
    for block in blocks(features):
        total += (residual[block].T @ features[block]).T
    return total


def softmax_pass(
    features: Float[Array, "N D"], weights: Float[Array, "D K"], actions: Int[Array, " N"], weight: Float[Array, " N"]
) -> tuple[Float[Array, " N"], Float[Array, "D K"]]:
    """Log-probability of each action taken, and X^T R with R = s (onehot(a) - p), in one reading of X.

    The second is the gradient of the log-likelihood of steps with the weights s.
    """
    taken, total = np.empty(len(features)), np.zeros(weights.T.shape)
    weights, weight = (a.astype(features.dtype, copy=False) for a in (weights, weight))
    for block in blocks(features):
        rows, codes, s = features[block], actions[block], weight[block]
        at = codes, np.arange(len(codes))
        z = weights.T @ rows.T
        z -= z.max(axis=0)
        proba = np.exp(z)
        norm = proba.sum(axis=0)
        taken[block] = z[at] - np.log(norm)
        proba *= -s / norm
        proba[at] += s
        total += proba @ rows
    return taken, total.T


def hessian_product(
    features: Float[Array, "N D"],
    proba: Float[Array, "N K"],
    weight: Float[Array, " N"],
    direction: Float[Array, "D K"],
) -> Float[Array, "D K"]:
    """H V without the penalty: X^T [ s p (z - p.z) ] with z = X V, in one reading of X.

    `proba` are the probabilities p of the policy, `weight` the weights s of the steps, `direction` is V.
    """
    total = np.zeros(direction.shape)
    direction, proba, weight = (a.astype(features.dtype, copy=False) for a in (direction, proba, weight))
    for block in blocks(features):
        rows, p = features[block], proba[block].T
        z = direction.T @ rows.T
        z *= p
        z -= p * z.sum(axis=0)
        z *= weight[block]
        total += (z @ rows).T
    return total
