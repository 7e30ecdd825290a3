"""A neural policy that cannot memorise bad data: what it says of a step comes from a network that never saw it.

A flexible policy explains whatever it was trained on, the actions of adversaries too, and its in-sample likelihood says
nothing of who is to be trusted. So there are k networks, each trained without the demonstrations of one fold, and what
the judge learns of a step is what the network without its demonstration says (cross-fitting, as cleanlab does by row).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import blake2b
from itertools import pairwise
from typing import Any

import numpy as np

from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space
from rpil.numerics.types import Array
from rpil.policies.heads import HEADS, Head
from rpil.policies.networks import Networks, Plan, raw_outputs, train, untrained

_N_PIECES = 20
"""Pieces that steps are cut into where no whole demonstration can be held out."""

_JUDGES = 5
"""One unit in so many is held out of a network that is in no need of a fold, to say when to stop."""

_LEAST = 0.01
"""Share of the weight from which somebody has learned something."""


@dataclass(frozen=True, eq=False)
class _Trained:
    """Networks, and how to read them.

    Attributes
    ----------
    networks : Networks
    center, spread : (D,) arrays
        What inputs are standardised with.
    head : Head
    """

    networks: Networks
    center: Array
    spread: Array
    head: Head


@dataclass(frozen=True, eq=False)
class TorchPolicy:
    """A multilayer perceptron for discrete or continuous actions, cross-fitted over demonstrations.

    Instances never change: `learn` gives a new policy. Same seed, same bits, on one CPU; no random state but its own is
    used. Discrete actions get a softmax; continuous ones Student's distribution around the network's outputs.

    Parameters
    ----------
    hidden : tuple of int
        Units of the hidden layers.
    n_folds : int
        Networks, each without the demonstrations of one fold; 1 is a single network that has seen everything, for
        those who only predict: the judge would trust what it has memorised.
    epochs : int
        Most readings of the data in one training.
    patience : int or None
        Readings without a gain on held-out demonstrations after which a network stops; it is then the best there was.
        With None all `epochs` are trained.
    batch_size : int
        Most steps in a mini-batch.
    learning_rate : float
        Adam's.
    device : str
        "cpu", "cuda", or whatever torch knows.
    seed : int
    scale : float or (A,) array, optional
        Standard deviations of continuous actions; by default they are learned, from held-out steps.
    space : Discrete or Box, optional
        Of the actions; `learn` finds it in the problem.

    Raises
    ------
    DataError
        Where a parameter makes no sense.
    MissingExtraError
        Where torch is not installed, at the first training.

    Examples
    --------
    >>> policy, outputs = TorchPolicy(hidden=(64,)).learn(problem, weight)    # doctest: +SKIP
    """

    hidden: tuple[int, ...] = (64, 64)
    n_folds: int = 5
    epochs: int = 200
    patience: int | None = 8
    batch_size: int = 256
    learning_rate: float = 3e-3
    device: str = "cpu"
    seed: int = 0
    scale: Any = None
    space: Space | None = None
    trained: _Trained | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "hidden", tuple(self.hidden))
        whole = {"n_folds": self.n_folds, "epochs": self.epochs, "batch_size": self.batch_size}
        whole |= {f"hidden[{layer}]": size for layer, size in enumerate(self.hidden)}
        whole |= {} if self.patience is None else {"patience": self.patience}
        for name, value in whole.items():
            if value != int(value) or value < 1:
                raise DataError(f"TorchPolicy: {name}={value!r} must be a whole number, 1 or more.")
        if not 0.0 < self.learning_rate < np.inf:
            raise DataError(f"TorchPolicy: learning_rate={self.learning_rate!r} must be a positive number.")
        if self.scale is not None and not np.all(np.asarray(self.scale, dtype=float) > 0):
            raise DataError(f"TorchPolicy: scale={self.scale!r} must be positive, one number or one for each part.")

    def for_space(self, space: Space) -> TorchPolicy:
        """The same for such actions, before it has seen any."""
        return replace(self, space=space, trained=None)

    def outputs(self, features: Array) -> Array:
        """Log-probabilities (N, K), or means (N, A): the average over the networks.

        Raises
        ------
        DataError
            Where a network's outputs are not finite, or nobody has said yet what actions there are.
        """
        if self.trained is None:
            if self.space is None:
                raise DataError("TorchPolicy: it has not learned yet, and does not know the actions; call learn first.")
            head = HEADS[self.space.kind](self.space, 1.0, self.scale)
            return head.read(np.zeros((len(features), head.width)))
        raw = raw_outputs(self.trained.networks, _standard(self.trained, features), self.device)
        return self.trained.head.average(self.trained.head.read(raw))

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n), (N,): of the codes (N,) of actions, or the density of (N, A)."""
        head = self.trained.head if self.trained else HEADS[self._known_space.kind](self._known_space, 1.0, self.scale)
        return head.log_prob(outputs, actions)

    def fit(self, data: FitData, weight: Array) -> tuple[TorchPolicy, Array]:
        """A policy for steps with `weight` (N,), and its outputs (N, ...), each from a network that did not see it.

        The networks are new ones. Fewer than three demonstrations are cut into pieces, each counting as one.

        Raises
        ------
        DataError
            Where the loss or a network's outputs are not finite, or torch does not know the device.
        MissingExtraError
            Where torch is not installed.
        """
        number = self._numbers(data)
        now = self._untrained(data, number)
        for phase in range(now.head.phases):
            now, _ = self._taught(now, data, number, weight, self.epochs, phase)
            raw = raw_outputs(now.networks, _standard(now, data.features), self.device)
            outputs = now.head.read(raw[number % len(raw), np.arange(len(number))])
            now = replace(now, head=now.head.fit(data, weight, outputs))
        return replace(self, space=data.space, trained=now), outputs

    def fit_all(self, data: FitData, weight: Array) -> TorchPolicy:
        """The policy of one new network that all steps by their `weight` (N,) have trained, for predicting.

        It is trained for as long as is best for new networks that are cross-fitted.
        """
        number = self._numbers(data)
        start = self._untrained(data, number)
        if self.trained is not None:
            start = replace(start, head=self.trained.head)  # it knows how far held-out actions are off
        elif start.head.phases > 1:
            start = replace(start, head=self.fit(data, weight)[0].trained.head)  # type: ignore[union-attr]
        epochs = self.epochs
        if self.patience is not None:
            epochs = max(self._taught(start, data, number, weight, epochs)[1], 1)
        single = replace(self, n_folds=1, space=data.space, patience=None)
        start = replace(single._untrained(data, number), head=start.head)
        final, _ = single._taught(start, data, number, weight, epochs)
        return replace(self, n_folds=1, space=data.space, trained=final)

    @property
    def _known_space(self) -> Space:
        if self.space is None:
            raise DataError("TorchPolicy: it has not learned yet, and does not know the actions; call learn first.")
        return self.space

    def _untrained(self, data: FitData, number: Array) -> _Trained:
        features = np.asarray(data.features, dtype=float)
        center, spread = features.mean(axis=0), features.std(axis=0)
        spread = np.where(spread > 1e-9 * np.maximum(np.abs(center), 1.0), spread, 1.0)
        head = HEADS[data.space.kind](data.space, len(data.actions), self.scale)
        n_networks = min(self.n_folds, int(number.max()) + 1)
        sizes = (features.shape[1], *self.hidden, head.width)
        networks = untrained(sizes, n_networks, np.random.default_rng([self.seed, 0]))
        return _Trained(networks, center, spread, head)

    def _numbers(self, data: FitData) -> Array:
        """The number of the unit of each step, (N,), which says who is held out of which network.

        It comes from what the unit holds, so that it does not depend on the order and copies share a fold.
        """
        units, keys = _units(data)
        distinct, at = np.unique(keys, return_inverse=True)
        place = np.random.default_rng([self.seed, 1]).permutation(len(distinct))
        return np.repeat(place[at], np.diff(units))

    def _taught(
        self, now: _Trained, data: FitData, number: Array, weight: Array, epochs: int, phase: int = 0
    ) -> tuple[_Trained, int]:
        """Networks after up to so many `epochs`, and how many were best; `number` (N,) is that of each step's unit."""
        n_folds = len(now.networks[0])
        learn, judge = _learn_and_judge(number, n_folds, weight)
        if self.patience is None:  # nothing but the fold itself is to be held out
            unseen = np.arange(n_folds)[:, None] == number % n_folds
            learn = ~unseen if n_folds > 1 else np.ones_like(learn)
        networks, when = train(
            now.networks,
            _standard(now, data.features),
            now.head.loss(data, weight, self.device),
            weight,
            learn,
            judge,
            Plan(epochs, self.patience, self.batch_size, self.learning_rate, self.device),
            np.random.default_rng([self.seed, 2, phase]),
        )
        return replace(now, networks=networks), when


