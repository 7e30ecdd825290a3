"""A zoo of small made-up problems: softmax or linear experts, and bad demonstrations of every sort, from one seed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import softmax

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete, Space
from rpil.mixture.adversaries.named import adversary
from rpil.mixture.em import State
from rpil.mixture.expert_prior import ExpertPrior
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.policies.linear import linear_policy
from rpil.results.record import Audit

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Toy:
    """Demonstrations of which all is known."""

    observations: Array
    actions: Array
    offsets: Array
    space: Space
    is_good: Array
    labels: Array  # what the fit may know: 1 expert, -1 adversary, 0 nothing
    weights: Array  # of the softmax or linear expert, the constant last

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(f"d{m}" for m in range(len(self.is_good)))

    @property
    def groups(self) -> Array:
        return np.repeat(np.arange(len(self.is_good)), np.diff(self.offsets))

    @property
    def demonstrations(self) -> Demonstrations:
        return Demonstrations(self.observations, self.actions, self.offsets, self.ids)

    @property
    def means(self) -> Array:
        """What a linear expert means to do, (N, A)."""
        return self.observations @ self.weights[:-1] + self.weights[-1]

    def is_judged_right(self, audit: Audit) -> bool:
        """Whether the good demonstrations have the word for the better ones, and the bad ones the other."""
        return audit.verdicts == tuple(np.where(self.is_good, audit.vocabulary.upper, audit.vocabulary.lower))

    def problem(self, features: str = "raw") -> FitData:
        """As EM wants it."""
        design = FeatureMap.fit(features, self.observations, settings=FeatureSettings()).design(self.observations)
        return FitData(design, self.actions, self.offsets, self.space, self.labels)

    def labelled(self, labels: dict[int, int]) -> Toy:
        """The same with ``labels`` {index: 1 or -1}."""
        known = np.zeros(len(self.is_good), dtype=int)
        for m, label in labels.items():
            known[m] = label
        return replace(self, labels=known)


def make(
    kind: str,
    seed: int,
    *,
    n_actions: int = 3,
    n_observations: int = 2,
    n_good: int = 6,
    n_bad: int = 6,
    steps: tuple[int, int] = (20, 40),
    sharpness: float = 4.0,
) -> Toy:
    """Softmax experts in states of a standard Gaussian, the good demonstrations first.

    `kind` is what the bad ones do: "random" actions; "flipped" (K-1-k for k) or "shifted" (k+1 for k) ones; "noisy",
    half of them random; random in a "window" of half the steps; "none" spoils none.
    """
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=(n_observations + 1, n_actions)) * sharpness
    weights[-1] /= 4
    lengths = rng.integers(steps[0], steps[1], size=n_good + n_bad, endpoint=True)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    observations = rng.normal(size=(offsets[-1], n_observations))
    proba = softmax(observations @ weights[:-1] + weights[-1], axis=1)
    actions = (proba.cumsum(axis=1) < rng.random((offsets[-1], 1))).sum(axis=1)
    for m in range(n_good, n_good + n_bad):
        mine = slice(offsets[m], offsets[m + 1])
        anything = rng.integers(n_actions, size=len(actions[mine]))
        actions[mine] = _spoil(kind, actions[mine], anything, n_actions - 1 - actions[mine], rng)
    actions[:n_actions] = np.arange(n_actions)  # every action occurs
    is_good = np.arange(n_good + n_bad) < n_good
    return Toy(observations, actions, offsets, Discrete(n_actions), is_good, np.zeros(len(is_good), dtype=int), weights)


def _spoil(kind: str, actions: Array, anything: Array, flipped: Array, rng: np.random.Generator) -> Array:
    """The actions of a bad demonstration; `anything` are actions at random."""
    n, rows = len(actions), (slice(None), *[None] * (actions.ndim - 1))
    match kind:
        case "random":
            return anything
        case "flipped":
            return flipped
        case "shifted":
            return (actions + 1) % (flipped + actions + 1)  # of as many classes as there are
        case "noisy":
            return np.where((rng.permutation(n) < n / 2)[rows], anything, actions)
        case "window":
            return np.where(((np.arange(n) + rng.integers(n)) % n < n / 2)[rows], anything, actions)
        case "none":
            return actions
    raise ValueError(kind)


def make_continuous(
    kind: str,
    seed: int,
    *,
    n_parts: int = 2,
    n_observations: int = 3,
    n_good: int = 6,
    n_bad: int = 6,
    steps: tuple[int, int] = (20, 40),
    noise: float = 0.2,
) -> Toy:
    """Linear experts with Gaussian noise in states of a standard Gaussian, the good demonstrations first.

    `kind` is what the bad ones do: anything in the box at "random"; the expert's actions "flipped" at its middle;
    "noisy", half of them random; random in a "window" of half the steps; "smooth", another linear policy, as little
    noisy as the expert's; "none" spoils none.
    """
    rng = np.random.default_rng(seed)
    weights, others = rng.normal(size=(2, n_observations + 1, n_parts))
    lengths = rng.integers(steps[0], steps[1], size=n_good + n_bad, endpoint=True)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    observations = rng.normal(size=(offsets[-1], n_observations))
    error = noise * rng.normal(size=(offsets[-1], n_parts))
    actions = observations @ weights[:-1] + weights[-1] + error
    smooth = observations @ others[:-1] + others[-1] + error
    box = Box.around(np.concatenate([actions, smooth]) if kind == "smooth" else actions)
    for m in range(n_good, n_good + n_bad):
        mine = slice(offsets[m], offsets[m + 1])
        if kind == "smooth":
            actions[mine] = smooth[mine]
            continue
        anything = rng.uniform(box.low, box.high, size=actions[mine].shape)
        actions[mine] = _spoil(kind, actions[mine], anything, box.low + box.high - actions[mine], rng)
    is_good = np.arange(n_good + n_bad) < n_good
    return Toy(observations, actions, offsets, box, is_good, np.zeros(len(is_good), dtype=int), weights)


def continuous_zoo(seed: int = 0) -> dict[str, Toy]:
    """Name -> problem with continuous actions."""
    still = make_continuous("random", seed)
    still.actions[:, 1] = 3.0  # a part that never moves
    far = make_continuous("noisy", seed)
    far.actions[::17] *= 100.0
    return {
        "random": make_continuous("random", seed),
        "flipped": make_continuous("flipped", seed, n_bad=3),
        "noisy": make_continuous("noisy", seed, n_parts=1),
        "window": make_continuous("window", seed, n_observations=5),
        "smooth": make_continuous("smooth", seed, n_bad=4),
        "none bad": make_continuous("none", seed),
        "mostly bad": make_continuous("random", seed, n_good=2, n_bad=10),
        "one step each": make_continuous("random", seed, n_good=30, n_bad=20, steps=(1, 1)),
        "unequal lengths": make_continuous("random", seed, n_good=8, n_bad=8, steps=(1, 400), n_observations=1),
        "a part that never moves": replace(still, space=Box.around(still.actions)),
        "actions far off": replace(far, space=Box.around(far.actions)),
        "no noise at all": make_continuous("random", seed, noise=0.0),
        "labelled": make_continuous("smooth", seed, n_bad=8).labelled({0: 1, 13: -1}),
    }


def zoo(seed: int = 0) -> dict[str, Toy]:
    """Name -> problem."""
    constant = make("random", seed, n_observations=3)
    constant.observations[:, 1] = 7.0
    lengths = make("random", seed, n_good=8, n_bad=8, steps=(1, 400), n_observations=1)
    return {
        "random": make("random", seed),
        "flipped": make("flipped", seed, n_actions=4),
        "shifted": make("shifted", seed, n_bad=4),
        "noisy": make("noisy", seed, n_observations=5),
        "window": make("window", seed, n_actions=4),
        "none bad": make("none", seed),
        "mostly bad": make("random", seed, n_good=2, n_bad=10),
        "one step each": make("random", seed, n_good=30, n_bad=20, steps=(1, 1)),
        "unequal lengths": lengths,
        "constant observation": constant,
        "two actions": make("flipped", seed, n_actions=2, n_bad=3),
        "two actions, random": make("random", seed, n_actions=2, n_observations=1),
        "five actions": make("random", seed, n_actions=5),
        "labelled": make("flipped", seed, n_bad=8).labelled({0: 1, 13: -1}),
    }


RIDGE = 1e-3
"""A step."""


def ridge(problem: FitData) -> Array:
    """A weak penalty on all but the constant."""
    penalty = np.full(problem.features.shape[1], RIDGE * len(problem.actions))
    penalty[-1] = 0.0
    return penalty


def pooled_state(problem: FitData, which: str) -> State:
    """Where EM starts by default: the policy that trusts everybody."""
    zero = linear_policy(problem.space, ridge(problem), len(problem.actions))
    policy, _ = zero.fit(problem, np.ones(len(problem.actions)))
    return State(policy, adversary(which, problem.space, zero), ExpertPrior())


def coefficients(model: Any) -> tuple[Array, Array]:
    """Coefficients and intercepts of a linear policy on the columns of its features, shaped as scikit-learn's."""
    features, weights = model.features_, model.policy_.weights
    coef, intercept = (
        (weights[:-1] / features.scale[:, None]).T,
        weights[-1] - features.center / features.scale @ weights[:-1],
    )
    return (coef[1:] - coef[:1], intercept[1:] - intercept[:1]) if len(model.classes_) == 2 else (coef, intercept)


@contextmanager
def refused(match: str | None = None, error: type[Exception] = DataError) -> Iterator[Any]:
    """The block fails with one sentence, on one line."""
    with pytest.raises(error, match=match) as caught:
        yield caught
    message = str(caught.value)
    assert re.fullmatch(r"([^.\n]|\.(?! ))*\.", message), message


def refused_file(match: str, call: Callable[..., Any], path: Path, *arguments: Any) -> None:
    """A function of a file fails with one sentence that names it."""
    with refused(match) as caught:
        call(path, *arguments)
    assert path.name in str(caught.value)


def told(
    rule: Callable[[Array], Array], n_demonstrations: int = 8, n_steps: int = 120, seed: int = 0
) -> tuple[Array, Array, Array]:
    """Demonstrations of a rule on two observations: observations, actions, offsets."""
    rng = np.random.default_rng(seed)
    observations = rng.normal(size=(n_demonstrations * n_steps, 2))
    return observations, rule(observations).astype(int), np.arange(n_demonstrations + 1) * n_steps


def curved(o: Array) -> Array:
    """A rule of which no linear policy has a half."""
    return o[:, 0] * o[:, 1] > 0.0
