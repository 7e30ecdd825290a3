"""The lag between an action and the state that follows it, by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.faults import segments
from rpil.faults.measured_columns import MeasuredColumns
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Pair:
    """An action and the state column that is best aligned with it; both are numbers of `MeasuredColumns`.

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


@dataclass(frozen=True, eq=False)
class Lag:
    """The pairs, the most correlated first, and the largest correlation of each action with each state, (A, S)."""

    pairs: tuple[Pair, ...]
    columns: MeasuredColumns
    related: Float[Array, "A S"]

    @property
    def most_related(self) -> tuple[Int[Array, " A"], Int[Array, " S"]]:
        """Numbers of the actions and of the states, those most correlated with a state, or action, first."""
        of_action, of_state = (-self.related.max(axis=axis, initial=0.0) for axis in (1, 0))
        action, state = np.flatnonzero(self.columns.is_action), np.flatnonzero(~self.columns.is_action)
        return action[np.argsort(of_action, kind="stable")], state[np.argsort(of_state, kind="stable")]


def find_lag(
    values: Float[Array, "C T"], offsets: Int[Array, " _"], columns: MeasuredColumns, settings: FaultSettings
) -> Lag:
    """The state column that is best aligned with each action, for the actions that have one.

    The longest memory with which there is one tells the lag best. Of many states, those are looked at whose changes are
    most correlated with the action or its changes.
    """
    action, state = np.flatnonzero(columns.is_action), np.flatnonzero(~columns.is_action)
    if not len(action) or not len(state) or np.isnan(values).any():  # missing values are reported alone
        return Lag((), columns, np.zeros((len(action), len(state))))
    change = segments.changes(values, offsets)
    related, found = _related(values, change, action, state, offsets, settings), []
    for row, own in zip(related, action.tolist(), strict=True):
        near = state[np.sort(np.argsort(-row, kind="stable")[: settings.max_partners])]
        for order in settings.memories:
            pair = _best_pair(values, change, offsets, own, near, order, settings.max_lag)
            if pair.correlation >= settings.min_correlation:
                found.append(pair)
                break
    return Lag(tuple(sorted(found, key=lambda pair: -pair.correlation)), columns, related)


def _related(values: Array, change: Array, action: Array, state: Array, offsets: Array, s: FaultSettings) -> Array:
    """The largest correlation, over the lags, of each action or its change with the change of each state, (A, S)."""
    drivers = np.concatenate([change[action], np.stack([centred(a, offsets) for a in values[action]])])
    (first, _), (other, _) = (_padded(series, offsets, s.max_lag) for series in (drivers, change[state]))
    power = np.outer((drivers**2).sum(axis=1), (change[state] ** 2).sum(axis=1))
    middle = first[:, s.max_lag : -s.max_lag]
    best = np.zeros((len(drivers), len(state)))
    for k in range(2 * s.max_lag + 1):
        np.maximum(best, np.abs(middle @ other[:, k : k + middle.shape[1]].T), out=best)
    return np.asarray((best / np.sqrt(power + 1e-300)).reshape(2, len(action), -1).max(axis=0))


def _best_pair(
    values: Array, change: Array, offsets: Array, action: int, state: Array, order: int, max_lag: int
) -> Pair:
    memory = _memory(values[action], offsets, order)
    driver = whitened(values[action], memory, offsets)
    candidates = []
    for of_change, series in ((False, values[state]), (True, change[state])):
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
