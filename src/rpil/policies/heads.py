"""What the raw outputs of a network mean: preferences among K actions, or the middle of Student's distribution.

A head is frozen. It knows the loss that trains a network, and what the policy says of an action given the outputs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy.special import logsumexp

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.numerics.blocks import log_softmax
from rpil.numerics.types import Array
from rpil.policies.networks import Loss, needs_torch, on_device
from rpil.policies.softmax import one_hot
from rpil.policies.student import StudentPolicy


@runtime_checkable
class Head(Protocol):
    """What a neural policy needs of its head."""

    @property
    def width(self) -> int:
        """O, the raw outputs of a network."""

    @property
    def phases(self) -> int:
        """How often to train, the head being fitted in between."""

    def read(self, raw: Array) -> Array:
        """Outputs as `Policy` has them, (..., N, O), of raw ones."""

    def average(self, outputs: Array) -> Array:
        """What networks say together, (k, N, O) -> (N, O)."""

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """Of the actions taken, (N,)."""

    def loss(self, data: FitData, weight: Array, device: str) -> Loss:
        """What to train with."""

    def fit(self, data: FitData, weight: Array, outputs: Array) -> Head:
        """The head that suits outputs (N, O) which were not trained on these steps."""


@dataclass(frozen=True)
class SoftmaxHead:
    """pi(k|s) = softmax of the raw outputs; outputs are the log-probabilities of all K actions."""

    width: int
    phases: int = 1

    def read(self, raw: Array) -> Array:
        return log_softmax(raw)

    def average(self, outputs: Array) -> Array:
        return logsumexp(outputs, 0) - np.log(len(outputs))

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        return np.take_along_axis(outputs, actions[:, None], axis=1)[:, 0]

    def loss(self, data: FitData, weight: Array, device: str) -> Loss:
        torch = needs_torch()
        targets = on_device(one_hot(data.actions, weight, self.width), device)
        return lambda raw, rows: -(targets[rows] * torch.log_softmax(raw, dim=-1)).sum(dim=-1)

    def fit(self, data: FitData, weight: Array, outputs: Array) -> SoftmaxHead:
        return self


@dataclass(frozen=True, eq=False)
class StudentHead:
    """a|s ~ t_nu(middle + half width * raw, Sigma); outputs are the means.

    Attributes
    ----------
    box : Box
    noise : StudentPolicy
        A linear policy of nothing, of which only the distribution around the means is of use.
    fixed : bool
        Whether that is given, and not learned. Else it is learned from outputs for steps that were held out: on those
        it was trained on, a network would seem surer than it has a right to be.
    """

    box: Box
    noise: StudentPolicy
    fixed: bool

    @classmethod
    def start(cls, box: Box, n_steps: float, scale: Array | None) -> StudentHead:
        """Very unsure, or with the standard deviations `scale` (A,)."""
        noise = StudentPolicy.of_errors(box, n_steps)
        if scale is not None:
            noise = replace(noise, cholesky=np.diag(np.broadcast_to(scale, box.low.shape).astype(float)))
        return cls(box, noise, scale is not None)

    @property
    def width(self) -> int:
        return len(self.box.low)

    @property
    def phases(self) -> int:
        return 1 if self.fixed else 3

    def read(self, raw: Array) -> Array:
        middle, half = self._units
        return middle + half * raw

    def average(self, outputs: Array) -> Array:
        mean: Array = outputs.mean(axis=0)
        return mean

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        return self.noise.log_prob(outputs, actions)

    def loss(self, data: FitData, weight: Array, device: str) -> Loss:
        torch = needs_torch()
        middle, half = self._units
        inverse, freedom = np.linalg.inv(self.noise.cholesky), self.noise.freedom
        white = (data.actions - middle) @ inverse.T, half[:, None] * inverse.T, weight
        actions, shrink, weights = (on_device(values, device) for values in white)
        factor = 0.5 * (freedom + self.width)

        def loss(raw: Any, rows: Any) -> Any:
            distance = (actions[rows] - raw @ shrink).square().sum(dim=-1)
            return weights[rows] * factor * torch.log1p(distance / freedom)

        return loss

    def fit(self, data: FitData, weight: Array, outputs: Array) -> StudentHead:
        if self.fixed or not weight.any():
            return self
        # Features of zero: nothing of what is left over can be predicted, there is only its distribution.
        left = replace(data, features=np.zeros((len(outputs), 1)), actions=data.actions - outputs)
        return replace(self, noise=self.noise.fit(left, weight)[0])

    @property
    def _units(self) -> tuple[Array, Array]:
        return 0.5 * (self.box.low + self.box.high), 0.5 * (self.box.high - self.box.low)


HEADS: dict[str, Callable[[Any, float, Array | None], Head]] = {
    "discrete": lambda space, n_steps, scale: SoftmaxHead(space.n),
    "continuous": StudentHead.start,
}
"""Kind of actions -> the head before it has seen data, given the space, the steps it will see and a fixed scale."""
