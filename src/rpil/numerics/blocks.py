"""What one pass over the data computes: sums over steps, in blocks that stay in cache.

The design matrix is read once per pass, block by block; everything else a pass touches is (N, K), each column
contiguous, so that sums and maxima over a handful of actions are whole-array operations. Objective, gradient and
Hessian products below are those of weighted softmax regression on soft targets T (N, K), whose row sums are the weights
of the steps:

    f(W) = - sum_nk T_nk log softmax(x_n W)_k + 1/2 sum_dk penalty_d W_dk^2
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rpil.numerics.types import Array

Sums = tuple[Any, ...]
"""Arrays, and tuples of such, that add up over parts of the data."""

BLOCK_BYTES = 1 << 19
"""Bytes of the design matrix in one block: half of a small second-level cache."""


def add(one: Any, other: Any) -> Any:
    """`Sums` of two parts of the data are those of both together."""
    if isinstance(one, tuple):
        return tuple(add(a, b) for a, b in zip(one, other, strict=True))
    return one + other


def blocks(features: Array) -> Iterator[slice]:
    """Slices of whole rows, each about `BLOCK_BYTES` of `features` (N, D)."""
    n_steps, n_features = features.shape
    rows = max(64, BLOCK_BYTES // (features.itemsize * n_features))
    for start in range(0, n_steps, rows):
        yield slice(start, min(start + rows, n_steps))


def linear(features: Array, weights: Array) -> Array:
    """The product X W in double precision, (N, K), columns contiguous, each block in the precision of `features`."""
    out = np.empty((weights.shape[1], features.shape[0]))
    weights = weights.astype(features.dtype, copy=False)
    for block in blocks(features):
        out[:, block] = weights.T @ features[block].T
    return out.T


def log_softmax(logits: Array) -> Array:
    """``logits - logsumexp(logits)`` along the last axis, (N, K)."""
    shifted = logits - logits.max(axis=-1, keepdims=True)
    shifted -= np.log(np.exp(shifted).sum(axis=-1, keepdims=True))
    return shifted


def gradient(features: Array, residual: Array) -> Array:
    """The product X^T R, (D, K), for residuals R (N, K)."""
    total = np.zeros((features.shape[1], residual.shape[1]))
    residual = residual.astype(features.dtype, copy=False)
    for block in blocks(features):
        total += (residual[block].T @ features[block]).T
    return total


def softmax_pass(features: Array, weights: Array, actions: Array, weight: Array) -> tuple[Array, Array]:
    """Log-probability of each action taken, (N,), and X^T R with R = s (onehot(a) - p), (D, K), in one reading of X.

    That is the gradient of the log-likelihood of steps with the weights s (N,). Nothing is kept of a block but these.
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


def hessian_product(features: Array, proba: Array, weight: Array, direction: Array) -> Array:
    """H V without the penalty, (D, K): X^T [ s p (z - p.z) ] with z = X V, in one reading of X.

    `proba` (N, K) are the policy's probabilities, `weight` (N,) the weights s of the steps, `direction` V is (D, K).
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
