"""The training group."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sklearn.metrics import roc_auc_score

from problems import fit_data_of, make
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, TrimmingSettings
from rpil.inference.trimming import best_explained, choose_ridge, fit_trimmed, group_shares

STEPS = (40, 60)


def test_training_group_is_the_best_explained():
    toy = make("random", 0, n_good=10, n_bad=10, steps=STEPS)
    problem = fit_data_of(toy)
    taught = fit_trimmed(problem, held_out_model(problem, 0, HeldOutSettings()), np.ones(20, dtype=bool), 1e-2, 0.6, 4)
    score = problem.mean_steps(taught.held_out.log_prob)
    assert roc_auc_score(toy.is_good, score) == 1.0
    assert taught.group.sum() == 12
    assert taught.group[toy.is_good].all()
    assert taught.history[-1] > taught.history[0]


def test_training_group_has_labelled_experts_and_no_labelled_adversaries():
    problem = fit_data_of(make("random", 0), labels=[1, -1, *[0] * 10])
    chosen = best_explained(problem, np.array([-9.0, 9.0, *range(10)]), 4)
    assert chosen[0]
    assert not chosen[1]
    assert chosen.sum() == 4


def test_choose_ridge_takes_a_strong_one_for_noise():
    rng = np.random.default_rng(0)
    features = np.column_stack([rng.normal(size=(400, 100)), np.ones(400)])
    noise = FitData(features, rng.integers(4, size=400), np.arange(21) * 20, Discrete(4), np.zeros(20, dtype=int))
    assert choose_ridge(noise, held_out_model(noise, 0, HeldOutSettings()), np.ones(20, dtype=bool)) == 1e-1
    clear = replace(noise, actions=(features[:, 0] > 0).astype(int))
    assert choose_ridge(clear, held_out_model(clear, 0, HeldOutSettings()), np.ones(20, dtype=bool)) < 1e-1


def test_shares_are_halved_down_to_the_smallest_group():
    assert group_shares(100, TrimmingSettings()) == [0.6, 0.3, 0.15, 0.075]
    assert group_shares(20, TrimmingSettings()) == [0.6, 0.3]
    assert group_shares(4, TrimmingSettings()) == [0.6]
