"""Any scikit-learn classifier or regressor as the policy, judged by demonstrations that it did not see.

A flexible policy explains whatever it was fitted to, bad demonstrations included. So its likelihoods are cross-fitted:
each demonstration is judged by a model fitted to the others, as cleanlab does with rows (Northcutt et al. 2021).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone, is_regressor
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import Pipeline
from sklearn.utils import get_tags
from sklearn.utils.validation import has_fit_parameter

from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Space
from rpil.numerics.blocks import log_softmax
from rpil.numerics.types import Array
from rpil.policies.student import StudentPolicy

N_FOLDS = 5
_NEGLIGIBLE = 1e-3
"""Weight of a step, to that of the heaviest, that a model is not troubled with."""

_TEMPERATURES = np.geomspace(0.2, 2.0, 7)
_DOUBTS = (1e-4, 1e-3, 0.01, 0.03, 0.1)
_SURE = 1e-12
_ROUNDING = 1e-3
"""By how much probabilities of a state may miss one."""


@dataclass(frozen=True, eq=False)
class ClassifierPolicy:
    """pi(k|s) is what a classifier says of observations it has not seen, as surely as it deserves.

    Attributes
    ----------
    estimator : classifier
        What is cloned and fitted.
    n_actions : int
        K.
    models : tuple of classifiers
        One for each fold of demonstrations, or the one of `finished`.
    temperature, doubt : float
        Logits are multiplied by the one, and the share of the other goes to all actions alike: chosen by the
        cross-fitted likelihood, because many classifiers are too sure.
    """

    estimator: Any
    n_actions: int
    models: tuple[Any, ...] = ()
    temperature: float = 1.0
    doubt: float = 0.01

    def outputs(self, features: Array) -> Array:
        """log pi(k|s), (N, K), of the models' mean."""
        if not self.models:
            return np.full((len(features), self.n_actions), -np.log(self.n_actions))
        return self._tempered(np.mean([self._proba(model, features) for model in self.models], axis=0))

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n) of the actions taken, (N,)."""
        return np.take_along_axis(outputs, actions[:, None], axis=1)[:, 0]

    def fit(self, data: FitData, weight: Array) -> tuple[ClassifierPolicy, Array]:
        """Models for folds of demonstrations, and what each says of the demonstrations that it did not see."""
        models, proba = [], np.empty((len(data.actions), self.n_actions))
        for held in _folds(data):
            model = _fitted(self.estimator, data.features[~held], data.actions[~held], weight[~held])
            proba[held] = self._proba(model, data.features[held])
            models.append(model)
        policy = replace(self, models=tuple(models))._calibrated(proba, data.actions, weight)
        return policy, policy._tempered(proba)

    def fit_all(self, data: FitData, weight: Array) -> ClassifierPolicy:
        """One model fitted to all steps by weight: what a user takes home."""
        return replace(self, models=(_fitted(self.estimator, data.features, data.actions, weight),))

    def _proba(self, model: Any, features: Array) -> Array:
        """Of all K actions, also of those that a model has not seen."""
        proba = np.zeros((len(features), self.n_actions))
        if len(features):
            seen = np.asarray(model.classes_, dtype=int)
            said = np.asarray(model.predict_proba(features))
            where = f"{type(self.estimator).__name__}.predict_proba"
            if said.shape != (len(features), len(seen)):
                raise DataError(f"{where} gave the shape {said.shape}; let it give {(len(features), len(seen))}.")
            if not np.isfinite(said).all():
                raise DataError(f"{where} gave NaN; scale its inputs or regularise.")
            if (said < 0).any() or np.abs(said.sum(axis=1) - 1).max() > _ROUNDING:
                raise DataError(f"{where} gave no probabilities; let every row be positive and sum to one.")
            proba[:, seen] = said
        return proba

    def _tempered(self, proba: Array) -> Array:
        logits = self.temperature * np.log(np.maximum(proba, _SURE))
        return np.logaddexp(np.log1p(-self.doubt) + log_softmax(logits), np.log(self.doubt / self.n_actions))

    def _calibrated(self, proba: Array, actions: Array, weight: Array) -> ClassifierPolicy:
        tried = [replace(self, temperature=float(t), doubt=d) for t in _TEMPERATURES for d in _DOUBTS]
        return max(tried, key=lambda policy: float(weight @ policy.log_prob(policy._tempered(proba), actions)))


@dataclass(frozen=True, eq=False)
class RegressorPolicy:
    """A regressor's mean, with Student's distribution of the errors it makes on what it has not seen around it.

    Attributes
    ----------
    estimator : regressor
    noise : StudentPolicy
        Of the errors.
    models : tuple of regressors
    """

    estimator: Any
    noise: StudentPolicy
    models: tuple[Any, ...] = ()

    def outputs(self, features: Array) -> Array:
        """The means, (N, A)."""
        n_parts = self.noise.weights.shape[1]
        if not self.models:
            return np.tile(self.noise.weights[-1], (len(features), 1))
        return np.mean([model.predict(features).reshape(-1, n_parts) for model in self.models], axis=0)

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n), a density, (N,)."""
        return self.noise.log_prob(np.zeros((1, outputs.shape[1])), actions - outputs)

    def fit(self, data: FitData, weight: Array) -> tuple[RegressorPolicy, Array]:
        """Models for folds of demonstrations, and what each says of the demonstrations that it did not see."""
        models, mean = [], np.zeros_like(data.actions)
        for held in _folds(data):
            model = _fitted(self.estimator, data.features[~held], data.actions[~held], weight[~held])
            if held.any():
                mean[held] = model.predict(data.features[held]).reshape(-1, mean.shape[1])
            models.append(model)
        if not np.isfinite(mean).all():
            raise DataError(f"{type(self.estimator).__name__}.predict gave NaN; scale its inputs or regularise.")
        errors = FitData.from_steps(np.ones((len(mean), 1)), data.actions - mean, data.space)
        noise, _ = replace(self.noise, weights=np.zeros_like(self.noise.weights)).fit(errors, weight, tol=1e-6)
        return replace(self, models=tuple(models), noise=noise), mean + noise.weights

    def fit_all(self, data: FitData, weight: Array) -> RegressorPolicy:
        """One model fitted to all steps by weight."""
        return replace(self, models=(_fitted(self.estimator, data.features, data.actions, weight),))


