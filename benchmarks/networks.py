"""How well do networks tell who acts at random, and what do they learn? The table of docs/policies.md.

    python benchmarks/networks.py
    python benchmarks/networks.py --quick
    python benchmarks/networks.py --large --device cuda

Needs ``pip install 'rpil[torch]'``. Demonstrators follow a rule that no linear policy knows, and some act at random.
AUROC of good against bad demonstrations; the share of right actions in new states, or R^2 of numbers; the same of one
network that trusts all demonstrations alike, and of one that is trained on the good ones alone; seconds of a fit on one
core. Means over seeds. `reweight` runs a training loop as that of ``examples/plot_torch_loop.py``. With ``--large`` one
wider network, and 500 demonstrations of 200 steps, on every core or on a device of torch.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from sklearn.metrics import r2_score, roc_auc_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from skorch import NeuralNetClassifier, NeuralNetRegressor
from torch import nn

from rpil import RPIL, Demonstrations, reweight
from tables import table

Array = np.ndarray[Any, Any]
World = tuple[Demonstrations, Array]
"""Demonstrations, and which of them are good."""

N_SEEDS, N_NEW_STATES = 3, 4000
HIDDEN, WIDE = (64, 64), (256, 256)
LARGE = "40 % of 500 demonstrations of 200 steps act at random"


def rule(x: Array) -> Array:
    """Go left or right where both observations agree, else stay."""
    return np.where(x[:, 0] * x[:, 1] > 0, np.where(x[:, 0] > 0, 2, 0), 1)


def wave(x: Array) -> Array:
    return np.stack([np.sin(2 * x[:, 0]), np.abs(x[:, 1]) - 1], axis=1)


def classes(seed: int, n_bad: int = 12, n_idle: int = 0, steps: int = 40, n: int = 30) -> World:
    """Demonstrations of the rule, 5 % of all actions being anything; `n_bad` act at random."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n * steps, 2 + n_idle))
    actions = rule(x)
    good = rng.permutation(n) >= n_bad
    loose = (rng.random(len(x)) < 0.05) | ~np.repeat(good, steps)
    actions[loose] = rng.integers(3, size=loose.sum())
    return Demonstrations(x, actions, np.arange(n + 1) * steps), good


