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
    lag : int
        Steps after which the state follows the action; negative where the action follows the state.
    usual : (2 L + 1,) array
        Usual cross-correlation at the lags -L to L steps from `lag`; at a positive lag the state is later.
    """

    action: int
    state: int
    of_change: bool
    memory: Float[Array, " P"]
    lag: int
    usual: Float[Array, " K"]

    @property
    def correlation(self) -> float:
        """At that lag, without its sign."""
        return float(np.abs(self.usual[len(self.usual) // 2]))


def find_pairs(
    values: Float[Array, "C T"], offsets: Int[Array, " _"], columns: Columns, settings: FaultSettings
) -> tuple[tuple[Pair, ...], Float[Array, " S"]]:
    """The state column that is best aligned with each action, for the actions that have one; and the largest
    correlation of each state column with an action, at any lag.

    The longest memory with which there is one tells the lag best. Where to look comes from one transform of each
    column; only the lags of the best state are then computed step by step.
    """
    action, state = np.flatnonzero(columns.is_action), np.flatnonzero(~columns.is_action)
    if not len(action) or not len(state):
        return (), np.zeros(len(state))
    change, level = segments.changes(values, offsets), np.stack([centred(a, offsets) for a in values[action]])
    table = _table(np.concatenate([change[action], level]), change[state], offsets, settings)
    found, whole = [], np.array([0, offsets[-1]])
    for a, number in enumerate(action.tolist()):
        for order in settings.memories:
            memory, pairs = _memory(values[number], offsets, order), []
            driver = whitened(values[number], memory, offsets)
            for of_change, row in ((False, table[a]), (True, table[len(action) + a])):
                s, k = np.unravel_index(int(np.argmax(row)), row.shape)
                lag = int(k) - settings.farthest_lag
                response = whitened((change if of_change else values)[state[s]], memory, offsets)
                for _ in range(2):  # around the coarse lag, and where that is another one, the best
                    usual = _correlations(driver, response, whole, offsets, lag, settings.max_lag)[0]
                    off = int(np.argmax(np.abs(usual))) - settings.max_lag
                    if not off:
                        break
                    lag += off
                pairs.append(Pair(number, int(state[s]), of_change, memory, lag, usual))
            best = max(pairs, key=lambda pair: pair.correlation)
            if best.correlation >= settings.min_correlation:
                found.append(best)
                break
    found.sort(key=lambda pair: -pair.correlation)
    return tuple(found[: settings.max_pairs]), np.asarray(table.max(axis=(0, 2)))


def _table(drivers: Array, responses: Array, offsets: Array, s: FaultSettings) -> Array:
    """Size of the correlation of each driver with each response at the lags up to `farthest_lag`, (A, R, 2 L + 1), from
    transforms of pieces of the series. Lags beyond `max_lag` count for less: motion that repeats has many."""
    reach, size = s.farthest_lag, 4 * s.farthest_lag
    power = np.outer((drivers**2).sum(axis=1), (responses**2).sum(axis=1))
    first, other = (_padded(series, offsets, reach)[0] for series in (drivers, responses))
    n_pieces = -(-first.shape[1] // size)
    first = np.pad(first, ((0, 0), (0, n_pieces * size - first.shape[1])))
    other = np.pad(other, ((0, 0), (reach, reach + n_pieces * size - other.shape[1])))
    windows = np.lib.stride_tricks.sliding_window_view(other, size + 2 * reach, axis=1)[:, ::size]
    spectra = np.fft.rfft(first.reshape(len(first), n_pieces, size), size + 2 * reach).conj(), np.fft.rfft(windows)
    own, others = (np.ascontiguousarray(spectrum.transpose(2, 0, 1)) for spectrum in spectra)
    cross = np.matmul(own, others.transpose(0, 2, 1)).transpose(1, 2, 0)
    sums = np.fft.irfft(cross, size + 2 * reach)[:, :, : 2 * reach + 1]
    far = np.abs(np.arange(2 * reach + 1) - reach) > s.max_lag
    return np.asarray(np.abs(sums) / np.sqrt(power + 1e-300)[:, :, None] * np.where(far, s.far_lag, 1.0))


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
        own = _correlations(driver, response, offsets, offsets, pair.lag, settings.max_lag)
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


def _correlations(driver: Array, response: Array, groups: Array, offsets: Array, lag: int, reach: int) -> Array:
    """Cross-correlation at `lag` and `reach` lags on each side, over each group of demonstrations, (G, 2 L + 1).

    `groups` begin and end where demonstrations do.
    """
    power = np.add.reduceat(driver**2, groups[:-1]) * np.add.reduceat(response**2, groups[:-1])
    margin = reach + abs(lag)
    first, starts = _padded(driver, offsets, margin)
    other, _ = _padded(response, offsets, margin)
    middle, starts = first[margin:-margin], starts[np.searchsorted(offsets, groups[:-1])] - margin
    begin = margin + lag - reach
    lags = [np.add.reduceat(middle * other[k : k + len(middle)], starts) for k in range(begin, begin + 2 * reach + 1)]
    return np.asarray(np.stack(lags, axis=1) / np.sqrt(power + 1e-300)[:, None])
