"""The rules about commands and the states that follow them: what is wrong whatever is usual in the set."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned
from rpil.faults.tracking import misfits, parts_of, relation
from rpil.numerics.types import Array


class CommandRule(ComparingRule):
    """A rule about `Tracked` pairs, which needs no other demonstration where actions are commands."""

    needs: tuple[str, ...] = ("commands",)
    takes_steps = True

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Result of `relation` for each demonstration, (M, P); three quantiles of the distance of each action from its
        state, (M, P); the steps that states need for the distance, (M,); and `misfits`."""
        pairs, gaps, turn = learned.tracked, [], block.turn[learned.tracked.action, None]
        parts = [*parts_of(block, pairs)]
        for actions, states in parts:
            some = np.s_[:, :: max(actions.shape[1] // 200, 1)]  # enough for quantiles
            gap = actions[some] - pairs.slope[:, None] * states[some]
            at = [round(q * (gap.shape[1] - 1)) for q in settings.GAP_QUANTILES]
            gap.sort(axis=1)
            gaps.append(gap[:, at] - turn * np.rint(gap[:, at[1:2]] / np.where(turn > 0, turn, np.inf)))
        left = misfits(block, pairs) if pairs.fits.any() else np.ones((len(gaps), 2 * settings.MAX_SHIFT + 1))
        own, of = pairs.state[pairs.fits], pairs.action[pairs.fits]
        scale = block.columns.scale[own]  # with leaps as large as ten usual changes at most
        apart = block.values[of]
        apart -= block.values[own]
        sizes = np.abs(apart, out=apart), np.minimum(block.size[own], 10.0 * scale[:, None])
        far, step = (np.add.reduceat((1.0 / scale) @ x, block.offsets[:-1]) for x in sizes)
        gap = np.moveaxis(np.array(gaps), 2, 0)
        return *relation(parts, pairs.is_command), *gap, far / np.maximum(step, 1e-300), left


class ActionIsState(CommandRule):
    name, grade = "action is state", "broken"
    words = "the action is the state of the same step: a policy learns to stay"
    sentence = f"{words}; take the state of a later step"

    def compare(self) -> Compared:
        left, zero = self.measured[-1], settings.MAX_SHIFT
        beside = left[:, [zero - 1, zero + 1]].min(axis=1)
        is_known = self.data.learned.tracked.is_command & (beside > 0) & np.isfinite(beside)
        value = np.where(is_known, left[:, zero] / np.maximum(beside, 1e-300), 1.0)
        severity = np.where(is_known, np.minimum(settings.IS_STATE / (value + 1e-12), 1e6), np.nan)
        return value, settings.IS_STATE, severity


class Exchanged(CommandRule):
    name, words, grade = "exchanged", "columns are in another order", "broken"
    sentence = "{column} goes with {other}: the columns of the action, or of the state, are in another order"

    def compare(self) -> Compared:
        pairs, (own, other) = self.data.learned.tracked, self.measured[3:5]
        self.names = tuple(self.columns.names[a] for a in pairs.action)
        better = own / np.maximum(other, 1e-6) / settings.OTHER_FITS * (other <= 1.0 - settings.SURE)
        better *= (better > 1).sum(axis=1, keepdims=True) > 1  # what has its place is out of place as well
        return other, own, better

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        state = self.data.learned.tracked.state[int(self.measured[2][m, c])]
        return super().say(fault, m, c, other=self.columns.names[state])


class CommandAgainstState(CommandRule):
    name, words, grade = "offset", "a command is at another level than the state that follows it", "broken"
    causes = ("exchanged", "action is state", "never moves", "two units", "unrelated")

    def compare(self) -> Compared:
        pairs, (slope, own, _, _, _, low, gap, high) = self.data.learned.tracked, self.measured[:8]
        self.names = tuple(self.columns.names[a] for a in pairs.action)
        error, spread = (high - low) / settings.GAP_WIDTH, self.columns.spread[pairs.action]
        fits = pairs.fits | ((own >= settings.TRACKS) & (np.abs(slope - 1.0) <= settings.SAME_UNIT))
        least = np.maximum(settings.ERRORS * error, settings.LEAST_GAP * spread) + 1e-12
        level = np.where(fits, np.abs(gap) / least, 0.0)
        # What many have by little may be the load of an arm.
        is_usual = (level > 1).mean(axis=0) > settings.MOST_FEW
        level = np.where(is_usual & (np.abs(gap) < settings.LEAST_USUAL_GAP * spread), 0.0, level)
        ratio, moves = slope / pairs.slope, own >= settings.SURE
        # A pair that never fits may have a unit of its own by design, but no other sense in the same unit.
        usual = pairs.fits | ((np.abs(ratio - 1.0) <= settings.SAME_UNIT) & moves).any(axis=0)
        size = np.abs(np.log(np.maximum(np.abs(ratio), 1e-300)))
        known_unit = np.min(np.abs(size[..., None] - np.log(settings.UNITS)), axis=-1) < settings.UNIT_ERROR
        unit = np.where(moves & (usual | known_unit), size / np.log(settings.OTHER_UNIT), 0.0)
        sign = np.where(moves & (ratio < 0) & (usual | (size < settings.SAME_UNIT)), 2.0, 0.0)
        every = np.stack([level, unit, sign])
        self.kind, self.ratio = every.argmax(axis=0), ratio
        return gap, least, every.max(axis=0) if pairs.is_command else np.full(level.shape, np.nan)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        state = self.columns.names[self.data.learned.tracked.state[c]]
        off, times = f"{abs(fault.value):.3g} {'above' if fault.value > 0 else 'below'}", abs(self.ratio[m, c])
        said = (
            f"is {off} {state} throughout: the zero of one of them has moved",
            f"changes {times:.3g} times as much as {state}, which follows it: another unit",
            f"has the other sign than {state}, which follows it",
        )
        return f"{fault.column} {said[self.kind[m, c]]}"

    def findings(self) -> Iterator[Fault]:
        """Faults of sign and unit under the names that they have where other demonstrations tell them."""
        for fault in super().findings():
            kind = int(self.kind[self.data.ids.index(fault.id), self.names.index(fault.column)])
            yield replace(fault, rule=(self.name, "scale", "sign")[kind])
