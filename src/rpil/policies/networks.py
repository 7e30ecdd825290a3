"""Multilayer perceptrons of one shape, trained side by side: all there is of torch in policies.

The networks of a cross-fit see the same rows, but for those that each is not to see. Stacked into (k, in, out) matrices
they are one computation, so that k small networks take little longer than one. Between computations they are NumPy
arrays: they can be shared, saved and compared, and nothing that was handed out ever changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rpil.data.errors import DataError, MissingExtraError
from rpil.numerics.types import Array

Networks = tuple[Array, ...]
"""Weights (k, in, out) and biases (k, 1, out) of each layer in turn, float32."""

Loss = Callable[[Any, Any], Any]
"""Of raw outputs (k, B, O) and the rows (B,) they belong to, both tensors: (k, B), each row's weight included."""

_ROWS = 1 << 16
"""Rows that go through the networks at a time where there is nothing to learn."""

_UPDATES = 16
_LEAST_BATCH = 16
"""An epoch has so many updates at least, as long as a batch has so many rows: few data need not many epochs."""


@dataclass(frozen=True)
class Plan:
    """How to train: at most `epochs`; `patience` of them without a better held-out loss are one too many.

    With ``patience=None`` there is no holding out, and the networks are those of the last epoch.
    """

    epochs: int
    patience: int | None
    batch_size: int
    learning_rate: float
    device: str


def needs_torch() -> Any:
    """The module torch.

    Raises
    ------
    MissingExtraError
        Where it is not installed.
    """
    try:
        import torch  # lazily: it takes seconds, and most users have no need of it
    except ImportError as error:
        raise MissingExtraError("A neural policy", "torch") from error
    return torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Nothing is shared out among cores: small networks only lose by it, a lot on a busy machine, and the bits would
    depend on how many there are."""
    torch = needs_torch()
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def untrained(sizes: tuple[int, ...], n_networks: int, rng: np.random.Generator) -> Networks:
    """`n_networks` with layers of these sizes, inputs and outputs among them: He's initialisation, and zeros in the
    last layer, so that they say nothing before they have seen anything."""
    networks: list[Array] = []
    for layer, (n_in, n_out) in enumerate(pairwise(sizes)):
        bound = np.sqrt(6.0 / n_in) if layer < len(sizes) - 2 else 0.0
        networks += [rng.uniform(-bound, bound, (n_networks, n_in, n_out)), np.zeros((n_networks, 1, n_out))]
    return tuple(_frozen(array) for array in networks)


@one_thread()
def raw_outputs(networks: Networks, inputs: Array, device: str) -> Array:
    """What every network says of inputs (N, D), (k, N, O).

    Raises
    ------
    DataError
        Where that is not a number.
    """
    torch = needs_torch()
    parameters = [on_device(array, device) for array in networks]
    found = []
    with torch.no_grad():
        for start in range(0, max(len(inputs), 1), _ROWS):
            rows = on_device(inputs[start : start + _ROWS], device)
            found.append(_forward(torch, parameters, rows).cpu().numpy())
    out = np.concatenate(found, axis=1).astype(float)
    if not np.isfinite(out).all():
        raise DataError("The network's outputs are not finite; look for extreme observations, or train it again.")
    return out


@one_thread()
def train(
    networks: Networks,
    inputs: Array,
    loss: Loss,
    weight: Array,
    learn: Array,
    judge: Array,
    plan: Plan,
    rng: np.random.Generator,
) -> tuple[Networks, int]:
    """The networks after training, and the epoch, counted from 1, at which they were best together, 0 for the start.

    One epoch is best for all of them: the held-out rows of a single network may be few, and all of them an adversary's.
    The start is a candidate too, so that the held-out loss never rises.

    Parameters
    ----------
    networks : Networks
        Where to start; they stay as they are.
    inputs : (N, D) array
    loss : Loss
    weight : (N,) array
        Of the rows, as `loss` has it.
    learn, judge : (k, N) bool arrays
        Rows that each network is trained on, and those by which it is judged.
    plan : Plan
    rng : numpy Generator
        For the order of the rows.

    Raises
    ------
    DataError
        Where the loss is not a number.
    """
    torch = needs_torch()
    used = np.flatnonzero((weight > 0.0) & learn.any(axis=0))
    if not len(used):
        return networks, 0
    parameters = [on_device(array, plan.device).requires_grad_() for array in networks]
    device = parameters[0].device
    rows = on_device(inputs, plan.device)
    # what a row adds to a mean, for a unit of its weight: over a network's own rows, and over all that are held out
    taught = on_device(learn / np.maximum((learn * weight).sum(axis=1, keepdims=True), 1e-12), plan.device)
    judged = on_device(judge / max(float((judge * weight).sum()), 1e-12), plan.device)
    judges = torch.from_numpy(np.flatnonzero((weight > 0.0) & judge.any(axis=0))).to(device)
    size = int(np.clip(len(used) // _UPDATES, _LEAST_BATCH, plan.batch_size))
    adam = torch.optim.Adam(parameters, lr=plan.learning_rate)

    def held_out() -> float:
        with torch.no_grad():
            parts = ((loss(_forward(torch, parameters, rows[p]), p) * judged[:, p]).sum() for p in judges.split(_ROWS))
            return float(sum(parts))

    best, when, kept = held_out(), 0, [p.detach().clone() for p in parameters]
    for epoch in range(1, plan.epochs + 1):
        total = torch.zeros((), device=device)
        for batch in torch.from_numpy(rng.permutation(used)).to(device).split(size):
            adam.zero_grad(set_to_none=True)
            value = (loss(_forward(torch, parameters, rows[batch]), batch) * taught[:, batch]).sum()
            (value * (len(used) / len(batch))).backward()
            adam.step()
            total += value.detach()
        now = held_out()
        if not np.isfinite(now + float(total)):
            raise DataError(
                f"The network's loss is not finite in epoch {epoch}; look for extreme observations, or lower "
                f"learning_rate={plan.learning_rate:g}."
            )
        if now < best or plan.patience is None:
            best, when, kept = now, epoch, [p.detach().clone() for p in parameters]
        elif epoch - when >= plan.patience:
            break
    return tuple(_frozen(p.cpu().numpy()) for p in kept), when


def _forward(torch: Any, parameters: Any, rows: Any) -> Any:
    """(k, B, O) raw outputs of rows (B, D)."""
    hidden = rows.expand(len(parameters[0]), *rows.shape)
    for layer in range(0, len(parameters), 2):
        if layer:
            hidden = torch.relu(hidden)
        hidden = torch.baddbmm(parameters[layer + 1], hidden, parameters[layer])
    return hidden


def on_device(array: Array, device: str) -> Any:
    """A copy as a tensor of single precision.

    Raises
    ------
    DataError
        Where there is no such device.
    """
    torch = needs_torch()
    try:
        return torch.tensor(array, dtype=torch.float32, device=device)
    except (RuntimeError, AssertionError) as error:  # torch without CUDA asserts
        raise DataError(f"device={device!r}: torch finds no such device here; use 'cpu'.") from error


def _frozen(array: Array) -> Array:
    array = np.array(array, dtype=np.float32)
    array.flags.writeable = False
    return array
