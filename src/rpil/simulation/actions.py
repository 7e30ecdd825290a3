"""What an environment lets one do: one of K numbered actions, or any point of a box.

Either kind knows how to draw an action, how to mirror and turn one, and what it makes of a policy's answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rpil.data.errors import DataError


@runtime_checkable
class ActionSpace(Protocol):
    """What drivers, corruptions and rollouts ask of either kind; arrays of actions have one entry or row per step."""

    @property
    def classes_(self) -> NDArray[np.int64]:
        """All actions, under scikit-learn's name for them; empty where they cannot be listed."""

    @property
    def wanted(self) -> str:
        """What a policy must answer to an observation, for messages."""

    def draw(self, n_steps: int, rng: np.random.Generator) -> NDArray[Any]:
        """Uniform draws, one per step."""

    def flip(self, actions: NDArray[Any]) -> NDArray[Any]:
        """The opposite of every action."""

    def shift(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Every action moved on along a circle."""

    def executed(self, answer: NDArray[Any], n_steps: int) -> NDArray[Any] | None:
        """What is done where a policy gives this `answer` to `n_steps` observations; None where it can't be done."""


@dataclass(frozen=True)
class NumberedActions:
    """The actions `start` .. `start` + `n` - 1."""

    n: int
    start: int = 0

    @property
    def classes_(self) -> NDArray[np.int64]:
        """All of them, (n,)."""
        return np.arange(self.start, self.start + self.n)

    @property
    def wanted(self) -> str:
        """One of them."""
        return f"one action {self.start} to {self.start + self.n - 1}"

    def draw(self, n_steps: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Uniform draws (n_steps,)."""
        return rng.integers(self.start, self.start + self.n, size=n_steps)

    def flip(self, actions: NDArray[np.int64]) -> NDArray[np.int64]:
        """Swap the first and the last action; those between stay."""
        swap = self.classes_
        swap[[0, -1]] = swap[[-1, 0]]
        return swap[actions - self.start]

    def shift(self, actions: NDArray[np.int64]) -> NDArray[np.int64]:
        """Turn every action into the next, the last into the first."""
        return (actions - self.start + 1) % self.n + self.start

    def executed(self, answer: NDArray[Any], n_steps: int) -> NDArray[np.int64] | None:
        """The `answer` (n_steps,) as int64, if it is whole numbers among the actions."""
        if answer.shape != (n_steps,) or answer.dtype.kind not in "iufb":
            return None
        # Compared before the cast: NaN and infinity have no integer.
        if not np.all((answer >= self.start) & (answer < self.start + self.n)):
            return None
        actions = answer.astype(np.int64)
        return actions if np.array_equal(actions, answer) else None

    def __str__(self) -> str:
        return f"the actions {self.start} to {self.start + self.n - 1}"


@dataclass(frozen=True, eq=False)
class ActionBox:
    """Continuous actions of A numbers, each between its bounds.

    Attributes
    ----------
    low, high : (A,) arrays
        In the precision that the environment takes, which recorded actions have as well.
    """

    low: NDArray[Any]
    high: NDArray[Any]

    @classmethod
    def of(cls, low: ArrayLike, high: ArrayLike) -> ActionBox:
        """A box in single precision, as Gymnasium's are."""
        return cls(np.asarray(low, dtype=np.float32), np.asarray(high, dtype=np.float32))

    @property
    def classes_(self) -> NDArray[np.int64]:
        """Empty: a box has no list of actions."""
        return np.empty(0, dtype=np.int64)

    @property
    def wanted(self) -> str:
        """A numbers."""
        return "one finite number" if len(self.low) == 1 else f"{len(self.low)} finite numbers"

    def draw(self, n_steps: int, rng: np.random.Generator) -> NDArray[Any]:
        """Uniform draws (n_steps, A).

        Raises
        ------
        DataError
            Where a bound is infinite.
        """
        if not np.isfinite([self.low, self.high]).all():
            raise DataError(f"No action can be drawn uniformly from {self}: give every number two finite bounds.")
        return rng.uniform(self.low, self.high, size=(n_steps, len(self.low))).astype(self.low.dtype)

    def flip(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Mirror every number at the middle of its bounds: a becomes low + high - a."""
        return self._clipped(self.low + self.high - actions)

    def shift(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Move every number on by half of its range, beyond the upper bound going on at the lower."""
        span = self.high - self.low
        return self._clipped(self.low + (actions - self.low + span / 2) % span)

    def executed(self, answer: NDArray[Any], n_steps: int) -> NDArray[Any] | None:
        """The `answer` (n_steps, A), or (n_steps,) where A is 1, clipped to the box, if it is finite numbers."""
        if answer.shape == (n_steps,) and len(self.low) == 1:
            answer = answer[:, None]
        if answer.shape != (n_steps, len(self.low)) or answer.dtype.kind not in "iuf" or not np.isfinite(answer).all():
            return None
        return self._clipped(answer)

    def __str__(self) -> str:
        bounds = ", ".join(f"{low:g} to {high:g}" for low, high in zip(self.low, self.high, strict=True))
        return f"continuous actions ({bounds})"

    def _clipped(self, actions: NDArray[Any]) -> NDArray[Any]:
        # Clipped before the cast: what is far beyond the box may be beyond its precision too.
        return np.clip(actions, self.low, self.high).astype(self.low.dtype)
