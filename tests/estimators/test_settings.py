"""Settings of the stages reach them through `RPIL`, and refuse invalid values."""

from functools import partial

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from problems import make, make_continuous, refused
from rpil import RPIL, MixtureSettings, SampleSettings, Settings
from rpil.inference.settings import AnswerSettings, HeldOutSettings, JudgeSettings, OutlierSettings
from rpil.numerics.regression import ErrorSettings
from rpil.policies.settings import CrossFitSettings
from rpil.scale.settings import AscentSettings


def test_cross_fit_settings_reach_a_policy_of_scikit_learn():
    chosen = CrossFitSettings(n_folds=2)
    model = RPIL(policy=LogisticRegression(), settings=Settings(cross_fit=chosen)).fit(make("noisy", 0).demonstrations)
    assert model.policy_.settings == chosen


def test_the_audit_carries_the_thresholds_of_its_judge():
    judge = JudgeSettings(outliers=OutlierSettings(min_proba=0.6), answers=AnswerSettings(min_proba=0.7))
    audit = RPIL(settings=Settings(judge=judge)).fit(make("random", 3, n_good=4, n_bad=0).demonstrations).audit_
    assert [audit.settings.min_proba(anchor) for anchor in ("none", "answers", "named adversary")] == [0.6, 0.7, 0.9]


def test_error_settings_reach_the_scores_of_continuous_actions():
    data = make_continuous("noisy", 0).demonstrations
    heavy = JudgeSettings(held_out=HeldOutSettings(errors=ErrorSettings(degrees_of_freedom=1.0)))
    ours, theirs = RPIL().fit(data), RPIL(settings=Settings(judge=heavy)).fit(data)
    assert not np.allclose(ours.audit_.step_log_ratio, theirs.audit_.step_log_ratio)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (partial(MixtureSettings, prior=1.5), "prior 1.5 is no probability"),
        (partial(MixtureSettings, prior=(0.5, 2)), r"Beta prior \(0.5, 2.0\) has no single mode"),
        (partial(MixtureSettings, max_iter=-1), "max_iter=-1 must be a whole number"),
        (partial(MixtureSettings, tol=-1.0), "tol=-1.0 must be a number"),
        (partial(SampleSettings, max_ratio=0.5), "max_ratio=0.5"),
        (partial(AscentSettings, max_passes=0), "max_passes=0 must be a whole number"),
        (partial(Settings, min_feature_weight=1.0), "min_feature_weight=1.0"),
    ],
)
def test_invalid_values_of_settings_are_refused_in_one_sentence(record, words):
    with refused(words):
        record()
