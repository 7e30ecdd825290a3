"""Settings of the choice of features, and of the cross-fit of an estimator that is given as the policy."""

from __future__ import annotations

import numpy as np

from rpil.data.archive import check_settings, settings_record
from rpil.numerics.regression import ErrorSettings
from rpil.policies.features import FeatureSettings


@settings_record(n_folds="[2, inf)", min_trust="[0, 1)", n_reweightings="[0, inf)")
class SelectionSettings:
    """How features are chosen. Unless stated otherwise, values were chosen by hand, not tuned."""

    ridges: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5)
    """Ridges a step to choose from, the strongest first: each fit starts from the one before."""
    n_folds: int = 5
    """Folds of demonstrations; one demonstration alone is cut into as many parts."""
    max_steps: int = 6_000
    """Steps of the demonstrations by which features are chosen, about, at most."""
    max_columns: int = 450
    """Columns of a feature map, at most; kinds with more are no candidates."""
    min_trust: float = 0.1
    """Mean weight of a demonstration's steps, relative to the largest one, from which it is used."""
    temperatures: tuple[float, float] = (0.03, 5.0)
    """Bounds of the temperature."""
    n_reweightings: int = 4
    """Least-squares fits after each of which steps with large errors get less weight: a bad step that is trusted by
    mistake must not choose."""
    errors: ErrorSettings = ErrorSettings()
    """Distribution of the errors by which they do."""
    maps: FeatureSettings = FeatureSettings()
    """How every feature map is fitted, that of the judge included."""

    def __post_init__(self) -> None:
        check_settings(self.errors, min_scale="[0, inf)")


@settings_record(n_folds="[2, inf)", min_weight="[0, 1)", lapses="(0, 1)")
class CrossFitSettings:
    """How an estimator is cross-fitted. All were chosen by hand, not tuned."""

    n_folds: int = 5
    """Folds of demonstrations, at most."""
    min_weight: float = 1e-3
    """Weight of a step, relative to the largest one, from which a model is fitted to it."""
    temperatures: tuple[float, ...] = tuple(np.geomspace(0.2, 2.0, 7).tolist())
    """Temperatures to choose from; a classifier's logits are multiplied by one."""
    lapses: tuple[float, ...] = (1e-4, 1e-3, 0.01, 0.03, 0.1)
    """Probabilities to choose from that the action is any, uniformly."""