def cross_fitted_policy(estimator: Any, space: Space, n_steps: int) -> Any:
    """The policy that `estimator` makes before it has seen data; `TorchPolicy` is one, and only told of the actions.

    Raises
    ------
    DataError
        Where it is no estimator, gives no probabilities, takes no weights, or is made for other actions.
    """
    if hasattr(estimator, "for_space"):
        return estimator.for_space(space)
    name = type(estimator).__name__
    if isinstance(estimator, type) or not (hasattr(estimator, "fit") and hasattr(estimator, "get_params")):
        what = f"the class {estimator.__name__}" if isinstance(estimator, type) else f"a {name}"
        raise DataError(
            f"The policy is {what}, no scikit-learn estimator; give one such as HistGradientBoostingClassifier(), "
            "rpil.TorchPolicy() for a network, or rpil.reweight around a training loop of your own."
        )
    if is_regressor(estimator) != (space.kind == "continuous"):
        kinds = ("a regressor", "discrete") if space.kind == "discrete" else ("no regressor", "continuous")
        raise DataError(f"The policy {name} is {kinds[0]} and the actions are {kinds[1]}; give one made for these.")
    _weight_key(estimator)
    if isinstance(space, Box):
        if len(space.low) > 1 and not get_tags(estimator).target_tags.multi_output:
            estimator = MultiOutputRegressor(estimator)
        return RegressorPolicy(estimator, StudentPolicy.of_errors(space, n_steps))
    if not hasattr(estimator, "predict_proba"):
        raise DataError(
            f"The policy {name} has no predict_proba; give one that has, or wrap it in scikit-learn's "
            "CalibratedClassifierCV."
        )
    return ClassifierPolicy(estimator, getattr(space, "n", 0))


def _folds(data: FitData) -> list[Array]:
    """Steps (N,) bool to hold out together: whole demonstrations, about as many steps in each fold."""
    order = np.argsort(-data.lengths, kind="stable")
    n_folds = min(N_FOLDS, data.n_demonstrations)
    fold = np.empty(data.n_demonstrations, dtype=int)
    load = np.zeros(n_folds)
    for m in order:  # the longest first, each to the smallest fold so far
        fold[m] = int(np.argmin(load))
        load[fold[m]] += data.lengths[m]
    of_step = data.per_step(fold)
    return [of_step == k for k in range(n_folds)] if n_folds > 1 else [np.zeros(len(of_step), dtype=bool)]


def _fitted(estimator: Any, features: Array, actions: Array, weight: Array) -> Any:
    used = weight > _NEGLIGIBLE * weight.max() if len(weight) and weight.max() > 0 else np.ones(len(weight), bool)
    weight = weight[used] if weight.max() > 0 else np.ones(int(used.sum()))
    target = actions[used]
    if target.ndim == 1 and (target == target[0]).all():
        return _Always(int(target[0]))
    target = target[:, 0] if target.ndim == 2 and target.shape[1] == 1 else target
    try:
        return clone(estimator).fit(features[used], target, **{_weight_key(estimator): weight})
    except (TypeError, ValueError) as error:
        said = " ".join(str(error).split()).rstrip(".")
        raise DataError(
            f"The policy {type(estimator).__name__} cannot be fitted: {said}; correct its settings."
        ) from error


@dataclass(frozen=True)
class _Always:
    """A classifier that has seen one action only."""

    action: int

    @property
    def classes_(self) -> Array:
        return np.array([self.action])

    def predict_proba(self, features: Array) -> Array:
        return np.ones((len(features), 1))


def _weight_key(estimator: Any) -> str:
    """The name under which `estimator.fit` takes the weights of steps, through pipelines and searches."""
    if isinstance(estimator, Pipeline):
        name, last = estimator.steps[-1]
        return f"{name}__{_weight_key(last)}"
    if has_fit_parameter(estimator, "sample_weight"):
        return "sample_weight"
    if hasattr(estimator, "estimator"):
        return _weight_key(estimator.estimator)
    raise DataError(
        f"The policy {type(estimator).__name__} takes no sample_weight, so that trust cannot reach it; give one that "
        "does, such as HistGradientBoostingClassifier."
    )
