"""Settings of the stages reach them through `RPIL`, and refuse invalid values."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from problems import make, make_continuous, refused
from rpil import RPIL, DataError, MixtureSettings, SampleSettings, Settings
from rpil.estimators.reweight import ReweightOptions
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.mixture.settings import DemonstratorSettings
from rpil.numerics.regression import ErrorSettings
from rpil.policies.features import FeatureSettings
from rpil.policies.settings import CrossFitSettings, SelectionSettings
from rpil.scale.settings import AscentSettings


def test_feature_settings_reach_the_map_of_the_policy():
    maps = FeatureSettings(n_landmarks=5, ridge_per_step=1e-3)
    settings = Settings(selection=SelectionSettings(maps=maps))
    model = RPIL("nystroem", settings=settings).fit(make("noisy", 0).demonstrations)
    assert len(model.features_.landmarks) == 5
    assert model.features_.ridge_per_step == 1e-3


def test_error_settings_reach_the_scores_of_continuous_actions():
    data = make_continuous("noisy", 0).demonstrations
    heavy = JudgeSettings(held_out=HeldOutSettings(errors=ErrorSettings(degrees_of_freedom=1.0)))
    ours, theirs = RPIL().fit(data), RPIL(settings=Settings(judge=heavy)).fit(data)
    assert not np.allclose(ours.audit_.step_log_ratio, theirs.audit_.step_log_ratio)


def test_cross_fit_settings_reach_a_policy_of_scikit_learn():
    chosen = CrossFitSettings(n_folds=2)
    model = RPIL(policy=LogisticRegression(), settings=Settings(cross_fit=chosen)).fit(make("noisy", 0).demonstrations)
    assert model.policy_.settings == chosen


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (partial(MixtureSettings, prior=1.5), "prior 1.5 is no probability"),
        (partial(MixtureSettings, prior=(0.5, 2)), r"Beta prior \(0.5, 2.0\) has no single mode"),
        (partial(MixtureSettings, max_iter=-1), "max_iter=-1 must be a whole number"),
        (partial(MixtureSettings, tol=-1.0), "tol=-1.0 must be a number"),
        (partial(DemonstratorSettings, spreads=(0.0, -1.0)), "spreads"),
        (partial(SampleSettings, max_ratio=0.5), "max_ratio=0.5"),
        (partial(AscentSettings, max_passes=0), "max_passes=0 must be a whole number"),
        (partial(Settings, min_feature_weight=1.0), "min_feature_weight=1.0"),
        (partial(ReweightOptions, patience=0), "patience=0"),
    ],
)
def test_invalid_values_of_settings_are_refused_in_one_sentence(record, words):
    with refused(words):
        record()


def test_unknown_m_step_is_refused():
    settings = MixtureSettings()
    object.__setattr__(settings, "m_step", "none")  # past the check of types, which users do not have
    with pytest.raises(DataError, match="no m_step 'none'; choose joint or expert_only"):
        settings.__post_init__()
