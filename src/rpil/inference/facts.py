"""Facts about demonstrations that are shown beside the words, and from which no answer learns.

`dynamics` says how well the next state follows from state and action: the mean log-density of the change of each state,

    s_{n+1} - s_n = (s_n, a_n, 1) W + sigma e_n,    e_n ~ t_nu,

under one linear model of all demonstrations. `at_time_limit` says who was probably cut off: several demonstrations that
share the largest length.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.channels import BLOCK_ROWS, StateScale
from rpil.inference.settings import ChannelSettings
from rpil.numerics.regression import ROUNDING, solve_ridge, student_log_density
from rpil.numerics.types import Array, Float

DYNAMICS, TIME_LIMIT = "dynamics", "time limit"

MAX_COLUMNS = 512
"""Columns of states and actions up to which dynamics are measured: the cost grows with their square."""
RIDGE = 1e-6
"""A step; columns of the same content are no obstacle with it."""
MIN_AT_LIMIT = 3
"""Demonstrations, at least, that share the largest length where there is a time limit: two may by chance."""


def facts_beside(
    data: FitData, actions: Float[Array, "N A"], states: StateScale, settings: ChannelSettings
) -> dict[str, Float[Array, " M"]]:
    """The facts about M demonstrations by name; what is not known is left out. `actions` as in `channels`."""
    found = {DYNAMICS: dynamics(data, actions, states, settings), TIME_LIMIT: at_time_limit(data.lengths)}
    return {name: values for name, values in found.items() if values is not None}


def at_time_limit(lengths: Array) -> Float[Array, " M"] | None:
    """1 for demonstrations of the largest length, 0 for others; None where it is that of few, or of all."""
    longest = lengths == lengths.max()
    return longest.astype(float) if MIN_AT_LIMIT <= longest.sum() < len(longest) else None


def dynamics(
    data: FitData, actions: Float[Array, "N A"], states: StateScale, settings: ChannelSettings
) -> Float[Array, " M"] | None:
    """Mean log-density of the changes of state of each demonstration, in nats a step and column; the median of the
    others for a demonstration of one step; None where states and actions have too many columns, or never change."""
    if data.features.shape[1] + actions.shape[1] > MAX_COLUMNS or (data.lengths < 2).all():
        return None
    n, n_states = len(data.features) - data.n_demonstrations, data.features.shape[1]
    n_inputs = n_states + actions.shape[1] + 1
    gram, product, square = np.zeros((n_inputs, n_inputs)), np.zeros((n_inputs, n_states)), np.zeros(n_states)
    for _, inputs, change in _transitions(data, actions, states):
        gram += inputs.T @ inputs
        product += inputs.T @ change
        square += (change**2).sum(axis=0)
    moves = square > n * ROUNDING
    if not moves.any():
        return None
    product, square = product[:, moves], square[moves]
    weights = solve_ridge(gram, product, n, RIDGE)
    left = square - 2 * (weights * product).sum(axis=0) + (weights * (gram @ weights)).sum(axis=0)
    spread = np.sqrt(square / n)
    scale = np.sqrt(np.maximum(left / n, 0.0)) / spread + settings.errors.min_scale
    density = np.zeros(len(data.features))
    for rows, inputs, change in _transitions(data, actions, states):
        errors = (change[:, moves] - inputs @ weights) / spread
        density[rows] = student_log_density(errors, scale, settings.errors) / moves.sum()
    means = data.sum_steps(density) / np.maximum(data.lengths - 1, 1)
    return np.asarray(np.where(data.lengths < 2, np.median(means[data.lengths >= 2]), means))


def _transitions(data: FitData, actions: Array, states: StateScale) -> Iterator[tuple[Array, Array, Array]]:
    """Blocks of steps that another one follows: their rows, states with actions and a constant, and the changes."""
    inside = np.ones(len(data.features), dtype=bool)
    inside[data.offsets[1:] - 1] = False
    for begin in range(0, len(inside), BLOCK_ROWS):
        scaled = states.scaled(data.features[begin : begin + BLOCK_ROWS + 1])
        own = np.flatnonzero(inside[begin : begin + BLOCK_ROWS])
        here, rows = scaled[own], begin + own
        yield rows, np.column_stack([here, actions[rows], np.ones(len(rows))]), scaled[own + 1] - here
