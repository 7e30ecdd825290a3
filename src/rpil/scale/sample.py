"""The sample of a large data set that the judge reads."""

from __future__ import annotations

import numpy as np

from rpil.numerics.types import Array
from rpil.scale.settings import SampleSettings


def sample_steps(n_coefficients: int, settings: SampleSettings) -> int:
    """Steps of a sample for a policy with so many coefficients."""
    return max(settings.min_steps, settings.steps_per_coefficient * n_coefficients)


def is_large(offsets: Array, n_steps: int, settings: SampleSettings) -> bool:
    """Whether the judge reads a sample of `n_steps` steps instead of everything, `offsets` (M + 1,)."""
    total, n_demonstrations = int(offsets[-1]), len(offsets) - 1
    typical = settings.n_demonstrations * total / n_demonstrations
    size = max(n_steps, min(typical, settings.max_ratio * n_steps))
    return total > max(settings.min_samples * n_steps, 2 * size)


def draw_sample(
    lengths: Array, labels: Array, n_steps: int, rng: np.random.Generator, settings: SampleSettings
) -> Array:
    """Draw the demonstrations of the sample at random, in order: (S,) indices.

    Known experts, known adversaries and demonstrations without a label (`labels` 1, -1, 0, each (M,)) are drawn apart,
    each up to `n_steps` steps; `lengths` (M,) are the steps of the demonstrations.
    """

    def first(order: Array) -> Array:
        bounds = [n_steps, settings.max_ratio * n_steps]
        enough, too_many = np.searchsorted(np.cumsum(lengths[order]), bounds) + 1
        return order[: max(enough, min(settings.n_demonstrations, max(too_many, settings.min_demonstrations)))]

    order = rng.permutation(len(lengths))
    return np.sort(np.concatenate([first(order[labels[order] == label]) for label in (1, -1, 0)]))
