"""What the user is told: ranking, verdicts, the steps to look at, and what cannot be known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Verdict = Literal["expert", "adversary", "uncertain"]


@dataclass(frozen=True)
class Interval:
    """A mean with a 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Audit:
    """How far each demonstration can be trusted.

    Attributes
    ----------
    ids : tuple
        Demonstration ids, in the order of the data (M of them).
    offsets : (M + 1,) int array
        Demonstration m owns the steps ``offsets[m]:offsets[m + 1]``.
    log_odds : (M,) array
        Log posterior odds of expert against adversary, in nats; the primary output.
    expert_proba : (M,) array
        ``sigmoid(log_odds)``.
    reliability : (M,) array
        Posterior mean share of the demonstration's steps that are the expert's.
    reliability_interval : (M, 2) array
        Its 95 % posterior interval.
    verdicts : tuple of {"expert", "adversary", "uncertain"}
    step_log_ratio : (N,) array
        ``log pi(a|s) - log psi(a|s)`` per step, in nats.
    step_weight : (N,) array
        Weight of each step for training a policy, in [0, 1].
    prior : Interval
        Share of expert demonstrations.
    identifiable : bool
        False where several groups of demonstrations each agree among themselves and nothing says which one is the
        expert; then ``competing`` holds the groups and ``to_label`` the ids whose labels would settle it.
    competing : tuple of tuple of ids
    to_label : tuple of ids
    adversary : str
        Name of the adversary model that was used or chosen.
    history : (T,) array
        The EM objective at each iteration of the winning run.
    assumptions : tuple of str
        What the audit took for granted, one sentence each.
    """

    ids: tuple[Any, ...]
    offsets: NDArray[np.int64]
    log_odds: NDArray[np.float64]
    expert_proba: NDArray[np.float64]
    reliability: NDArray[np.float64]
    reliability_interval: NDArray[np.float64]
    verdicts: tuple[Verdict, ...]
    step_log_ratio: NDArray[np.float64]
    step_weight: NDArray[np.float64]
    prior: Interval
    identifiable: bool
    competing: tuple[tuple[Any, ...], ...]
    to_label: tuple[Any, ...]
    adversary: str
    history: NDArray[np.float64]
    assumptions: tuple[str, ...]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Steps per demonstration, (M,)."""
        return np.diff(self.offsets)

    def ranking(self) -> NDArray[np.int64]:
        """Indices of the demonstrations, the most trusted first."""
        return np.argsort(-self.log_odds, kind="stable")

    def worst_steps(self, index: int, k: int = 5) -> list[int]:
        """Up to `k` steps of demonstration `index` (counted from 0 within it) that speak most against an expert."""
        ratio = self.step_log_ratio[self.offsets[index] : self.offsets[index + 1]]
        worst = np.argsort(ratio, kind="stable")[:k]
        return [int(n) for n in worst if ratio[n] < 0]
