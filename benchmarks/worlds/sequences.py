"""Tables of other kinds: observations of text, actions without a state, several agents, long recordings, takeovers.

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
    of_agents: World | None = None
    """Those of each agent in each demonstration, in this order."""
    bad_steps: Array = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(N,) bool: the steps that are bad."""


def table(rows: list[dict[str, object]]) -> pa.Table:
    """The rows as a table."""
    return pa.table({name: [row[name] for row in rows] for name in rows[0]})


def is_bad(n: int, share: float, clean: bool, rng: np.random.Generator) -> Array:
    """Which of `n` are bad: none in a clean table."""
    return np.asarray((rng.permutation(n) < share * n) & (not clean))


def phases(seed: int, clean: bool = False) -> Table:
    """60 episodes in four phases, which a column of text names; one in four often acts as another phase asks for."""
    rng = np.random.default_rng([31, seed])
    names, goals = ["approach", "grasp", "lift", "place"], np.array([-1.0, 0.5, 1.5, 0.0])
    rows, episodes, bad = list[dict[str, object]](), [], is_bad(60, 0.25, clean, rng)
    for e in range(60):
        x, states, actions = float(rng.normal()), [], []
        phase = np.minimum(np.cumsum(rng.random(50) < 0.1), 3)
        for t, k in enumerate(phase.tolist()):
            goal = goals[rng.integers(4)] if bad[e] and rng.random() < 0.3 else goals[k]
            action = 0.3 * (goal - x) + 0.1 * rng.normal()
            rows.append({"episode": f"e{e}", "step": t, "x": x, "phase": names[k], "action": action})
            states.append([x, *(k == np.arange(4))])
            actions.append([action])
            x += action
        episodes.append((np.array(states, dtype=float), np.array(actions)))
    return Table(table(rows), {}, World.of(Demonstrations.from_episodes(episodes), ~bad))


def actions_alone(seed: int, clean: bool = False) -> Table:
    """60 sequences of six moves; good ones follow from the last two, and one in four mixes in moves of chance."""
    rng = np.random.default_rng([32, seed])
    first, second = 1.8 * rng.normal(size=(6, 6)), 1.2 * rng.normal(size=(6, 6))
    rows, episodes, bad = list[dict[str, object]](), [], is_bad(60, 0.25, clean, rng)
    for e in range(60):
        moves: list[int] = []
        for t in range(int(rng.integers(30, 60))):
            values = first[moves[-1]] if moves else np.zeros(6)
            values = values + second[moves[-2]] if len(moves) > 1 else values
            values = values * (0.0 if bad[e] and rng.random() < 0.35 else 1.0)
            moves.append(int(np.argmax(values + rng.gumbel(size=6))))
            rows.append({"episode": f"e{e}", "step": t, "action": "abcdef"[moves[-1]]})
        before = [[-1, -1, *moves][k : k + len(moves)] for k in (1, 0)]
        states = np.concatenate([np.array(own)[:, None] == np.arange(6) for own in before], axis=1)
        episodes.append((states.astype(float), np.array(moves)))
    return Table(table(rows), {"history": 2}, World.of(Demonstrations.from_episodes(episodes), ~bad))


def agents(seed: int, clean: bool = False) -> Table:
    """60 episodes of three agents with one policy, whose rows are mixed; in one of four, an agent often acts by chance.

    An episode is bad if an agent in it is.
    """
    rng = np.random.default_rng([33, seed])
    weights = 1.5 * rng.normal(size=(4, 5))
    rows, episodes, own, bad = list[dict[str, object]](), [], [], is_bad(60, 0.25, clean, rng)
    of_agents = []
    for e in range(60):
        worse = int(rng.integers(3)) if bad[e] else -1
        states = np.cumsum(0.4 * rng.normal(size=(3, 40, 4)), axis=1)
        moves = np.zeros((3, 40), dtype=int)
        for t in range(40):
            for k in range(3):
                heed = rng.random() >= (0.5 if k == worse else 0.05)
                moves[k, t] = np.argmax(heed * states[k, t] @ weights + rng.gumbel(size=5))
                named = {f"s{d}": states[k, t, d] for d in range(4)}
                rows.append(
                    {"episode": f"e{e}", "step": t, "player": "ABC"[k], **named, "action": "vwxyz"[moves[k, t]]}
                )
        episodes.append((states.reshape(-1, 4), moves.reshape(-1)))
        own += [(states[k], moves[k]) for k in range(3)]
        of_agents += [k != worse for k in range(3)]
    apart = World.of(Demonstrations.from_episodes(own), of_agents)
    true = World.of(Demonstrations.from_episodes(episodes), ~bad)
    return Table(table(rows), {"agent": "player"}, true, of_agents=apart)


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
    "text observed": phases,
    "actions alone": actions_alone,
    "several agents": agents,
    "long recordings": long_recordings,
    "takeovers": takeovers,
}
