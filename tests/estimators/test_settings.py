"""Settings of the stages reach them through `RPIL`."""

from __future__ import annotations

import numpy as np
from sklearn.linear_model import LogisticRegression

from problems import make, make_continuous
from rpil import RPIL, Settings
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.numerics.regression import ErrorSettings
from rpil.policies.cross_fitted import CrossFitSettings
from rpil.policies.features import FeatureSettings
from rpil.policies.selection import SelectionSettings


def test_feature_settings_reach_the_maps_of_the_judge_and_of_the_policy():
    maps = FeatureSettings(n_knots=5, ridge_per_step=1e-3)
    settings = Settings(selection=SelectionSettings(maps=maps))
    model = RPIL("spline", settings=settings).fit(make("noisy", 0).demonstrations)
    for features in (model.features_, model.judge_features_):
        assert len(features.knots) == 5
        assert features.ridge_per_step == 1e-3


def test_error_settings_reach_the_scores_of_continuous_actions():
    data = make_continuous("noisy", 0).demonstrations
    heavy = JudgeSettings(held_out=HeldOutSettings(errors=ErrorSettings(degrees_of_freedom=1.0)))
    ours, theirs = RPIL().fit(data), RPIL(settings=Settings(judge=heavy)).fit(data)
    assert not np.allclose(ours.audit_.step_log_ratio, theirs.audit_.step_log_ratio)


def test_cross_fit_settings_reach_a_policy_of_scikit_learn():
    chosen = CrossFitSettings(n_folds=2)
    model = RPIL(policy=LogisticRegression(), settings=Settings(cross_fit=chosen)).fit(make("noisy", 0).demonstrations)
    assert model.policy_.settings == chosen
