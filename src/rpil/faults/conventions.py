"""The rules about what a set agrees on: constants, limits, order and sign of its columns, and where it is cut."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from rpil.data.text import counted, listed
from rpil.faults import settings
from rpil.faults.measured_columns import MeasuredColumns, MovingBlock, part_means
from rpil.faults.motion import Jump, Wraps
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, in_words
from rpil.faults.still import few
from rpil.numerics.types import Array, Bool, Float


class OutsideRange(ComparingRule):
    name, words, grade = "outside range", "an action passes a limit that the others touch", "broken"
    needs = ("several",)
    sentence = "{column} goes to {value:.4g}; the others touch {limit:.4g} and never pass it"
    causes = ("two units",)

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The largest value of each action, and the next smaller one, also downwards, of other signs, (M, 2 A);
        and the largest value, with either sign, of the observations that may stay the same."""
        actions, begins, found = block.block.actions, block.offsets[:-1], []
        # A code has no limit.
        actions = np.ascontiguousarray((actions if actions.ndim == 2 else np.zeros((len(actions), 0))).T)
        for of, sign in ((np.maximum, 1.0), (np.minimum, -1.0)):
            top = of.reduceat(actions, begins, axis=1)
            inside = actions != np.repeat(top, np.diff(block.offsets), axis=1)
            below = of.reduceat(np.where(inside, actions, actions.dtype.type(-sign * np.inf)), begins, axis=1)
            found.append((sign * top.T.astype(np.float64), sign * below.T.astype(np.float64)))
        same = block.block.observations[:, [*learned.same]]
        ends = (np.maximum.reduceat(values, begins, axis=0) for values in (same, -same))
        return *map(np.hstack, zip(*found, strict=True)), *ends

    def compare(self) -> Compared:
        (top, below), data = self.measured[:2], self.data
        self.names, n = data.learned.action_labels * 2, top.shape[1] // 2
        # Copies tell no limit.
        _, others = np.unique(np.column_stack([top, below, data.lengths]), axis=0, return_index=True)
        moves = np.isfinite(below[others])
        self.limits = np.array([limit_of(own[rows]) for own, rows in zip(top[others].T, moves.T, strict=True)])
        ranges = self.limits + np.median(np.roll(top, n, axis=1), axis=0)
        severity = np.nan_to_num((top - self.limits) / np.where(ranges > 0, ranges, np.nan)) / settings.BEYOND_LIMIT
        # What has the limit among its values has one more of them, unless it belongs to a task or beyond [-1, 1]; and
        # what measures may begin where others end.
        tasks = data.of_each("task")
        of_task = np.array([is_split(tasks, rows) for rows in severity.T > 1], dtype=bool)
        own = np.tile((self.limits == 1.0).reshape(2, n).all(axis=0), 2) | of_task
        some = (severity > 1).sum(axis=0) <= few(len(data.ids))
        severity = severity * ((self.limits == 1.0) | ((some | of_task) & ~np.isin(self.names, self.columns.names)))
        return np.where(np.arange(2 * n) < n, top, -top), 0.0, severity * ((below != self.limits) | own)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return super().say(fault, m, c, limit=self.limits[c] if c < len(self.names) // 2 else -self.limits[c])


class ConstantAction(ComparingRule):
    name, words, grade = "constant", "an action is the same in every step of the set", "broken"
    needs, measure = (), OutsideRange.measure
    is_action = True

    def findings(self) -> Iterator[Fault]:
        """Columns whose range is 0."""
        learned, (top, _, high, low) = self.data.learned, (of_each.max(axis=0) for of_each in self.measured)
        names = [*learned.same.values()]
        if self.is_action:
            names, (high, low) = [*learned.action_labels], np.split(top, 2)
        if same := np.flatnonzero(high == -low).tolist():
            every = listed([f"{names[c]} is {high[c]:.4g}" for c in same])
            what, them = ("their ranges are", "them") if len(same) > 1 else ("its range is", "it")
            column = "" if len(same) > 1 else names[same[0]]
            said = f"{every} in every step: {what} 0, by which min-max normalisation divides; leave {them} out"
            yield Fault(self.name, "", 0, 0, column, float(len(same)), 0.0, 1.0, said, self.data.ids)


class ConstantState(ConstantAction):
    name, words, grade = "constant state", "an observation is the same in every step of the set", "odd"
    is_action = False


def limit_of(tops: Float[Array, " M"]) -> float:
    """The limit of an action, NaN without one: exactly the largest value of most demonstrations that do not pass it,
    and of no other value as many; 1 comes before others."""
    if not len(tops):
        return np.nan
    values, counts = np.unique(tops, return_counts=True)
    often = np.where(counts >= max(settings.FEWEST_DEMONSTRATIONS, settings.FEW_SHARE * len(tops)), counts, 0)
    limit = 1.0 if 1.0 in values[often > 0] else values[often.argmax()]
    inside = tops <= limit
    touched = (tops[inside] == limit).mean() >= settings.TOUCHED and often.any()
    return float(limit) if touched and (inside.mean() > 0.5 or limit == 1.0) else np.nan


class TwoEpisodes(ComparingRule):
    name, words, grade = "two episodes", "it begins, or ends, with rows of another demonstration", "broken"
    needs = ("observations", "several")
    takes_steps = True
    sentence = "{which}: all columns jump at {last}, and none from one demonstration to the other"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """First and last values of each column, and its changes at the second and at the last step."""
        values, size, begin, end = block.values, block.size, block.offsets[:-1], block.offsets[1:] - 1
        return values[:, begin].T, values[:, end].T, size[:, np.minimum(begin + 1, end)].T, size[:, end].T

    def compare(self) -> Compared:
        own, jumps = ~self.columns.is_action, self.data.measured[Jump.measure]
        first, last, begins, ends = (of_each[:, own] for of_each in self.measured)
        (jump, step), limit = (x[:, 0] for x in jumps[3:5]), Jump.limit(jumps)
        usual = np.maximum(begins[1:], ends[:-1]) + self.columns.scale[own]
        tells = ((begins > 0) | (ends > 0)).any(axis=0) & (self.columns.memory[own] >= settings.LEAST_MEMORY)
        between = np.log1p(np.abs(first[1:] - last[:-1]) / usual)[:, tells]
        near = between.mean(axis=1) < settings.GOES_ON if tells.any() else np.zeros(len(between), dtype=bool)
        self.early, near = step < self.data.lengths / 2, np.concatenate([[False], near, [False]])
        joined = np.where(self.early, near[:-1], near[1:]) & (jump > limit)
        self.first, self.last = step - 1, step
        least = max(settings.FEWEST_DEMONSTRATIONS, settings.MOST_ABSENT * (len(joined) - 1))
        return jump, limit, np.where(joined & (joined.sum() >= least), jump / limit, 0.0)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        which = f"its last {int(self.data.lengths[m]) - fault.last} rows are those of the next one"
        if self.early[m]:
            which = f"its first {fault.last} rows are those of the one before"
        return super().say(fault, m, c, which=which)


class Unrelated(ComparingRule):
    name, words = "unrelated", "no observation goes with an action in any demonstration"
    needs = "observations", "actions", "several"

    def findings(self) -> Iterator[Fault]:
        """One line, if any."""
        if self.data.learned.are_strangers:
            said = "the observations go with the actions of other demonstrations as well as with their own: "
            said += "these columns may belong to something else, or to other demonstrations"
            yield Fault(self.name, "", 0, 0, "", 1.0, 0.0, 1.0, said, self.data.ids)


class Units(ComparingRule):
    """Found by `Conventions`."""

    name, words, grade = "two units", "a part of the set has columns in another unit than the rest", "broken"


class Conventions(ComparingRule):
    name, grade = "two conventions", "broken"
    words = "two parts of the set have columns in another order, of other signs, or moved"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Means over parts of each demonstration, (M, K, C)."""
        return (part_means(block.values, block.offsets, settings.PARTS),)

    def findings(self) -> Iterator[Fault]:
        """The difference of the part that tells most."""
        parts = [(rows, self.told(rows)) for rows in self.parts()]
        rows, told = max(parts, key=lambda part: len(part[1]), default=(np.zeros(1), {}))
        ids, share = tuple(itertools.compress(self.data.ids, rows)), float(rows.mean())
        for kind in dict.fromkeys(kind for kind, _ in told.values()):
            (c, said), *others = ((c, said) for c, (of, said) in told.items() if of == kind)
            which, rest = in_words(ids, self.data.ids, self.data.groups), f"the other {len(rows) - len(ids):,}"
            more = f"; the same in {counted(len(others), 'more column')}" if others and kind[:5] != "order" else ""
            sentence = f"{said} in {which} than in {rest}; which is right cannot be known{more}"
            rule = Units.name if kind == "unit" else self.name
            yield Fault(rule, "", 0, 0, self.columns.names[c], share, 0.0, 1.0 + share, sentence, ids)

    def parts(self) -> list[Bool[Array, " M"]]:
        """The smaller part of each way to part the set that a column tells, groups first, or an operator."""
        profile, of = self.measured[0], np.array(self.data.of_each("operator"))
        ends, size = self.data.measured[TwoEpisodes.measure][:2], np.log(profile.std(axis=1) + 1e-9)
        features = size.mean(axis=1, keepdims=True), *ends, size, profile.reshape(n := len(of), -1)
        told = [of == name for name in sorted({*of.tolist()})]
        told += [*two_groups(np.concatenate(features, axis=1))]
        told = [rows if (rows.sum(), rows[0]) <= (n / 2, False) else ~rows for rows in told]
        every = dict.fromkeys(rows.tobytes() for rows in told if rows.sum() > 1)
        return [np.frombuffer(rows, dtype=bool) for rows in [*every][: settings.MIN_DISTINCT]]

    def told(self, rows: Bool[Array, " M"]) -> dict[int, tuple[str, str]]:
        """Columns that a part has otherwise: the kind, and what is seen; none unless all columns are as in the rest
        once that is undone, and some that move are so as they are."""
        profile, pairs, columns = self.measured[0], self.data.learned.tracked, self.columns
        parts = profile[rows], profile[~rows]
        part, rest = ((p.mean(axis=0), p.var(axis=0) / len(p), *motion_of(p)) for p in parts)
        found, alike, moves = undone(part, rest, columns)
        home = self.home_differs(rows)
        found = {c: way for c, way in found.items() if way[0] not in ("sign", "turned") or home[c]}
        known = (self.data.measured[Wraps.measure][0] == 0).all(axis=0)
        whole = (alike | ~known | np.isin(np.arange(len(known)), [*found])).mean()
        units = [c for c, (kind, _) in found.items() if kind == "unit"]
        size = np.log(profile[..., units].std(axis=1) + 1e-9).mean(axis=1) if units else np.zeros(0)
        if units and max(size[~rows].min() - size[rows].max(), size[rows].min() - size[~rows].max()) < 0:
            return {}  # some are of the other part
        if len(units) >= settings.SURE * len(known):
            return {c: way for c, way in found.items() if way[0] == "unit"}
        if whole < 1 or (alike & moves & known).sum() < 2:
            return {}
        own = dict(zip(pairs.action.tolist(), pairs.state.tolist(), strict=True))
        other = {state: action for action, state in own.items()} | own if pairs.is_command else {}
        found = {c: way for c, way in found.items() if known[c] and other.get(c, c) in found}  # else commands tell
        own = {c: s for c, s in enumerate(columns.partner.tolist()) if columns.is_action[c] and s >= 0} | own
        several = len({kind if "order" in kind else own.get(c, c) for c, (kind, _) in found.items()}) > 1
        kinds, many = {kind[:5] for kind, _ in found.values()}, rows.sum() > 2  # several together are two tasks
        # The set changes once, in order, or with the operator, and not with the task: else one column may differ by it.
        once = (rows[1:] != rows[:-1]).sum() == 1 or is_split(self.data.of_each("operator"), rows)
        once &= not is_split(self.data.of_each("task"), rows)
        is_sure = several or kinds == {"unit"} or (many and (kinds == {"moved"} or once))
        return found if len(kinds) == 1 and is_sure else {}

    def home_differs(self, rows: Bool[Array, " M"]) -> Bool[Array, " C"]:
        """Whether demonstrations of a part begin elsewhere in a column than the rest: from one home, they may do a task
        the other way. Nothing is known of few."""
        first = self.data.measured[TwoEpisodes.measure][0]
        own, other = first[rows], first[~rows]
        apart = np.abs(np.median(own, axis=0) - np.median(other, axis=0))
        is_far = apart > np.maximum(np.ptp(own, axis=0), np.ptp(other, axis=0))
        return np.asarray(is_far & (len(own) > 2) & (len(first) >= 2 * settings.FEWEST_DEMONSTRATIONS))


def is_split(words: list[str], rows: Bool[Array, " M"]) -> bool:
    """Whether no word is that of demonstrations both in a part and out of it."""
    return len({*words}) > 1 and not {*itertools.compress(words, rows)} & {*itertools.compress(words, ~rows)}


def undone(
    part: tuple[Array, ...], rest: tuple[Array, ...], columns: MeasuredColumns
) -> tuple[dict[int, tuple[str, str]], Bool[Array, " C"], Bool[Array, " C"]]:
    """By column, what makes a part like the rest: the kind, and what is seen; which columns are alike, and which move.
    Given are means over parts of time, (K, C), the variances of these, how far a demonstration goes, and its way."""
    (u, x, own, path), (v, y, other, others) = part, rest
    error, motion = settings.BY_CHANCE * np.sqrt(x + y), np.maximum(own, other)
    apart, level = np.abs(u - v), np.maximum(np.abs(u), np.abs(v)).max(axis=0)
    ratio, moves = np.log(np.maximum(own, 1e-300) / np.maximum(other, 1e-300)), motion > error.min(axis=0)
    by_path = np.log(np.maximum(path, 1e-300) / np.maximum(others, 1e-300))
    in_pace = np.abs(ratio) < np.log(settings.OTHER_UNIT)
    alike = (apart <= error + settings.ALIKE * motion).all(axis=0) & (in_pace | ~moves)
    weight = 1.0 / np.maximum(y, 1e-300)  # of the larger part, which is known best
    begins, by = apart[0] > error[0], ((u - v) * weight).sum(axis=0) / weight.sum(axis=0)
    ways: list[tuple[str, str, Array, float, Array, Array]] = [("sign", "has another sign", -v, 1.0, level, begins)]
    for times in (*settings.UNITS, 100.0):
        for way, word in ((times, "larger"), (1.0 / times, "smaller")):
            is_own = np.abs(ratio - np.log(way)) < 1.5 * settings.SAME_UNIT
            is_own &= np.abs(by_path - np.log(way)) < np.log(settings.OTHER_UNIT)  # else it leaps
            ways.append(("unit", f"is {times:.3g} times {word}", way * v, way, own, is_own))
    in_pace &= moves
    far = in_pace & (apart > error).all(axis=0) & (np.abs(by) > 2.0 * settings.ALIKE * motion)
    ways += [("moved", "is {} throughout", v + by, 1.0, motion, far)]
    ways += [("turned", "goes the other way", np.median(u + v, axis=0) - v, 1.0, motion, begins & in_pace)]
    found: dict[int, tuple[str, str]] = {}
    for kind, said, target, way, size, is_own in ways:
        slack = settings.BY_CHANCE * np.sqrt(x + way**2 * y) + settings.ALIKE * size
        for c in np.flatnonzero(is_own & ~alike & (np.abs(u - target) <= slack).all(axis=0)).tolist():
            moved = f"{abs(by[c]):.3g} {'higher' if by[c] > 0 else 'lower'}"
            found.setdefault(c, (kind, f"{columns.names[c]} {said.format(moved)}"))
    for is_action in (False, True):
        at = np.flatnonzero(~alike & (columns.is_action == is_action))
        slack = settings.BY_CHANCE * np.sqrt(x[:, at, None] + y[:, None, at]) + settings.ALIKE * motion[at]
        fits = (np.abs(u[:, at, None] - v[:, None, at]) <= slack).all(axis=0)
        if len(at) > 1 and (fits.sum(axis=0) == 1).all() and (fits.sum(axis=1) == 1).all():
            names = " and ".join(columns.names[c] for c in at)
            found |= {int(c): (f"order {is_action}", f"{names} are in another order") for c in at}
    return found, alike, moves


def motion_of(profile: Float[Array, "M K C"]) -> tuple[Float[Array, " C"], Float[Array, " C"]]:
    """How far each column goes in the median demonstration; and there and back, without its largest change."""
    changes = np.abs(np.diff(profile, axis=1))
    ways = np.ptp(profile, axis=1), changes.sum(axis=1) - changes.max(axis=1)
    return np.median(ways[0], axis=0), np.median(ways[1], axis=0)


def two_groups(values: Float[Array, "M F"]) -> Iterator[Bool[Array, " M"]]:
    """The larger ones of the values of each feature that form two groups far apart, of two or more each, and the later
    ones where a feature changes at some place more than by chance."""
    m, later = len(values), list[Bool[Array, " M"]]()
    for own in (values[:, k : k + 64] for k in range(0, values.shape[1], 64)):  # of which there may be very many
        order, columns = np.sort(own, axis=0), np.arange(own.shape[1])
        k = np.diff(order, axis=0).argmax(axis=0) + 1
        low, high = order[k - 1, columns], order[k, columns]
        apart = high - low > settings.APART * np.maximum(low - order[0], order[-1] - high)
        apart &= (k > 1) & (k < m - 1)
        yield from (own[:, apart] >= high[apart]).T
        off, n = own - own.mean(axis=0), np.arange(1, m)[:, None]
        between = np.cumsum(off, axis=0)[:-1] ** 2 * m / (n * (m - n))  # the sum of squares that a change explains
        within = (off**2).sum(axis=0) - between
        between[[0, -1]] = 0.0
        at = between.argmax(axis=0)
        least = (2.0 * settings.BY_CHANCE) ** 2 / max(m - 2, 1) * np.maximum(within[at, columns], 1e-300)
        later += [np.arange(m) > step for step in at[between[at, columns] > least]]
    yield from later
