"""Linear maps between states and actions, and what a demonstration gains in fit by undoing a fault.

A window holds the states and the actions of three steps, the states `lag` steps later, less their means over the
demonstration: a level that differs by a calibration or a session is no fault. Two linear models are fitted to the other
demonstrations: a_t from s_{t-1..t+1}, and s_{t+1} - s_t from s_t, a_{t-1}, a_t. Both are maps of the robot and its
controller rather than of who demonstrates. `B z` are their residuals in a window z. With the mean G of z z' over a
demonstration, the mean squares e are the diagonal of B G B'.

Undoing a fault gains sum_k log(e_k / e'_k) / 2, with e' afterwards. Signs are linear in z: what is left over
becomes r + q, and e' = e + 2 <r, q> + <q, q>.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rpil.faults import settings
from rpil.numerics.types import Array, Float, Int

WIDTH = 3
"""Steps of a window."""

FLOOR = 1e-7
"""Added to mean squares, of columns of variance 1: rounding of 32-bit numbers."""

OF_ROWS = {
    "frame rate": "doubled rate",
    "doubled rate": "frame rate",
    "actions late": "actions early",
    "actions early": "actions late",
}
"""Faults of all columns, and those whose undoing makes them."""


@dataclass(frozen=True, eq=False)
class Window:
    """Which columns the window holds: S states, then A actions, C in all."""

    column: Int[Array, " C"]
    """Numbers of `MeasuredColumns`."""
    n_states: int
    lag: int
    """Steps after which the states follow the actions."""
    centre: Float[Array, " C"]
    spread: Float[Array, " C"]
    rows: int
    """Windows of a demonstration that are looked at, at most."""

    @cached_property
    def places(self) -> Int[Array, "C 3"]:
        """Where in a window each column is, at the step before, at the step, and after."""
        n, width, step = self.n_states, len(self.column), np.arange(WIDTH)
        states = np.arange(n)[:, None] + n * step
        return np.concatenate([states, WIDTH * n + np.arange(width - n)[:, None] + (width - n) * step])

    @cached_property
    def tried(self) -> tuple[Array, Int[Array, " H"]]:
        """The kinds of the faults that are tried, H of them, and the positions of their columns, -1 where all have it:
        each sign, `OF_ROWS`, and each offset."""
        columns = np.arange(len(self.column))
        kinds = ["sign"] * len(columns) + [*OF_ROWS] + ["offset"] * len(columns)
        return np.array(kinds), np.concatenate([columns, np.full(len(OF_ROWS), -1), columns])

    def moments(self, values: Float[Array, "T C"]) -> Float[Array, "D D"] | None:
        """G of a demonstration, whose columns are those of the window; None where it is too short."""
        n, size = self.n_states, len(values) - abs(self.lag) - WIDTH + 1
        if size < 2 * WIDTH:
            return None
        every = -(-size // self.rows)
        sides = ((values[:, :n], max(self.lag, 0)), (values[:, n:], max(-self.lag, 0)))
        parts = [side[first + k : first + k + size : every] for side, first in sides for k in range(WIDTH)]
        window = np.concatenate(parts, axis=1, dtype=np.float64)
        window -= window.mean(axis=0)
        scale = np.empty(window.shape[1])
        scale[self.places] = self.spread[:, None]
        return np.asarray(window.T @ window / (len(window) * np.outer(scale, scale)))


def maps_of(mean: Float[Array, "D D"], window: Window, ridge: float) -> Float[Array, "K D"]:
    """B, from the mean of G over demonstrations; K = A + S."""
    n = window.n_states
    before, now, after = window.places.T
    out = np.zeros((len(window.column), len(mean)))
    n_actions = len(now) - n
    for rows, x, y in (
        (slice(0, n_actions), [*before[:n], *now[:n], *after[:n]], mean[:, now[n:]]),
        (slice(n_actions, None), [*now[:n], *before[n:], *now[n:]], mean[:, after[:n]] - mean[:, now[:n]]),
    ):
        out[rows, x] = -np.linalg.solve(mean[np.ix_(x, x)] + ridge * np.eye(len(x)), y[x]).T
    rest = np.arange(n_actions, len(out))
    out[np.arange(n_actions), now[n:]] = 1.0
    out[rest, after[:n]] += 1.0
    out[rest, now[:n]] -= 1.0
    return out


def misfit(maps: Float[Array, "K D"], moments: Float[Array, "D D"]) -> Float[Array, " K"]:
    """Mean squares of what the maps leave over in a demonstration."""
    return np.asarray(((maps @ moments) * maps).sum(axis=1) + FLOOR)


def others(fold: Int[Array, " M"], own: int, among: Array | bool = True) -> Array:
    """The demonstrations of the other folds; all where there are none."""
    rows = among & (fold != own)
    return rows if rows.any() else fold >= 0


def fit_maps(moments: Float[Array, "M D D"], fold: Int[Array, " M"], window: Window) -> Array:
    """B for each fold of the demonstrations, of the others, (F, K, D).

    Those that are fitted worst are left out, so that faults do not shape the maps. A map that tells nothing is 0.
    """
    n_folds, usual = int(fold.max()) + 1, np.ones(len(fold), dtype=bool)
    for _ in range(3):
        own = [others(fold, f, usual) for f in range(n_folds)]
        maps = np.stack([maps_of(moments[rows].mean(axis=0), window, settings.MAP_RIDGE) for rows in own])
        left = np.log([misfit(maps[f], g) for f, g in zip(fold, moments, strict=True)])
        off = left.mean(axis=1)
        usual = off <= np.quantile(off, settings.MAP_TRIM)
    mean, n = moments[usual].mean(axis=0), window.n_states
    _, now, after = window.places.T
    step = mean[after[:n], after[:n]] + mean[now[:n], now[:n]] - 2 * mean[now[:n], after[:n]]
    power = np.concatenate([mean[now[n:], now[n:]], step])
    return maps * (np.median(np.exp(left), axis=0) < settings.MAP_UNKNOWN * power)[:, None]


def undo(kind: str, values: Float[Array, "T C"], n_states: int) -> Float[Array, "_ C"]:
    """Apply the inverse of a whole-demonstration fault, one of `OF_ROWS`."""
    if kind == "doubled rate":
        return values[::2]
    if kind == "frame rate":
        out = np.repeat(values, 2, axis=0)[:-1].astype(float)
        out[1::2] = (values[1:] + values[:-1]) / 2
        return out
    late = int(kind == "actions early")
    states, actions = values[late : len(values) - 1 + late, :n_states], values[1 - late : len(values) - late, n_states:]
    return np.concatenate([states, actions], axis=1)


def gains(values: Float[Array, "T C"], moments: Array, maps: Array, window: Window) -> Float[Array, " H"]:
    """What undoing each fault but offsets gains in a demonstration."""
    place, left = window.places, misfit(maps, moments)
    change, seen = -2.0 * maps[:, place].transpose(1, 0, 2), (maps @ moments)[:, place].transpose(1, 0, 2)
    first = (change * seen).sum(axis=2)
    second = (np.matmul(change, moments[place[:, :, None], place[:, None, :]]) * change).sum(axis=2)
    gain = np.log(left / np.maximum(left + 2 * first + second, FLOOR)).sum(axis=1) / 2
    undone = [window.moments(undo(kind, values, window.n_states)) for kind in OF_ROWS]  # None: it is too short
    of_rows = [0.0 if g is None else float(np.log(left / misfit(maps, g)).sum() / 2) for g in undone]
    return np.append(gain, of_rows)


def levels(values: Float[Array, "T C"], maps: Float[Array, "K D"], window: Window) -> Float[Array, " K"]:
    """What the maps leave over of the mean of a demonstration."""
    return np.asarray(per_column(maps, window) @ ((values.mean(axis=0) - window.centre) / window.spread))


def per_column(maps: Float[Array, "... K D"], window: Window) -> Float[Array, "... K C"]:
    """What the maps leave over of a constant in a column."""
    return np.asarray(maps[..., window.places].sum(axis=-1))
