"""Settings of fits to data larger than the sample that the judge reads."""

from __future__ import annotations

from rpil.data.demonstrations import BLOCK_STEPS
from rpil.data.settings_record import settings_record


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
    max_kept_entries: int = 2**25
    """Entries of the design matrix up to which data on disk are kept in memory, in single precision, as they are read
    by the first pass: every other pass would read and prepare them again."""
    block_steps: int = BLOCK_STEPS
    """Steps of a block, about, in the passes over all data."""


@settings_record(tol="[0, inf)", rounding="[0, inf)")
class AscentSettings:
    """The fit of the final policy by passes (`rpil.scale.ascent`). All values were chosen by hand, not tuned."""

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
