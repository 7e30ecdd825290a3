"""Scores and policies made by hand, so that a decision of the judge can be tested alone.

All demonstrations take the same actions, so that every group of them has the same frequencies of actions. What a policy
explains beyond these is written down: a gain for each demonstration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.answers import Answers
from rpil.inference.groups import Groups
from rpil.inference.held_out import HeldOutModel, log_reference
from rpil.inference.scores import Scores, Scoring, TrimmedFit
from rpil.inference.settings import JudgeSettings

Array = NDArray[Any]
Gains = Callable[[Array], Any]
"""Of the policy fitted to a group (M,) bool: its gain over frequent actions on each demonstration, (M,) or a number."""


def same_actions(n_demonstrations: int, discrete: bool = False) -> FitData:
    """Demonstrations that all take the same actions: an odd number of them, whose median is that of any group."""
    steps = 4 if discrete else 5
    n = n_demonstrations * steps
    features = np.column_stack([np.tile(np.arange(float(steps)), n_demonstrations), np.ones(n)])
    offsets, labels = np.arange(0, n + 1, steps), np.zeros(n_demonstrations, dtype=int)
    if discrete:
        return FitData(features, np.tile(np.arange(steps) % 2, n_demonstrations), offsets, Discrete(2), labels)
    actions = np.tile(np.random.default_rng(0).normal(size=(steps, 2)), (n_demonstrations, 1))
    return FitData(features, actions, offsets, Box.around(actions), labels)


COLUMNS = np.column_stack([np.linspace(-1.5, 1.5, 12), np.tile([0.5, -0.5, 0.1], 4), np.repeat([-1.0, 1.0], 6)])
"""What is known of twelve demonstrations, from which answers learn: the ranking, a channel, and the group."""


def answers_of(labels: Any = None, pairs: Any = (), outcome: Any = None, tied: Any = (), m: int = 12) -> Answers:
    """Answers about `m` demonstrations, or as many as there are labels; one outcome or several."""
    labels = np.zeros(m, dtype=np.int64) if labels is None else np.asarray(labels, dtype=np.int64)
    outcomes = np.array([] if outcome is None else outcome, dtype=float).reshape(-1, len(labels)).T
    pairs, tied = (np.array(numbers, dtype=np.int64).reshape(-1, 2) for numbers in (pairs, tied))
    return Answers(labels, pairs, outcomes, tied, ("outcome", "other", "third")[: outcomes.shape[1]])


def reference(data: FitData, settings: JudgeSettings) -> Array:
    """log q of every step, for each group of demonstrations."""
    return log_reference(data, np.ones(data.n_demonstrations, dtype=bool), settings.held_out)


@dataclass(eq=False)
class Written(HeldOutModel):
    """Policies whose gains are written down."""

    data: FitData
    gains: Gains
    settings: JudgeSettings
    fitted: list[Array] = field(default_factory=list)
    """The groups to which policies were fitted."""

    def evaluate(self, weight: Array, ridge: float) -> Array:
        group = self.data.mean_steps(weight) > 0
        self.fitted.append(group)
        of_each = np.broadcast_to(np.asarray(self.gains(group), dtype=float), self.data.n_demonstrations)
        return self.data.per_step(of_each) + reference(self.data, self.settings)


def scoring_of(data: FitData, gains: Gains, settings: JudgeSettings) -> Scoring:
    """How demonstrations are scored by policies with these gains."""
    log_q = reference(data, settings)
    return Scoring(data, Written(data, gains, settings), settings, 1e-2, log_q, log_q, np.zeros(data.n_demonstrations))


def groups_of(p_two: float, share: float = 0.5, deviation: float = 0.1) -> Groups:
    """Two groups of scores, around 0 and 1, with a standard deviation."""
    spread = np.full(2, deviation**2)
    return Groups(float(np.log(p_two / (1 - p_two))), np.array([0.0, 1.0]), spread, share, 0.1, np.array([0.0, 1]))


def scores_of(scoring: Scoring, score: Any, p_two: float, deviation: float = 0.1, **other: Any) -> Scores:
    """Scores around 0 and 1, where the training group has those above one half."""
    score = np.asarray(score, dtype=float)
    log_prob = scoring.data.per_step(score) + scoring.log_q
    fit = TrimmedFit(log_prob, score > 0.5, scoring.ridge, np.zeros(1))
    fields = {"step_variance": 1.0, "state_predicts_action": True}
    groups = groups_of(p_two, deviation=deviation)
    return Scores(score, np.full(len(score), 1e-4), np.zeros(len(score)), groups=groups, fit=fit, **(fields | other))
