"""Multilayer perceptrons of one shape, as one computation; `rpil.policies.torch` trains them.

The networks of a cross-fit see the same rows, each without those of its fold. Stacked into (k, in, out) matrices they
are one computation, so that k small networks take little longer than one. Between computations they are read-only NumPy
arrays, which can be shared, saved and compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np

from rpil.data.errors import DataError, optional
from rpil.numerics.types import Array, Float, Num, Shaped

Tensor = Any
"""``torch.Tensor``; torch is imported only when a network is used."""

Networks = tuple[Shaped[Array, "..."], ...]
"""Weights (k, in, out) and biases (k, 1, out) of each layer in turn, float32."""

Loss = Callable[[Tensor, Tensor], Tensor]
"""The loss (k, B) of raw outputs (k, B, O) and the indices (B,) of their rows, times the weights of the rows."""

EVALUATION_ROWS = 1 << 16
"""Rows that go through the networks at a time without training: bounds the memory."""


def import_torch() -> Any:
    """The module torch; a `MissingExtraError` where it is not installed."""
    return optional("torch", "A neural policy", "torch")  # lazily: it takes seconds, and most users do not need it


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
    return tuple(read_only(array) for array in networks)


@single_threaded()
def raw_outputs(networks: Networks, inputs: Num[Array, "N D"], device: str) -> Float[Array, "k N O"]:
    """The raw outputs of every network; a `DataError` where one is not finite."""
    torch = import_torch()
    parameters = [on_device(array, device) for array in networks]
    parts = []
    with torch.no_grad():
        for start in range(0, max(len(inputs), 1), EVALUATION_ROWS):
            rows = on_device(inputs[start : start + EVALUATION_ROWS], device)
            parts.append(forward(parameters, rows).cpu().numpy())
    out = np.concatenate(parts, axis=1).astype(float)
    if not np.isfinite(out).all():
        raise DataError("The network's outputs are not finite; look for extreme observations, or train it again.")
    return out


def forward(parameters: list[Tensor], rows: Tensor) -> Tensor:
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


def read_only(array: Array) -> Array:
    array = np.array(array, dtype=np.float32)
    array.flags.writeable = False
    return array
