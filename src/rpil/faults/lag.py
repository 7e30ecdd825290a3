"""The lag between an action and the state that follows it, by cross-correlation of changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.faults import segments
from rpil.faults.columns import Columns
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Lag:
    """The action and the state, numbers of `Columns`, whose changes, or the action and the change of the state, are
    most correlated, and after how many steps; and the largest correlation of each action with each state, (A, S)."""

    action: int
    state: int
    steps: int
    related: Float[Array, "A S"]

    @property
    def is_known(self) -> bool:
        """Whether there is an action that a state follows."""
        return self.state >= 0


def find_lag(values: Float[Array, "C T"], offsets: Int[Array, " _"], columns: Columns, s: FaultSettings) -> Lag:
    """The usual lag, from one transform of each column."""
    action, state = np.flatnonzero(columns.is_action), np.flatnonzero(~columns.is_action)
    if not len(action) or not len(state):
        return Lag(-1, -1, 0, np.zeros((len(action), len(state))))
    change, level = segments.changes(values, offsets), np.stack([centred(a, offsets) for a in values[action]])
    table = _table(np.concatenate([change[action], level]), change[state], offsets, s)
    related = table.max(axis=2).reshape(2, len(action), len(state)).max(axis=0)
    a, b, k = np.unravel_index(int(np.argmax(table)), table.shape)
    is_known = table[a, b, k] >= s.min_correlation
    return Lag(int(action[a % len(action)]), int(state[b]) if is_known else -1, int(k) - s.farthest_lag, related)


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


def centred(values: Float[Array, " T"], offsets: Int[Array, " _"]) -> Float[Array, " T"]:
    """Distances from the mean of each demonstration."""
    lengths = np.diff(offsets)
    return np.asarray(values - np.repeat(np.add.reduceat(values, offsets[:-1]) / lengths, lengths))


def _padded(values: Array, offsets: Array, n_zeros: int) -> tuple[Array, Array]:
    """(..., T) with zeros before and after each demonstration, and where each demonstration begins, (M,)."""
    n_demonstrations = len(offsets) - 1
    rows = np.arange(offsets[-1]) + n_zeros * (1 + np.repeat(np.arange(n_demonstrations), np.diff(offsets)))
    out = np.zeros((*values.shape[:-1], offsets[-1] + n_zeros * (n_demonstrations + 1)))
    out[..., rows] = values
    return out, offsets[:-1] + n_zeros * (1 + np.arange(n_demonstrations))
