"""Push a disc to a goal in the plane, with five sorts of bad demonstrations: Push2D.

Source: imjbassi/demo-quality-robustness on GitHub, "Not all bad demonstrations are equally bad". Licence: MIT. Its
README, figures and source were read, and the table, the drivers and the sorts written anew. Published there with 400
demonstrations and a network of 2 x 256: clean 97 %; half bad: truncation 93, flailing 97, occlusion 91, another
strategy 93, accidental success 97 %; nine tenths accidental 85 to 90 %.

A cell names a sort and the percentage that is bad. A second strategy succeeds as often as the first: it counts as bad,
as in the source, but a method that keeps it is not wrong. A truncated demonstration lacks its end, and what it holds is
good. At 100 % nothing can be chosen, and it is left out.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from rpil_outside.learners import fit
from rpil_outside.made import laid_out
from rpil_outside.world import Made

LOW, HIGH = 0.05, 0.95
"""The table's walls, for point and disc."""
STEP, TOUCH, NEAR, LIMIT = 0.04, 0.06, 0.05, 110
"""Length of a step, radius of contact, radius of the goal, and steps at most."""
BEHIND, ROUND = 1.25 * TOUCH, TOUCH + 0.04
"""How far behind the disc a careful driver stages, and the radius in which it goes round."""
HELD, FLAILED, KEPT = 0.35, 12, 0.7
"""Share of steps in which the camera is covered, steps of flailing, share that truncation leaves."""
MODES = ("occlusion", "accidental", "flailing", "truncation", "strategy")
SHARES = (10, 25, 50, 75, 90)


class Tables:
    """n tables at once."""

    def __init__(self, n: int, rng: np.random.Generator) -> None:
        self.disc = rng.uniform(0.2, 0.8, (n, 2))
        way = rng.uniform(0, 2 * np.pi, n)
        self.goal = self.disc + rng.uniform(0.25, 0.45, (n, 1)) * np.column_stack([np.cos(way), np.sin(way)])
        self.goal = np.clip(self.goal, LOW + 0.05, HIGH - 0.05)
        self.point = rng.uniform(LOW, HIGH, (n, 2))
        while (near := length(self.point - self.disc)[:, 0] < 2 * TOUCH).any():
            self.point[near] = rng.uniform(LOW, HIGH, (near.sum(), 2))

    def seen(self) -> np.ndarray:
        """Return ten numbers each."""
        return np.hstack([self.point, self.disc, self.goal, self.disc - self.point, self.goal - self.disc])

    def reached(self) -> np.ndarray:
        """Return whether each disc is at its goal."""
        return length(self.goal - self.disc)[:, 0] < NEAR

    def move(self, action: np.ndarray) -> None:
        """Move the points, and the discs they touch."""
        self.point = np.clip(self.point + STEP * np.clip(action, -1, 1), LOW, HIGH)
        pushed = np.clip(self.point + TOUCH * unit(self.disc - self.point), LOW, HIGH)
        self.disc = np.where(length(self.disc - self.point) < TOUCH, pushed, self.disc)


def length(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths, (n, 1)."""
    return np.sqrt((vectors**2).sum(axis=1, keepdims=True))


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return the directions."""
    return vectors / np.maximum(length(vectors), 1e-9)


def careful(tables: Tables, always_left: bool = False) -> np.ndarray:
    """Return the direction of one who goes round the disc, stages behind it, and pushes."""
    back = unit(tables.disc - tables.goal)
    away = tables.point - tables.disc
    far, place = length(away), unit(away)
    turn = place[:, :1] * back[:, 1:] - place[:, 1:] * back[:, :1]
    side = np.ones_like(turn) if always_left else np.where(turn >= 0, 1.0, -1.0)
    radius = ROUND - 0.01 if always_left else ROUND
    around = unit(side * np.column_stack([-place[:, 1], place[:, 0]]) + np.clip(8 * (radius - far), -1, 1) * place)
    is_behind = np.arccos(np.clip((place * back).sum(axis=1, keepdims=True), -1, 1)) < 0.2
    is_staged = far <= BEHIND + 0.02
    way = np.where(far > 1.8 * radius, unit(tables.disc + (radius + 0.1) * back - tables.point), around)
    way = np.where(is_behind & ~is_staged, unit(tables.disc + BEHIND * back - tables.point), way)
    return np.where(is_behind & is_staged, -back, way)


def drive(mode: str, n: int, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Record `n` tables, and return the episodes that succeed."""
    tables, live = Tables(n, rng), np.ones(n, dtype=bool)
    seen, done, lengths = [], [], np.zeros(n, dtype=int)
    for t in range(LIMIT):
        way = unit(tables.disc - tables.point) if mode == "accidental" else careful(tables, mode == "strategy")
        if mode == "flailing" and t < FLAILED:
            way = np.clip(way + rng.uniform(-0.9, 0.9, way.shape), -1, 1)
        seen.append(tables.seen())
        done.append(way)
        lengths += live
        tables.move(way * live[:, None])
        live &= ~tables.reached()
        if not live.any():
            break
    rows, acts = np.stack(seen, axis=1), np.stack(done, axis=1)
    return [(rows[m, : lengths[m]], acts[m, : lengths[m]]) for m in np.flatnonzero(~live)]


def successes(mode: str, n: int, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Record until `n` episodes succeeded."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    while len(found) < n:
        found += drive(mode, max(2 * n, 200) if mode != "accidental" else 2000, rng)
    return found[:n]


class Push2D:
    """Five sorts by five shares."""

    name = "push2d"
    source = "imjbassi/demo-quality-robustness (GitHub)"
    licence = "MIT"
    published = "clean 97 %; half bad 91 to 97 %; 90 % accidental 85 to 90 %"
    cells = tuple(f"{mode} {share}" for mode, share in product(MODES, SHARES))
    needs: tuple[str, ...] = ()
    whole = 100.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Record 400 episodes, or 80."""
        mode, share = cell.split()
        n = 80 if quick else 400
        n_bad, rng = round(n * int(share) / 100), np.random.default_rng([seed, self.cells.index(cell), 1])
        episodes = successes("careful", n - n_bad, rng)
        good_steps = [np.ones(len(rows), dtype=bool) for rows, _ in episodes]
        for rows, acts in successes(mode, n_bad, rng):
            fine = np.full(len(rows), mode == "truncation")
            if mode == "truncation":
                end = max(2, int(KEPT * len(rows)))
                rows, acts, fine = rows[:end], acts[:end], fine[:end]
            if mode == "flailing":
                fine[FLAILED:] = True
            if mode == "occlusion":
                width = max(1, int(HELD * len(rows)))
                start = int(rng.integers(1, max(2, len(rows) - width)))
                rows = rows.copy()
                rows[start : start + width] = rows[start - 1]
                fine[:start] = fine[start + width :] = True
            episodes.append((rows, acts))
            good_steps.append(fine)
        good = np.arange(n) < n - n_bad
        return laid_out(episodes, good, good | (mode != "truncation"), good_steps, rng)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return the percentage of tables on which the policy brings the disc to its goal."""
        data = made.demonstrations
        policy = fit(data.observations, data.actions, weights, seed, steps=800 if quick else 3000, noise=0.0)
        tables = Tables(100 if quick else 200, np.random.default_rng([seed, 2]))
        reached = tables.reached()
        for _ in range(LIMIT):
            tables.move(policy.predict(tables.seen()) * ~reached[:, None])
            reached |= tables.reached()
        return 100 * float(reached.mean())
