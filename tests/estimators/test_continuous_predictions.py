"""Predictions, scores and weights of the estimators where actions are continuous."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sklearn.base import clone

from problems import make_continuous, refused
from rpil.data.demonstrations import Demonstrations
from rpil.data.spaces import Box
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from small import FAST

STEPS = (40, 60)

MANY: dict[str, Any] = {"n_good": 10, "n_bad": 10, "steps": STEPS}


def test_units_of_the_actions_do_not_matter():
    toy = make_continuous("noisy", 0, **MANY)
    unit, shift = np.array([1e-3, 40.0]), np.array([3.0, -500.0])
    other = replace(toy, actions=toy.actions * unit + shift)
    one, two = (RPIL(settings=FAST).fit(t.demonstrations) for t in (toy, other))
    np.testing.assert_allclose(two.log_odds_, one.log_odds_, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose((two.predict(toy.observations) - shift) / unit, one.predict(toy.observations), atol=1e-4)


@pytest.mark.parametrize(("estimator", "n_parts"), [(RPIL(), 2), (BehavioralCloning(), 1), (RMEnt(), 1)])
def test_predictions_lie_in_the_box(estimator, n_parts):
    toy = make_continuous("random", 0, n_parts=n_parts)
    model = clone(estimator).fit(toy.demonstrations)
    assert len(model.classes_) == 0
    assert isinstance(model.space_, Box)
    np.testing.assert_array_equal(model.space_.low, toy.actions.min(axis=0))
    predicted = model.predict(100 * toy.observations)
    assert predicted.shape == (len(toy.actions), n_parts)
    assert ((model.space_.low <= predicted) & (predicted <= model.space_.high)).all()
    assert (predicted == model.space_.high).any()
    log_prob = model.log_prob(toy.observations, toy.actions)
    assert log_prob.shape == (len(toy.actions),)
    assert model.coef_.shape == (n_parts, 3)
    linear = toy.observations @ model.coef_.T + model.intercept_
    np.testing.assert_allclose(model.predict(toy.observations), model.space_.act(linear), atol=1e-9)
    for method in ("predict_proba", "predict_log_proba"):
        with refused("The actions are continuous"):
            getattr(model, method)(toy.observations)


def test_one_dimensional_float_actions():
    toy = make_continuous("random", 0, n_parts=1)
    columns = Demonstrations(toy.observations, toy.actions, toy.offsets)
    flat = Demonstrations(toy.observations, toy.actions[:, 0], toy.offsets)
    models = [RPIL(settings=FAST).fit(data) for data in (columns, flat)]
    np.testing.assert_array_equal(models[0].log_odds_, models[1].log_odds_)
    assert models[1].predict(toy.observations).shape == (len(toy.actions), 1)
    # scikit-learn's own checks want one-dimensional floats refused: they look like a regression
    with refused("continuous", ValueError):
        RPIL().fit(toy.observations, toy.actions[:, 0], groups=toy.groups)
