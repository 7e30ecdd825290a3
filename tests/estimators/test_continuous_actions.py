"""Continuous actions from end to end: EM, what is trusted, what is learned, kept and shown."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression, LogisticRegression
from sklearn.metrics import r2_score, roc_auc_score

import more_experts  # noqa: F401 (makes LunarLanderContinuous known)
from problems import continuous_zoo, make, make_continuous
from rpil import Settings
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rpil import RPIL
from small import FAST

ZOO = continuous_zoo(0)
STEPS = (40, 60)
MANY: dict[str, Any] = {"n_good": 10, "n_bad": 10, "steps": STEPS}


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


def test_one_outlying_step_does_not_decide_a_verdict():
    """Under a Gaussian its density would be e^-5000; the box and the tails forgive it."""
    toy = make_continuous("random", 0, **MANY)
    spoiled = replace(toy, actions=toy.actions.copy())
    spoiled.actions[3] = toy.space.high
    spoiled.actions[toy.offsets[4]] = toy.space.low
    model = RPIL(action_box=(toy.space.low, toy.space.high)).fit(spoiled.demonstrations)
    assert toy.is_judged_right(model.audit_)


def test_adversaries_are_found_and_the_experts_policy_is_learned():
    toy = make_continuous("random", 1, n_parts=2, **MANY)
    model = RPIL().fit(toy.demonstrations)
    assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0
    assert toy.is_judged_right(model.audit_)
    assert model.audit_.identifiable
    np.testing.assert_array_equal(model.log_odds_, model.audit_.log_odds)
    truth = model.space_.act(toy.means)
    naive = BehavioralCloning().fit(toy.demonstrations)
    ours, theirs = (np.abs(m.predict(toy.observations) - truth).mean() for m in (model, naive))
    assert ours < 0.05
    assert ours < theirs


def test_auto_features_fit_a_nonlinear_expert():
    toy = make_continuous("random", 0, **MANY)
    good = toy.is_good[toy.groups]
    curve = 3 * toy.observations[:, 0] * toy.observations[:, 1]
    actions = np.where(good, curve + 0.2 * np.random.default_rng(0).normal(size=len(good)), toy.actions[:, 0])[:, None]
    data = Demonstrations(toy.observations, actions, toy.offsets)
    model = RPIL("auto", settings=Settings(judge_features="nystroem")).fit(data)
    assert model.features_.kind == "nystroem"
    assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0


def test_constant_part_of_an_action_and_no_noise():
    for name in ("no noise at all", "a part that never moves"):
        toy = ZOO[name]
        model = RPIL(settings=FAST).fit(toy.demonstrations)
        assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0, name
        predicted = model.predict(toy.observations)
        assert np.isfinite(predicted).all()
    np.testing.assert_allclose(predicted[:, 1], 3.0, atol=1e-3)


def test_regressor_as_policy():
    toy = make_continuous("random", 1, **MANY)
    model = RPIL(policy=LinearRegression()).fit(toy.demonstrations)
    assert toy.is_judged_right(model.audit_)
    assert r2_score(model.space_.act(toy.means), model.predict(toy.observations)) > 0.98
    with pytest.raises(DataError, match="The policy LogisticRegression is no regressor and the actions are continuous"):
        RPIL(policy=LogisticRegression()).fit(toy.demonstrations)
    with pytest.raises(DataError, match="The policy LinearRegression is a regressor and the actions are discrete"):
        RPIL(policy=LinearRegression()).fit(make("random", 0).demonstrations)
