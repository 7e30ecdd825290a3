"""The lag between an action and the state that follows it, by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.faults import segments
from rpil.faults.columns import Columns
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Pair:
    """An action and the state column that is best aligned with it; both are numbers of `Columns`.

    Attributes
    ----------
    action, state : int
    of_change : bool
        Whether the changes of the state are aligned with the action (a speed), rather than its level (a position).
    memory : (P,) array
        How the action follows from its last P values. It is taken out of both series (Box and Jenkins 1970,
        prewhitening), without which a slow action is correlated with what happens at many lags.
    usual : (2 L + 1,) array
        Usual cross-correlation at the lags -L to L steps; at a positive lag the state is later.
    """

    action: int
    state: int
    of_change: bool
    memory: Float[Array, " P"]
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
    """The state column that is best aligned with each action, for the actions that have one.

    The longest memory with which there is one tells the lag best.
    """
    if columns.is_action.all() or np.isnan(values).any():  # where all have missing values, these alone are reported
        return ()
    found = []
    for action in np.flatnonzero(columns.is_action).tolist():
        for order in settings.memories:
            pair = _best_pair(values, offsets, columns, action, order, settings.max_lag)
            if pair.correlation >= settings.min_correlation:
                found.append(pair)
                break
    return tuple(found)


def _best_pair(values: Array, offsets: Array, columns: Columns, action: int, order: int, max_lag: int) -> Pair:
    state = np.flatnonzero(~columns.is_action)
    memory = _memory(values[action], offsets, order)
    driver = whitened(values[action], memory, offsets)
    candidates = []
    for of_change, series in ((False, values[state]), (True, segments.changes(values[state], offsets))):
        responses = np.stack([whitened(column, memory, offsets) for column in series])
        usual = _correlations(driver, responses, offsets, max_lag)
        s = int(np.argmax(np.abs(usual).max(axis=1)))
        candidates.append(Pair(action, int(state[s]), of_change, memory, usual[s]))
    return max(candidates, key=lambda pair: pair.correlation)


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
        driver = whitened(values[pair.action], pair.memory, offsets)
        response = whitened((change if pair.of_change else values)[pair.state], pair.memory, offsets)
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


def whitened(values: Float[Array, " T"], memory: Float[Array, " P"], offsets: Int[Array, " _"]) -> Float[Array, " T"]:
    """x_t - sum_i memory_i x_(t-i) of the centred values, and 0 at the first P steps of each demonstration."""
    own = centred(values, offsets)
    out = own.copy()
    for back, weight in enumerate(memory.tolist(), start=1):
        out[back:] -= weight * own[:-back]
    for step in range(len(memory)):
        out[np.minimum(offsets[:-1] + step, offsets[1:] - 1)] = 0.0
    return np.asarray(out)


def _memory(values: Float[Array, " T"], offsets: Int[Array, " _"], order: int) -> Float[Array, " P"]:
    """The weights of the last values with which they predict the next one best."""
    own = centred(values, offsets)
    first = np.repeat(offsets[:-1], np.diff(offsets))
    rows = np.flatnonzero(np.arange(len(own)) - first >= order)
    if not len(rows):
        return np.zeros(order)
    past = np.stack([own[rows - back] for back in range(1, order + 1)], axis=1)
    return np.asarray(np.linalg.lstsq(past, own[rows], rcond=1e-9)[0])


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
