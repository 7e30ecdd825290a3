"""Which fault, when undone, makes a demonstration fit the maps of the others: limits from a sample, then each block.

For a linear fault, the gain of undoing it where it is follows from the gain of undoing it where it is not; the others
are planted into the sample. Where the two gains overlap, that fault of that column is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.demonstrations import Block
from rpil.faults.columns import Columns
from rpil.faults.lag import Lag
from rpil.faults.maps import OF_ROWS, Frame, Tried, fit_maps, gains, left_over, misfit, plant, undo
from rpil.faults.settings import FaultSettings
from rpil.numerics.types import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Namer:
    """What names the fault of a demonstration.

    Attributes
    ----------
    maps : (F, K, D) array
        `fit_maps`.
    usual : (K,) array
        Mean squares.
    limit, rest : (H,) arrays
        Gain from which a fault is named, NaN where nothing is known; and what may be left over beyond the usual then.
    screen : float
        What a demonstration leaves over beyond the usual, from which on faults are tried.
    """

    frame: Frame
    tried: Tried
    maps: Float[Array, "F K D"]
    usual: Float[Array, " K"]
    limit: Float[Array, " H"]
    rest: Float[Array, " H"]
    screen: float

    def name(self, number: int, values: Float[Array, "T C"]) -> tuple[int, float]:
        """The fault tried that a demonstration has, or -1, and what undoing it gains."""
        maps, moments = self.maps[number % len(self.maps)], self.frame.moments(values)
        if moments is None:
            return -1, 0.0
        excess = float(np.log(misfit(maps, moments) / self.usual).sum() / 2)
        if excess <= self.screen:
            return -1, 0.0
        gain = gains(values, moments, maps, self.frame, self.tried)
        gain = np.where((gain > self.limit) & (excess - gain <= self.rest), gain, 0.0)
        best = int(np.argmax(gain))
        return (best, float(gain[best])) if gain[best] > 0 else (-1, 0.0)


def name_block(namer: Namer | None, values: Float[Array, "C T"], block: Block, numbers: Array) -> tuple[Array, Array]:
    """`Namer.name` of each demonstration of a block, (M,) and (M,)."""
    found = np.tile([-1.0, 0.0], (len(numbers), 1))
    if namer is not None:
        rows = values[namer.frame.column].T
        for m, (number, first, end) in enumerate(zip(numbers, block.offsets, block.offsets[1:], strict=False)):
            found[m] = namer.name(int(number), rows[first:end])
    return found[:, 0].astype(int), found[:, 1]


def learn(
    sample: Block, numbers: Int[Array, " M"], columns: Columns, lag: Lag, n_all: int, s: FaultSettings
) -> Namer | None:
    """The maps of a sample, and the limits of the gains in it; None where no map tells anything."""
    action, state = (chosen[: s.map_columns] for chosen in lag.most_related)
    if not len(action) or not len(state) or len(numbers) < s.min_demonstrations:
        return None
    own = np.concatenate([np.sort(state), np.sort(action)])
    values = columns.of(sample)[own]
    rows = [values[:, a:b].T for a, b in zip(sample.offsets, sample.offsets[1:], strict=False)]
    spread, best = values.std(axis=1), None
    for steps in dict.fromkeys([0, 1, 2, *[pair.lag for pair in lag.pairs[:1]]]):
        frame = Frame(own, len(state), steps, np.where(spread > 0, spread, 1.0), s.map_rows)
        seen = [frame.moments(x) for x in rows]
        kept = [m for m, g in enumerate(seen) if g is not None]
        if len(kept) < s.min_demonstrations:
            continue
        fold = numbers[kept] % s.map_folds
        moments = np.stack([g for g in seen if g is not None])
        maps = fit_maps(moments, fold, frame, s)
        left = np.log([misfit(maps[f], g) for f, g in zip(fold, moments, strict=True)])
        apart = _apart([rows[m] for m in kept[:: -(-len(kept) // s.lag_sample)]], maps[0], frame)
        if best is None or apart > best[0]:
            best = apart, frame, maps, left, kept
    if best is None or not best[2].any():
        return None
    _, frame, maps, left, kept = best
    usual = np.median(left, axis=0)
    excess = (left - usual).sum(axis=1) / 2
    share = max(1.0 - s.map_tested / n_all, 0.0)
    screen = float(np.quantile(excess, share)) if share else -np.inf
    chosen = np.unique(np.linspace(0, len(kept) - 1, s.map_sample).astype(int))
    tried, sampled = Tried.of(frame), [kept[k] for k in chosen]
    clean, planted, rest = _gains([rows[m] for m in sampled], maps[numbers[sampled] % s.map_folds], frame, tried, usual)
    return Namer(frame, tried, maps, np.exp(usual), _limits(clean, planted, s), _above(rest, s), screen)


def _apart(rows: list[Array], maps: Array, frame: Frame) -> float:
    """How far apart the gains of undoing faults of all columns are, without and with the fault."""
    clean, planted, _ = _gains(rows, np.broadcast_to(maps, (len(rows), *maps.shape)), frame, Tried.of(frame), 0.0)
    return float((np.median(planted, axis=0) - np.median(clean, axis=0))[-len(OF_ROWS) :].sum())


def _gains(rows: list[Array], maps: Array, frame: Frame, tried: Tried, usual: Array | float) -> tuple[Array, ...]:
    """Gains of undoing each fault in demonstrations without, and with it, and what is left over then, (M, H)."""
    clean, planted, rest = [], [], []
    for x, own in zip(rows, maps, strict=True):
        moments = frame.moments(x)
        assert moments is not None
        gain = gains(x, moments, own, frame, tried)
        with_fault, excess = -gain, np.full(len(gain), (np.log(misfit(own, moments)) - usual).sum() / 2)
        for h, kind in enumerate(OF_ROWS, start=len(gain) - len(OF_ROWS)):
            changed = plant(kind, x, frame.n_states)
            other = frame.moments(changed)
            if other is not None:
                before = misfit(own, other)
                with_fault[h] = left_over(undo(kind, changed, frame.n_states), own, frame, before)
                excess[h] = (np.log(before) - usual).sum() / 2 - with_fault[h]
        clean.append(gain)
        planted.append(with_fault)
        rest.append(excess)
    return np.array(clean), np.array(planted), np.array(rest)


def _above(rest: Array, s: FaultSettings) -> Array:
    """From where on what is left over is unusual (Tukey 1977)."""
    low, high = np.quantile(rest, [0.25, 0.75], axis=0)
    return np.asarray(high + s.map_rest * (high - low))


def _limits(clean: Array, planted: Array, s: FaultSettings) -> Array:
    """Between the gains without and with a fault, as far from both in their spreads; NaN where they overlap."""
    below, middle = np.quantile(clean, [0.75, 0.5], axis=0), np.median(planted, axis=0)
    wide = below[0] - below[1], middle - np.quantile(planted, 0.25, axis=0)
    limit = (below[1] * wide[1] + middle * wide[0]) / np.maximum(wide[0] + wide[1], 1e-9)
    limit = np.maximum(limit, s.least_gain)
    is_known = (below[1] + s.map_tail * wide[0] < limit) & (middle - s.map_tail * wide[1] > limit)
    return np.asarray(np.where(is_known, limit, np.nan))
