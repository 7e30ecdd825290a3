"""Cook onion soups in pairs, after people: Overcooked.

Source: the human trials in the source distribution of overcooked-ai 1.1.0 (Carroll et al., arXiv 1910.05789), read once
into plain arrays: `overcooked_*.npz` in the folder that the environment variable RPIL_DATA names, or in `shared/data`
beside the repository. Licence: MIT. Published: points of pairs of agents, and nothing of who is good.

A cell names a kitchen; there are 76 trials in five. Each of the two cooks of a trial is a demonstration, and it is good
where the team scored at least the kitchen's median: the score of one cook would ask on which side of a counter he
stood. A seed draws three quarters of the trials. Steps in which a cook waited are left out. The kitchen's rules are
written anew; a policy plays both cooks, and its return is 20 points for each soup. Which way things lie from a square
is read from the recorded steps themselves.
"""

from __future__ import annotations

import json
import os
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rpil_outside.learners import fit
from rpil_outside.made import laid_out
from rpil_outside.world import Made

KITCHENS = ("cramped_room", "asymmetric_advantages", "coordination_ring", "forced_coordination", "counter_circuit")
WAYS = ((0, -1), (0, 1), (1, 0), (-1, 0))
"""North, south, east and west, as the actions 0 to 3; 4 interacts."""
HELD, COMPASS = ("none", "onion", "dish", "soup"), "nsew"
COOKING, STEPS, POINTS, SHARE = 20, 400, 20, 0.75


def folder() -> Path:
    """Return where the recorded trials are."""
    return Path(os.environ.get("RPIL_DATA") or Path(__file__).resolve().parents[4].parent / "shared" / "data")


