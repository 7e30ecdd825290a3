"""People who drive Meta-World's arm by its scripted policies: good ones, and bad ones of eleven kinds.

An operator sees an observation, perhaps wrongly, asks the script for an action, and carries it out, perhaps wrongly.
Actions are a motion of the hand, three numbers, and a force of the gripper, all in [-1, 1].
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
HAND, OBJECT, GOAL = slice(0, 3), slice(4, 7), slice(36, 39)
"""Places in an observation."""
TYPICAL = 60
"""Steps that a script needs for a task, about: faults begin at shares of it."""


class Operator:
    """Follows the script with a slight tremor."""

    gain = 1.0
    """Multiplies the motion of the hand."""
    tremor = 0.1
    """Standard deviation of the motion."""

    def __init__(self, script: Any, side: Array, rng: np.random.Generator) -> None:
        self.script, self.rng = script, rng
        self.side = side
        """A horizontal direction, (3,), the same for all of a data set."""
        self.begins = int(TYPICAL * rng.uniform(0.3, 0.7))

    def act(self, observation: Array, n: int) -> Array:
        """The action (4,) at step n."""
        wanted = np.clip(self.script.get_action(self.see(observation, n)), -1, 1)
        action = self.do(np.array(wanted, dtype=float), n)
        action[HAND] = self.gain * action[HAND] + self.tremor * self.rng.normal(size=3)
        return np.clip(action, -1, 1)

    def see(self, observation: Array, n: int) -> Array:
        return observation

    def do(self, action: Array, n: int) -> Array:
        return action

    def stops(self, n: int) -> bool:
        """Whether the episode ends before step n, whatever was reached."""
        return False


class Gentle(Operator):
    """A little slower."""

    gain = 0.75


class GivesUp(Operator):
    """Rests from the middle on."""

    def do(self, action: Array, n: int) -> Array:
        return action if n < self.begins else np.array([0, 0, 0, action[3]])

    def stops(self, n: int) -> bool:
        return n > self.begins + 30


class Drops(Operator):
    """Lets go in the middle, and lifts the empty hand."""

    def do(self, action: Array, n: int) -> Array:
        return action if n < self.begins else np.array([0, 0, 0.5, -1])

    def stops(self, n: int) -> bool:
        return n > self.begins + 30


class Beside(Operator):
    """Takes goal and object to be 8 cm to the side."""

    def see(self, observation: Array, n: int) -> Array:
        return moved(observation, 0.08 * self.side)

    def stops(self, n: int) -> bool:
        return n > 2 * TYPICAL


class Slow(Operator):
    """Moves at less than half the speed."""

    gain = 0.4


class Detours(Operator):
    """Goes some other way three times."""

    def __init__(self, script: Any, side: Array, rng: np.random.Generator) -> None:
        super().__init__(script, side, rng)
        self.starts = rng.integers(0, TYPICAL, size=3)
        self.ways = rng.uniform(-1, 1, size=(3, 3))

    def do(self, action: Array, n: int) -> Array:
        for start, way in zip(self.starts, self.ways, strict=True):
            if start <= n < start + 15:
                action[HAND] = way
        return action


class Pauses(Operator):
    """Rests twenty steps three times."""

    def __init__(self, script: Any, side: Array, rng: np.random.Generator) -> None:
        super().__init__(script, side, rng)
        self.starts = rng.integers(0, TYPICAL, size=3)

    def do(self, action: Array, n: int) -> Array:
        if any(start <= n < start + 20 for start in self.starts):
            action[HAND] = 0
        return action


class Overshoots(Operator):
    """Aims 6 cm beyond at first."""

    def see(self, observation: Array, n: int) -> Array:
        if n == 0:
            way = observation[OBJECT] - observation[HAND]
            self.beyond = 0.06 * np.array([*way[:2], 0]) / max(np.linalg.norm(way[:2]), 1e-6)
        return moved(observation, self.beyond) if n < self.begins else observation


class Late(Operator):
    """Acts on what was seen six steps before."""

    def __init__(self, script: Any, side: Array, rng: np.random.Generator) -> None:
        super().__init__(script, side, rng)
        self.seen: list[Array] = []

    def see(self, observation: Array, n: int) -> Array:
        self.seen.append(observation)
        return self.seen[max(n - 6, 0)]


class Shaky(Operator):
    """Noise as large as the motion."""

    tremor = 0.8


class WrongGripper(Operator):
    """Opens where it should close, and the reverse, for ten steps of every twenty."""

    def do(self, action: Array, n: int) -> Array:
        if (n // 10) % 2:
            action[3] = -action[3] if action[3] else 1.0
        return action


class OtherOrder(Operator):
    """Goes to the mirrored place first."""

    def do(self, action: Array, n: int) -> Array:
        if n < self.begins:
            action[:2] *= -1
        return action


GOOD: dict[str, type[Operator]] = {"normal": Operator, "gentle": Gentle}
BAD: dict[str, type[Operator]] = {
    "gives up": GivesUp,
    "drops": Drops,
    "beside": Beside,
    "slow": Slow,
    "detours": Detours,
    "pauses": Pauses,
    "overshoots": Overshoots,
    "late": Late,
    "shaky": Shaky,
    "wrong gripper": WrongGripper,
    "other order": OtherOrder,
}


def moved(observation: Array, way: Array) -> Array:
    """The observation with object and goal elsewhere."""
    seen = observation.copy()
    seen[OBJECT] += way
    seen[GOAL] += way
    return seen
