"""A neural policy whose outputs for each step come from a network that was trained without its demonstration.

A flexible policy explains all that it was trained on, the actions of adversaries included, so that its likelihoods of
those steps say nothing about trust. So there are k networks, each trained without the demonstrations of one fold, and
the judge sees the outputs for each fold of the network without it (cross-fitting, as in cleanlab for rows).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.settings_record import check_settings
from rpil.data.spaces import Space, simple_space
from rpil.numerics.types import Array, Bool, Float, Int, Num
from rpil.policies.folds import deal, pieces
from rpil.policies.heads import Head, initial_head
from rpil.policies.networks import (
    EVALUATION_ROWS,
    Loss,
    Networks,
    forward,
    import_torch,
    initial_networks,
    on_device,
    raw_outputs,
    read_only,
    single_threaded,
)
from rpil.policies.protocol import Actions, Outputs

N_PIECES = 20
"""Pieces into which steps are cut where no whole demonstration can be held out. Chosen by hand, not tuned."""
VALIDATED_EVERY = 5
"""One demonstration, or piece, in so many is validated on where there is one network. Chosen by hand, not tuned."""

MIN_VALIDATED_SHARE = 0.01
"""Share of the total weight that a network must be trained on to be validated. Chosen by hand, not tuned."""

N_TRAININGS = 3
"""Trainings at most, after each of which the head is fitted to held-out errors."""
MIN_BATCH = 16
"""Rows of a mini-batch, and mini-batches of an epoch, at least, where there are rows for both: small data need not many
epochs. Chosen by hand, not tuned."""


@dataclass(frozen=True, eq=False)
class _Trained:
    """Networks, the mean and standard deviation (D,) by which their inputs are standardised, and the head."""

    networks: Networks
    center: Float[Array, " D"]
    spread: Float[Array, " D"]
    head: Head

    def standardise(self, features: Array) -> Array:
        return np.asarray((features - self.center) / self.spread)


@dataclass(frozen=True, eq=False)
class TorchPolicy:
    """A multilayer perceptron for discrete or continuous actions, cross-fitted over demonstrations.

    pi(k|s) = softmax_k(f(s)) for discrete actions; a|s ~ t_nu(f(s), Sigma) for continuous ones, f being the network.
    Instances never change: `fit` returns a new policy. The same seed gives the same bits on one CPU; no other random
    state is used.

    Parameters
    ----------
    hidden : tuple of int
        Units of the hidden layers.
    n_folds : int
        Networks, each without the demonstrations of one fold. 1 is a single network that is trained on everything: for
        predicting alone, because the judge would trust the demonstrations that it has memorised.
    epochs : int
        Readings of the data in one training, at most.
    patience : int or None
        Epochs without a lower loss of held-out demonstrations after which training stops, with the networks of the best
        epoch. With None all `epochs` are trained.
    batch_size : int
        Steps of a mini-batch, at most.
    learning_rate : float
        Step size of Adam.
    device : str
        "cpu", "cuda", or another name that torch knows.
    seed : int
    space : Discrete or Box, optional
        Space of the actions; `fit` takes that of the data.

    Raises
    ------
    DataError
        If a parameter makes no sense.
    MissingExtraError
        If torch is not installed, at the first training.

    Examples
    --------
    >>> policy, outputs = TorchPolicy(hidden=(64,)).fit(data, weight)    # doctest: +SKIP
    """

    hidden: tuple[int, ...] = (64, 64)
    n_folds: int = 5
    epochs: int = 200
    patience: int | None = 8
    batch_size: int = 256
    learning_rate: float = 3e-3
    device: str = "cpu"
    seed: int = 0
    space: Space | None = None
    trained: _Trained | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "hidden", tuple(self.hidden))
        check_settings(self, seed="[0, inf)")

    def for_space(self, space: Space) -> TorchPolicy:
        """The policy for such actions, before it is fitted."""
        return replace(self, space=space, trained=None)

    def outputs(self, features: Num[Array, "N D"]) -> Outputs:
        """Log-probabilities (N, K), or means (N, A): the average over the networks.

        Raises
        ------
        DataError
            If a network's outputs are not finite, or the actions are not known yet.
        """
        head = self._head
        if self.trained is None:
            return head.read(np.zeros((len(features), head.width)))
        raw = raw_outputs(self.trained.networks, self.trained.standardise(features), self.device)
        return head.average(head.read(raw))

    def log_prob(self, outputs: Outputs, actions: Actions) -> Float[Array, " N"]:
        """log pi(a_n|s_n): of the codes (N,) of actions, or the density of (N, A)."""
        return self._head.log_prob(outputs, actions)

    def fit(self, data: FitData, weight: Float[Array, " N"]) -> tuple[TorchPolicy, Outputs]:
        """A policy for weighted steps, and the outputs for each step of the network trained without its demonstration.

        Training begins with new networks. Fewer than three demonstrations are cut into pieces, each treated as one.

        Raises
        ------
        DataError
            If the loss or a network's outputs are not finite, or torch does not know the device.
        MissingExtraError
            If torch is not installed.
        """
        unit = self._unit_of_step(data)
        trained = self._initial(data, unit)
        for phase in range(N_TRAININGS):
            trained, _ = self._train(trained, data, unit, weight, phase)
            raw = raw_outputs(trained.networks, trained.standardise(data.features), self.device)
            outputs = trained.head.read(raw[unit % len(raw), np.arange(len(unit))])
            last, trained = trained.head, replace(trained, head=trained.head.fit(data, weight, outputs))
            if trained.head is last:
                break
        return replace(self, space=simple_space(data.space), trained=trained), outputs

    def fit_all(self, data: FitData, weight: Float[Array, " N"]) -> TorchPolicy:
        """The policy of one new network that is trained on all weighted steps, for predicting.

        It is trained for the number of epochs that is best for new networks that are cross-fitted.
        """
        if self.trained is None:
            return self.fit(data, weight)[0].fit_all(data, weight)
        unit, head = self._unit_of_step(data), self.trained.head  # which was fitted to held-out errors
        start = replace(self._initial(data, unit), head=head)
        epochs = self.epochs
        if self.patience is not None:
            epochs = max(self._train(start, data, unit, weight)[1], 1)
        single = replace(self, n_folds=1, space=simple_space(data.space), patience=None, epochs=epochs)
        trained, _ = single._train(replace(single._initial(data, unit), head=head), data, unit, weight)
        return replace(self, n_folds=1, space=simple_space(data.space), trained=trained)

    @property
    def _head(self) -> Head:
        if self.trained is not None:
            return self.trained.head
        if self.space is None:
            raise DataError("TorchPolicy: it is not fitted and does not know the actions; call fit first.")
        return initial_head(self.space, 1.0)

    def _initial(self, data: FitData, unit: Array) -> _Trained:
        features = np.asarray(data.features, dtype=float)
        center, spread = features.mean(axis=0), features.std(axis=0)
        spread = np.where(spread > 1e-9 * np.maximum(np.abs(center), 1.0), spread, 1.0)
        head = initial_head(simple_space(data.space), len(data.actions))
        n_networks = min(self.n_folds, int(unit.max()) + 1)
        sizes = (features.shape[1], *self.hidden, head.width)
        networks = initial_networks(sizes, n_networks, np.random.default_rng([self.seed, 0]))
        return _Trained(networks, center, spread, head)

    def _unit_of_step(self, data: FitData) -> Int[Array, " N"]:
        """The number of each step's unit, which is held out as a whole, of the network `number` modulo k."""
        if data.n_demonstrations < 3:  # too few to hold out
            data = pieces(data, N_PIECES)
        return data.per_step(deal(data, data.n_demonstrations, self.seed))

    def _train(
        self, trained: _Trained, data: FitData, unit: Array, weight: Array, phase: int = 0
    ) -> tuple[_Trained, int]:
        """The networks after training, and the best epoch; `unit` (N,) is the unit of each step."""
        n_folds = len(trained.networks[0])
        learn, validation = training_and_validation(unit, n_folds, weight)
        if self.patience is None:  # without validation only the fold itself is held out
            learn = np.arange(n_folds)[:, None] != unit % n_folds if n_folds > 1 else np.ones_like(learn)
        inputs, loss = trained.standardise(data.features), trained.head.loss(data, weight, self.device)
        rng, split = np.random.default_rng([self.seed, 2, phase]), (learn, validation)
        networks, epoch = train(self, trained.networks, inputs, weight, loss, split, rng)
        return replace(trained, networks=networks), epoch


