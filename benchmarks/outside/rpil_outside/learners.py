"""Train the small network that every world drives, with a weight for each step.

Two hidden layers on scaled observations; Adam; each batch is drawn by the weights of the steps. Numbers are
regressed, and of classes the cross entropy is minimised. NumPy alone, so that a fit takes a second of one core and
gives the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

MAX_SCALED = 5.0
"""Scaled observations are cut off here: a policy need not go on beyond what it was shown."""


@dataclass(frozen=True, eq=False)
class Network:
    """A fitted policy."""

    center: np.ndarray
    scale: np.ndarray
    layers: list[tuple[np.ndarray, np.ndarray]]
    """Weights (in, out) and biases."""
    classes: np.ndarray | None

    def outputs(self, observations: np.ndarray) -> np.ndarray:
        """Return actions, or logits of the classes, (n, outputs)."""
        return _forward(_scaled(observations, self.center, self.scale), self.layers)[-1]

    def predict(self, observations: np.ndarray) -> np.ndarray:
        """Return actions (n, A), or the likeliest class (n,)."""
        out = self.outputs(observations)
        return out if self.classes is None else self.classes[out.argmax(axis=1)]

    def sample(self, observations: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw a class (n,) by its probability."""
        logits = self.outputs(observations)
        return self.classes[(logits + rng.gumbel(size=logits.shape)).argmax(axis=1)]  # a draw by the softmax


def fit(
    observations: np.ndarray,
    actions: np.ndarray,
    weights: np.ndarray,
    seed: int,
    *,
    steps: int = 1500,
    hidden: int = 64,
    batch: int = 128,
    rate: float = 3e-3,
    noise: float = 0.03,
    discrete: bool = False,
) -> Network:
    """Fit a network to steps (N, D) and their actions (N, A), or classes (N,), drawn in proportion to `weights` (N,).

    `noise` is the standard deviation of what is added to scaled observations.
    """
    rng = np.random.default_rng([seed, 77])
    weights = np.clip(np.asarray(weights, dtype=float), 0, None)
    if not weights.any():
        weights = np.ones(len(observations))  # with nothing to prefer, all are used
    share = weights / weights.sum()
    center = share @ observations
    spread = np.sqrt(share @ (observations - center) ** 2)
    scale = np.where(spread > 1e-6, spread, np.inf)  # a column that never changes says nothing
    x = _scaled(observations, center, scale)
    classes, y = (np.unique(actions, return_inverse=True)) if discrete else (None, actions.astype(np.float32))
    widths = (x.shape[1], hidden, hidden, len(classes) if discrete else y.shape[1])
    layers = [
        (rng.normal(0, np.sqrt(2 / a), (a, b)).astype(np.float32), np.zeros(b, dtype=np.float32))
        for a, b in pairwise(widths)
    ]
    moments = [[np.zeros_like(p), np.zeros_like(p)] for layer in layers for p in layer]
    drawn = rng.choice(len(x), size=(steps, batch), p=share)
    for n, rows in enumerate(drawn, start=1):
        seen = x[rows] + noise * rng.standard_normal((batch, x.shape[1]), dtype=np.float32)
        gradients = _gradients(seen, y[rows], layers, discrete)
        now = rate * (1 + np.cos(np.pi * n / steps)) / 2
        for p, g, (m, v) in zip((p for layer in layers for p in layer), gradients, moments, strict=True):
            m += 0.1 * (g - m)
            v += 0.001 * (g * g - v)
            p -= now * (m / (1 - 0.9**n)) / (np.sqrt(v / (1 - 0.999**n)) + 1e-8)
    return Network(center, scale, layers, classes)


def _scaled(observations: np.ndarray, center: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.clip((observations - center) / scale, -MAX_SCALED, MAX_SCALED).astype(np.float32)


def _forward(x: np.ndarray, layers: list[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """Return what goes into each layer, and the output."""
    values = [x]
    for weights, bias in layers[:-1]:
        values.append(np.maximum(values[-1] @ weights + bias, 0))
    weights, bias = layers[-1]
    return [*values, values[-1] @ weights + bias]


def _gradients(
    x: np.ndarray, y: np.ndarray, layers: list[tuple[np.ndarray, np.ndarray]], discrete: bool
) -> list[np.ndarray]:
    """Return the gradient of the mean loss for each weight and bias, in the order of the layers."""
    *values, out = _forward(x, layers)
    if discrete:
        error = np.exp(out - out.max(axis=1, keepdims=True))
        error /= error.sum(axis=1, keepdims=True)
        error[np.arange(len(y)), y] -= 1
    else:
        error = 2 * (out - y) / y.shape[1]
    error /= len(x)
    found: list[np.ndarray] = []
    for k in reversed(range(len(layers))):
        found = [values[k].T @ error, error.sum(axis=0), *found]
        error = (error @ layers[k][0].T) * (values[k] > 0) if k else error
    return found
