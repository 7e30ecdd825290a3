"""Tables of other kinds: long recordings, takeovers.

Each `Table` holds what a user has, the options that read it, and the same demonstrations as someone makes them who
knows their kind. In a clean table nobody is bad.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from rpil.data.demonstrations import Demonstrations
from worlds import Array, World

RATE = 10.0
"""Steps a second."""

LAW = np.array([-0.9, -0.6, 0.0])
"""Of the policy that a person corrects: of the position, of the speed, and alone."""


@dataclass(frozen=True, eq=False)
class Table:
    """What a user has, and the truth about it."""

    rows: pa.Table
    options: Mapping[str, Any]
    """Those with which the rows are read."""
    true: World
    """The same demonstrations, by their true kind."""
    bad_steps: Array = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(N,) bool: the steps that are bad."""


def table(rows: list[dict[str, object]]) -> pa.Table:
    """The rows as a table."""
    return pa.table({name: [row[name] for row in rows] for name in rows[0]})


def is_bad(n: int, share: float, clean: bool, rng: np.random.Generator) -> Array:
    """Which of `n` are bad: none in a clean table."""
    return np.asarray((rng.permutation(n) < share * n) & (not clean))


def long_recordings(seed: int, clean: bool = False) -> Table:
    """Four drives of five minutes by one driver, who in stretches of twenty seconds is tired: late and coarse."""
    rng = np.random.default_rng([34, seed])
    rows, episodes, good, steps = list[dict[str, object]](), [], list[bool](), list[bool]()
    for d in range(4):
        offset, speed, states, actions, tired = 0.0, 0.0, [], [], []
        begins = rng.permutation(14)[: int(rng.integers(2, 4))] * 200
        for t in range(3000):
            is_tired = not clean and bool(((begins <= t) & (t < begins + 200)).any())
            curve = np.sin(t / 37) + 0.5 * np.sin(t / 11 + d)
            seen = (0.0 if rng.random() < 0.3 else 0.4) if is_tired else 1.0
            action = float(
                0.8 * curve - seen * (1.2 * offset + 0.8 * speed) + (0.25 if is_tired else 0.1) * rng.normal()
            )
            state = {"offset": offset, "speed": speed, "curve": curve}
            rows.append({"drive": f"drive{d}", "time_s": t / RATE, **state, "action": action})
            states.append([offset, speed, curve])
            actions.append([action])
            tired.append(is_tired)
            speed = 0.9 * speed + 0.1 * (action - 0.8 * curve) + 0.05 * rng.normal()
            offset = 0.98 * offset + 0.1 * speed
        for first in range(0, 3000, 100):
            episodes.append((np.array(states[first : first + 100]), np.array(actions[first : first + 100])))
            good.append(np.mean(tired[first : first + 100]) < 0.5)
        steps += tired
    options = {"segment": 10.0, "id": "drive"}
    return Table(
        table(rows), options, World.of(Demonstrations.from_episodes(episodes), good), bad_steps=np.array(steps)
    )


def takeovers(seed: int, clean: bool = False) -> Table:
    """40 episodes of a policy that errs in stretches, subtly; mostly a person takes over a second later."""
    rng = np.random.default_rng([35, seed])
    rows, episodes, wrong = list[dict[str, object]](), [], list[bool]()
    for e in range(40):
        x, v, states, actions = float(rng.normal()), 0.0, [], []
        begin = int(rng.integers(20, 60)) if not clean and rng.random() < 0.6 else 1000
        end = begin + int(rng.integers(8, 14))
        until = end + 20 if rng.random() < 0.8 else end
        for t in range(100):
            errs = begin <= t < end
            action = float(
                -0.9 * x - 0.6 * v + (0.5 if errs else 0.0) + (0.12 if end <= t < until else 0.25) * rng.normal()
            )
            rows.append(
                {"episode": e, "step": t, "timestamp": t / RATE, "x": x, "v": v, "action": action}
                | {"is_intervention": end <= t < until}
            )
            states.append([x, v])
            actions.append([action])
            wrong.append(errs)
            v, x = 0.9 * v + 0.1 * action, x + 0.1 * v
        episodes.append((np.array(states), np.array(actions)))
    true = World.of(Demonstrations.from_episodes(episodes), np.ones(40))
    return Table(table(rows), {}, true, bad_steps=np.array(wrong))


KINDS: dict[str, Callable[..., Table]] = {
    "long recordings": long_recordings,
    "takeovers": takeovers,
}
