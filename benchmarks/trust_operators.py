"""Two operators with known policies who act alike in most states, for the style worlds of trust_worlds.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax
from scipy.stats import norm

N_STATES, N_ACTIONS, N_CONTROLS, MEMORY = 8, 4, 3, 0.9
"""Numbers in a state, discrete actions, numbers in a continuous action, correlation of a state with the next."""

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Operators:
    """Two operators who act by the same softmax (linear Gaussian) policy, except where a state lies beyond a plane:
    there the second acts by another policy.

    Attributes
    ----------
    weights : (2, N_STATES, K or A) array
    normal : (N_STATES,) array
        Of length 1, across the plane.
    threshold : float
        How far from the origin the plane is.
    continuous : bool
        Whether actions are numbers with an error of standard deviation 1.
    """

    weights: Array
    normal: Array
    threshold: float
    continuous: bool

    @classmethod
    def drawn(cls, difference: int, continuous: bool, rng: np.random.Generator) -> Operators:
        """At random; the plane cuts off `difference` percent of all states."""
        normal = rng.normal(size=N_STATES)
        weights = rng.normal(size=(2, N_STATES, N_CONTROLS if continuous else N_ACTIONS)) / np.sqrt(N_STATES)
        weights *= 0.6 if continuous else 1.5
        return cls(weights, normal / np.linalg.norm(normal), norm.ppf(1 - difference / 100), continuous)

    def outputs(self, states: Array) -> Array:
        """Mean actions, or log-probabilities of all actions, of the two, (2, N, A or K)."""
        usual, other = states @ self.weights
        beyond = states @ self.normal > self.threshold
        both = np.stack([usual, np.where(beyond[:, None], other, usual)])
        return both if self.continuous else log_softmax(both, axis=-1)

    def act(self, outputs: Array, rng: np.random.Generator) -> Array:
        """An action for each row of outputs."""
        return outputs + rng.normal(size=outputs.shape) if self.continuous else drawn(outputs, rng)

    def divergence(self, own: Array, other: Array) -> Array:
        """Expected log ratio of the likelihood under the own policy to that under the other, (N,)."""
        if self.continuous:
            return 0.5 * ((own - other) ** 2).sum(axis=1)
        return (np.exp(own) * (own - other)).sum(axis=1)

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """Log-likelihood of actions, (N,), up to a constant where they are numbers."""
        if self.continuous:
            return -0.5 * ((actions - outputs) ** 2).sum(axis=1)
        return np.take_along_axis(outputs, actions[:, None], axis=1)[:, 0]


def wandering(size: int, steps: int, rng: np.random.Generator) -> Array:
    """Stationary AR(1) series of standard normal states, (size, steps, N_STATES)."""
    states = rng.normal(size=(size, steps, N_STATES))
    for n in range(1, steps):
        states[:, n] = MEMORY * states[:, n - 1] + np.sqrt(1 - MEMORY**2) * states[:, n]
    return states


def drawn(log_proba: Array, rng: np.random.Generator) -> Array:
    """One action for each row of log-probabilities, (N, K) -> (N,): the largest after adding Gumbel noise."""
    return (log_proba + rng.gumbel(size=log_proba.shape)).argmax(axis=1)
