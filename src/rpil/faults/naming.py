"""Which fault, when undone, makes a demonstration fit the maps of the others: limits from a sample, then each block.

For a fault of columns, the gain of undoing it where it is follows from the gain of undoing it where it is not; faults
of time are planted into the sample. Where the two gains overlap, that fault of that column is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.demonstrations import Block
from rpil.faults.alignment import Frame, fit_maps, misfit
from rpil.faults.columns import Columns
from rpil.faults.lag import Lag
from rpil.faults.settings import FaultSettings
from rpil.faults.undo import OF_ROWS, SHIFTS, UNITS, Tried, Weights, plant, scores, whole_gain
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Namer:
    """What names the fault of a demonstration; `limit` (H,) are gains from which a fault is named, NaN where nothing is
    known, and `far` (C,) the offsets, in standard deviations."""

    frame: Frame
    tried: Tried
    weights: tuple[Weights, ...]
    limit: Float[Array, " H"]
    far: Float[Array, " C"]
    screen: float  # what a demonstration leaves over beyond the usual, from which on faults are tried

    def name(self, number: int, values: Float[Array, "T C"]) -> tuple[int, float, float]:
        """The fault tried that a demonstration has, or -1; what undoing it gains; and the offset of its column."""
        weights = self.weights[number % len(self.weights)]
        moments = self.frame.moments(values)
        if moments is None:
            return -1, 0.0, 0.0
        excess = float(np.log(misfit(weights.maps, moments) / weights.usual).sum() / 2)
        if excess <= self.screen:
            return -1, 0.0, 0.0
        found = scores(values, weights, self.frame, self.tried)
        if found is None:
            return -1, 0.0, 0.0
        gain, off = found
        fits = np.ones(len(gain), dtype=bool)
        fits[self.tried.kind == "offset"] = np.abs(off) > self.far
        fits[self.tried.kind == "scale"] = self._has_size(moments).ravel()
        # A fault explains what is odd; of one column, with noise, a part of it.
        share = np.select([np.isin(self.tried.kind, SHIFTS), self.tried.kind == "frame rate"], [0.5, 0.0], 0.2)
        gain = np.where(fits & (gain > np.maximum(self.limit, share * excess)), gain, 0.0)
        best = int(np.argmax(gain))
        column = self.tried.columns[best, 0]
        return (best, float(gain[best]), float(off[column])) if gain[best] > 0 else (-1, 0.0, 0.0)

    def _has_size(self, moments: Array) -> Array:
        """Whether each column has about the size that it would have in each other unit, (U, C)."""
        now, frame = self.frame.places()[:, 1], self.frame
        square = frame.spread**2 * moments[now, now] + 2 * frame.spread * frame.centre * moments[now, -1]
        size = np.log(np.maximum(square + frame.centre**2, 1e-300)) - np.log(frame.spread**2 + frame.centre**2)
        factor = np.log(UNITS)[:, None]
        return np.asarray(np.abs(size / 2 + factor) < 0.75 * np.abs(factor))


def name_block(namer: Namer | None, values: Float[Array, "C T"], block: Block, numbers: Array) -> tuple[Array, Array]:
    """`Namer.name` of each demonstration of a block: faults, (M,), and gains and offsets, (M, 2)."""
    found = np.tile([-1.0, 0.0, 0.0], (len(numbers), 1))
    if namer is not None:
        rows = values[namer.frame.column].T
        for m, (number, first, end) in enumerate(zip(numbers, block.offsets, block.offsets[1:], strict=False)):
            found[m] = namer.name(int(number), rows[first:end])
    return found[:, 0].astype(int), found[:, 1:]


def learn(
    sample: Block, numbers: Int[Array, " M"], columns: Columns, lag: Lag, n_all: int,
    s: FaultSettings,
) -> Namer | None:  # fmt: skip
    """The maps of a sample, and the limits of the gains in it; None where no map tells anything."""
    action, state = np.flatnonzero(columns.is_action), np.flatnonzero(~columns.is_action)
    if len(action) and len(state):
        chosen_actions = np.sort(np.argsort(-lag.related.max(axis=1), kind="stable")[: s.map_columns])
        follows = lag.related[chosen_actions].max(axis=0)
        action, state = action[chosen_actions], state[np.sort(np.argsort(-follows, kind="stable")[: s.map_columns])]
    if not len(action) or not len(state) or len(numbers) < s.min_demonstrations:
        return None
    values, own = columns.of(sample), np.concatenate([state, action])
    values = values[own]
    rows = [values[:, a:b].T for a, b in zip(sample.offsets, sample.offsets[1:], strict=False)]
    spread, best = values.std(axis=1), None
    leap = 2 * np.quantile([np.abs(np.diff(x, axis=0)).max(axis=0, initial=0) for x in rows], 0.75, axis=0) + 1e-12
    for steps in dict.fromkeys([0, 1, 2, *[lag.steps] * lag.is_known]):
        frame = Frame(
            own, len(state), steps, np.median(values, axis=1), np.where(spread > 0, spread, 1.0), leap, s.map_rows
        )
        seen = [frame.moments(x) for x in rows]
        kept = [m for m, g in enumerate(seen) if g is not None]
        if len(kept) < s.min_demonstrations:
            continue
        fold = numbers[kept] % s.map_folds
        moments = np.stack([g for g in seen if g is not None])
        maps = fit_maps(moments, fold, frame, s)
        left = np.log([misfit(maps[f], g) for f, g in zip(fold, moments, strict=True)])
        usual = np.median(left, axis=0)
        apart = _apart([rows[m] for m in kept[:: -(-len(kept) // s.lag_sample)]], maps[0], frame)
        if best is None or apart > best[0]:
            best = apart, frame, maps, np.exp(usual), left - usual, kept
    if best is None or not best[2].any():
        return None
    _, frame, maps, usual, excess, kept = best
    tried = Tried.of(frame)
    weights = tuple(Weights.of(b, usual, frame, tried.pairs) for b in maps)
    share = max(1.0 - s.map_tested / n_all, 0.0)
    screen = float(np.quantile(excess.sum(axis=1) / 2, share)) if share else -np.inf
    chosen = [kept[k] for k in np.unique(np.linspace(0, len(kept) - 1, s.map_sample).astype(int))]
    clean, planted, off = _gains([rows[m] for m in chosen], numbers[chosen] % s.map_folds, weights, frame, tried)
    limit = _limits(clean, planted, s)
    far = np.maximum(s.offset_factor * np.quantile(np.abs(off), 0.75, axis=0), s.least_offset)
    used: Array = np.any(maps, axis=(0, 1))
    is_known = (far < s.largest_offset) & used[frame.places()[:, 1]]
    limit[tried.kind == "offset"] = np.where(is_known, s.least_gain, np.nan)
    return Namer(frame, tried, weights, limit, far, screen)


def _apart(rows: list[Array], maps: Array, frame: Frame) -> float:
    """How far apart the gains of undoing faults of all columns are, without and with the fault."""
    return sum(
        float(np.median([whole_gain(kind, plant(kind, x, frame.n_states), maps, frame) for x in rows]))
        - float(np.median([whole_gain(kind, x, maps, frame) for x in rows]))
        for kind in ("reversed", "frame rate", "+1", "-1")
    )


def _gains(
    rows: list[Array], fold: Array, weights: tuple[Weights, ...], frame: Frame, tried: Tried
) -> tuple[Array, Array, Array]:
    """Gains of undoing each fault in demonstrations without, and with it, (M, H), and offsets, (M, C)."""
    clean, planted, offsets = [], [], []
    whole = {kind: int(np.flatnonzero(tried.kind == kind)[0]) for kind in OF_ROWS}
    for x, f in zip(rows, fold.tolist(), strict=True):
        found = scores(x, weights[f], frame, tried)
        assert found is not None
        gain, off = found
        with_fault = -gain
        scale = np.flatnonzero(tried.kind == "scale").reshape(len(UNITS) // 2, 2, -1)
        with_fault[scale] = -gain[scale[:, ::-1]]  # the other unit is the inverse
        for kind, h in whole.items():
            with_fault[h] = whole_gain(kind, plant(kind, x, frame.n_states), weights[f].maps, frame)
        clean.append(gain)
        planted.append(with_fault)
        offsets.append(off)
    return np.array(clean), np.array(planted), np.array(offsets)


def _limits(clean: Array, planted: Array, s: FaultSettings) -> Array:
    """Between the gains without and with a fault, as far from both in their spreads; NaN where they overlap."""
    below, middle = np.quantile(clean, [0.75, 0.5], axis=0), np.median(planted, axis=0)
    wide = below[0] - below[1], middle - np.quantile(planted, 0.25, axis=0)
    limit = (below[1] * wide[1] + middle * wide[0]) / np.maximum(wide[0] + wide[1], 1e-9)
    limit = np.maximum(limit, s.least_gain)
    is_known = (below[1] + s.map_tail * wide[0] < limit) & (middle - s.map_tail * wide[1] > limit)
    return np.asarray(np.where(is_known, limit, np.nan))
