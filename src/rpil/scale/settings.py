"""Settings of fits to data larger than the sample that the judge reads, and the draw of the sample."""

from __future__ import annotations

import numpy as np

from rpil.data.archive import settings_record
from rpil.data.demonstrations import BLOCK_STEPS
from rpil.numerics.types import Array


@settings_record(max_ratio="[1, inf)")
class SampleSettings:
    """The sample that the judge reads. All values were chosen by hand, not tuned."""

    min_steps: int = 20_000
    """Steps of a sample, at least."""
    steps_per_coefficient: int = 50
    """Steps of a sample for each coefficient of the policy, at least."""
    n_demonstrations: int = 100
    """Demonstrations of a sample, unless they are longer than `max_ratio` allows."""
    max_ratio: float = 10.0
    """Steps of the sample at most, relative to the two lower bounds above."""
    min_demonstrations: int = 20
    """Demonstrations of a sample, at least, however long."""
    min_samples: float = 10.0
    """Steps of all data, in samples, from which the judge reads one sample instead of everything."""
    block_steps: int = BLOCK_STEPS
    """Steps of a block, about, in the passes over all data."""

    def steps(self, n_coefficients: int) -> int:
        """Steps of a sample for a policy with so many coefficients."""
        return max(self.min_steps, self.steps_per_coefficient * n_coefficients)

    def is_smaller_than(self, offsets: Array, n_steps: int) -> bool:
        """Whether the judge reads a sample of `n_steps` steps instead of everything, `offsets` (M + 1,)."""
        total, typical = int(offsets[-1]), self.n_demonstrations * int(offsets[-1]) / (len(offsets) - 1)
        size = max(n_steps, min(typical, self.max_ratio * n_steps))
        return total > max(self.min_samples * n_steps, 2 * size)

    def draw(self, lengths: Array, labels: Array, n_steps: int, rng: np.random.Generator) -> Array:
        """Draw the demonstrations of the sample at random, in order: (S,) indices.

        Known experts, known adversaries and demonstrations without a label (`labels` 1, -1, 0, each (M,)) are drawn
        apart, each up to `n_steps` steps; `lengths` (M,) are the steps of the demonstrations.
        """

        def first(order: Array) -> Array:
            enough, too_many = np.searchsorted(np.cumsum(lengths[order]), [n_steps, self.max_ratio * n_steps]) + 1
            return order[: max(enough, min(self.n_demonstrations, max(too_many, self.min_demonstrations)))]

        order = rng.permutation(len(lengths))
        return np.sort(np.concatenate([first(order[labels[order] == label]) for label in (1, -1, 0)]))


@settings_record(tol="[0, inf)", rounding="[0, inf)")
class AscentSettings:
    """The fit of the final policy by passes (`rpil.scale.fit.ascend`). All values were chosen by hand, not tuned."""

    tol: float = 1e-6
    """Largest entry of the gradient, a step, at which the policy is fitted: its actions no longer change."""
    max_passes: int = 200
    """Passes at most."""
    radius: float = 2.0
    """Largest change of a coefficient in the step after one that lowered the objective, until steps of that size
    succeed: the Hessian of a sample has no curvature where the sample has no steps."""
    min_radius: float = 1e-4
    """Radius at which the ascent stops."""
    patience: int = 10
    """Passes in which the gradient must halve or the objective grow."""
    rounding: float = 1e-8
    """Relative change of the objective that is taken for rounding: single precision changes it by some 3e-9."""
