"""The rules about what a set agrees on: constants, limits, order and sign of its columns, and where it is cut."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from rpil.data.demonstrations import DemonstrationSet
from rpil.data.text import listed
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, means
from rpil.faults.motion import Jump, Wraps
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, Rule, in_words
from rpil.faults.still import few
from rpil.numerics.types import Array, Bool, Float


class ConstantAction(Rule):
    name, words, grade = "constant", "an action is the same in every step of the set", "broken"

    @classmethod
    def find(cls, demonstrations: DemonstrationSet, learned: Learned) -> Iterator[Fault]:
        """Actions whose range is 0."""
        of = learned.action_labels  # none of codes, which may be text
        if same := [a for a in range(len(of)) if demonstrations.low[a] == demonstrations.high[a]]:
            every = listed([f"{of[a]} is {demonstrations.low[a]:.4g}" for a in same])
            what, them = ("their ranges are", "them") if len(same) > 1 else ("its range is", "it")
            column = "" if len(same) > 1 else of[same[0]]
            said = f"{every} in every step: {what} 0, by which min-max normalisation divides; leave {them} out"
            yield Fault(cls.name, "", 0, 0, column, float(len(same)), 0.0, 1.0, said, demonstrations.ids)


class OutsideRange(ComparingRule):
    name, words, grade = "outside range", "an action passes a limit that the others touch", "broken"
    needs = ("several",)
    sentence = "{column} goes to {value:.4g}; the others touch {limit:.4g} and never pass it"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The largest value of each action, and the next smaller one; then the same downwards, where signs are changed,
        (M, 2 A)."""
        actions, begins = block.block.actions, block.offsets[:-1]
        actions = actions if actions.ndim == 2 else np.zeros((len(actions), 0))  # a code has no limit
        sides = np.concatenate([actions.T, -actions.T]).astype(np.float64)
        top = np.maximum.reduceat(sides, begins, axis=1)
        below = np.where(sides < np.repeat(top, np.diff(block.offsets), axis=1), sides, -np.inf)
        return top.T, np.maximum.reduceat(below, begins, axis=1).T

    def compare(self) -> Compared:
        (top, below), data = self.measured, self.data
        self.names, n = data.learned.action_labels * 2, top.shape[1] // 2
        # Copies tell no limit.
        _, others = np.unique(np.column_stack([top, below, data.lengths]), axis=0, return_index=True)
        moves = np.isfinite(below[others])
        self.limits = np.array([limit_of(own[rows]) for own, rows in zip(top[others].T, moves.T, strict=True)])
        ranges = self.limits + np.median(np.roll(top, n, axis=1), axis=0)
        severity = np.nan_to_num((top - self.limits) / np.where(ranges > 0, ranges, np.nan)) / settings.BEYOND_LIMIT
        # What has the limit among its values has one more of them, unless it belongs to a task or beyond [-1, 1]; and
        # what measures may begin where others end.
        tasks = np.array([data.tasks.get(str(name), "") for name in data.ids])
        of_task = np.array([not {*tasks[rows]} & {*tasks[~rows], ""} for rows in severity.T > 1], dtype=bool)
        own = np.tile((self.limits == 1.0).reshape(2, n).all(axis=0), 2) | of_task
        some = (severity > 1).sum(axis=0) <= few(len(data.ids))
        severity = severity * ((self.limits == 1.0) | ((some | of_task) & ~np.isin(self.names, self.columns.names)))
        return np.where(np.arange(2 * n) < n, top, -top), 0.0, severity * ((below != self.limits) | own)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return super().say(fault, m, c, limit=self.limits[c] * (1 if c < len(self.names) // 2 else -1))


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
        """First, last and mean values of each column, and its changes at the second and at the last step."""
        values, size, begin, end = block.values, block.size, block.offsets[:-1], block.offsets[1:] - 1
        ends = values[:, begin].T, values[:, end].T, means(values, block.offsets)
        return *ends, size[:, np.minimum(begin + 1, end)].T, size[:, end].T

    def compare(self) -> Compared:
        own, jumps = ~self.columns.is_action, self.data.measured[Jump.measure]
        first, last, _, begins, ends = (of_each[:, own] for of_each in self.measured)
        (jump, step), limit = (x[:, 0] for x in jumps[4:6]), Jump.limit(jumps)
        usual = np.maximum(begins[1:], ends[:-1]) + self.columns.scale[own]
        tells = ((begins > 0) | (ends > 0)).any(axis=0) & (self.columns.memory[own] >= settings.LEAST_MEMORY)
        between = np.log1p(np.abs(first[1:] - last[:-1]) / usual)[:, tells]
        near = between.mean(axis=1) < settings.GOES_ON if tells.any() else np.zeros(len(between), dtype=bool)
        self.early, near = step < self.data.lengths / 2, np.concatenate([[False], near, [False]])
        joined = np.where(self.early, near[:-1], near[1:]) & (jump > limit)
        self.first, self.last = step - 1, step
        return jump, limit, np.where(joined, jump / limit, 0.0) * (joined.sum() >= settings.FEWEST_DEMONSTRATIONS)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        which = f"its last {int(self.data.lengths[m]) - fault.last} rows are those of the next one"
        if self.early[m]:
            which = f"its first {fault.last} rows are those of the one before"
        return super().say(fault, m, c, which=which)


class Conventions(ComparingRule):
    name, grade = "two conventions", "broken"
    words = "two parts of the set have columns in another order, or of other signs"
    measure = TwoEpisodes.measure

    def findings(self) -> Iterator[Fault]:
        told = [(column, rows if rows[0] else ~rows, said, kind) for column, rows, said, kind in self.told()]
        for column, rows, said, _ in told:
            kinds = {kind for _, other, _, kind in told if (other == rows).all()}
            if len(kinds) < 2 and not self.is_change(rows):
                continue
            if rows.mean() > 0.5 or (rows.mean() == 0.5 and rows[0]):
                rows = ~rows
            ids = tuple(self.data.ids[m] for m in np.flatnonzero(rows).tolist())
            which = in_words(ids, self.data.ids, self.data.tasks)
            sentence = f"{which}: {said} than in the other {len(rows) - len(ids):,}; which is right cannot be known"
            yield Fault(self.name, "", 0, 0, column, float(rows.mean()), 0.0, 1.0 + float(rows.mean()), sentence, ids)

    def is_change(self, rows: Bool[Array, " M"]) -> bool:
        """Whether the set changes once, in order, and not with the task: else one column may differ by what is done."""
        tasks = [self.data.tasks.get(str(name), "") for name in self.data.ids]
        of_task = len({*tasks}) > 1 and not {*itertools.compress(tasks, rows)} & {*itertools.compress(tasks, ~rows)}
        return bool((rows[1:] != rows[:-1]).sum() == 1 and not of_task)

    def told(self) -> Iterator[tuple[str, Bool[Array, " M"], str, object]]:
        """A column, some demonstrations, what of it is other there, and what it is evidence of."""
        is_action, names, features = self.columns.is_action, self.columns.names, np.stack(self.measured[:3])
        pairs, wraps = self.data.learned.tracked, (self.data.measured[Wraps.measure][0] > 0).sum(axis=0)
        groups = [(c, two_groups(features[0, :, c])) for c in range(len(names)) if not wraps[c]]
        commands = dict(zip(pairs.action.tolist(), pairs.state.tolist(), strict=True)) if pairs.is_command else {}
        joints = {state: state for state in commands.values()} | commands
        parts = [(c, rows) for c, rows in groups if rows is not None]
        for (i, rows), (j, other) in itertools.combinations_with_replacement(parts, 2):
            if not (rows == other).all() and not (rows != other).all():
                continue
            (u, x), (v, y) = (features[:, of][..., [i, j]].mean(axis=1).T for of in (rows, ~rows))
            least = settings.ALIKE * np.abs(u - v).min()
            if i == j and i in joints and np.abs(u + v).max() <= least:
                yield names[i], rows, f"{names[i]} has another sign", joints[i]
            if i != j and is_action[i] == is_action[j] and np.abs([u - y, v - x]).max() <= least:
                yield names[i], rows, f"{names[i]} and {names[j]} are in another order", (bool(is_action[i]),)


def two_groups(values: Float[Array, " M"]) -> Bool[Array, " M"] | None:
    """The larger ones of values that form two groups far apart; None where they do not."""
    order = np.sort(values)
    gaps = np.diff(order)
    k = int(gaps.argmax()) + 1
    parts = order[:k], order[k:]
    apart = gaps[k - 1] > settings.APART * max(np.ptp(parts[0]), np.ptp(parts[1]))
    return values >= order[k] if apart and min(map(len, parts)) >= 2 else None