def _standard(trained: _Trained, features: Array) -> Array:
    return (features - trained.center) / trained.spread


def _units(data: FitData) -> tuple[Array, list[int]]:
    """Where the units begin that are held out as a whole, and the end, (U + 1,); and a key to the contents of each."""
    offsets = data.offsets
    if len(offsets) < 4:
        offsets = np.unique(np.linspace(0, len(data.actions), _N_PIECES + 1).astype(int))
    columns = np.ascontiguousarray(data.features), np.ascontiguousarray(data.actions)
    keys = []
    for start, stop in pairwise(offsets):
        digest = blake2b(digest_size=8)
        for column in columns:
            digest.update(column[start:stop].tobytes())
        keys.append(int.from_bytes(digest.digest()))
    return offsets, keys


def _learn_and_judge(number: Array, n_folds: int, mass: Array) -> tuple[Array, Array]:
    """Steps that each network learns from, and those by which it is judged, both (k, N), given the `number` (N,) of
    each step's unit, and how much each step counts (N,).

    A network is judged by the fold that it has not seen: only when to stop, one number for all of them, is learned
    there. A single network has seen all; it leaves out every fifth unit. Where a few demonstrations hold all of the
    weight, nobody has learned who could be judged by them: then every fifth piece of the steps that count is left out.
    """
    if n_folds > 1:
        unseen = np.arange(n_folds)[:, None] == number % n_folds
        learn, judge = ~unseen, unseen
    else:
        unseen = np.zeros((1, len(number)), dtype=bool)
        judge = (number % _JUDGES == 0)[None]
        learn = ~judge
    taught, asked = ((rows * mass).sum(axis=1) for rows in (learn, judge))
    if asked[taught > _LEAST * mass.sum()].sum() <= _LEAST * mass.sum():
        place = np.cumsum(mass > 0.0) / max((mass > 0.0).sum(), 1)
        judge = ~unseen & (np.ceil(place * _N_PIECES) % _JUDGES == 0)
        learn = ~unseen & ~judge
    return learn, judge
