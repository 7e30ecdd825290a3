"""Everything in memory, and what passes read on a device besides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, TypeVar

from rpil.engines.memory import Held, InMemory
from rpil.errors import DataError

R = TypeVar("R")


@dataclass(frozen=True)
class OnDevice(Held):
    """Shards in a list; `device` knows a faster way of some passes, see `rpil.tensors.Device`."""

    device: Any

    def map(self, function: Callable[[Any], R]) -> Iterator[R]:
        import torch

        from rpil.policies.networks import one_thread

        try:
            with one_thread():  # shards go side by side, and no sum depends on the number of cores
                yield from super().map(self.device.faster(function) or function)
        except torch.OutOfMemoryError as error:
            name = str(self.device.device)
            raise DataError(
                f"The demonstrations do not fit into the memory of device={name!r}; leave engine out."
            ) from error

    def then(self, function: Callable[[Any], Any]) -> OnDevice:
        return OnDevice(list(self.map(function)), self.device)


@dataclass(frozen=True)
class TorchEngine(InMemory):
    """Passes that fit the final policy for discrete actions on tensors, on a GPU above all.

    The design matrix is kept on the device, in single precision; parameters go there and sums come back. All else is as
    without an engine: continuous actions, and the two passes that measure demonstrations and weigh their steps. Like
    every engine it is for data many times larger than the sample that the judge reads.

    Parameters
    ----------
    device : str
        "cuda", "cuda:1", "cpu", or whatever torch knows that has double precision.

    Raises
    ------
    DataError
        At once, where there is no such device; in a fit, where its memory is too small.
    MissingExtraError
        Where torch is not installed.

    Examples
    --------
    >>> model = RPIL(engine=TorchEngine("cuda")).fit(demonstrations)    # doctest: +SKIP
    """

    n_parts: int = field(default=1, init=False)
    device: str = "cuda"

    def __post_init__(self) -> None:
        from rpil.policies.networks import needs_torch

        torch = needs_torch("TorchEngine")
        try:
            torch.ones(1, dtype=torch.float64, device=self.device).sum().item()
        except (RuntimeError, AssertionError, TypeError, NotImplementedError) as error:  # torch without CUDA asserts
            kind = "CUDA" if str(self.device).startswith("cuda") else "such"
            raise DataError(
                f"device={self.device!r}: torch finds no {kind} device with double precision here; "
                "use device='cpu' or leave engine out."
            ) from error

    def place(self, parts: Sequence[Iterable[Any]]) -> OnDevice:
        from rpil.tensors import Device  # it knows the passes, which engines need not

        return OnDevice(list(chain.from_iterable(parts)), Device(self.device))
