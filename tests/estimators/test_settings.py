"""Settings of the stages reach them through `RPIL`, and refuse invalid values."""

from __future__ import annotations

from functools import partial

import pytest
from sklearn.linear_model import LogisticRegression

from problems import make, refused
from rpil import RPIL, MixtureSettings, SampleSettings, Settings
from rpil.estimators.reweight import ReweightOptions
from rpil.mixture.settings import DemonstratorSettings
from rpil.policies.settings import CrossFitSettings
from rpil.scale.settings import AscentSettings


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