def numbers(seed: int, n_bad: int = 8, steps: int = 40, n: int = 24) -> World:
    """Demonstrations of the wave with errors of .1; `n_bad` act at random."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n * steps, 2))
    actions = wave(x) + 0.1 * rng.normal(size=(len(x), 2))
    good = rng.permutation(n) >= n_bad
    bad = ~np.repeat(good, steps)
    actions[bad] = rng.uniform(-2, 2, size=(bad.sum(), 2))
    return Demonstrations(x, actions, np.arange(n + 1) * steps), good


WORLDS: dict[str, Callable[[int], World]] = {
    "40 % act at random": classes,
    "60 % act at random": partial(classes, n_bad=18),
    "40 %, and 18 irrelevant observations": partial(classes, n_idle=18),
    "40 %, demonstrations of 8 steps": partial(classes, steps=8),
    "two numbers, 33 % act at random": numbers,
}


class Weighted:
    """The weights of steps for networks of skorch, which have none: they travel with the observations."""

    def fit(self, X: Array, y: Array, sample_weight: Array) -> Any:
        y = y if y.dtype == int else y.reshape(len(y), -1).astype(np.float32)
        return super().fit({"X": X, "weight": sample_weight}, y)

    def infer(self, x: Any, **_: Any) -> torch.Tensor:
        return super().infer((x["X"] if isinstance(x, dict) else x).float())

    def get_loss(self, y_pred: torch.Tensor, y_true: torch.Tensor, X: Any, **_: Any) -> torch.Tensor:
        loss = super().get_loss(y_pred, y_true).reshape(len(y_pred), -1).sum(dim=1)
        return (loss * X["weight"].to(loss)).mean()


class Classifier(Weighted, NeuralNetClassifier):
    """A network for classes."""


class Regressor(Weighted, NeuralNetRegressor):
    """A network for numbers, one or several."""

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags


def layers(sizes: tuple[int, ...]) -> nn.Sequential:
    """New layers, the same for the same sizes."""
    torch.manual_seed(0)
    linears = [nn.Linear(a, b) for a, b in pairwise(sizes)]
    return nn.Sequential(*(part for linear in linears for part in (linear, nn.ReLU())))[:-1]


def network(data: Demonstrations, hidden: tuple[int, ...] = HIDDEN, device: str = "cpu") -> Any:
    """A pipeline for such actions, trained by few steps on all of the data."""
    of_classes = data.actions.ndim == 1
    kind, loss = (Classifier, nn.CrossEntropyLoss) if of_classes else (Regressor, nn.HuberLoss)
    n_outputs = 3 if of_classes else data.actions.shape[1]
    net = kind(
        partial(layers, (data.observations.shape[1], *hidden, n_outputs)),
        device=device,
        criterion=loss,
        criterion__reduction="none",
        optimizer=torch.optim.LBFGS,
        optimizer__line_search_fn="strong_wolfe",
        optimizer__max_iter=30,
        lr=1.0,
        max_epochs=1,
        batch_size=-1,
        train_split=None,
        verbose=0,
        **({"classes": range(n_outputs)} if of_classes else {}),
    )
    return make_pipeline(StandardScaler(), net)


class Learner:
    """The network and the optimiser of a training loop."""

    def __init__(self, n_observations: int) -> None:
        self.net = layers((n_observations, *HIDDEN, 3))
        self.optimizer = torch.optim.Adam(self.net.parameters(), lr=3e-3)
        self.shuffle = torch.Generator().manual_seed(0)

    def predict(self, x: Array) -> Array:
        with torch.no_grad():
            return np.asarray(self.net(torch.as_tensor(x, dtype=torch.float32)).argmax(dim=1))


def log_prob(learner: Learner, observations: Array, actions: Array) -> torch.Tensor:
    with torch.no_grad():
        logits = learner.net(torch.as_tensor(observations, dtype=torch.float32))
    return torch.log_softmax(logits, dim=1)[torch.arange(len(actions)), torch.as_tensor(actions)]


def one_epoch(learner: Learner, observations: Array, actions: Array, weights: Array) -> None:
    x, a = torch.as_tensor(observations, dtype=torch.float32), torch.as_tensor(actions)
    w = torch.as_tensor(weights, dtype=torch.float32)
    for batch in torch.randperm(len(a), generator=learner.shuffle).split(64):
        learner.optimizer.zero_grad()
        loss = nn.functional.cross_entropy(learner.net(x[batch]), a[batch], reduction="none")
        (w[batch] * loss).mean().backward()
        learner.optimizer.step()


def by_policy(make: Callable[[Demonstrations], object], data: Demonstrations) -> tuple[Array, Any]:
    """Log-odds, and what predicts."""
    model = RPIL(policy=make(data)).fit(data)
    return model.audit_.log_odds, model


def by_loop(n_folds: int, data: Demonstrations) -> tuple[Array, Any]:
    learner = Learner(data.observations.shape[1])
    found = reweight(learner, data, log_prob=log_prob, train=one_epoch, n_folds=n_folds)
    return found.audit.log_odds, found.policy


METHODS: dict[str, Callable[[Demonstrations], tuple[Array, Any]]] = {
    "skorch": partial(by_policy, network),
    "reweight(n_folds=3)": partial(by_loop, 3),
    "reweight(n_folds=1)": partial(by_loop, 1),
}


def right(model: Any, data: Demonstrations) -> float:
    """The share of right actions in new states, or R^2."""
    x = np.random.default_rng(99).normal(size=(N_NEW_STATES, data.observations.shape[1]))
    predicted = model.predict(x)
    return float((predicted == rule(x)).mean() if data.actions.ndim == 1 else r2_score(wave(x), predicted))


def measured(
    method: Callable[[Demonstrations], tuple[Array, Any]],
    world: World,
    clock: Callable[[], float] = time.process_time,
) -> list[float]:
    """AUROC, right actions, and seconds by the `clock`."""
    data, good = world
    start = clock()
    log_odds, model = method(data)
    seconds = clock() - start
    return [float(roc_auc_score(good, log_odds)), right(model, data), seconds]


def naive(world: World) -> list[float]:
    """Right actions of networks that trust all demonstrations alike, and the good ones alone."""
    data, good = world
    known = []
    for trusted in (np.ones(len(good)), good.astype(float)):
        weight = {f"{network(data).steps[-1][0]}__sample_weight": np.repeat(trusted, np.diff(data.offsets))}
        known.append(right(network(data).fit(data.observations, data.actions, **weight), data))
    return known


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one world, one seed")
    parser.add_argument("--large", action="store_true", help="one wide network, many demonstrations, wall time")
    parser.add_argument("--device", default="cpu", help="of torch, with --large")
    options = parser.parse_args()
    print(large(options.device) if options.large else small(options.quick))


def large(device: str) -> str:
    """The table of a wide network on a `device`."""
    world = classes(0, n_bad=200, n_idle=18, steps=200, n=500)
    method = partial(by_policy, partial(network, hidden=WIDE, device=device))
    figures = [f"{figure:.3f}" for figure in measured(method, world, clock=time.perf_counter)]
    return table(["", "device", "AUROC", "right", "seconds"], [[LARGE, device, *figures]], 2)


def small(quick: bool) -> str:
    """The table of all worlds and methods."""
    torch.set_num_threads(1)  # networks so small only lose by more
    rows = []
    for name, make in list(WORLDS.items())[: 1 if quick else None]:
        worlds = [make(seed) for seed in range(1 if quick else N_SEEDS)]
        others = [f"{value:.3f}" for value in np.mean([naive(world) for world in worlds], axis=0)]
        for method, fit in METHODS.items():
            if method.startswith("reweight") and worlds[0][0].actions.ndim > 1:
                continue  # the loop is one for classes
            auroc, share, seconds = np.mean([measured(fit, world) for world in worlds], axis=0)
            rows.append([name, method, f"{auroc:.3f}", f"{share:.3f}", f"{seconds:.1f}", *others])
            name, others = "", ["", ""]
    return table(["", "method", "AUROC", "right", "seconds", "trusting all", "only the good"], rows, 2)


if __name__ == "__main__":
    main()
