"""People who drive Meta-World's arm by its scripted policies: good ones, and bad ones of eleven kinds.

An operator sees an observation, perhaps wrongly, asks the script for an action, and carries it out, perhaps wrongly.
Actions are a motion of the hand, three numbers, and a force of the gripper, all in [-1, 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rpil.numerics.types import Array

HAND, OBJECT, GOAL = slice(0, 3), slice(4, 7), slice(36, 39)
"""Places in an observation; the hand is also that of the motion in an action."""
TYPICAL = 60
"""Steps that a script needs for a task, about. The middle of an episode is at 0.3 to 0.7 of them."""
INTERLUDES, AFTER_LEAVING, GRIPPER_TURNS = 3, 30, 10
"""How often an operator pauses or goes astray; steps until one who left the task stops; steps of a wrong gripper."""


@dataclass(frozen=True)
class Kind:
    """How an operator differs from the script."""

    gain: float = 1.0
    """Multiplies the motion of the hand."""
    tremor: float = 0.1
    """Standard deviation of what is added to it."""
    aside: float = 0.0
    """Metres by which goal and object seem to be to one side, the same side in a whole data set."""
    beyond: float = 0.0
    """Metres by which they seem to be farther away, up to the middle."""
    delay: int = 0
    """Steps after which an observation is acted on."""
    leaves: tuple[float, float] | None = None
    """What is done from the middle on: the motion upwards, and the gripper (0: as the script)."""
    pauses: int = 0
    """Steps of each pause."""
    strays: int = 0
    """Steps of each detour, in a direction at random."""
    mirrored: bool = False
    """Goes to the other side up to the middle."""
    wrong_gripper: bool = False
    """Opens where the script closes, and the reverse, every other ten steps."""
    limit: int = 1000
    """Steps after which the operator is content, whatever was reached."""


GOOD = {"normal": Kind(), "gentle": Kind(gain=0.75)}
BAD = {
    "gives up": Kind(leaves=(0, 0)),
    "drops": Kind(leaves=(0.5, -1)),
    "beside": Kind(aside=0.08, limit=2 * TYPICAL),
    "slow": Kind(gain=0.4),
    "detours": Kind(strays=15),
    "pauses": Kind(pauses=20),
    "overshoots": Kind(beyond=0.06),
    "late": Kind(delay=6),
    "shaky": Kind(tremor=0.8),
    "wrong gripper": Kind(wrong_gripper=True),
    "other order": Kind(mirrored=True),
}


class Operator:
    """Drives one episode."""

    def __init__(self, kind: Kind, script: Any, side: Array, rng: np.random.Generator) -> None:
        self.kind, self.script, self.side, self.rng = kind, script, side, rng
        self.middle = int(TYPICAL * rng.uniform(0.3, 0.7))
        self.interludes = rng.integers(0, TYPICAL, size=INTERLUDES)
        self.ways = rng.uniform(-1, 1, size=(INTERLUDES, 3))
        self.seen: list[Array] = []

    def act(self, observation: Array, n: int) -> Array:
        """The action (4,) at step n."""
        self.seen.append(observation)
        wanted = np.clip(self.script.get_action(self._believed(n)), -1, 1)
        action = self._done(np.array(wanted, dtype=float), n)
        action[HAND] = self.kind.gain * action[HAND] + self.kind.tremor * self.rng.normal(size=3)
        return np.clip(action, -1, 1)

    def stops(self, n: int) -> bool:
        """Whether the episode ends before step n, whatever was reached."""
        left = self.kind.leaves is not None and n > self.middle + AFTER_LEAVING
        return left or n > self.kind.limit

    def _believed(self, n: int) -> Array:
        kind, seen = self.kind, self.seen[max(n - self.kind.delay, 0)].copy()
        way = self.seen[0][OBJECT] - self.seen[0][HAND]
        onward = np.array([*way[:2], 0]) / max(np.linalg.norm(way[:2]), 1e-6)
        wrong = kind.aside * self.side + kind.beyond * (n < self.middle) * onward
        seen[OBJECT] += wrong
        seen[GOAL] += wrong
        return seen

    def _done(self, action: Array, n: int) -> Array:
        kind = self.kind
        if kind.leaves is not None and n >= self.middle:
            upwards, gripper = kind.leaves
            return np.array([0, 0, upwards, gripper or action[3]])
        for start, way in zip(self.interludes, self.ways, strict=True):
            if start <= n < start + kind.pauses:
                action[HAND] = 0
            if start <= n < start + kind.strays:
                action[HAND] = way
        if kind.mirrored and n < self.middle:
            action[:2] *= -1
        if kind.wrong_gripper and (n // GRIPPER_TURNS) % 2:
            action[3] = -action[3] if action[3] else 1.0
        return action