def training_and_validation(
    unit: Int[Array, " N"], n_folds: int, weight: Float[Array, " N"]
) -> tuple[Bool[Array, "k N"], Bool[Array, "k N"]]:
    """Steps that each network is trained on, and those of its validation loss.

    The validation loss decides when training stops, at one epoch for all networks. A network is validated on its
    fold; a single network on one unit in five. Where a few demonstrations have all of the weight, no network that is
    trained on them could be validated on its fold: then one piece in five of the steps with weight is.

    There are `n_folds` networks k, and `unit` is the number of each step's unit.
    """
    if n_folds > 1:
        held_out = np.arange(n_folds)[:, None] == unit % n_folds
        validation = held_out
    else:
        held_out = np.zeros((1, len(unit)), dtype=bool)
        validation = (unit % VALIDATED_EVERY == 0)[None]
    learn = ~validation
    trained, validated = ((rows * weight).sum(axis=1) for rows in (learn, validation))
    least = MIN_VALIDATED_SHARE * weight.sum()
    if validated[trained > least].sum() <= least:
        place = np.cumsum(weight > 0.0) / max((weight > 0.0).sum(), 1)
        validation = ~held_out & (np.ceil(place * N_PIECES) % VALIDATED_EVERY == 0)
        learn = ~held_out & ~validation
    return learn, validation


