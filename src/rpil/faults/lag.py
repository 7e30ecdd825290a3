"""The lag between an action and the state that follows it, by cross-correlation."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Pair:
    """An action and the state column that is best aligned with it; both are numbers of `MeasuredColumns`."""

    action: int
    state: int
    of_change: bool  # whether the changes of the state are aligned with it (a speed), not its level (a position)
    memory: Float[Array, " P"]
    """How the action follows from its last P values. It is taken out of both series (Box and Jenkins 1970,
    prewhitening), without which a slow action is correlated with what happens at many lags."""
    usual: Float[Array, " K"]
    """Usual cross-correlation at the lags -L to L steps, K = 2 L + 1; at a positive lag the state is later."""

    @property
    def lag(self) -> int:
        """Steps after which the state follows the action; negative where the action follows the state."""
        return int(np.argmax(np.abs(self.usual))) - len(self.usual) // 2

    @property
    def correlation(self) -> float:
        """At that lag, without its sign."""
        return float(np.abs(self.usual).max())


def find_lag(sample: MovingBlock, max_lag: int, told: Collection[int]) -> tuple[tuple[Pair, ...], Int[Array, " C"]]:
    """The state column that is best aligned with each action that has one, the most correlated pair first; and the
    partner of each column. Columns that are `told`, commands and their states, need no pair. The longest memory with
    which there is one tells the lag best. Of many states, those are looked at whose changes are most correlated with
    the action or its changes."""
    is_action = sample.columns.is_action
    action, state, partner = np.flatnonzero(is_action), np.flatnonzero(~is_action), np.full(len(is_action), -1)
    if not len(action) or not len(state) or len({*told}) == len(partner):
        return (), partner
    related, pairs = _related(sample, action, state, max_lag), []
    for row, own in zip(related, action.tolist(), strict=True):
        near = state[np.sort(np.argsort(-row, kind="stable")[: settings.MAX_PARTNERS])]
        for order in settings.MEMORIES if own not in told else ():
            pair = _best_pair(sample, own, near, order, max_lag)
            if pair.correlation >= settings.MIN_CORRELATION:
                pairs.append(pair)
                break
    pairs.sort(key=lambda pair: -pair.correlation)
    if pairs and abs(pairs[0].lag) == max_lag == settings.MAX_LAG:  # it may be longer than what was looked at
        return find_lag(sample, 2 * max_lag, told)
    for some, other, of_own in ((action, state, related), (state, action, related.T)):
        partner[some] = np.where(of_own.max(axis=1) >= settings.LEAST_RELATED, other[of_own.argmax(axis=1)], -1)
    return tuple(pairs), partner


def _related(sample: MovingBlock, action: Int[Array, " A"], state: Int[Array, " S"], max_lag: int) -> Array:
    """The largest correlation, over the lags, of each action or its change with the change of each state, (A, S)."""
    change, offsets = sample.change, sample.offsets
    drivers = np.concatenate([change[action], centred(sample.values[action], offsets)])
    power = np.outer((drivers**2).sum(axis=1), (change[state] ** 2).sum(axis=1))
    middle, series, _ = _at_lags(drivers, change[state], offsets, max_lag)
    best = np.zeros((len(drivers), len(state)))
    for later in series:
        np.maximum(best, np.abs(middle @ later.T), out=best)
    return np.asarray((best / np.sqrt(power + 1e-300)).reshape(2, len(action), -1).max(axis=0))


def _best_pair(sample: MovingBlock, action: int, state: Int[Array, " S"], order: int, max_lag: int) -> Pair:
    """The action with the state, or its change, that is most correlated with it."""
    offsets = sample.offsets
    memory = _memory(sample.values[action], offsets, order)
    driver = whitened(sample.values[action], memory, offsets)
    candidates = []
    for of_change, series in ((False, sample.values[state]), (True, sample.change[state])):
        usual = _correlations(driver, whitened(series, memory, offsets), offsets, max_lag)
        s = int(np.argmax(np.abs(usual).max(axis=1)))
        candidates.append(Pair(action, int(state[s]), of_change, memory, usual[s]))
    return max(candidates, key=lambda pair: pair.correlation)


def shifts(block: MovingBlock, pairs: tuple[Pair, ...]) -> tuple[Array, Array, Float[Array, "M P"]]:
    """Steps by which the cross-correlations of each demonstration are shifted from the usual ones, what that shift
    adds to their agreement, relative to the agreement that is usual; and the correlation of each pair at its usual lag,
    positive where it is of the usual sign."""
    offsets, n_demonstrations, largest = block.offsets, len(block.numbers), settings.MAX_SHIFT
    signs, agreement = np.zeros((n_demonstrations, len(pairs))), np.zeros((n_demonstrations, 2 * largest + 1))
    for p, pair in enumerate(pairs):
        driver = whitened(block.values[pair.action], pair.memory, offsets)
        response = whitened((block.change if pair.of_change else block.values)[pair.state], pair.memory, offsets)
        own = _own_correlations(driver, response, offsets, len(pair.usual) // 2)
        at = int(np.argmax(np.abs(pair.usual)))
        signs[:, p] = own[:, at] * np.sign(pair.usual[at])
        middle = pair.usual[largest:-largest]
        for k in range(2 * largest + 1):
            agreement[:, k] += own[:, k : k + len(middle)] @ middle
    usual = sum(float(pair.usual[largest:-largest] @ pair.usual[largest:-largest]) for pair in pairs)
    best = np.argmax(agreement, axis=1)
    gain = (agreement[np.arange(n_demonstrations), best] - agreement[:, largest]) / max(usual, 1e-12)
    return best - largest, gain, signs


def centred(values: Float[Array, "... T"], offsets: Int[Array, " _"]) -> Float[Array, "... T"]:
    """Distances from the mean of each demonstration."""
    lengths = np.diff(offsets)
    means = np.add.reduceat(values, offsets[:-1], axis=-1) / lengths
    return np.asarray(values - np.repeat(means, lengths, axis=-1))


def whitened(values: Float[Array, "... T"], memory: Float[Array, " P"], offsets: Int[Array, " _"]) -> Array:
    """x_t - sum_i memory_i x_(t-i) of the centred values, and 0 at the first P steps of each demonstration."""
    level = centred(values, offsets)
    out = level.copy()
    for back, weight in enumerate(memory.tolist(), start=1):
        out[..., back:] -= weight * level[..., :-back]
    for step in range(len(memory)):
        out[..., np.minimum(offsets[:-1] + step, offsets[1:] - 1)] = 0.0
    return out


def _memory(values: Float[Array, " T"], offsets: Int[Array, " _"], order: int) -> Float[Array, " P"]:
    """The weights of the last values with which they predict the next one best."""
    own = centred(values, offsets)
    first = np.repeat(offsets[:-1], np.diff(offsets))
    rows = np.flatnonzero(np.arange(len(own)) - first >= order)
    past = np.stack([own[rows - back] for back in range(1, order + 1)], axis=1)
    return np.asarray(np.linalg.lstsq(past, own[rows], rcond=1e-9)[0])


def _at_lags(driver: Array, series: Array, offsets: Array, max_lag: int) -> tuple[Array, list[Array], Array]:
    """The driver (..., T + L (M - 1)) and, at each lag from -L to L, the series, with zeros between demonstrations; and
    where each demonstration begins."""
    lengths = np.diff(offsets)
    gaps = max_lag * np.arange(1, len(lengths) + 1)
    rows = np.arange(offsets[-1]) + np.repeat(gaps, lengths)
    padded = [np.zeros((*values.shape[:-1], offsets[-1] + max_lag * (len(lengths) + 1))) for values in (driver, series)]
    for out, values in zip(padded, (driver, series), strict=True):
        out[..., rows] = values
    middle = padded[0][..., max_lag:-max_lag]
    later = [padded[1][..., k : k + middle.shape[-1]] for k in range(2 * max_lag + 1)]
    return middle, later, offsets[:-1] + gaps - max_lag


def _correlations(driver: Array, change: Array, offsets: Array, max_lag: int) -> Array:
    """Cross-correlation of the driver with each change, over all demonstrations, (C, 2 L + 1)."""
    norm = np.sqrt((driver @ driver) * np.einsum("ct,ct->c", change, change)) + 1e-300
    middle, series, _ = _at_lags(driver, change, offsets, max_lag)
    return np.asarray(np.stack([later @ middle for later in series], axis=1) / norm[:, None])


def _own_correlations(driver: Array, change: Array, offsets: Array, max_lag: int) -> Array:
    """Cross-correlation of the driver with the change, of each demonstration, (M, 2 L + 1)."""
    power = np.add.reduceat(driver**2, offsets[:-1]) * np.add.reduceat(change**2, offsets[:-1])
    middle, series, starts = _at_lags(driver, change, offsets, max_lag)
    lags = [np.add.reduceat(middle * later, starts) for later in series]
    return np.asarray(np.stack(lags, axis=1) / np.sqrt(power + 1e-300)[:, None])
