"""What a saved file may hold: which classes, and arrays of which shapes."""

from __future__ import annotations

from typing import Any

from rpil.adversaries import (
    Complement,
    Confusion,
    Constant,
    Marginal,
    MarginalBox,
    OwnPolicy,
    Uniform,
    UniformBox,
)
from rpil.audit import Audit, Demonstrator, Interval
from rpil.cloning import BehavioralCloning
from rpil.em import Share, State
from rpil.estimators import RPIL
from rpil.features import FeatureMap
from rpil.judge.fitted import FittedJudge, SoftmaxScale, StudentScale
from rpil.judge.groups import Groups
from rpil.policies import SoftmaxPolicy, StudentPolicy
from rpil.polish import Polished
from rpil.rment import RMEnt
from rpil.spaces import Box, Discrete

ESTIMATORS: dict[str, Any] = {"RPIL": RPIL, "RMEnt": RMEnt, "BehavioralCloning": BehavioralCloning}

# The arrays of each class: every axis a number or a letter that means one size all through the file, perhaps plus one.
# D observations, F features, K actions or A parts of one, B bins, M demonstrations, N steps, Q quantiles.
KNOWN: dict[type, dict[str, str]] = {
    FeatureMap: {
        "knots": "knots D",
        "location": "D",
        "spread": "D",
        "center": "F",
        "scale": "F",
        "landmarks": "R E",
        "mixing": "R R",
    },
    SoftmaxPolicy: {"weights": "F+1 K", "ridge": "F+1"},
    StudentPolicy: {"weights": "F+1 A", "cholesky": "A A", "ridge": "F+1", "least": "A", "low": "A", "high": "A"},
    Discrete: {},
    Box: {"low": "A", "high": "A"},
    SoftmaxScale: {"weights": "F+1 K", "frequency": "K"},
    StudentScale: {"weights": "F+1 A"} | dict.fromkeys(("location", "spread", "scale", "center", "width"), "A"),
    Groups: {"mean": "2", "spread": "2", "quantiles": "Q"},
    FittedJudge: {},
    Polished: {"history": "iterations 2", "path": "places 2 rows columns"},
    State: {},
    Share: {},
    Interval: {},
    Demonstrator: {},
    Constant: {},
    Uniform: {},
    Marginal: {"log_frequency": "K"},
    Complement: {},
    Confusion: {"log_matrix": "K K"},
    UniformBox: {},
    MarginalBox: {"low": "A", "width": "A", "log_density": "A B"},
    OwnPolicy: {},
    Audit: {
        "offsets": "M+1",
        **dict.fromkeys(("log_odds", "from_actions", "from_demonstrator", "from_label"), "M"),
        **dict.fromkeys(("expert_proba", "reliability"), "M"),
        "reliability_interval": "M 2",
        **dict.fromkeys(("step_log_ratio", "step_weight"), "N"),
        "history": "iterations",
    },
}
BY_NAME = {known.__name__: known for known in KNOWN}
_POLICY = ("space_", "features_", "policy_")
_FIT = ("n_iter_", "converged_")
FITTED = {
    "BehavioralCloning": _POLICY,
    "RMEnt": (*_POLICY, "ids_", "weights_", "log_likelihood_", "objective_", *_FIT),
    "RPIL": (*_POLICY, "judge_features_", "judge_", "audit_", "lower_bound_", *_FIT),
}
FITTED_ARRAYS = {"weights_": "M", "log_likelihood_": "M"}
