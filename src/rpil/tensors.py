"""The passes that fit the final policy on tensors: `rpil.polish.clone_pass` once more, on whatever device torch knows.

For softmax policies; everything else stays with NumPy. The design matrix and what is (N, K) are in the precision of the
design, as in `rpil.passes.softmax_pass`, and sums over steps in double precision. Torch is imported with this module,
and this module only where a `TorchEngine` is made.

Nothing is added up by atomics: sums are matrix products and plain reductions. So the same device gives the same bits in
every run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch

from rpil.passes import Array, Sums
from rpil.policies import SoftmaxPolicy
from rpil.polish import clone_pass
from rpil.problem import Problem

Tensor = Any

_ROWS = 2048
"""Rows of the design that are summed in its own precision; beyond that sums are double."""


@dataclass(frozen=True, eq=False)
class Tensors:
    """The steps of a `Problem` on a device.

    Attributes
    ----------
    features : (N, D) tensor
    actions : (N,) int64 tensor
    """

    features: Tensor
    actions: Tensor

    @classmethod
    def of(cls, problem: Problem, device: Any) -> Tensors:
        """On a CPU the design is shared with `problem`, elsewhere it is copied."""
        return cls(_tensor(problem.features, device).contiguous(), _tensor(problem.actions, device, torch.int64))


class Device:
    """Where tensors are, and the passes that are faster there.

    Parameters
    ----------
    name : str
        As torch has it.
    """

    def __init__(self, name: str) -> None:
        self.device = torch.device(name)
        self._held: WeakKeyDictionary[Problem, Tensors] = WeakKeyDictionary()

    def faster(self, function: Callable[[Any], Any]) -> Callable[[Any], Any] | None:
        """A pass that says the same as `function` of every shard; None where there is none."""
        if not isinstance(function, partial) or function.func is not clone_pass:
            return None
        policy = function.keywords["policy"]
        return partial(self.clone, policy=policy) if type(policy) is SoftmaxPolicy else None

    def held(self, problem: Problem) -> Tensors:
        """The tensors of a problem: made once, kept as long as the problem."""
        if problem not in self._held:
            self._held[problem] = Tensors.of(problem, self.device)
        return self._held[problem]

    def clone(self, lesson: tuple[Problem, Array, Array], policy: SoftmaxPolicy) -> Sums:
        """`rpil.polish.clone_pass` for a softmax policy."""
        held = self.held(lesson[0])
        weights, weight = (_tensor(a, self.device, torch.float64) for a in (policy.weights, lesson[1]))
        log_proba = torch.log_softmax(held.features @ weights.to(held.features.dtype), 1)
        at = held.actions[:, None]
        value = (weight * log_proba.gather(1, at)[:, 0]).sum()
        weight = weight.to(log_proba.dtype)[:, None]
        residual = log_proba.exp_().mul_(-weight)
        residual.scatter_(1, at, residual.gather(1, at) + weight)
        slope = _gradient(held.features, residual)
        slope -= slope.mean(1, keepdim=True)  # what all actions share is rounding
        return _array(value), (_array(slope),), lesson[1].sum()


def _gradient(features: Tensor, residual: Tensor) -> Tensor:
    """X^T R, (D, K): blocks of rows side by side in the precision of X, then summed in double."""
    whole = len(features) - len(features) % _ROWS
    x, r = (a[:whole].view(-1, _ROWS, a.shape[1]) for a in (features, residual))
    return (x.mT @ r).double().sum(0) + (features[whole:].mT @ residual[whole:]).double()


def _tensor(array: Array, device: Any, dtype: Any = None) -> Tensor:
    writable = array if array.flags.writeable else array.copy()  # torch warns of others
    return torch.from_numpy(np.ascontiguousarray(writable)).to(device, dtype)


def _array(tensor: Tensor) -> Array:
    array: Array = tensor.cpu().numpy()
    return array
