"""Estimators that cannot be policies are refused in one sentence, wherever in a pipeline or a search they are."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.ensemble import AdaBoostClassifier
from sklearn.linear_model import LogisticRegression, RidgeClassifier
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import KNeighborsClassifier, KNeighborsRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from problems import refused
from rpil import RPIL, Demonstrations


class Answers(LogisticRegression):
    """Says of every state what `answer` makes of what it should have said."""

    def __init__(self, answer=None):
        super().__init__()
        self.answer = answer

    def predict_proba(self, X):
        return self.answer(super().predict_proba(X))


def demonstrations(continuous: bool = False) -> Demonstrations:
    rng = np.random.default_rng(0)
    observations = [rng.normal(size=(20, 2)) for _ in range(6)]
    actions = [0.5 * o[:, :1] if continuous else (o[:, 0] > 0).astype(int) for o in observations]
    return Demonstrations.from_episodes(list(zip(observations, actions, strict=True)), source="lab.npz")


NEIGHBOURS, RIDGE = KNeighborsClassifier(), RidgeClassifier()
NO_WEIGHT = "The policy KNeighborsClassifier takes no sample_weight, so that trust cannot reach it; give one that does"


@pytest.mark.parametrize(
    ("policy", "match"),
    [
        (NEIGHBOURS, NO_WEIGHT),
        (KNeighborsRegressor(), "KNeighborsRegressor takes no sample_weight"),
        (make_pipeline(StandardScaler(), StandardScaler(), NEIGHBOURS), NO_WEIGHT),
        (GridSearchCV(make_pipeline(StandardScaler(), NEIGHBOURS), {}), NO_WEIGHT),
        (RIDGE, "The policy RidgeClassifier has no predict_proba; give one that has"),
        (make_pipeline(StandardScaler(), RIDGE), "The policy Pipeline has no predict_proba; give one that has"),
        (LogisticRegression, "The policy is the class LogisticRegression, no scikit-learn estimator; give one"),
        ("forest", "The policy is a str, no scikit-learn estimator; give one such as HistGradient"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_policy_is_refused_before_any_work(policy, match, monkeypatch):
    monkeypatch.setattr("rpil.estimators.pipeline.judge", lambda *_: pytest.fail("too late"))
    with refused(match):
        RPIL(policy=policy).fit(demonstrations(isinstance(policy, KNeighborsRegressor)))


@pytest.mark.parametrize(
    ("policy", "match"),
    [
        (Answers(lambda p: p * np.nan), "Answers.predict_proba gave no probabilities; scale its inputs"),
        (Answers(lambda p: 5 * p), "Answers.predict_proba gave no probabilities; .* let every row sum to one"),
        (Answers(lambda p: p[:, :1]), r"Answers.predict_proba gave the shape \(\d+, 1\); let it give \(\d+, 2\)"),
        (AdaBoostClassifier(NEIGHBOURS), "AdaBoostClassifier cannot be fitted .*KNeighborsClassifier doesn't support "),
    ],
)  # fmt: skip
def test_what_goes_wrong_in_an_estimator_is_told(policy, match):
    with refused(match):
        RPIL(policy=policy).fit(demonstrations())
