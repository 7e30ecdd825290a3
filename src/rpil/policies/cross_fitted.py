"""Any scikit-learn classifier or regressor as the policy, evaluated on demonstrations that it was not fitted to.

A flexible policy explains all that it was fitted to, bad demonstrations included. So its likelihoods are cross-fitted:
those of each demonstration come from a model fitted to the others, as in cleanlab for rows (Northcutt et al. 2021).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpil.data.errors import DataError, in_words
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete, Space
from rpil.numerics.blocks import at_actions, log_softmax
from rpil.numerics.types import Array, Float, Int, Num
from rpil.policies.folds import deal, out_of_fold, pieces
from rpil.policies.settings import CrossFitSettings
from rpil.policies.student import StudentPolicy

Estimator = Any
"""A scikit-learn classifier or regressor, or an object with its methods."""

MIN_PROBABILITY = 1e-12
"""Lower bound of a classifier's probabilities before their logarithm."""

PROBABILITY_TOLERANCE = 1e-3
"""Largest deviation from one of the sum of the probabilities in a state."""


@dataclass(frozen=True)
class IdentityMap:
    """Observations as they are, for policies that compute features of their own."""

    kind: str = "the policy's own"

    def design(self, observations: Num[Array, "N D"], single: bool = False) -> Float[Array, "N D"]:
        """The observations in double precision."""
        return np.asarray(observations, dtype=float)


@dataclass(frozen=True, eq=False)
class ClassifierPolicy:
    """pi(k|s) = (1 - lapse) softmax_k(temperature log p(s)) + lapse / K, for the probabilities p of a classifier.

    Temperature and lapse are chosen by the held-out likelihood, because many classifiers are too sure.
    """

    estimator: Estimator
    """Cloned and fitted."""
    n_actions: int
    """K."""
    settings: CrossFitSettings
    lapse: float
    temperature: float = 1.0
    """Both are chosen by `fit`."""
    models: tuple[Estimator, ...] = ()
    """One for each fold of demonstrations, or one for all."""

    def outputs(self, features: Num[Array, "N D"]) -> Float[Array, "N K"]:
        """log pi(k|s), where p is the mean over the models."""
        return self._log_proba(np.mean([self._predict(model, features) for model in self.models], axis=0))

    def log_prob(self, outputs: Float[Array, "N K"], actions: Int[Array, " N"]) -> Float[Array, " N"]:
        return at_actions(outputs, actions)

    def fit(self, data: FitData, weight: Float[Array, " N"]) -> tuple[ClassifierPolicy, Float[Array, "N K"]]:
        """Models for folds of demonstrations, and held-out log-probabilities."""
        settings = self.settings
        models, proba = _cross_fit(self, data, weight)
        tried = [replace(self, temperature=t, lapse=p) for t in settings.temperatures for p in settings.lapses]
        best = max(tried, key=lambda policy: float(weight @ at_actions(policy._log_proba(proba), data.actions)))
        return replace(best, models=models), best._log_proba(proba)

    def _predict(self, model: Estimator, features: Array) -> Array:
        """Probabilities of all K actions, 0 for those that a model was not fitted to."""
        proba = np.zeros((len(features), self.n_actions))
        if not len(features):
            return proba
        classes = np.asarray(model.classes_, dtype=int)
        predicted = np.asarray(model.predict_proba(features))
        where, expected = f"{type(self.estimator).__name__}.predict_proba", (len(features), len(classes))
        if predicted.shape != expected:
            raise DataError(f"{where} gave the shape {predicted.shape}; let it give {expected}.")
        if not (np.all(predicted >= 0) and np.abs(predicted.sum(axis=1) - 1).max() <= PROBABILITY_TOLERANCE):  # or NaN
            raise DataError(f"{where} gave no probabilities; scale its inputs, or let every row sum to one.")
        proba[:, classes] = predicted
        return proba

    def _log_proba(self, proba: Array) -> Array:
        logits = self.temperature * np.log(np.maximum(proba, MIN_PROBABILITY))
        uniform = np.log(self.lapse / self.n_actions)
        return np.asarray(np.logaddexp(np.log1p(-self.lapse) + log_softmax(logits), uniform))


@dataclass(frozen=True, eq=False)
class RegressorPolicy:
    """A regressor's mean, with Student's distribution of its held-out errors around it."""

    estimator: Estimator
    """Cloned and fitted."""
    noise: StudentPolicy
    """The distribution of the errors."""
    settings: CrossFitSettings
    models: tuple[Estimator, ...] = ()
    """One for each fold of demonstrations, or one for all."""

    def outputs(self, features: Num[Array, "N D"]) -> Float[Array, "N A"]:
        """The mean over the models."""
        return np.asarray(np.mean([self._predict(model, features) for model in self.models], axis=0))

    def log_prob(self, outputs: Float[Array, "N A"], actions: Float[Array, "N A"]) -> Float[Array, " N"]:
        """log pi(a_n|s_n), a density."""
        return self.noise.log_prob(np.zeros_like(outputs), actions - outputs)

    def fit(self, data: FitData, weight: Float[Array, " N"]) -> tuple[RegressorPolicy, Float[Array, "N A"]]:
        """Models for folds of demonstrations, and held-out means."""
        models, mean = _cross_fit(self, data, weight)
        if not np.isfinite(mean).all():
            raise DataError(f"{type(self.estimator).__name__}.predict gave NaN; scale its inputs or regularise.")
        errors = FitData.from_steps(np.ones((len(mean), 1)), data.actions - mean, data.space)
        noise, _ = replace(self.noise, weights=np.zeros_like(self.noise.weights)).fit(errors, weight, tol=1e-6)
        return replace(self, models=models, noise=noise), mean + noise.weights

    def _predict(self, model: Estimator, features: Array) -> Array:
        return np.asarray(model.predict(features).reshape(-1, self.noise.weights.shape[1]))


