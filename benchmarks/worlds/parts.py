"""Worlds whose actions have several parts, or are texts of many kinds, with the law by which experts act."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.special import log_softmax
from scipy.stats import norm

Array = NDArray[Any]

N_STATES, N_STEPS = 4, 30
"""Columns of observations, and steps of a demonstration."""


@dataclass(frozen=True, eq=False)
class PartsWorld:
    """M demonstrations of N steps in all, as a table, and the truth."""

    states: Array
    """(N, D)."""
    actions: dict[str, Array]
    """The parts of the action, (N,) each: texts, whole numbers or floats."""
    is_good: Array
    """(M,) int."""
    by_law: Array
    """(M,): the mean log-probability of the actions under the expert's own law, the best that any judge can know."""
    known: tuple[Array, dict[str, Array]]
    """States and actions as one who knows the kind of the action writes them for an audit of numbers, or of classes."""

    def table(self, states: Array | None = None, parts: dict[str, Array] | None = None) -> pa.Table:
        """The table, with other states, or other parts of the action, in the place of these."""
        episodes = np.repeat(np.arange(len(self.is_good)), N_STEPS)
        seen = self.states if states is None else states
        columns = {f"state.{d}": column for d, column in enumerate(seen.T)}
        return pa.table({"episode": episodes, **columns, **(self.actions if parts is None else parts)})


def _begin(seed: int, kind: int, n_bad: int, n: int) -> tuple[np.random.Generator, Array, Array]:
    rng = np.random.default_rng([31, kind, seed])
    good = rng.permutation(n) >= n_bad
    return rng, rng.uniform(-1, 1, (n * N_STEPS, N_STATES)), good


def _drawn(logits: Array, rng: np.random.Generator) -> Array:
    return (logits + rng.gumbel(size=logits.shape)).argmax(axis=1)


def _taken(logits: Array, codes: Array) -> Array:
    return log_softmax(logits, axis=1)[np.arange(len(codes)), codes]


def skills(seed: int, n_bad: int = 12, n: int = 48) -> PartsWorld:
    """A skill in words and its two parameters, whose rule is another one for each skill; bad ones choose skills as
    experts do, and in a quarter of the steps the parameters of another skill."""
    rng, states, good = _begin(seed, 0, n_bad, n)
    slopes, rules = 4 * rng.normal(size=(N_STATES, 3)), rng.normal(size=(3, N_STATES, 2))
    skill = _drawn(states @ slopes, rng)
    astray = ~np.repeat(good, N_STEPS) & (rng.random(len(skill)) < 0.25)
    followed = np.where(astray, (skill + rng.integers(1, 3, len(skill))) % 3, skill)
    means = np.einsum("nd,kda->nka", states, rules)
    rows = np.arange(len(skill))
    numbers = means[rows, followed] + 0.5 * rng.normal(size=(len(skill), 2))
    law = _taken(states @ slopes, skill) + norm.logpdf(numbers, means[rows, skill], 0.5).sum(axis=1)
    names = np.array(["reach", "grip", "turn"])[skill]
    parts = {"action.skill": names, "action.x": numbers[:, 0], "action.y": numbers[:, 1]}
    within = np.eye(3)[skill][:, :, None] * np.append(states, np.ones((len(states), 1)), axis=1)[:, None]
    known = within.reshape(len(states), -1), {name: parts[name] for name in ("action.x", "action.y")}
    return PartsWorld(states, parts, good.astype(int), law.reshape(n, -1).mean(axis=1), known)


def keys(seed: int, n_bad: int = 12, n: int = 48) -> PartsWorld:
    """A direction, a button and an item, whole numbers of 3, 2 and 5 kinds; bad ones take each at random in one of
    eight steps."""
    rng, states, good = _begin(seed, 1, n_bad, n)
    parts, law, combined = {}, np.zeros(len(states)), np.zeros(len(states), dtype=int)
    for name, size in (("direction", 3), ("button", 2), ("item", 5)):
        logits = 3 * states @ rng.normal(size=(N_STATES, size))
        code, by_chance = _drawn(logits, rng), rng.integers(size, size=len(states))
        astray = ~np.repeat(good, N_STEPS) & (rng.random(len(code)) < 0.12)
        parts[f"action.{name}"] = np.where(astray, by_chance, code)
        law += _taken(logits, parts[f"action.{name}"])
        combined = size * combined + parts[f"action.{name}"]
    return PartsWorld(states, parts, good.astype(int), law.reshape(n, -1).mean(axis=1), (states, {"action": combined}))


def texts(seed: int, n_bad: int = 12, n: int = 48) -> PartsWorld:
    """Commands of eight kinds, and in one of ten steps one of 400 rare remarks; bad ones give commands at random in a
    quarter of the steps."""
    rng, states, good = _begin(seed, 2, n_bad, n)
    logits = 3 * states @ rng.normal(size=(N_STATES, 8))
    code = _drawn(logits, rng)
    astray = ~np.repeat(good, N_STEPS) & (rng.random(len(code)) < 0.25)
    code = np.where(astray, rng.integers(8, size=len(code)), code)
    remark = rng.random(len(code)) < 0.1
    remarks = rng.integers(400, size=len(code))
    names = [f"remark {k}" if said else f"command {c}" for c, k, said in zip(code, remarks, remark, strict=True)]
    law = np.where(remark, 0.0, _taken(logits, code))
    known = states, {"action": np.where(remark, 8, code)}
    return PartsWorld(states, {"action": np.array(names)}, good.astype(int), law.reshape(n, -1).mean(axis=1), known)


WORLDS: dict[str, Callable[..., PartsWorld]] = {"skill and parameters": skills, "several keys": keys, "texts": texts}