@single_threaded()
def train(
    policy: TorchPolicy,
    networks: Networks,
    inputs: Float[Array, "N D"],
    weight: Float[Array, " N"],
    loss: Loss,
    split: tuple[Bool[Array, "k N"], Bool[Array, "k N"]],
    rng: np.random.Generator,
) -> tuple[Networks, int]:
    """The networks after training by Adam as the `policy` says, and the epoch, counted from 1, of the lowest validation
    loss, 0 for the start; `split` is `training_and_validation`.

    One epoch is the best of all networks: the validation rows of a single network may be few, and all an adversary's.
    The start is a candidate too, so that the validation loss never rises. Without `patience` the networks are those of
    the last epoch. `rng` draws the order of the rows. A `DataError` where the loss is not finite.
    """
    torch, (learn, validation) = import_torch(), split
    used = np.flatnonzero((weight > 0.0) & learn.any(axis=0))
    if not len(used):
        return networks, 0
    parameters = [on_device(array, policy.device).requires_grad_() for array in networks]
    device = parameters[0].device
    inputs = on_device(inputs, policy.device)
    # the factor of a row's loss in a mean: over the rows of its network, and over the validation rows of all
    train_weight = learn / np.maximum((learn * weight).sum(axis=1, keepdims=True), 1e-12)
    of_train = on_device(train_weight, policy.device)
    of_validation = on_device(validation / max(float((validation * weight).sum()), 1e-12), policy.device)
    validated = torch.from_numpy(np.flatnonzero((weight > 0.0) & validation.any(axis=0))).to(device)
    size = int(np.clip(len(used) // MIN_BATCH, MIN_BATCH, policy.batch_size))
    adam = torch.optim.Adam(parameters, lr=policy.learning_rate)

    def validation_loss() -> float:
        with torch.no_grad():
            parts = validated.split(EVALUATION_ROWS)
            return float(sum((loss(forward(parameters, inputs[p]), p) * of_validation[:, p]).sum() for p in parts))

    best, best_epoch, kept = validation_loss(), 0, [p.detach().clone() for p in parameters]
    for epoch in range(1, policy.epochs + 1):
        total = torch.zeros((), device=device)
        for batch in torch.from_numpy(rng.permutation(used)).to(device).split(size):
            adam.zero_grad(set_to_none=True)
            value = (loss(forward(parameters, inputs[batch]), batch) * of_train[:, batch]).sum()
            (value * (len(used) / len(batch))).backward()
            adam.step()
            total += value.detach()
        now = validation_loss()
        if not np.isfinite(now + float(total)):
            raise DataError(
                f"The network's loss is not finite in epoch {epoch}; look for extreme observations, or lower "
                f"learning_rate={policy.learning_rate:g}."
            )
        if now < best or policy.patience is None:
            best, best_epoch, kept = now, epoch, [p.detach().clone() for p in parameters]
        elif epoch - best_epoch >= policy.patience:
            break
    return tuple(read_only(p.cpu().numpy()) for p in kept), best_epoch