@lru_cache(maxsize=5)
def trials(kitchen: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the arrays of a kitchen and what is written about them."""
    path = folder() / f"overcooked_{kitchen}.npz"
    if not path.exists():
        raise FileNotFoundError(f"{path.name}: it is not in {path.parent}; set RPIL_DATA to the folder that holds it.")
    with np.load(path, allow_pickle=False) as arrays:
        held = {
            name: arrays[name] for name in ("observations", "actions", "episode_ids", "trial_ids", "episode_return")
        }
    return held, json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))


class Kitchen:
    """One game of two cooks."""

    def __init__(self, kitchen: str) -> None:
        _, about = trials(kitchen)
        self.grid, self.names = about["layout"], about["feature_names"]
        cells = {(x, y): cell for y, row in enumerate(self.grid) for x, cell in enumerate(row)}
        self.places = [next(place for place, cell in cells.items() if cell == cook) for cook in "12"]
        self.cells = {place: " " if cell in "12" else cell for place, cell in cells.items()}
        self.facing, self.hands, self.soups = [0, 0], ["none", "none"], 0
        self.lying: dict[tuple[int, int], str] = {}
        self.pots = {place: [0, 0] for place, cell in self.cells.items() if cell == "P"}
        """Onions, and steps of cooking."""
        self.paths = paths(kitchen)

    def front(self, cook: int) -> tuple[int, int]:
        """Return the square before a cook."""
        (x, y), (dx, dy) = self.places[cook], WAYS[self.facing[cook]]
        return x + dx, y + dy

    def step(self, actions: np.ndarray) -> None:
        """Let both cooks act, and the pots cook."""
        for cook, action in enumerate(actions):
            if action == 4:
                self.interact(cook)
        before, wanted = list(self.places), list(self.places)
        for cook, action in enumerate(actions):
            if action != 4:
                self.facing[cook] = int(action)
                ahead = self.front(cook)
                wanted[cook] = ahead if self.cells[ahead] == " " else before[cook]
        if wanted[0] != wanted[1] and wanted != before[::-1]:  # else they are in each other's way
            self.places = wanted
        for pot in self.pots.values():
            pot[1] += pot[0] == 3

    def interact(self, cook: int) -> None:
        """Take, put, fill, fetch or deliver what is before a cook."""
        place = self.front(cook)
        cell, hand = self.cells[place], self.hands[cook]
        if cell == "X" and (hand == "none") == (place in self.lying):
            self.hands[cook] = self.lying.pop(place, "none")
            if hand != "none":
                self.lying[place] = hand
        elif cell in "OD" and hand == "none":
            self.hands[cook] = "onion" if cell == "O" else "dish"
        elif cell == "S" and hand == "soup":
            self.hands[cook], self.soups = "none", self.soups + 1
        elif cell == "P":
            pot = self.pots[place]
            if hand == "onion" and pot[0] < 3:
                self.hands[cook], pot[0] = "none", pot[0] + 1
            elif hand == "dish" and pot[1] >= COOKING:
                self.hands[cook], self.pots[place] = "soup", [0, 0]

    def look(self, cook: int) -> str:
        """Return the name of what is before a cook."""
        place = self.front(cook)
        if place == self.places[1 - cook]:
            return "front_partner"
        if (cell := self.cells[place]) == "X":
            return "front_counter_obj" if place in self.lying else "front_counter"
        if cell == "P":
            onions, steps = self.pots[place]
            return "front_pot_" + ("ready" if steps >= COOKING else ("empty", "part", "part", "cooking")[onions])
        return {" ": "front_floor", "O": "front_onion", "D": "front_dish", "S": "front_serve"}[cell]

    def seen(self, cook: int) -> np.ndarray:
        """Return the columns of the recorded trials, as a cook sees them now."""
        (x, y), (other_x, other_y), hand = self.places[cook], self.places[1 - cook], self.hands[cook]
        gap = (other_x - x, other_y - y)
        found = {f"pos_{x}_{y}": 1.0, f"facing_{COMPASS[self.facing[cook]]}": 1.0, f"held_{hand}": 1.0}
        found |= {self.look(cook): 1.0, f"partner_held_{self.hands[1 - cook]}": 1.0}
        found |= {"partner_dx": gap[0] / len(self.grid[0]), "partner_dy": gap[1] / len(self.grid)}
        if gap in WAYS:
            found[f"partner_in_{COMPASS[WAYS.index(gap)]}"] = 1.0
        for k, (onions, steps) in enumerate(self.pots.values()):
            is_ready = steps >= COOKING
            found |= {f"pot{k}_n": onions / 3, f"pot{k}_cooking": float(onions == 3 and not is_ready)}
            found[f"pot{k}_ready"] = float(is_ready)
        own = np.array([found.get(name, 0.0) for name in self.names])
        return own + self.paths.get((f"pos_{x}_{y}", hand), 0.0)


@lru_cache(maxsize=5)
def paths(kitchen: str) -> dict[tuple[str, str], np.ndarray]:
    """Return the columns of the ways to things, which depend on the square and on what is held alone."""
    arrays, about = trials(kitchen)
    rows, names = arrays["observations"], about["feature_names"]
    is_way = np.array([name.split("_")[0] in HELD for name in names])
    squares = [k for k, name in enumerate(names) if name.startswith("pos_")]
    hands = [names.index(f"held_{hand}") if f"held_{hand}" in names else None for hand in HELD]
    found = {}
    for square in squares:
        for hand, column in zip(HELD, hands, strict=True):
            own = np.flatnonzero((rows[:, square] == 1) & (column is not None and rows[:, column] == 1))
            if len(own):
                found[names[square], hand] = rows[own[0]] * is_way
    return found


class Overcooked:
    """Five kitchens."""

    name = "overcooked"
    source = "human trials of overcooked-ai 1.1.0, arXiv 1910.05789"
    licence = "MIT"
    published = "nothing of who is good"
    cells = KITCHENS
    needs: tuple[str, ...] = ()

    @property
    def files(self) -> list[Path]:
        """Return the recorded trials that must be there."""
        return [folder() / f"overcooked_{kitchen}.npz" for kitchen in KITCHENS]

    whole = 200.0

    def make(self, cell: str, seed: int, quick: bool) -> Made:
        """Draw three quarters of the trials."""
        arrays, _ = trials(cell)
        rng, teams = np.random.default_rng([seed, KITCHENS.index(cell), 11]), np.unique(arrays["trial_ids"])
        drawn = np.flatnonzero(np.isin(arrays["trial_ids"], rng.permutation(teams)[: round(SHARE * len(teams))]))
        bounds = np.append(np.flatnonzero(np.diff(arrays["episode_ids"], prepend=-1)), len(arrays["actions"]))
        spans = [slice(*span) for span in pairwise(bounds.tolist())]
        episodes = [(arrays["observations"][spans[m]].astype(float), arrays["actions"][spans[m]]) for m in drawn]
        score = arrays["episode_return"]
        return laid_out(episodes, score[drawn] >= np.median(score), None, None, rng)

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """Return the mean points of games of two cooks who both follow the policy; keys are drawn."""
        data, rng = made.demonstrations, np.random.default_rng([seed, 12])
        policy = fit(data.observations, data.actions, weights, seed, steps=300 if quick else 2000, discrete=True)
        games = [Kitchen(cell) for _ in range(3 if quick else 20)]
        for _ in range(STEPS):
            seen = np.array([game.seen(cook) for game in games for cook in (0, 1)])
            for game, keys in zip(games, policy.sample(seen, rng).reshape(-1, 2), strict=True):
                game.step(keys)
        return POINTS * float(np.mean([game.soups for game in games]))
