"""The linear map between states and actions, with which the undoing of a fault is judged.

A window of a demonstration holds the states and the actions of three steps and a 1; the states are taken `lag` steps
later, when they follow the actions. Least squares, on other demonstrations, tell two maps of it:

    the action of the middle step, from the states of the three steps;
    the next change of the state, from the state and the actions until then.

Both are maps of the robot and its controller rather than of who demonstrates, and both are rows of one matrix B that
gives what they leave over, B z for a window z. With the mean G of z z' over a demonstration, the mean squares are the
diagonal of B G B', and a fault that is linear in z is undone by a change of the columns of B alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int

WIDTH = 3
"""Steps of a window."""

LEFT_OUT = 4
"""Windows of a demonstration that may be left out, as of two spikes; where more leap, that is how the columns are."""

FLOOR = 1e-7
"""Added to mean squares, of columns of variance 1: rounding of 32-bit numbers."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Which columns the window holds: S states, then A actions, C in all.

    Attributes
    ----------
    column : (C,) int array
        Numbers of `Columns`.
    n_states : int
    lag : int
        Steps after which the states follow the actions.
    centre, spread : (C,) arrays
    leap : (C,) array
        Change from one step to the next beyond which a single window is left out.
    rows : int
        Windows of a demonstration that are looked at, at most.
    """

    column: Int[Array, " C"]
    n_states: int
    lag: int
    centre: Float[Array, " C"]
    spread: Float[Array, " C"]
    leap: Float[Array, " C"]
    rows: int

    def places(self) -> Int[Array, "C 3"]:
        """Where in a window each column is, at the step before, at the step, and after."""
        n, width = self.n_states, len(self.column)
        step = np.arange(WIDTH)
        states = np.arange(n)[:, None] + n * step
        return np.concatenate([states, WIDTH * n + np.arange(width - n)[:, None] + (width - n) * step])

    def moments(self, values: Float[Array, "T C"]) -> Float[Array, "D D"] | None:
        """G of a demonstration, whose columns are those of the frame; None where it is too short."""
        n, lag = self.n_states, self.lag
        states, actions = values[max(lag, 0) :, :n], values[max(-lag, 0) :, n:]
        size = min(len(states), len(actions)) - WIDTH + 1
        if size < 2 * WIDTH:
            return None
        states, actions = states[: size + 2], actions[: size + 2]
        leaps: Array = np.abs(np.diff(np.concatenate([states, actions], axis=1), axis=0)) > self.leap
        wild: Array = np.any(leaps, axis=1)
        is_wild: Array = np.logical_or(wild[:-1], wild[1:])
        at = np.flatnonzero(~is_wild) if is_wild.sum() <= LEFT_OUT else np.arange(size)
        at = at if len(at) <= self.rows else at[np.linspace(0, len(at) - 1, self.rows).astype(int)]
        states, actions = (states - self.centre[:n]) / self.spread[:n], (actions - self.centre[n:]) / self.spread[n:]
        parts = [side[at + k] for side in (states, actions) for k in range(WIDTH)]
        window = np.column_stack([*parts, np.ones(len(at))])
        return np.asarray(window.T @ window / len(at))


def maps_of(mean: Float[Array, "D D"], frame: Frame, ridge: float) -> Float[Array, "K D"]:
    """B, from the mean of G over demonstrations; K = A + S."""
    n, one = frame.n_states, len(mean) - 1
    before, now, after = frame.places().T
    action = now[n:]
    out = np.zeros((len(frame.column), len(mean)))

    def predict(x: Array, rows: Array, y: Array) -> None:
        penalty = ridge * np.eye(len(x))
        out[np.ix_(rows, x)] -= np.linalg.solve(mean[np.ix_(x, x)] + penalty, y).T

    x = np.concatenate([before[:n], now[:n], after[:n], [one]])
    rows = np.arange(len(action))
    out[rows, action] = 1.0
    predict(x, rows, mean[np.ix_(x, action)])
    x = np.concatenate([now[:n], before[n:], action, [one]])
    rows = len(action) + np.arange(n)
    out[rows, after[:n]] += 1.0
    out[rows, now[:n]] -= 1.0
    predict(x, rows, mean[np.ix_(x, after[:n])] - mean[np.ix_(x, now[:n])])
    return out


def misfit(maps: Float[Array, "K D"], moments: Float[Array, "D D"]) -> Float[Array, " K"]:
    """Mean squares of what the maps leave over in a demonstration."""
    return np.asarray(np.einsum("kd,kd->k", maps @ moments, maps) + FLOOR)


def fit_maps(moments: Float[Array, "M D D"], fold: Int[Array, " M"], frame: Frame, s: FaultSettings) -> Array:
    """B for each fold of the demonstrations, of the others, (F, K, D).

    Twice those that are fitted worst are left out, so that faults do not shape the maps. A map that tells nothing is 0.
    """
    n_folds, usual = int(fold.max()) + 1, np.ones(len(fold), dtype=bool)
    for _ in range(3):
        own = [usual & (fold != f) if (usual & (fold != f)).any() else fold >= 0 for f in range(n_folds)]
        maps = np.stack([maps_of(moments[rows].mean(axis=0), frame, s.map_ridge) for rows in own])
        left = np.log([misfit(maps[f], g) for f, g in zip(fold, moments, strict=True)])
        off = (left - np.median(left, axis=0)).mean(axis=1)
        usual = off <= np.quantile(off, s.map_trim)
    target = frame.places()
    mean, n = moments[usual].mean(axis=0), frame.n_states
    step = mean[target[:n, 2], target[:n, 2]] + mean[target[:n, 1], target[:n, 1]]
    step -= 2 * mean[target[:n, 1], target[:n, 2]]
    power = np.concatenate([mean[target[n:, 1], target[n:, 1]] - mean[target[n:, 1], -1] ** 2, step])
    return maps * (np.median(np.exp(left), axis=0) < s.map_unknown * power)[:, None]
