"""The scikit-learn face: its checks, its tools, and what `RPIL` adds to them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sklearn import config_context
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_validate
from sklearn.utils.estimator_checks import parametrize_with_checks

from problems import Toy, make, make_continuous
from rpil import Settings
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.inference.settings import HeldOutSettings, PartSettings, TrimmingSettings
from small import FAST, ONE_SHARE, mixture

STEPS = (40, 60)


FASTEST = replace(
    ONE_SHARE,
    held_out=HeldOutSettings(max_folds=2, ridges=(0.01,)),
    trimming=TrimmingSettings(max_iter=1),
    parts=PartSettings(max_iter=1),
)
"""One fit of each of two folds: to scikit-learn every row is a demonstration, and it makes a hundred fits."""


@parametrize_with_checks(
    [BehavioralCloning(), RMEnt(n_starts=2, groups="rows"), RPIL(settings=Settings(judge=FASTEST), groups="rows")]
)
def test_estimator_checks_of_scikit_learn(estimator, check):
    """All of them: repeated rows and weights are the same to `BehavioralCloning`, the others take no weights. How well
    `RMEnt` predicts is not among them, see the next test."""
    check(estimator)


def test_rment_of_single_steps_may_leave_out_a_class():
    """It is the optimum of eq. 2 and no failure of the search; nine tenths predict as well as scikit-learn asks."""
    rng = np.random.default_rng(0)
    y = np.repeat([0, 1, 2], 20)
    X = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]])[y] + 0.3 * rng.normal(size=(60, 2))
    rows = np.arange(60)
    half = RMEnt().fit(X, y, groups=rows)
    assert len(set(y[half.weights_ == 1.0])) == 2
    clone = BehavioralCloning().fit(X, y)  # tells all three apart, at the price of a larger ridge
    taken = np.sort(clone.log_prob(X, y))[30:]
    assert half.objective_ < clone.policy_.penalty() / 60 - taken.mean()
    assert RMEnt(0.9).fit(X, y, groups=rows).score(X, y) > 0.83


def predicted(model: Any, toy: Toy) -> np.ndarray:
    return model.predict_proba(toy.observations)


def test_adversaries_are_found_and_the_experts_policy_is_learned():
    toy = make("noisy", 1, n_actions=4, n_good=10, n_bad=10, steps=STEPS)
    model = RPIL().fit(toy.demonstrations)
    assert roc_auc_score(toy.is_good, model.audit_.log_odds) == 1.0
    assert toy.is_judged_right(model.audit_)
    assert model.audit_.identifiable
    np.testing.assert_array_equal(model.expert_proba_, model.audit_.expert_proba)
    assert model.audit_.ids == toy.ids
    proba = predicted(model, toy)
    naive = predicted(BehavioralCloning().fit(toy.observations, toy.actions), toy)
    good = toy.is_good[toy.groups]
    oracle = predicted(BehavioralCloning().fit(toy.observations[good], toy.actions[good]), toy)
    assert np.abs(proba - oracle).mean() < 0.3 * np.abs(naive - oracle).mean()


@pytest.mark.parametrize("estimator", [RPIL(settings=FAST, random_state=3), RMEnt(random_state=3), BehavioralCloning()])
@pytest.mark.parametrize("toy", [make("noisy", 0), make_continuous("noisy", 0)])
def test_same_seed_gives_same_bits_for_arrays_and_demonstrations(toy, estimator):
    groups = {} if isinstance(estimator, BehavioralCloning) else {"groups": toy.groups}
    models = [clone(estimator).fit(toy.demonstrations) for _ in range(2)]
    models.append(clone(estimator).fit(toy.observations, toy.actions, **groups))
    for other in models[1:]:
        np.testing.assert_array_equal(other.policy_.weights, models[0].policy_.weights)
        np.testing.assert_array_equal(other.predict(toy.observations), models[0].predict(toy.observations))
        for name in {"expert_proba_", "lower_bound_", "log_likelihood_", "objective_"} & {*dir(other)}:
            np.testing.assert_array_equal(getattr(other, name), getattr(models[0], name))


def test_cross_validate_without_groups_is_an_error():
    toy = make("random", 0)
    model, splits = RPIL(adversary="uniform"), GroupKFold(3)
    arguments = model, toy.observations, toy.actions
    with pytest.raises(ValueError, match=r"All the 3 fits failed(.|\n)*RPIL\(\)\.set_fit_request\(groups=True\)"):
        cross_validate(*arguments, groups=toy.groups, cv=splits)
    with config_context(enable_metadata_routing=True), warnings.catch_warnings():
        warnings.simplefilter("error")
        model.set_fit_request(groups=True, labels=False)
        found = cross_validate(
            *arguments, params={"groups": toy.groups}, cv=splits, return_estimator=True, error_score="raise"
        )
    assert [len(fitted.audit_.ids) for fitted in found["estimator"]] == [8, 8, 8]


def test_progress_is_reported():
    said: list[str] = []
    RPIL(progress=said.append).fit(make("random", 0).demonstrations)
    assert said[0] == "features"
    stages = ["ridge", "fitting the training group", "what the scores support", "the policy"]
    assert said[1:] == stages
    RPIL(adversary="uniform", progress=said.append).fit(make("random", 0).demonstrations)
    assert "fitting, from the start pooled" in said


def test_warning_without_convergence():
    with pytest.warns(ConvergenceWarning, match="raise max_iter"):
        RPIL(adversary="confusion", settings=mixture(max_iter=1, tol=0.0)).fit(make("window", 0).demonstrations)


@pytest.mark.parametrize(("prior", "is_turned"), [(None, False), (0.9, False), (0.2, True), ((20, 80), True)])
def test_a_prior_says_which_of_two_parts_the_policy_trusts(prior, is_turned):
    toy = make("flipped", 1, n_good=9, n_bad=5, steps=STEPS)
    audit = RPIL(settings=mixture(prior=prior)).fit(toy.demonstrations).audit_
    np.testing.assert_array_equal(audit.part > 0, (toy.is_good == 1) ^ is_turned)
    assert audit.step_weight[audit.offsets[:-1]].tolist() == (audit.part > 0).tolist()
