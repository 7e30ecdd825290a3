"""The passes of a large fit on tensors: `rpil.em` and `rpil.polish` once more, on whatever device torch knows.

For discrete actions, a softmax policy and the adversaries of `_PSI`; everything else stays with NumPy. What is (N, K),
(N,) or (M, J) is in double precision, as in NumPy; what is (N, J), and products with the design matrix, in the
precision of the design. Torch is imported with this module, and this module only by whoever makes a `TorchEngine`.

Nothing is added up by atomics: sums over the steps of a demonstration are segment reductions, all others are matrix
products and plain reductions. So the same device gives the same bits in every run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch

from rpil.adversaries import Adversary, Complement, Confusion, Constant, Marginal, Uniform
from rpil.demonstrations import Piece
from rpil.demonstrators import Strangers
from rpil.em import State
from rpil.large import Weigh
from rpil.passes import Array, Sums
from rpil.policies import SoftmaxPolicy
from rpil.polish import MStep, clone_pass, em_pass
from rpil.problem import Problem
from rpil.reliability import ADVERSARY, EXPERT

Tensor = Any

_IN_CACHE = 1 << 12
_IN_MEMORY = 1 << 18
"""Steps whose mixtures over the whole grid are there at a time: in the cache of a CPU, and where one is busy with many.
"""

_ROWS = 2048
"""Rows of the design that are summed in its own precision; beyond that sums are double."""

_LARGE = 80.0
"""As in `rpil.em`: log-ratios beyond this are no different."""


@dataclass(frozen=True, eq=False)
class Tensors:
    """A `Problem` on a device.

    Attributes
    ----------
    features : (N, D) tensor
    actions : (N,) int64 tensor
    lengths : (M,) int64 tensor
    labels : (M,) tensor
    chunks : list of (slice, slice, tensor)
        Steps, the demonstrations they belong to, and how many of the steps each of these has.
    """

    features: Tensor
    actions: Tensor
    lengths: Tensor
    labels: Tensor
    chunks: list[tuple[slice, slice, Tensor]]

    @classmethod
    def of(cls, problem: Problem, device: Any) -> Tensors:
        """On a CPU the design is shared with `problem`, elsewhere it is copied."""
        offsets, n_steps = problem.offsets, len(problem.actions)
        size = _IN_CACHE if device.type == "cpu" else _IN_MEMORY
        chunks = []
        for start in range(0, n_steps, size):
            stop = min(start + size, n_steps)
            first = int(np.searchsorted(offsets, start, side="right")) - 1
            last = int(np.searchsorted(offsets, stop, side="left"))
            lengths = np.diff(np.clip(offsets[first : last + 1], start, stop))
            chunks.append((slice(start, stop), slice(first, last), _tensor(lengths, device)))
        actions, lengths, labels = (
            _tensor(a, device, torch.int64) for a in (problem.actions, problem.lengths, problem.labels)
        )
        return cls(_tensor(problem.features, device).contiguous(), actions, lengths, labels, chunks)

    def sum_steps(self, values: Tensor) -> Tensor:
        """Sums over the steps of each demonstration, (N,) -> (M,)."""
        return _segments(values, self.lengths)

    def spread(self, values: Tensor) -> Tensor:
        """A value of each demonstration, repeated for its steps, (M,) -> (N,)."""
        return torch.repeat_interleave(values, self.lengths, output_size=len(self.actions))


@dataclass(frozen=True, eq=False)
class Found:
    """What an E-step finds, as in `rpil.em.Posterior`; `intended` (N, K) by the adversary, if anything."""

    log_proba: Tensor
    intended: Tensor | None
    evidence: Tensor
    joint: Tensor
    log_odds: Tensor
    log_evidence: Tensor
    log_ratio: Tensor
    step: Tensor


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
        what: Any = type(function)
        given: dict[str, Any] = {"weigh": function}
        if isinstance(function, partial):
            what, given = function.func, function.keywords
        if what not in _WAYS:
            return None
        way, known = _WAYS[what]
        return partial(way, self, **given) if known(**given) else None

    def held(self, problem: Problem) -> Tensors:
        """The tensors of a problem: made once, kept as long as the problem."""
        if problem not in self._held:
            self._held[problem] = Tensors.of(problem, self.device)
        return self._held[problem]

    def double(self, array: Array) -> Tensor:
        return _tensor(np.asarray(array), self.device, torch.float64)

    def find(self, problem: Problem, state: State) -> Found:
        """The E-step, see `rpil.em.e_step`."""
        held, policy = self.held(problem), state.policy
        logits = _logits(held, self.double(policy.weights))  # type: ignore[attr-defined]
        log_proba = torch.log_softmax(logits.double(), 1)
        log_pi = _taken(log_proba, held.actions)
        log_psi, intended = _PSI[type(state.adversary)](self, state.adversary, log_proba, held.actions)
        nodes = state.reliability.nodes
        evidence = self._evidence(held, log_pi, log_psi, nodes)
        prior, weight = self.double(state.prior.log(problem.lengths)), self.double(state.reliability.log_weight)
        log_joint = prior[:, :, None] + weight + evidence[:, None]
        by_group = torch.logsumexp(log_joint, 2)
        log_joint[:, ADVERSARY].masked_fill_((held.labels > 0)[:, None], -torch.inf)
        log_joint[:, EXPERT].masked_fill_((held.labels < 0)[:, None], -torch.inf)
        log_evidence = torch.logsumexp(log_joint, (1, 2))
        joint = torch.exp(log_joint - log_evidence[:, None, None])
        log_ratio = log_pi - log_psi
        step = self._expert_steps(held, log_ratio, joint.sum(1), nodes)
        log_odds = by_group[:, EXPERT] - by_group[:, ADVERSARY]
        return Found(log_proba, intended, evidence, joint, log_odds, log_evidence, log_ratio, step)

    def _evidence(self, held: Tensors, log_pi: Tensor, log_psi: Tensor, nodes: Array) -> Tensor:
        """See `rpil.em.evidence_by_reliability`, (M, J)."""
        inside = (nodes > 0.0) & (nodes < 1.0)
        out = torch.empty((len(held.lengths), len(nodes)), dtype=torch.float64, device=self.device)
        for j in np.flatnonzero(~inside):
            out[:, j] = held.sum_steps(log_pi if nodes[j] else log_psi)
        if not inside.any():
            return out
        top = torch.maximum(log_pi, log_psi)
        precision = held.features.dtype
        mine, other = (torch.exp(a - top).to(precision)[:, None] for a in (log_pi, log_psi))
        rho, against = (self.double(a).to(precision) for a in (nodes[inside], 1 - nodes[inside]))
        total = held.sum_steps(top)[:, None].repeat(1, len(rho))
        for steps, demonstrations, lengths in held.chunks:
            mixture = rho * mine[steps]
            mixture += against * other[steps]
            total[demonstrations] += _segments(mixture.log_().double(), lengths)
        out[:, torch.from_numpy(inside).to(self.device)] = total
        return out

    def _expert_steps(self, held: Tensors, log_ratio: Tensor, by_node: Tensor, nodes: Array) -> Tensor:
        """See `rpil.em.expert_steps`, (N,)."""
        inside, surely = (nodes > 0.0) & (nodes < 1.0), torch.zeros_like(by_node[:, 0])
        for j in np.flatnonzero(nodes == 1.0):
            surely += by_node[:, j]
        out = held.spread(surely)
        if inside.any():
            precision = held.features.dtype
            ratio = torch.exp(torch.clamp(-log_ratio, max=_LARGE)).to(precision)[:, None]
            odds_against = self.double((1 - nodes[inside]) / nodes[inside]).to(precision)
            weight = by_node[:, torch.from_numpy(inside).to(self.device)].to(precision)
            for steps, demonstrations, lengths in held.chunks:
                share = odds_against * ratio[steps]
                share += 1.0
                mine = torch.repeat_interleave(weight[demonstrations], lengths, 0, output_size=len(share))
                out[steps] += (mine / share).sum(1)
        return out.clamp_(0.0, 1.0)


def _em(device: Device, problem: Problem, state: State, mode: MStep) -> Sums:
    if not _plain(problem):
        return em_pass(problem, state, mode)
    held, found = device.held(problem), device.find(problem, state)
    taken = torch.nn.functional.one_hot(held.actions, found.log_proba.shape[1]).double()
    weight, adversary = found.step, 1 - found.step
    targets = taken * weight[:, None]
    if mode == "joint" and found.intended is not None:
        targets += adversary[:, None] * found.intended
        weight = targets.sum(1)
    slope = _gradient(held.features, targets - weight[:, None] * found.log_proba.exp())
    expert = _array(found.joint[:, EXPERT].sum(1))
    return (
        _array(found.log_evidence.sum()),
        (_centred(slope),),
        _statistics(state.adversary, taken, adversary, found.intended),
        state.prior.statistics(expert, problem.lengths),
        _array(found.joint.sum(0)),
    )


def _clone(device: Device, lesson: tuple[Problem, Array, Array], policy: SoftmaxPolicy) -> Sums:
    """As `rpil.passes.softmax_pass`, all but the sums are in the precision of the design."""
    held, weight = device.held(lesson[0]), device.double(lesson[1])
    log_proba = torch.log_softmax(_logits(held, device.double(policy.weights)), 1)
    value = (weight * _taken(log_proba, held.actions)).sum()
    weight = weight.to(log_proba.dtype)[:, None]
    residual, at = log_proba.exp_().mul_(-weight), held.actions[:, None]
    residual.scatter_(1, at, residual.gather(1, at) + weight)
    return _array(value), (_centred(_gradient(held.features, residual)),), lesson[1].sum()


def _weigh(device: Device, ready: tuple[Piece, Problem], weigh: Weigh) -> tuple[Problem, Array, Array]:
    if not _plain(ready[1]):
        return weigh(ready)
    found = device.find(ready[1], weigh.state)
    return weigh.lesson(ready, _array(found.step), _array(found.log_ratio))


def _plain(problem: Problem) -> bool:
    """Whether steps have no weights, and demonstrations nothing to do with each other."""
    return problem.weight is None and isinstance(problem.company, Strangers)


def _knows_policy(policy: Any) -> bool:
    return type(policy) is SoftmaxPolicy


def _knows_state(state: State, mode: MStep = "joint") -> bool:
    return _knows_policy(state.policy) and type(state.adversary) in _PSI


_WAYS: dict[Any, tuple[Callable[..., Any], Callable[..., bool]]] = {
    em_pass: (_em, _knows_state),
    clone_pass: (_clone, _knows_policy),
    Weigh: (_weigh, lambda weigh: _knows_state(weigh.state)),
}
"""Pass over a shard -> the same on tensors, and whether it can be, given what the pass is given. Demonstrations
are judged one by one, and once a fit: that is left to NumPy."""


def _constant(device: Device, psi: Constant, log_proba: Tensor, actions: Tensor) -> tuple[Tensor, None]:
    return torch.zeros_like(log_proba[:, 0]), None


def _uniform(device: Device, psi: Uniform, log_proba: Tensor, actions: Tensor) -> tuple[Tensor, None]:
    return torch.full_like(log_proba[:, 0], -np.log(log_proba.shape[1])), None


def _marginal(device: Device, psi: Marginal, log_proba: Tensor, actions: Tensor) -> tuple[Tensor, None]:
    return device.double(psi.log_frequency)[actions], None


def _complement(device: Device, psi: Complement, log_proba: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
    others = log_proba.scatter(1, actions[:, None], -torch.inf)
    scale = np.log(log_proba.shape[1] - 1) if psi.normalised else 0.0
    return torch.logsumexp(others, 1) - scale, torch.softmax(others, 1)


def _confusion(device: Device, psi: Confusion, log_proba: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
    joint = log_proba + device.double(psi.log_matrix.T)[actions]
    total = torch.logsumexp(joint, 1)
    return total, torch.exp(joint - torch.where(total.isfinite(), total, 0.0)[:, None])


_PSI: dict[type, Callable[..., tuple[Tensor, Tensor | None]]] = {
    Constant: _constant,
    Uniform: _uniform,
    Marginal: _marginal,
    Complement: _complement,
    Confusion: _confusion,
}
"""Adversary -> log psi of the actions taken, (N,), and what was intended, (N, K) or None; see `rpil.adversaries`."""


def _statistics(psi: Adversary, taken: Tensor, weight: Tensor, intended: Tensor | None) -> Sums:
    """See `Adversary.statistics`; `taken` (N, K) has a one where the action is."""
    if isinstance(psi, Marginal):
        return (_array(weight @ taken),)
    if isinstance(psi, Confusion) and psi.learned and intended is not None:
        return (_array((weight[:, None] * intended).T @ taken),)
    return ()


def _logits(held: Tensors, weights: Tensor) -> Tensor:
    """X W, (N, K), in the precision of the design."""
    return held.features @ weights.to(held.features.dtype)


def _taken(log_proba: Tensor, actions: Tensor) -> Tensor:
    return log_proba.gather(1, actions[:, None])[:, 0]


def _gradient(features: Tensor, residual: Tensor) -> Tensor:
    """X^T R, (D, K): blocks of rows side by side in the precision of X, then summed in double."""
    residual = residual.to(features.dtype)
    whole = len(features) - len(features) % _ROWS
    x, r = (a[:whole].view(-1, _ROWS, a.shape[1]) for a in (features, residual))
    return (x.mT @ r).double().sum(0) + (features[whole:].mT @ residual[whole:]).double()


def _centred(slope: Tensor) -> Array:
    return _array(slope - slope.mean(1, keepdim=True))  # what all actions share is rounding


def _segments(values: Tensor, lengths: Tensor) -> Tensor:
    """Sums over stretches of rows of these `lengths`, which are all there are."""
    return torch.segment_reduce(values, "sum", lengths=lengths, axis=0, unsafe=True)


def _tensor(array: Array, device: Any, dtype: Any = None) -> Tensor:
    writable = array if array.flags.writeable else array.copy()  # torch warns of others
    return torch.from_numpy(np.ascontiguousarray(writable)).to(device, dtype)


def _array(tensor: Tensor) -> Array:
    array: Array = tensor.cpu().numpy()
    return array
