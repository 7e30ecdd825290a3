"""Pick a thing up and carry it to a place, where some operators let go on the way: early release.

Source: Bedi, "What demonstration curation metrics do to your policy", arXiv 2606.10229. Licence: none, so that nothing
of its code is here. There a LIBERO task of pick and place; here a hand in a box of air over a table, written
from the description, since LIBERO does not install on a machine without a GPU in a night. Published: all 3 %, oracle
93 %; the detector with the best AUROC (.80) makes a policy of 13 %, one with .64 a policy of 90 %; five of seven scores
are length in disguise.

A bad operator slows down a good part of the way before the place, opens the hand there, and goes on as if nothing had
happened. In `shorter` a record ends soon after the thing was let go, so that bad ones are the shorter ones; in `one
length` every record has the same number of steps. The number is the percentage that is bad. The success flag is that
of a recorder who looks whether the hand came to the place and opened: it notes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from rpil_outside.learners import fit
from rpil_outside.made import laid_out
from rpil_outside.world import Made

SPEED, LIMIT, ONE_LENGTH = 0.05, 90, 60
GRASP, HEIGHT, NEAR = 0.03, 0.25, 0.06
"""Distance at which a closing hand takes the thing, height of the way, and distance of a success."""
RATE, BEFORE = 0.34, 0.35
"""How much a hand opens or closes in a step, and how far before the wrong place it begins to open."""
KINDS, SHARES = ("shorter", "one length"), (25, 50, 75)


class Box:
    """n boxes at once: a hand, how far it is open, the thing, and its place."""

    def __init__(self, n: int, rng: np.random.Generator) -> None:
        flat = lambda low, high: np.column_stack([rng.uniform(low, high, (n, 2)), np.zeros(n)])  # noqa: E731
        self.thing, self.place = flat(-0.4, -0.1), flat(0.2, 0.5)
        self.hand = flat(-0.3, 0.1) + np.array([0, 0, HEIGHT])
        self.opening, self.held = np.ones(n), np.zeros(n, dtype=bool)

    def seen(self) -> np.ndarray:
        """Return thirteen numbers each."""
        gaps = [self.thing - self.hand, self.place - self.thing]
        return np.hstack([self.hand, self.opening[:, None], self.thing, *gaps])

    def move(self, action: np.ndarray) -> None:
        """Move the hands, open or close them, and let fall what nobody holds."""
        action = np.clip(action, -1, 1)
        step = SPEED * action[:, :3]
        self.hand = np.maximum(self.hand + step, [-1.0, -1.0, 0.0])
        self.opening = np.clip(self.opening + RATE * action[:, 3], 0, 1)
        near = np.linalg.norm(self.thing - self.hand, axis=1) < GRASP
        self.held = (self.held | near) & (self.opening < 0.4)
        fallen = np.column_stack([self.thing[:, :2], np.maximum(self.thing[:, 2] - 2 * SPEED, 0)])
        self.thing = np.where(self.held[:, None], self.hand, fallen)

    def placed(self) -> np.ndarray:
        """Return whether the thing lies at its place, and nobody holds it."""
        return ~self.held & (np.linalg.norm(self.thing - self.place, axis=1) < NEAR)


class Operator:
    """Drives n boxes through five phases: above the thing, down, up, across, down and open."""

    def __init__(self, n: int, bad: bool, rng: np.random.Generator) -> None:
        self.phase, self.rng = np.zeros(n, dtype=int), rng
        self.early = rng.uniform(0.45, 0.6, n) if bad else np.ones(n)
        """Share of the way at which the hand opens."""
        self.start: np.ndarray | None = None

    def act(self, box: Box) -> np.ndarray:
        """Return the actions (n, 4)."""
        up = np.array([0, 0, HEIGHT])
        if self.start is None:
            self.start = box.thing.copy()
        turn = self.start + self.early[:, None] * (box.place - self.start)
        early = (self.early < 1)[:, None]
        targets = np.stack(
            [self.start + up, self.start, self.start + up, turn + up, np.where(early, turn + up, turn), box.place + up]
        )
        target = targets[self.phase, np.arange(len(turn))]
        gap = target - box.hand
        shut = np.isin(self.phase, (2, 3)) | ((self.phase == 1) & (np.linalg.norm(gap, axis=1) < 0.02))
        shut &= ~((self.phase == 3) & (self.early < 1) & (np.linalg.norm(gap, axis=1) < BEFORE))
        shut |= (self.phase == 4) & (self.early == 1) & (np.linalg.norm(gap, axis=1) > 0.03)
        ready = np.linalg.norm(gap, axis=1) < np.array([0.03, 0.02, 0.03, 0.03, 0.03, -1])[self.phase]
        ready &= np.where(self.phase == 1, box.held, True) & np.where(self.phase == 4, box.opening > 0.9, True)
        slow = np.where((self.phase == 3) & (self.early < 1), 10, 2)[:, None]
        way = np.clip(gap / (slow * SPEED), -1, 1) + self.rng.normal(0, 0.08, gap.shape)
        self.phase = np.minimum(self.phase + ready, 5)
        return np.clip(np.column_stack([way, np.where(shut, -1.0, 1.0)]), -1, 1)


def driven(n: int, act: Callable[[Box], np.ndarray], rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return what n hands saw (n, T, 13), their actions (n, T, 4), and whether each placed its thing."""
    box, seen, done = Box(n, rng), [], []
    for _ in range(LIMIT):
        seen.append(box.seen())
        done.append(act(box))
        box.move(done[-1])
    return np.stack(seen, axis=1), np.stack(done, axis=1), box.placed()


class EarlyRelease:
    """Two ways of recording by three shares."""

    name = "early_release"
    source = "arXiv 2606.10229"
    licence = "none; rewritten from the description"
    published = "success: all 3 %, oracle 93 %, best detector 13 %, best curated policy 90 %"
    cells = tuple(f"{kind} {share}" for kind, share in product(KINDS, SHARES))
    needs: tuple[str, ...] = ()
    whole = 100.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Record 100 demonstrations, or 40."""
        kind, share = cell.rsplit(" ", 1)
        n, rng = 40 if quick else 100, np.random.default_rng([seed, self.cells.index(cell), 5])
        n_bad = round(n * int(share) / 100)
        episodes: list[tuple[np.ndarray, np.ndarray]] = []
        good_steps: list[np.ndarray] = []
        for bad, count in ((False, n - n_bad), (True, n_bad)):
            operator = Operator(count, bad, rng)
            phases: list[np.ndarray] = []

            def act(box: Box, operator: Operator = operator, phases: list[np.ndarray] = phases) -> np.ndarray:
                phases.append(operator.phase.copy())
                return operator.act(box)

            seen, done, _ = driven(count, act, rng)
            for m, phase in enumerate(np.stack(phases, axis=1)):
                held = np.flatnonzero((seen[m, :, 7:10] == 0).all(axis=1))  # the thing is where the hand is
                end = ONE_LENGTH if kind == "one length" else int(held[-1]) + 4
                episodes.append((seen[m, :end], done[m, :end]))
                good_steps.append(phase[:end] < 3 if bad else np.ones(len(seen[m, :end]), dtype=bool))
        return laid_out(episodes, np.arange(n) < n - n_bad, np.ones(n), good_steps, rng)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return the percentage of boxes in which the policy places the thing."""
        data = made.demonstrations
        policy = fit(data.observations, data.actions, weights, seed, steps=800 if quick else 3000, noise=0.01)
        _, _, placed = driven(100, lambda box: policy.predict(box.seen()), np.random.default_rng([seed, 6]))
        return 100 * float(placed.mean())
