"""Rival groups and styles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import fit_data_of, make, make_continuous, two_styles
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.held_out import held_out_model
from rpil.inference.rivals import find_rival, find_style, split_by_gradients, state_overlap
from rpil.inference.settings import HeldOutSettings, JudgeSettings, RivalSettings

STEPS = (40, 60)


@pytest.mark.parametrize("kind", ["random", "noisy", "window"])
def test_noise_is_no_rival(kind):
    toy = make(kind, 0, n_good=10, n_bad=10, steps=STEPS)
    problem = fit_data_of(toy)
    model = held_out_model(problem, 0, HeldOutSettings())
    assert find_rival(problem, model, toy.is_good, 1e-2, JudgeSettings(), 0) is None


def test_states_of_moved_groups_do_not_overlap():
    toy = make("shifted", 1, steps=STEPS)
    problem = fit_data_of(toy)
    away = problem.features.copy()
    away[problem.per_step(~toy.is_good), 0] += 20.0
    moved = replace(problem, features=away)
    first, second = np.flatnonzero(toy.is_good), np.flatnonzero(~toy.is_good)
    assert state_overlap(problem, first, second, 0, RivalSettings(), HeldOutSettings()) > 0.8
    assert state_overlap(moved, first, second, 0, RivalSettings(), HeldOutSettings()) < 0.1


def test_one_style_has_no_rival():
    data, _ = two_styles(0, n_first=12, n_second=0)
    problem = FitData(
        np.column_stack([data.observations, np.ones(len(data.actions))]),
        data.actions,
        data.offsets,
        Discrete(2),
        np.zeros(12, dtype=int),
    )
    assert find_style(problem, held_out_model(problem, 0, HeldOutSettings()), 1e-3, JudgeSettings(), 0) is None


def test_split_by_gradients_divides_continuous_actions():
    toy = make_continuous("flipped", 0, n_good=6, n_bad=6, steps=(100, 120))
    side = split_by_gradients(toy.problem("raw"), 1e-3, RivalSettings())
    assert (side == toy.is_good).all() or (side == ~toy.is_good).all()
