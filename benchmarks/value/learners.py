"""Policies that are trained with a weight for each step: the library's linear one, and a network."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpil import BehavioralCloning
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array

MAX_SCALED = 5.0
"""Scaled observations are cut off here: a network need not go on beyond what it was shown."""


@dataclass(frozen=True)
class Training:
    """Of a network."""

    hidden: int = 128
    steps: int = 2000
    batch: int = 128
    rate: float = 1e-3
    """Of Adam; falls to 0 as half a cosine."""
    noise: float = 0.1
    """Standard deviation of what is added to scaled observations."""
    drawn: bool = False
    """Whether steps are drawn by their weights, instead of their errors being weighted."""


TRAINING = Training()
DISC_TRAINING = Training(steps=1000, rate=3e-3, noise=0.03)
"""For the disc: from 200 careful demonstrations a policy reaches 100 % with every seed, in less than a second."""


@dataclass(frozen=True, eq=False)
class Network:
    """Two hidden layers on scaled observations."""

    center: Array
    scale: Array
    layers: tuple[tuple[Array, Array], ...]
    """Weights (in, out) and biases."""
    classes: Array | None
    """The discrete actions."""

    def predict(self, observations: Array) -> Array:
        """Actions (n,) or (n, A) for observations (n, D)."""
        rows = np.clip((observations - self.center) / self.scale, -MAX_SCALED, MAX_SCALED).astype(np.float32)
        for weights, bias in self.layers[:-1]:
            rows = np.maximum(rows @ weights + bias, 0)
        outputs = rows @ self.layers[-1][0] + self.layers[-1][1]
        return outputs if self.classes is None else self.classes[outputs.argmax(axis=1)]


def linear(
    demonstrations: Demonstrations, weight: Array, seed: int, training: Training = TRAINING
) -> BehavioralCloning:
    """The library's final policy, in the features of its judge."""
    return BehavioralCloning(features="folded").fit(demonstrations, sample_weight=weight)


def network(demonstrations: Demonstrations, weight: Array, seed: int, training: Training = TRAINING) -> Network:
    """A network with two hidden layers."""
    actions = demonstrations.actions
    if demonstrations.is_discrete:
        classes, codes = np.unique(actions, return_inverse=True)
        return train(demonstrations.observations, codes, weight, seed, training, classes)
    return train(demonstrations.observations, actions, weight, seed, training)


def drawn_network(demonstrations: Demonstrations, weight: Array, seed: int, training: Training = TRAINING) -> Network:
    """A wider network that learns from steps drawn by their weights, without noise: a second way to learn."""
    return network(demonstrations, weight, seed, replace(training, hidden=256, noise=0.0, drawn=True))


def train(
    observations: Array, targets: Array, weight: Array, seed: int, training: Training, classes: Array | None = None
) -> Network:
    """Minimise the weighted squared error of actions, or cross entropy of `classes`, by Adam."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    used = weight > 0
    rows, w = observations[used], weight[used] / weight[used].mean()
    center = np.average(rows, axis=0, weights=w)
    spread = np.sqrt(np.average((rows - center) ** 2, axis=0, weights=w))
    scale = np.where(spread > 1e-6, spread, np.inf)  # a column that never changes says nothing
    x = torch.tensor(np.clip((rows - center) / scale, -MAX_SCALED, MAX_SCALED), dtype=torch.float32)
    y = torch.tensor(targets[used], dtype=torch.float32 if classes is None else torch.int64)
    w = torch.tensor(w, dtype=torch.float32)
    n_out = y.shape[1] if classes is None else len(classes)
    widths = (x.shape[1], training.hidden, training.hidden, n_out)
    linears = [torch.nn.Linear(a, b) for a, b in itertools.pairwise(widths)]
    net = torch.nn.Sequential(linears[0], torch.nn.ReLU(), linears[1], torch.nn.ReLU(), linears[2])
    adam = torch.optim.Adam(net.parameters(), lr=training.rate)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(adam, training.steps)
    drawn = torch.Generator().manual_seed(seed)
    for _ in range(training.steps):
        if training.drawn:
            batch = torch.multinomial(w, training.batch, replacement=True, generator=drawn)
        else:
            batch = torch.randint(len(x), (training.batch,), generator=drawn)
        seen = x[batch]
        out = net(seen + training.noise * torch.randn(seen.shape, generator=drawn))
        if classes is None:
            loss = ((out - y[batch]) ** 2).mean(dim=1)
        else:
            loss = torch.nn.functional.cross_entropy(out, y[batch], reduction="none")
        adam.zero_grad()
        (loss if training.drawn else w[batch] * loss).mean().backward()
        adam.step()
        slower.step()
    layers = tuple((each.weight.detach().numpy().T.copy(), each.bias.detach().numpy().copy()) for each in linears)
    return Network(center, scale, layers, classes)


Learner = Callable[[Demonstrations, Array, int, Training], Any]
LEARNERS: dict[str, Learner] = {"linear": linear, "network": network, "drawn network": drawn_network}
