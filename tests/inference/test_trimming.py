"""The training group."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from hand_made import Written, same_actions
from problems import fit_data_of, make
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings, TrimmingSettings
from rpil.inference.trimming import choose_ridge, fit_group, fit_trimmed

STEPS = (40, 60)
EVERYONE = np.ones(6, dtype=bool)


def written(gains):
    data = same_actions(6)
    return data, Written(data, gains, JudgeSettings())


def test_training_group_is_the_best_explained():
    toy = make("random", 0, n_good=10, n_bad=10, steps=STEPS)
    problem = fit_data_of(toy)
    taught = fit_trimmed(
        problem, held_out_model(problem, 0, HeldOutSettings()), np.ones(20, dtype=bool), 1e-2, TrimmingSettings()
    )
    score = problem.mean_steps(taught.log_prob)
    assert roc_auc_score(toy.is_good, score) == 1.0
    assert taught.group.sum() == 12
    assert taught.group[toy.is_good].all()
    assert taught.history[-1] > taught.history[0]


def test_best_explained_are_the_first_of_equals():
    fit = fit_trimmed(*written(lambda group: np.zeros(6)), EVERYONE, 1e-2, TrimmingSettings(share=0.5))
    assert np.flatnonzero(fit.group).tolist() == [0, 1, 2]


def test_concentration_steps_end_where_the_group_stays():
    ends = [[0, 1, 2], [1, 2, 3], [2, 3, 4], [2, 3, 4]]

    def gains(group):
        step = 0 if group.all() else 1 + ends.index(np.flatnonzero(group).tolist())
        return np.isin(np.arange(6), ends[min(step, 3)]) * (1.0 + step)

    data, model = written(gains)
    fit = fit_trimmed(data, model, EVERYONE, 1e-2, TrimmingSettings(0.5, 9))
    assert [np.flatnonzero(group).tolist() for group in model.fitted] == [list(range(6)), *ends[:3]]
    assert np.flatnonzero(fit.group).tolist() == [2, 3, 4]
    base = data.mean_steps(fit.log_prob).min()
    np.testing.assert_allclose(fit.history - base, [0.5, 4 / 3, 2.0, 4.0])
    assert fit.ridge == 1e-2
    short = fit_trimmed(*written(gains), EVERYONE, 1e-2, TrimmingSettings(0.5, 1))
    assert np.flatnonzero(short.group).tolist() == [0, 1, 2]
    assert len(short.history) == 2


@pytest.mark.parametrize(("share", "count"), [(0.6, 4), (0.5, 3), (0.01, 2)])
def test_a_training_group_has_its_share_and_two_at_least(share, count):
    fit = fit_trimmed(*written(lambda group: np.arange(6.0)), EVERYONE, 1e-2, TrimmingSettings(share))
    assert fit.group.sum() == count


def test_a_group_is_fitted_as_it_is():
    data, model = written(lambda group: np.where(group, 2.0, -1.0))
    group = EVERYONE.copy()
    group[0] = False
    fit = fit_group(data, model, group, 0.1)
    assert fit.group.tolist() == group.tolist()
    assert [one.tolist() for one in model.fitted] == [group.tolist()]
    assert fit.history.tolist() == pytest.approx([data.mean_steps(fit.log_prob)[1]])


class Ridges(Written):
    """Ridges, the strongest first, with the gain of each demonstration."""

    explained: ClassVar = {1.0: [0, 0, 0, 0, 0, 9], 0.1: [1, 1, 1, -9, -9, -9], 0.01: [-1, -1, -1, 9, 9, 9]}

    @property
    def ridges(self):
        return tuple(self.explained)

    def evaluate(self, weight, ridge):
        self.fitted.append(ridge)
        return self.data.per_step(np.array(self.explained[ridge], dtype=float))


def ridge_of(group):
    model = Ridges(same_actions(6), lambda group: 0.0, JudgeSettings())
    return choose_ridge(model.data, model, group), model.fitted


def test_ridge_is_that_of_the_median_demonstration_of_the_group(monkeypatch):
    assert ridge_of(np.arange(6) < 3) == (0.1, [1.0, 0.1, 0.01])
    assert ridge_of(np.arange(6) < 5) == (0.1, [1.0, 0.1, 0.01])
    # the search ends where a weaker ridge explains no more
    assert ridge_of(np.arange(6) >= 3) == (1.0, [1.0, 0.1])
    monkeypatch.setattr(Ridges, "explained", {1.0: [0] * 6, 0.1: [0] * 6, 0.01: [1] * 6})
    assert ridge_of(EVERYONE) == (1.0, [1.0, 0.1])
    monkeypatch.setattr(Ridges, "explained", {1.0: [0] * 6, 0.1: [1] * 6, 0.01: [2] * 6})
    assert ridge_of(EVERYONE) == (0.01, [1.0, 0.1, 0.01])
    assert choose_ridge(*written(lambda group: 0.0), EVERYONE) == 0.0


def test_choose_ridge_takes_a_strong_one_for_noise():
    rng = np.random.default_rng(0)
    features = np.column_stack([rng.normal(size=(400, 100)), np.ones(400)])
    noise = FitData(features, rng.integers(4, size=400), np.arange(21) * 20, Discrete(4), np.zeros(20, dtype=int))
    assert choose_ridge(noise, held_out_model(noise, 0, HeldOutSettings()), np.ones(20, dtype=bool)) == 1e-1
    clear = replace(noise, actions=(features[:, 0] > 0).astype(int))
    assert choose_ridge(clear, held_out_model(clear, 0, HeldOutSettings()), np.ones(20, dtype=bool)) < 1e-1
