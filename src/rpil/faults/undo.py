"""Faults that are named by undoing them: a demonstration has one where, undone, it fits the maps of the others.

Undoing is scored by sum_k log(e_k / e'_k) / 2, with the mean squares of what map k leaves over before and after: a gain
of likelihood for each step. Most faults are linear in the window, r' = r + q, and e' = e + 2 <r, q> + <q, q>.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.faults.alignment import FLOOR, Frame, misfit
from rpil.numerics.types import Array, Float, Int

UNITS = (180 / np.pi, np.pi / 180, 1e3, 1e-3)
"""Degrees for radians, millimetres for metres, and the inverse."""

SHIFTS = tuple(f"{steps:+d}" for size in (1, 2, 3, 4, 5, 6, 8, 10) for steps in (size, -size))
OF_ROWS = ("reversed", "frame rate", *SHIFTS)
"""Faults of all columns; shifts are the steps by which actions are late."""


def moved(values: Float[Array, "T C"], n_states: int, steps: int) -> Float[Array, "_ C"]:
    """The actions beside the states so many steps later."""
    size = max(len(values) - abs(steps), 0)
    states, actions = values[max(steps, 0) :, :n_states], values[max(-steps, 0) :, n_states:]
    return np.concatenate([states[:size], actions[:size]], axis=1)


def plant(kind: str, values: Float[Array, "T C"], n_states: int) -> Float[Array, "_ C"]:
    """A demonstration with one of the faults `OF_ROWS`."""
    if kind in SHIFTS:
        return moved(values, n_states, int(kind))
    return values[::-1] if kind == "reversed" else values[::2]


def undo(kind: str, values: Float[Array, "T C"], n_states: int) -> Float[Array, "_ C"]:
    """A demonstration without it."""
    if kind in SHIFTS:
        return moved(values, n_states, -int(kind))
    if kind == "reversed":
        return values[::-1]
    out = np.repeat(values, 2, axis=0)[:-1].astype(float)
    out[1::2] = (values[1:] + values[:-1]) / 2
    return out


@dataclass(frozen=True, eq=False)
class Tried:
    """The faults that are tried, H of them: `columns` are positions in the frame, -1 where none is meant."""

    kind: Array
    columns: Int[Array, "H 2"]
    pairs: Int[Array, "P 2"]

    @classmethod
    def of(cls, frame: Frame) -> Tried:
        """All faults of the columns of a frame."""
        width, n = len(frame.column), frame.n_states
        pairs = [(i, j) for low, high in ((0, n), (n, width)) for i in range(low, high) for j in range(i + 1, high)]
        exchanged = np.array(pairs, dtype=int).reshape(-1, 2)
        alone = np.column_stack([np.arange(width), np.full(width, -1)])
        kinds = ["sign", *["scale"] * len(UNITS), "offset"]
        kind = [*np.repeat(kinds, width), *["exchanged"] * len(exchanged), *OF_ROWS]
        whole = np.full((len(OF_ROWS), 2), -1)
        return cls(np.array(kind), np.concatenate([*[alone] * len(kinds), exchanged, whole]), exchanged)


@dataclass(frozen=True, eq=False)
class Weights:
    """What the columns of a frame contribute to each map, K of them."""

    maps: Float[Array, "K D"]
    usual: Float[Array, " K"]  # mean squares
    own: Float[Array, "K C 4"]  # weights of the value of a column, not centred, at three steps, and of the 1
    total: Float[Array, "K C"]  # of an offset of a column
    other: Float[Array, "K P 7"]  # change of the weights by the exchange of two columns, and of that of the 1

    @classmethod
    def of(cls, maps: Array, usual: Array, frame: Frame, pairs: Array) -> Weights:
        """The weights in one B."""
        own = maps[:, frame.places()]
        total = own.sum(axis=2)
        first, second = pairs.T
        ratio = (frame.spread[first] / frame.spread[second])[:, None]
        apart = frame.centre[second] - frame.centre[first]
        one = total[:, first] * apart / frame.spread[first] - total[:, second] * apart / frame.spread[second]
        change = own[:, second] * ratio - own[:, first], own[:, first] / ratio - own[:, second]
        at_zero = total * (frame.centre / frame.spread)
        own = np.concatenate([own, at_zero[:, :, None]], axis=2)
        return cls(maps, usual, own, total, np.concatenate([*change, one[:, :, None]], axis=2))


def scores(
    values: Float[Array, "T C"], weights: Weights, frame: Frame, tried: Tried
) -> tuple[Float[Array, " H"], Float[Array, " C"]] | None:
    """What undoing each fault gains, and the offset of each column; None where the demonstration is too short."""
    moments = frame.moments(values)
    if moments is None:
        return None
    maps, width, one = weights.maps, len(frame.column), len(moments) - 1
    left = misfit(maps, moments)
    seen = maps @ moments
    place = np.column_stack([frame.places(), np.full(width, one)])
    first, second = _products(weights.own, seen, moments, place)
    undone = [left[:, None] + 2 * (k - 1) * first + (k - 1) ** 2 * second for k in (-1.0, *UNITS)]
    mean = seen[:, one, None]
    off = -(weights.total * mean / weights.usual[:, None]).sum(axis=0)
    off /= np.maximum((weights.total**2 / weights.usual[:, None]).sum(axis=0), 1e-12)
    undone.append(left[:, None] + 2 * weights.total * off * mean + (weights.total * off) ** 2)
    place = np.column_stack([place[tried.pairs[:, 0], :3], place[tried.pairs[:, 1]]])
    first, second = _products(weights.other, seen, moments, place)
    undone.append(left[:, None] + 2 * first + second)
    gain = np.log(left[:, None] / np.maximum(np.concatenate(undone, axis=1), FLOOR)).sum(axis=0) / 2
    return np.append(gain, [whole_gain(kind, values, maps, frame) for kind in OF_ROWS]), off


def whole_gain(kind: str, values: Float[Array, "T C"], maps: Float[Array, "K D"], frame: Frame) -> float:
    """What undoing a fault of all columns gains."""
    moments = frame.moments(values), frame.moments(undo(kind, values, frame.n_states))
    if moments[0] is None or moments[1] is None:
        return 0.0
    return float(np.log(misfit(maps, moments[0]) / misfit(maps, moments[1])).sum() / 2)


def _products(weights: Array, seen: Array, moments: Array, place: Array) -> tuple[Array, Array]:
    """<r, q> and <q, q> for contributions q of the entries `place` (Q, I) of a window, each (K, Q)."""
    inner = moments[place[:, :, None], place[:, None, :]]
    first = np.einsum("kqi,kqi->kq", weights, seen[:, place])
    return first, np.einsum("kqi,kqi->kq", np.matmul(weights.transpose(1, 0, 2), inner).transpose(1, 0, 2), weights)
