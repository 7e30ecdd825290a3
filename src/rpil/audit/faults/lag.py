"""The lag between an action and the state that follows it, by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.audit.faults import segments
from rpil.audit.faults.columns import Columns
from rpil.audit.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Pair:
    """An action and the state column that is best aligned with it; both are numbers of `Columns`.

    Attributes
    ----------
    action, state : int
    of_change : bool
        Whether the changes of the state are aligned with the action (a speed), rather than its level (a position).
    memory : float
        Correlation of the action with itself one step before. It is taken out of both series (Box and Jenkins 1970,
        prewhitening), without which a slow action is correlated with what happens at many lags.
    usual : (2 L + 1,) array
        Usual cross-correlation at the lags -L to L steps; at a positive lag the state is later.
    """

    action: int
    state: int
    of_change: bool
    memory: float
    usual: Float[Array, " K"]

    @property
    def lag(self) -> int:
        """Steps after which the state follows the action; negative where the action follows the state."""
        return int(np.argmax(np.abs(self.usual))) - len(self.usual) // 2

    @property
    def correlation(self) -> float:
        """At that lag, without its sign."""
        return float(np.abs(self.usual).max())


def find_pairs(
    values: Float[Array, "C T"], offsets: Int[Array, " _"], columns: Columns, settings: FaultSettings
) -> tuple[Pair, ...]:
    """The state column that is best aligned with each action, for the actions that have one."""
    change = segments.changes(values, offsets)
    state = np.flatnonzero(~columns.is_action)
    found = []
    for action in np.flatnonzero(columns.is_action).tolist() if len(state) else []:
        own = centred(values[action], offsets)
        power = float(own @ own)
        memory = 1.0 - float(change[action] @ change[action]) / (2.0 * power) if power else 0.0
        driver = whitened(values[action], change[action], memory, offsets)
        candidates = []
        for of_change, series in ((False, values), (True, change)):
            rates = segments.changes(series, offsets)
            responses = np.stack([whitened(series[c], rates[c], memory, offsets) for c in state])
            usual = _correlations(driver, responses, offsets, settings.max_lag)
            s = int(np.argmax(np.abs(usual).max(axis=1)))
            candidates.append(Pair(action, int(state[s]), of_change, memory, usual[s]))
        best = max(candidates, key=lambda pair: pair.correlation)
        if best.correlation >= settings.min_correlation:
            found.append(best)
    return tuple(found)


def shifts(
    values: Array, change: Array, offsets: Array, pairs: tuple[Pair, ...], settings: FaultSettings
) -> tuple[Int[Array, " M"], Float[Array, " M"]]:
    """Steps by which the cross-correlations of each demonstration are shifted from the usual ones, and what that shift
    adds to their agreement, relative to the agreement that is usual."""
    n_demonstrations, largest = len(offsets) - 1, settings.max_shift
    if not pairs:
        return np.zeros(n_demonstrations, dtype=np.int64), np.zeros(n_demonstrations)
    agreement = np.zeros((n_demonstrations, 2 * largest + 1))
    for pair in pairs:
        driver = whitened(values[pair.action], change[pair.action], pair.memory, offsets)
        series, rate = values[pair.state], change[pair.state]
        if pair.of_change:
            series, rate = rate, segments.changes(rate[None], offsets)[0]
        response = whitened(series, rate, pair.memory, offsets)
        own = _own_correlations(driver, response, offsets, settings.max_lag)
        middle = pair.usual[largest:-largest]
        for k in range(2 * largest + 1):
            agreement[:, k] += own[:, k : k + len(middle)] @ middle
    usual = sum(float(pair.usual[largest:-largest] @ pair.usual[largest:-largest]) for pair in pairs)
    best = np.argmax(agreement, axis=1)
    gain = (agreement[np.arange(n_demonstrations), best] - agreement[:, largest]) / max(usual, 1e-12)
    return best - largest, gain


def centred(values: Float[Array, " T"], offsets: Int[Array, " _"]) -> Float[Array, " T"]:
    """Distances from the mean of each demonstration."""
    lengths = np.diff(offsets)
    return np.asarray(values - np.repeat(np.add.reduceat(values, offsets[:-1]) / lengths, lengths))


def whitened(values: Array, change: Array, memory: float, offsets: Array) -> Float[Array, " T"]:
    """x_t - memory x_(t-1) of the centred values, and 0 at the first step of each demonstration."""
    own = centred(values, offsets)
    out = memory * change + (1.0 - memory) * own
    out[offsets[:-1]] = 0.0
    return np.asarray(out)


def _padded(values: Array, offsets: Array, n_zeros: int) -> tuple[Array, Array]:
    """(..., T) with zeros before and after each demonstration, and where each demonstration begins, (M,)."""
    n_demonstrations = len(offsets) - 1
    rows = np.arange(offsets[-1]) + n_zeros * (1 + np.repeat(np.arange(n_demonstrations), np.diff(offsets)))
    out = np.zeros((*values.shape[:-1], offsets[-1] + n_zeros * (n_demonstrations + 1)))
    out[..., rows] = values
    return out, offsets[:-1] + n_zeros * (1 + np.arange(n_demonstrations))


def _correlations(driver: Array, change: Array, offsets: Array, max_lag: int) -> Array:
    """Cross-correlation of the driver with each change, over all demonstrations, (C, 2 L + 1)."""
    norm = np.sqrt((driver @ driver) * np.einsum("ct,ct->c", change, change)) + 1e-300
    first, _ = _padded(driver, offsets, max_lag)
    other, _ = _padded(change, offsets, max_lag)
    middle = first[max_lag:-max_lag]
    lags = [other[:, k : k + len(middle)] @ middle for k in range(2 * max_lag + 1)]
    return np.asarray(np.stack(lags, axis=1) / norm[:, None])


def _own_correlations(driver: Array, change: Array, offsets: Array, max_lag: int) -> Array:
    """Cross-correlation of the driver with the change, of each demonstration, (M, 2 L + 1)."""
    power = np.add.reduceat(driver**2, offsets[:-1]) * np.add.reduceat(change**2, offsets[:-1])
    first, starts = _padded(driver, offsets, max_lag)
    other, _ = _padded(change, offsets, max_lag)
    middle, starts = first[max_lag:-max_lag], starts - max_lag
    lags = [np.add.reduceat(middle * other[k : k + len(middle)], starts) for k in range(2 * max_lag + 1)]
    return np.asarray(np.stack(lags, axis=1) / np.sqrt(power + 1e-300)[:, None])
