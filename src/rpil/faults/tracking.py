"""Commands of positions and the states that follow them, and what holds between them in any recording.

An action and a state go together where their names agree but for a word such as action or state, their numbers
included, or else where one follows the other. Where the slope between them is near 1, the action is a command in the
unit of the state. Then the state follows its own command, later, in its sense and unit, to its level, and no other
demonstration is needed to know it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import as_strided, sliding_window_view

from rpil.faults import settings
from rpil.faults.lag import centred
from rpil.faults.measured_columns import MovingBlock, part_means
from rpil.numerics.types import Array, Bool, Float, Int

_ROLE_WORDS = re.compile(
    r"^(?:(?:observations?|obs|actions?|states?|commands?|cmds?|targets?|desired|leader|follower|measured|actual)"
    r"[ ._/-]*)+(?=.)"
)
"""Words at the beginning of a name that say whether it is an action."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """P actions and the states that go with them."""

    action: Int[Array, " P"]  # a number of `MeasuredColumns`, as the next one
    state: Int[Array, " P"]
    slope: Float[Array, " P"]  # how the action changes with its state: 1 where it is a command in the unit of the state
    fits: Bool[Array, " P"]  # whether it usually does
    lag: int = 0  # steps after which the states usually follow
    is_command: bool = False  # whether the actions are known to be commands in the units of the states


def find_tracked(sample: MovingBlock) -> Tracked:
    """The pairs of a sample."""
    names, is_action = sample.columns.names, sample.columns.is_action
    plain = [_ROLE_WORDS.sub("", name.lower()) for name in names]
    states = {plain[c]: c for c in np.flatnonzero(~is_action).tolist()[::-1]}
    own = [(a, states[plain[a]]) for a in np.flatnonzero(is_action).tolist() if plain[a] in states]
    named = _fitted(sample, np.array(own, dtype=int).reshape(-1, 2))
    if named.is_command:
        return replace(named, slope=np.ones(len(own)))  # of a pair that does not fit, too, it is known
    actions, others = np.flatnonzero(is_action), np.flatnonzero(~is_action)
    if len(actions) and len(others):
        first = Tracked(actions, others, np.ones(len(actions)), np.ones(len(actions), dtype=bool), 1)
        share = np.median([squared_correlation(*parts) for parts in parts_of(sample, first)], axis=0)
        best = _fitted(sample, np.column_stack([actions, others[share.argmax(axis=1)]]))
        if best.is_command and len({*best.state[best.slope == 1.0].tolist()}) == (best.slope == 1.0).sum():
            named = replace(best, fits=best.slope == 1.0)
    chosen = {name: getattr(named, name)[named.fits] for name in ("action", "state", "slope", "fits")}
    return replace(named, **chosen)


def _fitted(sample: MovingBlock, own: Int[Array, "P 2"]) -> Tracked:
    """Pairs with their usual lag and slopes."""
    action, state = own.T
    pairs = Tracked(action, state, np.ones(len(own)), np.ones(len(own), dtype=bool))
    if not len(own):
        return pairs
    pairs = replace(pairs, lag=int(np.median(misfits(sample, pairs), axis=0).argmin()) - settings.MAX_SHIFT)
    every = relation(parts_of(sample, pairs), False)[:2]
    slope, share = (np.quantile(each, 0.5, axis=0, method="lower") for each in every)
    fits = share >= settings.TRACKS
    slope = np.where(fits & (np.abs(slope - 1.0) <= settings.SAME_UNIT), 1.0, slope)
    is_command = bool((fits & (slope == 1.0)).sum() >= max(2, len(own) / 2))
    fits &= (slope == 1.0) | (not is_command)
    found = replace(pairs, slope=slope, fits=fits, is_command=is_command)
    if not fits.any():
        return found
    return replace(found, lag=int(np.median(misfits(sample, found), axis=0).argmin()) - settings.MAX_SHIFT)


def are_strangers(sample: MovingBlock) -> bool:
    """Whether states go with the actions of other demonstrations as well as with those of their own: in what is special
    of each, its means over parts of time less the median ones, of which a few do not decide. Nothing is known where
    that does not last."""
    columns, n = sample.columns, len(sample.numbers)
    profile = np.moveaxis(part_means(sample.values, sample.offsets, 4 * settings.PARTS), 2, 0)  # (C, M, K)
    own = (profile - np.median(profile, axis=1, keepdims=True)) / np.maximum(columns.spread, 1e-300)[:, None, None]
    size = np.sqrt((own**2).mean(axis=2, keepdims=True))
    own *= np.minimum(1.0, np.median(size, axis=1, keepdims=True) / np.maximum(size, 1e-300))
    power = (own**2).mean(axis=(1, 2))
    lasting = (own[..., 1:] * own[..., :-1]).mean(axis=(1, 2)) >= settings.LEAST_RELATED * power
    lasting &= (np.sqrt(power) >= settings.LEAST_SPREAD) & (columns.memory >= settings.LEAST_MEMORY)
    actions, states = own[lasting & columns.is_action], own[lasting & ~columns.is_action]
    if n < settings.PARTS or not len(actions) or not len(states):
        return False
    both = [np.concatenate([states, np.gradient(states, axis=2)])]
    both += [np.roll(actions, k, axis=1) for k in range(settings.PARTS)]
    series, *rolled = (x.reshape(len(x), -1) / np.sqrt((x**2).sum(axis=(1, 2)) + 1e-300)[:, None] for x in both)
    own_best, *best = (float(np.abs(x @ series.T).max()) for x in rolled)
    by_chance = float(np.mean(best) + settings.ERRORS * np.std(best))
    return own_best < by_chance <= settings.LEAST_RELATED  # else a relation would not be seen


def parts_of(block: MovingBlock, pairs: Tracked) -> Iterator[tuple[Array, Array]]:
    """The actions and the states of each demonstration, (P, T), the states taken later by the lag."""
    late, early = max(pairs.lag, 0), max(-pairs.lag, 0)
    actions, states = block.values[pairs.action], block.values[pairs.state]
    for begin, end in itertools.pairwise(block.offsets.tolist()):
        most = max(end - begin - 2, 0)  # of a demonstration that is shorter, nothing is known
        first, last = min(early, most), min(late, most)
        yield actions[:, begin + first : end - last], states[:, begin + last : end - first]


def squared_correlation(actions: Float[Array, "A T"], states: Float[Array, "S T"]) -> Float[Array, "A S"]:
    """Squared correlation of each action with each state; 0 where either rests."""
    a, s = (values - values.mean(axis=1, keepdims=True) for values in (actions, states))
    power = np.outer((a**2).sum(axis=1), (s**2).sum(axis=1))
    return np.asarray((a @ s.T) ** 2 / np.where(power > 0, power, np.inf))


def relation(parts: Iterable[tuple[Array, Array]], is_command: bool) -> tuple[Array, ...]:
    """Slope and squared correlation of each action with its own state; the other state that goes with it best; and the
    shares of its variance that its own state, as it is for commands, and the other leave; of each of the `parts_of`
    demonstrations, (M, P)."""
    sums = []
    for actions, states in parts:
        u, v = (x.sum(axis=1, keepdims=True) / x.shape[1] for x in (actions, states))
        a, s = actions - u, states - v
        squares = (np.einsum("pt,pt->p", x, x) for x in (a, s))
        sums.append((a @ s.T, *squares, actions.shape[1] * (u - v.T) ** 2))
    both, power, other, apart = map(np.array, zip(*sums, strict=True))
    own, every = np.arange(both.shape[1]), power[:, :, None] * other[:, None]
    share, power = both**2 / np.where(every > 0, every, np.inf), np.maximum(power, 1e-200)
    slope = np.sign(both[:, own, own]) * np.sqrt(power / np.maximum(other, 1e-300))
    left = 1.0 - share
    if is_command:
        left = np.maximum(power[:, :, None] + other[:, None] - 2.0 * both + apart, 0.0) / power[:, :, None]
    mine = left[:, own, own]
    left[:, own, own] = np.inf
    best = left.argmin(axis=2) if len(own) else np.zeros(power.shape, dtype=int)
    return slope, share[:, own, own], best, mine, np.take_along_axis(left, best[..., None], axis=2)[..., 0]


def misfits(block: MovingBlock, pairs: Tracked) -> Float[Array, "M K"]:
    """Share of the variance of the actions that is left where the states are taken later by -L to L steps, over all
    pairs, each in its usual spread; infinite at a lag, but none, where fewer than three steps are compared."""
    fits = np.flatnonzero(pairs.fits)[: settings.LAG_PAIRS]
    own, n, lengths, far = pairs.action[fits], len(fits), np.diff(block.offsets), settings.MAX_SHIFT
    spread, width = block.columns.spread[own, None], 3 * far
    # One demonstration after the other in parts of `width` steps, with L zeros or more between; and sums of squares.
    parts = -(-(lengths + far) // width)
    heads = np.cumsum(parts) - parts
    begins = heads * width + far
    rows = np.arange(block.offsets[-1]) + np.repeat(begins - block.offsets[:-1], lengths)
    both = np.zeros((2, n + 1, parts.sum() * width + 2 * far))
    both[0, :n][:, rows] = centred(block.values[own] / spread, block.offsets)
    slope = pairs.slope[fits, None] / spread
    both[1, :n][:, rows] = centred(block.values[pairs.state[fits]] * slope, block.offsets)
    np.einsum("kpt,kpt->kt", both[:, :n], both[:, :n], out=both[:, n])
    # The products of all steps of a part with all that are near, which have those of each lag on a diagonal.
    near = sliding_window_view(both[1, :n], width + 2 * far, axis=1)[:, ::width].transpose(1, 0, 2)
    every = both[0, :n, far:-far].reshape(n, -1, width).transpose(1, 2, 0) @ near
    down, right = every.strides[1:]
    shape, strides = (len(every), width, 2 * far + 1), (every.strides[0], down + right, right)
    products = np.add.reduceat(as_strided(every, shape, strides).sum(axis=1), heads)
    # Less what is not compared at a lag: the first steps of the one, and the last steps of the other.
    steps, nothing = np.arange(far), np.zeros((n + 1, len(parts), 1))
    ends = (begins[:, None] + steps, (begins + lengths - 1)[:, None] - steps)
    first, last = (np.cumsum(both[:, :, at], axis=-1) for at in ends)
    a, s = (np.concatenate([x[..., ::-1], nothing, y], 2) for x, y in ((first[0], last[0]), (last[1], first[1])))
    power, other = np.add.reduceat(both[:, n], begins, axis=1)
    lags = np.abs(np.arange(-far, far + 1))
    compared = np.maximum(lengths[:, None] - lags, 1)
    left = (power + other)[:, None] - a[n] - s[n] - 2.0 * products
    left = left / compared - (((a - s)[:n] / compared) ** 2).sum(axis=0)
    left = np.maximum(left, 0.0) / np.maximum(power / lengths, 1e-12)[:, None]
    return np.where((compared >= 3) | (lags == 0), left, np.inf)
