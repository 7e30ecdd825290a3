"""Linear maps between states and actions, and which fault, when undone, makes a demonstration fit those of the others.

A window holds the states and the actions of three steps, the states `lag` steps later, less their means over the
demonstration: a level that differs by a calibration or a session is no fault. Two linear models are fitted to the other
demonstrations: a_t from s_{t-1..t+1}, and s_{t+1} - s_t from s_t, a_{t-1}, a_t. Both are maps of the robot and its
controller rather than of who demonstrates. `B z` are their residuals in a window z. With the mean G of z z' over a
demonstration, the mean squares e are the diagonal of B G B'.

Undoing a fault gains sum_k log(e_k / e'_k) / 2, with e' afterwards. Signs are linear in z: what is left over
becomes r + q, and e' = e + 2 <r, q> + <q, q>.

What undoing a fault gains in the demonstrations as they are tells from where on a gain is unusual. Power without
planting: the loss from undoing a fault in a clean demonstration equals the gain in one that has it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rpil.faults import settings
from rpil.faults.lag import Pair
from rpil.faults.measured_columns import MovingBlock
from rpil.numerics.types import Array, Float, Int

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

    def rows_of(self, block: MovingBlock) -> list[Float[Array, "_ C"]]:
        """Its columns in each demonstration of a block, less their centre, in spreads."""
        rows = ((block.values[self.column].T - self.centre) / self.spread).astype(np.float64)
        return [rows[a:b] for a, b in itertools.pairwise(block.offsets)]

    @cached_property
    def places(self) -> Int[Array, "C 3"]:
        """Where in a window each column is, at the step before, at the step, and after."""
        n, width, step = self.n_states, len(self.column), np.arange(settings.WIDTH)
        states = np.arange(n)[:, None] + n * step
        return np.concatenate([states, settings.WIDTH * n + np.arange(width - n)[:, None] + (width - n) * step])

    @cached_property
    def tried(self) -> tuple[Array, Int[Array, " H"]]:
        """The kinds of the faults that are tried, H of them, and the positions of their columns, -1 where all have it:
        each sign, `OF_ROWS`, and each offset."""
        columns = np.arange(len(self.column))
        kinds = ["sign"] * len(columns) + [*OF_ROWS] + ["offset"] * len(columns)
        return np.array(kinds), np.concatenate([columns, np.full(len(OF_ROWS), -1), columns])

    def moments(self, values: Float[Array, "T C"]) -> Float[Array, "D D"] | None:
        """G of a demonstration, whose columns are those of the window; None where it is too short."""
        n, size = self.n_states, len(values) - abs(self.lag) - settings.WIDTH + 1
        if size < 2 * settings.WIDTH:
            return None
        every = -(-size // settings.MAP_ROWS)
        sides = ((values[:, :n], max(self.lag, 0)), (values[:, n:], max(-self.lag, 0)))
        parts = [side[first + k : first + k + size : every] for side, first in sides for k in range(settings.WIDTH)]
        window = np.concatenate(parts, axis=1, dtype=np.float64)
        window -= window.mean(axis=0)
        return np.asarray(window.T @ window / len(window))


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
    return np.asarray(((maps @ moments) * maps).sum(axis=1) + settings.FLOOR)


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
    gain = np.log(left / np.maximum(left + 2 * first + second, settings.FLOOR)).sum(axis=1) / 2
    undone = [window.moments(undo(kind, values, window.n_states)) for kind in OF_ROWS]  # None: it is too short
    of_rows = [0.0 if g is None else float(np.log(left / misfit(maps, g)).sum() / 2) for g in undone]
    return np.append(gain, of_rows)


def levels(values: Float[Array, "T C"], maps: Float[Array, "K D"], window: Window) -> Float[Array, " K"]:
    """What the maps leave over of the mean of a demonstration."""
    return np.asarray(per_column(maps, window) @ values.mean(axis=0))


def per_column(maps: Float[Array, "... K D"], window: Window) -> Float[Array, "... K C"]:
    """What the maps leave over of a constant in a column."""
    return np.asarray(maps[..., window.places].sum(axis=-1))


@dataclass(frozen=True, eq=False)
class Level:
    """What the maps leave over of the means of demonstrations: its centre and variance, (K,), and from where on the
    sum of squares is unusual. A constant that is added to a column changes nothing else."""

    centre: Float[Array, " K"]
    variance: Float[Array, " K"]
    rest: float = np.inf

    @classmethod
    def of(cls, levels: Float[Array, "M K"]) -> Level:
        """From those of a sample."""
        centre = np.median(levels, axis=0)
        variance = np.median((levels - centre) ** 2, axis=0) / 0.455 + settings.FLOOR
        plain = cls(centre, variance)
        return replace(plain, rest=float(_above(np.array([plain.excess(x) for x in levels]), settings.FENCE)))

    def excess(self, level: Float[Array, " K"]) -> float:
        return float(((level - self.centre) ** 2 / self.variance).sum() / 2)

    def gains(self, level: Float[Array, " K"], column: Float[Array, "K C"]) -> Float[Array, " C"]:
        """What taking the best constant off each column gains, with `per_column`."""
        along = column.T @ ((level - self.centre) / self.variance)
        return np.asarray(along**2 / (2.0 * self.power(column)))

    def power(self, column: Float[Array, "K C"]) -> Float[Array, " C"]:
        """Twice what a constant of one standard deviation gains."""
        return np.asarray((column**2 / self.variance[:, None]).sum(axis=0) + settings.FLOOR)


@dataclass(frozen=True, eq=False)
class Namer:
    """What names the fault of a demonstration."""

    window: Window
    maps: Float[Array, "F K D"]
    """`fit_maps`."""
    usual: Float[Array, " K"]
    """Mean squares of what they leave over."""
    reach: Float[Array, "F C"]
    """Variances up to which the maps are known."""
    level: Level
    limit: Float[Array, " H"]
    """Gain from which a fault is named, NaN where nothing is known."""
    rest: float
    """What a demonstration leaves over beyond the usual, from which on that is unusual."""
    screen: float
    """The same, from which on faults other than offsets are tried."""

    def name(self, number: int, values: Float[Array, "T C"]) -> tuple[int, float]:
        """The fault tried that a demonstration has, and what undoing it gains; 0 where it has none."""
        maps, moments = self.maps[number % len(self.maps)], self.window.moments(values)
        reach, now = self.reach[number % len(self.maps)], self.window.places[:, 1]
        if moments is None or (moments.diagonal()[now] > reach).any():
            return 0, 0.0
        gain, n = np.zeros(len(self.limit)), len(self.limit) - len(self.window.column)
        excess = float(np.log(misfit(maps, moments) / self.usual).sum() / 2)
        if excess > self.screen:
            gain[:n] = gains(values, moments, maps, self.window)
            gain[:n] *= (gain[:n] > self.limit[:n]) & (excess - self.rest <= gain[:n] * settings.EXPLAINED)
        if not gain.any() and excess <= self.rest:  # an offset changes the level alone
            level = levels(values, maps, self.window)
            off = self.level.gains(level, per_column(maps, self.window))
            unusual = self.level.excess(level) - self.level.rest
            gain[n:] = off * ((off > self.limit[n:]) & (unusual <= off * settings.CONSTANT))
        best = int(np.argmax(gain))
        return best, float(gain[best])


def learn_maps(
    sample: MovingBlock, pairs: tuple[Pair, ...], most_related: tuple[Array, Array], n_all: int
) -> Namer | None:
    """The maps of a sample, and the limits of the gains in it; None where no map tells anything. See `find_lag`."""
    action, state = (chosen[: settings.MAP_COLUMNS] for chosen in most_related)
    if not len(action) or not len(state) or len(sample.numbers) < settings.FEWEST_DEMONSTRATIONS:
        return None
    own = np.concatenate([np.sort(state), np.sort(action)])
    values = sample.values[own]
    centre, spread = np.median(values, axis=1), values.std(axis=1)
    found = []
    for steps in dict.fromkeys([0, 1, 2, *[pair.lag for pair in pairs[:1]]]):
        namer = _namer(sample, Window(own, len(state), steps, centre, spread), n_all)
        found += [] if namer is None else [namer]
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _namer(sample: MovingBlock, window: Window, n_all: int) -> tuple[float, Namer] | None:
    """How much faults of all columns would be seen with a window, and what names them; None where no map tells
    anything."""
    rows = window.rows_of(sample)
    seen = [window.moments(x) for x in rows]
    kept = [m for m, g in enumerate(seen) if g is not None]
    if len(kept) < settings.FEWEST_DEMONSTRATIONS:
        return None
    fold, moments = sample.numbers[kept] % settings.MAP_FOLDS, np.stack([g for g in seen if g is not None])
    maps = fit_maps(moments, fold, window)
    if not maps.any():
        return None
    left = np.log([misfit(maps[f], g) for f, g in zip(fold, moments, strict=True)])
    usual = np.median(left, axis=0)
    excess = (left - usual).sum(axis=1) / 2
    share = max(1.0 - settings.PILOT_DEMONSTRATIONS / n_all, 0.0)
    some = np.unique(np.linspace(0, len(kept) - 1, settings.MAP_SAMPLE).astype(int))
    gain = np.array([gains(rows[kept[k]], moments[k], maps[fold[k]], window) for k in some])
    offs = np.array([levels(rows[m], maps[f], window) for m, f in zip(kept, fold, strict=True)])
    level, column = Level.of(offs), per_column(maps, window)
    off = np.array([level.gains(x, column[f]) for x, f in zip(offs, fold, strict=True)])
    rest, screen = float(_above(excess, settings.FENCE)), float(np.quantile(excess, share)) if share else -np.inf
    limit = np.maximum(_above(gain, settings.TAIL), settings.LEAST_GAIN)
    middle = window.places[:, 1]
    means = np.array([moments[others(fold, f)].mean(axis=0)[middle, middle] for f in range(len(maps))])
    limit = np.append(limit, np.maximum(4.0 * np.quantile(off, 0.9, axis=0), settings.OFFSET_GAIN))
    usual_ones = excess[some] <= np.quantile(excess, settings.MAP_POWER)
    power = np.append(_planted(gain[usual_ones]), settings.LEAST_OFFSET**2 / 2 * level.power(column[0]))
    known = np.where(power > limit, limit, np.nan)
    apart = float(-np.median(gain, axis=0)[len(window.column) :].sum())
    return apart, Namer(window, maps, np.exp(usual), settings.MAP_REACH * means, level, known, rest, screen)


def _planted(gain: Float[Array, "M H"]) -> Float[Array, " H"]:
    """What undoing each fault would gain at least in most demonstrations: what making it loses."""
    lost, n, rows = -np.quantile(gain, settings.MAP_POWER, axis=0), gain.shape[1] - len(OF_ROWS), list(OF_ROWS)
    return np.append(lost[:n], [lost[n + rows.index(opposite)] for opposite in OF_ROWS.values()])


def _above(values: Array, tail: float) -> Array:
    """From where on values of demonstrations are unusual, above most of them."""
    middle, high = np.quantile(values, [0.5, 0.75], axis=0)
    return np.asarray(high + tail * (high - middle))