CrossFittedPolicy = ClassifierPolicy | RegressorPolicy
"""A policy whose `fit` returns held-out outputs: those of a model that was fitted without the demonstration."""


def cross_fitted_policy(
    estimator: Estimator, space: Space, n_steps: int, settings: CrossFitSettings
) -> CrossFittedPolicy:
    """The policy of a scikit-learn `estimator` for these actions, before it is fitted.

    A `DataError` where it is no estimator, gives no probabilities, takes no weights, or is made for other actions.
    """
    name = type(estimator).__name__
    if isinstance(estimator, type) or not (hasattr(estimator, "fit") and hasattr(estimator, "get_params")):
        what = f"the class {estimator.__name__}" if isinstance(estimator, type) else f"a {name}"
        raise DataError(
            f"The policy is {what}, no scikit-learn estimator; give one such as HistGradientBoostingClassifier(), "
            "or rpil.reweight around a training loop of your own."
        )
    from sklearn.base import is_regressor
    from sklearn.multioutput import MultiOutputRegressor
    from sklearn.utils import get_tags

    if is_regressor(estimator) != (space.kind == "continuous"):
        kinds = ("a regressor", "discrete") if space.kind == "discrete" else ("no regressor", "continuous")
        raise DataError(f"The policy {name} is {kinds[0]} and the actions are {kinds[1]}; give one made for these.")
    _weight_parameter(estimator)
    if not isinstance(space, Discrete):
        if len(space.low) > 1 and not get_tags(estimator).target_tags.multi_output:
            estimator = MultiOutputRegressor(estimator)
        return RegressorPolicy(estimator, StudentPolicy.of_errors(space, n_steps), settings=settings)
    if not hasattr(estimator, "predict_proba"):
        raise DataError(
            f"The policy {name} has no predict_proba; give one that has, or wrap it in scikit-learn's "
            "CalibratedClassifierCV."
        )
    return ClassifierPolicy(estimator, space.n, settings, settings.lapses[0])


def _cross_fit(policy: CrossFittedPolicy, data: FitData, weight: Array) -> tuple[tuple[Estimator, ...], Array]:
    """A model for each fold of demonstrations, fitted to the other folds, and its predictions for the fold, (N, O)."""
    models, n_folds = [], policy.settings.n_folds
    units = data if data.n_demonstrations > 1 else pieces(data, n_folds)

    def predict(_: int, test: Array) -> Array:
        train = ~test if not test.all() else test  # an only step
        models.append(fit_model(policy, data.features[train], data.actions[train], weight[train]))
        return policy._predict(models[-1], data.features[test])

    fold = deal(units, min(n_folds, units.n_demonstrations), seed=0)
    predictions = out_of_fold(units.per_step(fold), predict)
    return tuple(models), predictions


def fit_model(policy: CrossFittedPolicy, features: Array, actions: Array, weight: Array) -> Estimator:
    """The estimator of a policy, fitted to all steps but those of the least weight."""
    from sklearn.base import clone
    from sklearn.dummy import DummyClassifier

    estimator, largest = policy.estimator, weight.max(initial=0.0)
    used = weight > policy.settings.min_weight * largest if largest > 0 else np.ones(len(weight), bool)
    weight, target = weight[used] if largest > 0 else np.ones(len(weight)), actions[used]
    if target.ndim == 1 and (target == target[0]).all():
        return DummyClassifier().fit(features[used], target)  # many classifiers refuse a single class
    target = target[:, 0] if target.ndim == 2 and target.shape[1] == 1 else target
    try:
        return clone(estimator).fit(features[used], target, **{_weight_parameter(estimator): weight})
    except (TypeError, ValueError) as error:
        name, reason = type(estimator).__name__, in_words(error)
        raise DataError(f"The policy {name} cannot be fitted ({reason}); correct its settings.") from error


def _weight_parameter(estimator: Estimator) -> str:
    """The parameter of `estimator.fit` that takes the weights of steps, through pipelines and searches."""
    from sklearn.pipeline import Pipeline
    from sklearn.utils.validation import has_fit_parameter

    if isinstance(estimator, Pipeline):
        name, last = estimator.steps[-1]
        return f"{name}__{_weight_parameter(last)}"
    if has_fit_parameter(estimator, "sample_weight"):
        return "sample_weight"
    if hasattr(estimator, "estimator"):
        return _weight_parameter(estimator.estimator)
    raise DataError(
        f"The policy {type(estimator).__name__} takes no sample_weight, so that trust cannot reach it; give one that "
        "does, such as HistGradientBoostingClassifier."
    )
