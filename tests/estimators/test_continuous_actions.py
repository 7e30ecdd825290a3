"""Continuous actions from end to end: EM, what is trusted, what is learned, kept and shown."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, LogisticRegression
from sklearn.metrics import r2_score

from problems import coefficients, make, make_continuous, refused
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.spaces import Box
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL

MANY: dict[str, Any] = {"n_good": 10, "n_bad": 10, "steps": (40, 60)}


def test_experts_with_actions_on_the_bounds_of_the_box_are_trusted():
    """Most of their actions are at a bound: a straight line misses these, and random ones look more of one mind."""
    rng, is_good, lengths = np.random.default_rng(0), np.arange(30) % 3 > 0, np.full(30, 100)
    observations = rng.normal(size=(3000, 6))
    wanted = observations @ rng.normal(scale=1.1, size=(6, 2)) + 0.1 * rng.normal(size=(3000, 2))
    random = rng.uniform(-1.0, 1.0, size=(3000, 2))
    actions = np.where(np.repeat(is_good, lengths)[:, None], np.clip(wanted, -1.0, 1.0), random)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    audit = RPIL().fit(Demonstrations(observations, actions, offsets)).audit_
    assert audit.verdicts == tuple(np.where(is_good, "open", "outlier"))


def test_regressor_as_policy():
    toy = make_continuous("random", 1, **MANY)
    model = RPIL(policy=LinearRegression()).fit(toy.demonstrations)
    assert toy.is_judged_right(model.audit_)
    assert r2_score(model.space_.act(toy.means), model.predict(toy.observations)) > 0.98
    with pytest.raises(DataError, match="The policy LogisticRegression is no regressor and the actions are continuous"):
        RPIL(policy=LogisticRegression()).fit(toy.demonstrations)
    with pytest.raises(DataError, match="The policy LinearRegression is a regressor and the actions are discrete"):
        RPIL(policy=LinearRegression()).fit(make("random", 0).demonstrations)


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
    coef, intercept = coefficients(model)
    assert coef.shape == (n_parts, 3)
    linear = toy.observations @ coef.T + intercept
    np.testing.assert_allclose(model.predict(toy.observations), model.space_.act(linear), atol=1e-9)
    with refused("The actions are continuous"):
        model.predict_proba(toy.observations)
