"""What the raw outputs of a network mean: logits of K actions, or the mean of Student's distribution.

A head is frozen. It has the loss that trains a network, and the log-probability of an action given the outputs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete, Space
from rpil.numerics.blocks import at_actions, log_softmax, one_hot
from rpil.numerics.types import Array, Float
from rpil.policies.networks import Loss, Tensor, import_torch, on_device
from rpil.policies.protocol import Actions, Outputs
from rpil.policies.student import StudentPolicy


@dataclass(frozen=True)
class SoftmaxHead:
    """pi(k|s) = softmax of the raw outputs; outputs are the log-probabilities of all K actions."""

    width: int
    """K, the raw outputs of a network."""

    def read(self, raw: Float[Array, "*k N O"]) -> Float[Array, "*k N O"]:
        """Outputs, as in `rpil.policies.protocol`, of raw ones."""
        return log_softmax(raw)

    def average(self, outputs: Float[Array, "k N O"]) -> Outputs:
        """The outputs of the mean distribution of k networks."""
        return np.asarray(logsumexp(outputs, 0) - np.log(len(outputs)))

    def log_prob(self, outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        """log pi(a_n|s_n) of the actions taken."""
        return at_actions(outputs, actions)

    def loss(self, data: FitData, weight: Float[Array, " N"], device: str) -> Loss:
        """The loss that trains networks on weighted steps."""
        torch = import_torch()
        targets = on_device(one_hot(data.actions, weight, self.width), device)
        return lambda raw, rows: -(targets[rows] * torch.log_softmax(raw, dim=-1)).sum(dim=-1)

    def fit(self, data: FitData, weight: Float[Array, " N"], outputs: Outputs) -> SoftmaxHead:
        """The head fitted to held-out outputs for weighted steps; itself where nothing is to be fitted."""
        return self


@dataclass(frozen=True, eq=False)
class StudentHead:
    """a|s ~ t_nu(middle of the box + half its width * raw, Sigma); outputs are the means."""

    box: Box
    noise: StudentPolicy
    """Fitted to held-out errors: those of the steps that a network was trained on are too small."""

    @property
    def width(self) -> int:
        return len(self.box.low)

    def read(self, raw: Float[Array, "*k N O"]) -> Float[Array, "*k N O"]:
        return np.asarray(self._middle + self._half_width * raw)

    def average(self, outputs: Float[Array, "k N O"]) -> Outputs:
        return np.asarray(outputs.mean(axis=0))

    def log_prob(self, outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        return self.noise.log_prob(outputs, actions)

    def loss(self, data: FitData, weight: Float[Array, " N"], device: str) -> Loss:
        torch = import_torch()
        inverse, freedom = np.linalg.inv(self.noise.cholesky), self.noise.freedom
        standardised = (data.actions - self._middle) @ inverse.T, self._half_width[:, None] * inverse.T, weight
        actions, raw_to_standardised, weights = (on_device(values, device) for values in standardised)
        factor = 0.5 * (freedom + self.width)

        def loss(raw: Tensor, rows: Tensor) -> Tensor:
            distance = (actions[rows] - raw @ raw_to_standardised).square().sum(dim=-1)
            return weights[rows] * factor * torch.log1p(distance / freedom)

        return loss

    def fit(self, data: FitData, weight: Float[Array, " N"], outputs: Outputs) -> StudentHead:
        if not weight.any():
            return self
        # Features of zero: the errors have no mean to be predicted, only a distribution.
        errors = replace(data, features=np.zeros((len(outputs), 1)), actions=data.actions - outputs)
        return replace(self, noise=self.noise.fit(errors, weight)[0])

    @property
    def _middle(self) -> Array:
        return 0.5 * (self.box.low + self.box.high)

    @property
    def _half_width(self) -> Array:
        return 0.5 * (self.box.high - self.box.low)


Head = SoftmaxHead | StudentHead
"""What a neural policy needs of its outputs; `SoftmaxHead` says what the methods do."""


def initial_head(space: Space, n_steps: float) -> Head:
    """The head before training on steps of the total weight `n_steps`."""
    if isinstance(space, Discrete):
        return SoftmaxHead(space.n)
    return StudentHead(space, StudentPolicy.of_errors(space, n_steps))
