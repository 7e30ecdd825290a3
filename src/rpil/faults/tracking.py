"""Commands of positions and the states that follow them, and what holds between them in any recording.

An action and a state go together where their names agree but for a word such as action or state, their numbers
included, or else where one follows the other. Where the slope between them is near 1, the action is a command in the
unit of the state. Then the state follows its own command, later, in its sense and unit, to its level, and no other
demonstration is needed to know it. The lag between them is found by cross-correlation.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, part_means
from rpil.numerics.types import Array, Bool, Float, Int


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
    rows = np.flatnonzero(np.arange(len(own)) - np.repeat(offsets[:-1], np.diff(offsets)) >= order)
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
    own, offsets, far = pairs.action[fits], block.offsets, settings.MAX_SHIFT
    begins, lengths, spread = offsets[:-1], np.diff(offsets), block.columns.spread[own, None]
    actions = centred(block.values[own] / spread, offsets)
    states = centred(block.values[pairs.state[fits]] * pairs.slope[fits, None] / spread, offsets)
    power = np.add.reduceat(np.einsum("pt,pt->t", actions, actions), begins) / lengths
    to_end = np.repeat(offsets[1:], lengths) - np.arange(offsets[-1])  # steps, with the step itself
    left, apart = np.full((len(lengths), 2 * far + 1), np.inf), np.empty_like(actions)
    for lag in range(-far, far + 1):
        n, (first, later) = abs(lag), (actions, states) if lag >= 0 else (states, actions)
        rows = max(len(to_end) - n, 0)
        np.subtract(first[:, :rows], later[:, n:], out=apart[:, :rows])
        apart[:, to_end <= n] = 0.0  # what is later there belongs to the next demonstration
        compared = np.maximum(lengths - n, 1)
        squares = np.add.reduceat(np.einsum("pt,pt->t", apart, apart), begins) / compared
        means = np.add.reduceat(apart, begins, axis=1) / compared
        is_known = (compared >= 3) | (lag == 0)
        left[is_known, lag + far] = (squares - (means**2).sum(axis=0))[is_known]
    return np.asarray(np.maximum(left, 0.0) / np.maximum(power, 1e-12)[:, None])
