"""Multilayer perceptrons of one shape, trained together: all code that uses torch, with `heads`.

The networks of a cross-fit see the same rows, each without those of its fold. Stacked into (k, in, out) matrices they
are one computation, so that k small networks take little longer than one. Between computations they are read-only NumPy
arrays, which can be shared, saved and compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rpil.data.errors import DataError, MissingExtraError
from rpil.numerics.types import Array, Bool, Float, Num, Shaped

Tensor = Any
"""``torch.Tensor``; torch is imported only when a network is used."""

Networks = tuple[Shaped[Array, "..."], ...]
"""Weights (k, in, out) and biases (k, 1, out) of each layer in turn, float32."""

Loss = Callable[[Tensor, Tensor], Tensor]
"""The loss (k, B) of raw outputs (k, B, O) and the indices (B,) of their rows, times the weights of the rows."""

EVALUATION_ROWS = 1 << 16
"""Rows that go through the networks at a time without training: bounds the memory."""


@dataclass(frozen=True)
class TrainingSettings:
    """How networks are trained, by Adam on mini-batches."""

    epochs: int
    """Readings of the data, at most."""
    patience: int | None
    """Epochs without a lower validation loss after which training stops; the networks are those of the best epoch. With
    None there is no validation, and the networks are those of the last epoch."""
    batch_size: int
    """Rows of a mini-batch, at most."""
    learning_rate: float
    """Step size of Adam."""
    device: str
    """What torch calls it: "cpu", "cuda", or another."""
    min_updates: int = 16
    """Mini-batches of an epoch, at least, unless `min_batch_size` forbids them: small data need not many epochs. Chosen
    by hand, not tuned."""
    min_batch_size: int = 16
    """Rows of a mini-batch, at least. Chosen by hand, not tuned."""


class TrainingRows(NamedTuple):
    """The rows that networks are trained on."""

    inputs: Float[Array, "N D"]
    weight: Float[Array, " N"]
    """Weights of the rows; `Loss` includes them."""
    train: Bool[Array, "k N"]
    validation: Bool[Array, "k N"]
    """Rows that each network is trained on, and those of its validation loss."""


def import_torch() -> Any:
    """The module torch; a `MissingExtraError` where it is not installed."""
    try:
        import torch  # lazily: it takes seconds, and most users do not need it
    except ImportError as error:
        raise MissingExtraError("A neural policy", "torch") from error
    return torch


@contextmanager
def single_threaded() -> Iterator[None]:
    """torch with one thread: small networks are slower with more, above all on a busy machine, and the bits would
    depend on the number of cores."""
    torch = import_torch()
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def initial_networks(sizes: tuple[int, ...], n_networks: int, rng: np.random.Generator) -> Networks:
    """Networks with layers of these sizes, inputs and outputs included: He's initialisation, and zeros in the last
    layer, so that all raw outputs are zero."""
    networks: list[Array] = []
    for layer, (n_in, n_out) in enumerate(pairwise(sizes)):
        bound = np.sqrt(6.0 / n_in) if layer < len(sizes) - 2 else 0.0
        networks += [rng.uniform(-bound, bound, (n_networks, n_in, n_out)), np.zeros((n_networks, 1, n_out))]
    return tuple(_read_only(array) for array in networks)


@single_threaded()
def raw_outputs(networks: Networks, inputs: Num[Array, "N D"], device: str) -> Float[Array, "k N O"]:
    """The raw outputs of every network; a `DataError` where one is not finite."""
    torch = import_torch()
    parameters = [on_device(array, device) for array in networks]
    parts = []
    with torch.no_grad():
        for start in range(0, max(len(inputs), 1), EVALUATION_ROWS):
            rows = on_device(inputs[start : start + EVALUATION_ROWS], device)
            parts.append(_forward(parameters, rows).cpu().numpy())
    out = np.concatenate(parts, axis=1).astype(float)
    if not np.isfinite(out).all():
        raise DataError("The network's outputs are not finite; look for extreme observations, or train it again.")
    return out


@single_threaded()
def train(
    networks: Networks, rows: TrainingRows, loss: Loss, settings: TrainingSettings, rng: np.random.Generator
) -> tuple[Networks, int]:
    """The networks after training, and the epoch, counted from 1, of the lowest validation loss, 0 for the start.

    One epoch is the best of all networks: the validation rows of a single network may be few, and all an adversary's.
    The start is a candidate too, so that the validation loss never rises. `rng` draws the order of the rows. A
    `DataError` where the loss is not finite.
    """
    torch, weight = import_torch(), rows.weight
    used = np.flatnonzero((weight > 0.0) & rows.train.any(axis=0))
    if not len(used):
        return networks, 0
    parameters = [on_device(array, settings.device).requires_grad_() for array in networks]
    device = parameters[0].device
    inputs = on_device(rows.inputs, settings.device)
    # the factor of a row's loss in a mean: over the rows of its network, and over the validation rows of all
    train_weight = rows.train / np.maximum((rows.train * weight).sum(axis=1, keepdims=True), 1e-12)
    of_train = on_device(train_weight, settings.device)
    of_validation = on_device(rows.validation / max(float((rows.validation * weight).sum()), 1e-12), settings.device)
    validation = torch.from_numpy(np.flatnonzero((weight > 0.0) & rows.validation.any(axis=0))).to(device)
    size = int(np.clip(len(used) // settings.min_updates, settings.min_batch_size, settings.batch_size))
    adam = torch.optim.Adam(parameters, lr=settings.learning_rate)

    def validation_loss() -> float:
        with torch.no_grad():
            parts = validation.split(EVALUATION_ROWS)
            return float(sum((loss(_forward(parameters, inputs[p]), p) * of_validation[:, p]).sum() for p in parts))

    best, best_epoch, kept = validation_loss(), 0, [p.detach().clone() for p in parameters]
    for epoch in range(1, settings.epochs + 1):
        total = torch.zeros((), device=device)
        for batch in torch.from_numpy(rng.permutation(used)).to(device).split(size):
            adam.zero_grad(set_to_none=True)
            value = (loss(_forward(parameters, inputs[batch]), batch) * of_train[:, batch]).sum()
            (value * (len(used) / len(batch))).backward()
            adam.step()
            total += value.detach()
        now = validation_loss()
        if not np.isfinite(now + float(total)):
            raise DataError(
                f"The network's loss is not finite in epoch {epoch}; look for extreme observations, or lower "
                f"learning_rate={settings.learning_rate:g}."
            )
        if now < best or settings.patience is None:
            best, best_epoch, kept = now, epoch, [p.detach().clone() for p in parameters]
        elif epoch - best_epoch >= settings.patience:
            break
    return tuple(_read_only(p.cpu().numpy()) for p in kept), best_epoch


def _forward(parameters: list[Tensor], rows: Tensor) -> Tensor:
    """Raw outputs (k, B, O) of rows (B, D)."""
    torch = import_torch()
    hidden = rows.expand(len(parameters[0]), *rows.shape)
    for layer in range(0, len(parameters), 2):
        if layer:
            hidden = torch.relu(hidden)
        hidden = torch.baddbmm(parameters[layer + 1], hidden, parameters[layer])
    return hidden


def on_device(array: Shaped[Array, ...], device: str) -> Tensor:
    """A copy as a tensor of single precision; a `DataError` where there is no such device."""
    torch = import_torch()
    try:
        return torch.tensor(array, dtype=torch.float32, device=device)
    except (RuntimeError, AssertionError) as error:  # torch without CUDA asserts
        raise DataError(f"device={device!r}: torch finds no such device here; use 'cpu'.") from error


def _read_only(array: Array) -> Array:
    array = np.array(array, dtype=np.float32)
    array.flags.writeable = False
    return array
