"""The final policy: linear in features that are given, or chosen by held-out demonstrations."""

from __future__ import annotations

from dataclasses import dataclass

from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.linear import LinearPolicy, linear_policy
from rpil.policies.selection import FeatureChoice, choose_features
from rpil.policies.settings import SelectionSettings

SINGLE_PRECISION_ENTRIES = 1_000_000
"""Entries of a design matrix above which it is in single precision: it no longer fits in the cache."""

_SINGLE_PRECISION_TOL = 1e-6


@dataclass(frozen=True)
class LinearPolicySpec:
    """A linear policy and how far to fit it."""

    features: str
    """A kind of features, or "auto"."""
    C: float | None
    """Inverse ridge strength, as in scikit-learn's `LogisticRegression`."""
    tol: float
    """Largest entry of the gradient, a step, at which the fit stops."""
    selection: SelectionSettings
    min_feature_weight: float = 0.0
    """See `rpil.estimators.settings.Settings`."""

    def choice(self, data: Demonstrations, codes: Array, weight: Array, space: Space) -> FeatureChoice:
        """The features: those asked for, or chosen by held-out steps of `weight` (N,)."""
        if self.features != "auto":
            return FeatureChoice(self.features, self.selection.maps.ridge_per_step)
        return choose_features(FitData(data.observations, codes, data.offsets, space), weight, self.C, self.selection)

    def feature_map(self, choice: FeatureChoice, observations: Array, weight: Array) -> FeatureMap:
        """The features of the `choice`, fitted to the observations of the trusted steps."""
        trusted = weight > self.min_feature_weight * min(weight.max(), 1.0)
        rows, used = observations[trusted], weight[trusted]
        return FeatureMap.fit(choice.kind, rows, used, choice.ridge, settings=self.selection.maps)

    def fit(self, data: Demonstrations, codes: Array, weight: Array, space: Space) -> tuple[FeatureMap, LinearPolicy]:
        """The feature map, and the policy fitted to all steps by their `weight` (N,)."""
        choice = self.choice(data, codes, weight, space)
        features = self.feature_map(choice, data.observations, weight)
        ridge = ridge_of(features, self.C, weight.sum(), space)
        used = weight > 0.0
        single = bool(used.sum() * features.n_columns > SINGLE_PRECISION_ENTRIES)
        design = features.design(data.observations[used], single=single)
        steps = FitData.from_steps(design, codes[used], space)
        start = linear_policy(space, ridge, weight.sum())
        tol = max(self.tol, _SINGLE_PRECISION_TOL) if single else self.tol
        policy, _ = start.fit(steps, weight[used], tol=tol)
        return features, policy.with_temperature(choice.temperature)
