"""Continuous actions from end to end: EM, what is trusted, what is learned, kept and shown."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression, LogisticRegression
from sklearn.metrics import r2_score, roc_auc_score

from problems import continuous_zoo, make, make_continuous, refused
from rpil import Settings
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.spaces import Box
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rpil import RPIL
from rpil.mixture.adversaries.box import UniformBox
from rpil.mixture.adversaries.named import ADVERSARIES
from small import FAST, mixture

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
    audit = RPIL().fit(Demonstrations.from_arrays(observations, actions, offsets)).audit_
    assert audit.verdicts == tuple(np.where(is_good, "similar", "outlier"))


def test_one_outlying_step_does_not_decide_a_verdict():
    """Under a Gaussian its density would be e^-5000; the box and the tails forgive it."""
    toy = make_continuous("random", 0, **MANY)
    spoiled = replace(toy, actions=toy.actions.copy())
    spoiled.actions[3] = toy.space.high
    spoiled.actions[toy.offsets[4]] = toy.space.low
    model = RPIL(action_box=(toy.space.low, toy.space.high)).fit(spoiled.demonstrations)
    assert toy.is_judged_right(model.audit_)


@pytest.mark.parametrize(("n_parts", "seed"), [(1, 0), (2, 1)])
@pytest.mark.parametrize("kind", ["random", "noisy", "window"])
def test_adversaries_are_found_and_the_experts_policy_is_learned(kind, n_parts, seed):
    toy = make_continuous(kind, seed, n_parts=n_parts, **MANY)
    model = RPIL().fit(toy.demonstrations)
    assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0
    assert toy.is_judged_right(model.audit_) or kind == "window"
    assert model.audit_.identifiable
    np.testing.assert_array_equal(model.log_odds_, model.audit_.log_odds)
    truth = model.space_.act(toy.means)
    naive = BehavioralCloning().fit(toy.demonstrations)
    ours, theirs = (np.abs(m.predict(toy.observations) - truth).mean() for m in (model, naive))
    assert ours < 0.05
    assert ours < theirs or kind != "random"  # heavy tails alone forgive half of the steps


@pytest.mark.parametrize(("n_good", "n_bad"), [(4, 12), (3, 27)])
def test_adversaries_in_the_majority_are_found(n_good, n_bad):
    toy = make_continuous("random", 2, n_good=n_good, n_bad=n_bad, steps=STEPS)
    assert toy.is_judged_right(RPIL().fit(toy.demonstrations).audit_)


@pytest.mark.parametrize("features", ["folded", "nystroem", "auto"])
def test_every_kind_of_features_with_continuous_actions(features):
    toy = make_continuous("random", 1, **MANY)
    model = RPIL(features).fit(toy.demonstrations)
    assert toy.is_judged_right(model.audit_)
    score = r2_score(model.space_.act(toy.means), model.predict(toy.observations))
    assert score > 0.98
    assert any(f"linear in {model.features_.kind} features" in sentence for sentence in model.audit_.assumptions)


def test_auto_features_fit_a_nonlinear_expert():
    toy = make_continuous("random", 0, **MANY)
    good = toy.is_good[toy.groups]
    curve = 3 * toy.observations[:, 0] * toy.observations[:, 1]
    actions = np.where(good, curve + 0.2 * np.random.default_rng(0).normal(size=len(good)), toy.actions[:, 0])[:, None]
    data = Demonstrations.from_arrays(toy.observations, actions, toy.offsets)
    model = RPIL("auto", settings=Settings(judge_features="nystroem")).fit(data)
    assert model.features_.kind == "nystroem"
    assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0


@pytest.mark.parametrize(("kind", "seed"), [("flipped", 0), ("smooth", 1)])
def test_of_two_consistent_groups_only_answers_name_the_expert(kind, seed):
    toy = make_continuous(kind, seed, steps=STEPS)
    blind = RPIL().fit(toy.demonstrations)
    assert not blind.audit_.identifiable
    assert {frozenset(group) for group in blind.audit_.competing} == {frozenset(toy.ids[:6]), frozenset(toy.ids[6:])}
    sure = {"d1": "good", "d2": "good", "d7": "bad", "d8": "bad"}
    for labels in ({"d0": "better than d11"}, sure):
        told = RPIL().fit(toy.demonstrations, labels=labels)
        assert told.audit_.identifiable == (len(labels) > 1)  # one answer alone decides nothing
        assert roc_auc_score(toy.is_good, told.log_odds_) > 0.95, labels
        assert set(told.audit_.verdicts[:6]) <= {"good", "open"}
        assert set(told.audit_.verdicts[6:]) <= {"bad", "open"}
        if labels is sure:  # with one answer the policy learns from both groups
            error = np.abs(told.predict(toy.observations) - told.space_.act(toy.means)).mean()
            assert error < 0.5 * np.abs(blind.predict(toy.observations) - told.space_.act(toy.means)).mean()


def test_noisy_and_clean_demonstrations_form_no_rival_groups():
    for kind in ("random", "noisy", "window", "none"):
        assert RPIL().fit(make_continuous(kind, 3, **MANY).demonstrations).audit_.identifiable


def test_no_adversary_among_equal_demonstrations():
    toy = make_continuous("none", 0, **MANY)
    audit = RPIL().fit(toy.demonstrations).audit_
    assert audit.finding == "no outliers"
    assert set(audit.verdicts) == {"open"}


@pytest.mark.parametrize("which", ADVERSARIES["continuous"])
@pytest.mark.parametrize("kind", ["random", "none"])
def test_every_named_adversary_of_continuous_actions(which, kind):
    toy = make_continuous(kind, 0, **MANY)
    model = RPIL(adversary=which).fit(toy.demonstrations)
    assert model.audit_.adversary == which
    assert np.isfinite(model.log_odds_).all()
    if kind == "random" and which != "own policy":  # which may be either's
        assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0


def test_adversary_instance_and_fixed_prior():
    toy = make_continuous("random", 0, **MANY)
    box = Box.around(toy.actions)
    model = RPIL(adversary=UniformBox(box.log_volume), settings=mixture(prior=0.5)).fit(toy.demonstrations)
    assert toy.is_judged_right(model.audit_)
    assert model.audit_.prior.mean == 0.5


def test_constant_part_of_an_action_and_no_noise():
    for name in ("a part that never moves", "no noise at all"):
        toy = ZOO[name]
        model = RPIL(settings=FAST).fit(toy.demonstrations)
        assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0, name
        predicted = model.predict(toy.observations)
        assert np.isfinite(predicted).all()
    still = RPIL(settings=FAST).fit(ZOO["a part that never moves"].demonstrations)
    np.testing.assert_allclose(still.predict(toy.observations)[:, 1], 3.0, atol=1e-3)


def test_regressor_as_policy():
    toy = make_continuous("random", 1, **MANY)
    model = RPIL(policy=LinearRegression()).fit(toy.demonstrations)
    assert toy.is_judged_right(model.audit_)
    assert r2_score(model.space_.act(toy.means), model.predict(toy.observations)) > 0.98
    with pytest.raises(DataError, match="The policy LogisticRegression is no regressor and the actions are continuous"):
        RPIL(policy=LogisticRegression()).fit(toy.demonstrations)
    with pytest.raises(DataError, match="The policy LinearRegression is a regressor and the actions are discrete"):
        RPIL(policy=LinearRegression()).fit(make("random", 0).demonstrations)


def test_which_actions_of_new_demonstrations_are_scored():
    toy = make_continuous("random", 0, **MANY)
    model = RPIL().fit(toy.demonstrations)
    far = Demonstrations.from_arrays(toy.observations, 10 * toy.actions, toy.offsets)
    found = model.score_demonstrations(far)  # what nobody did while it was fitted is no reason to fail
    assert np.isfinite(found).all()
    assert (found < 0).all()
    with refused("the actions are discrete, and the fitted ones were not"):
        model.score_demonstrations(make("random", 0, n_observations=3).demonstrations)
    with refused():  # another number of parts
        model.score_demonstrations(make_continuous("random", 0, n_parts=1).demonstrations)
