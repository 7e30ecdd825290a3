"""Settings of the rules for recording faults."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FaultSettings:
    """Thresholds of the rules. `benchmarks/faults.py` chose those that name it, on some of its data sets, and checks
    them on the others; the rest were chosen by hand.

    A rule that compares demonstrations takes what is usual from themselves: a value is a fault where it is beyond
    ``factor`` times the upper quartile over the demonstrations, or further where the quartiles lie far apart (`fence`).

    Attributes
    ----------
    min_demonstrations : int
        Demonstrations from which it is known what is usual; with fewer, rules that compare are not applied.
    pilot_demonstrations, pilot_steps : int
        Demonstrations, spread evenly over the data, and steps, that tell how each column moves, at most.
    min_distinct : int
        Distinct values in the pilot from which a column counts as a measurement; codes, counts and one-hot columns
        have fewer.
    max_columns : int
        Observation columns beyond which observations are images, whose columns no rule compares.
    least_driven : float
        Range of a column, relative to the columns whose names differ by numbers only, below which nothing drives it.
    fence : float
        Distances of the upper quartile from the lower one, in logarithms, that a value may lie above the upper
        quartile. benchmarks/faults.py.
    max_spread : float
        Times that a value may be above the upper quartile by `fence`; where it were more, clean demonstrations differ
        so much that nothing can be known. benchmarks/faults.py.
    spike_factor, jump_factor : float
        Times the usual largest spike, and jump, of a demonstration. benchmarks/faults.py.
    smallest : float
        Share of the smallest spike and jump by which demonstrations do not differ. benchmarks/faults.py.
    change_factor : float
        Times the usual largest change of a demonstration that a spike or jump has at least. benchmarks/faults.py.
    smallest_leap : float
        Standard deviations of the column that a spike or jump has at least. benchmarks/faults.py.
    frozen_factor : float
        Times the usual longest run of one value. benchmarks/faults.py.
    smallest_run : float
        Steps by which such runs do not differ.
    min_frozen : int
        Steps. Shorter runs of one value are no fault.
    least_moving : float
        Share of the steps in motion in which a column changes, from which its leaps are looked at.
    min_moving : float
        Share of the steps in motion in which a column changes, from which it may be frozen: a gripper, a switch or a
        controller that is on or off rests for long.
    frame_gap : float
        Share of the time between two frames by which a time may be off before a frame counts as dropped or repeated.
    repeat_motion : float
        Motion, relative to the usual one, before and after a repeated row, from which the row is a repeated frame:
        what moves does not stand still for one step.
    repeat_factor, smallest_repeat : float
        Times the usual number of repeated rows of a demonstration, and rows by which it does not differ.
    idle_motion : float
        Motion, relative to the usual one, below which a step is idle.
    min_idle : int
        Steps. Shorter idle heads and tails are no fault.
    idle_factor : float
        Times the usual idle head, or tail.
    farthest_lag, max_lag, far_lag : int, int, float
        Steps. Lags between action and state at which the usual one is sought, in both directions; and from where on,
        and for which share, correlations count for less: motion that repeats has many.
    min_correlation : float
        Correlation of an action with the state, in the pilot, from which their lag is known.
    map_columns, map_rows, map_folds, map_ridge : int, int, int, float
        States, and actions, of the map between them; windows of a demonstration that are looked at; parts of the
        demonstrations, each judged by maps of the others; and the penalty of least squares, of variance 1.
    map_trim, map_unknown : float, float
        Share of the demonstrations that shape the maps, and of the variance that a map leaves over where it tells
        nothing.
    lag_sample, map_sample, map_tail : int, int, float
        Demonstrations that choose the lag of the map, and in which faults are planted, and quartile distances from the
        medians by which gains with and without must differ.
    map_tested : int
        Demonstrations, about, those with the most misfit, in which faults are tried at most.
    least_gain : float
        Logarithm of likelihood for each step that undoing a fault gains at least. benchmarks/faults.py.
    offset_factor, least_offset, largest_offset : float
        Times the usual offset, offset that is no fault, and limit from which on nothing is known, in standard
        deviations. benchmarks/faults.py.
    length_factor : float
        Times the usual length, or its inverse. benchmarks/faults.py.
    scale_factor : float
        Times the usual level and the usual change of a column, or their inverse. benchmarks/faults.py.
    near_share : float
        Share of independent demonstrations that are taken for near duplicates.
    near_duplicate : tuple of float
        Distance of two demonstrations below which, whatever that share, they are near duplicates, and above which they
        are not; relative to the median distance from the nearest other one.
    least_range : float
        Range of a column, relative to the lower quartile, below which it never moves.
    steady_range : float
        Range of a column, relative to the median, that demonstrations have at least in which it moves at all.
    common_limit : float
        Share of the demonstrations that reach the lowest or highest value of a column, from which that is a limit of
        the robot, where it may rest.
    settling : float
        Times by which motion decays from the first to the second third of a tail of a controller that settles.
    min_duplicate : int
        Steps from which equal demonstrations of codes alone are duplicates: shorter ones are equal by chance.
    """

    min_demonstrations: int = 4
    pilot_demonstrations: int = 200
    pilot_steps: int = 50_000
    min_distinct: int = 20
    max_columns: int = 1_000
    least_driven: float = 0.05
    fence: float = 2.0
    max_spread: float = 5.0
    spike_factor: float = 2.0
    jump_factor: float = 2.0
    smallest: float = 0.5
    change_factor: float = 1.25
    smallest_leap: float = 0.1
    frozen_factor: float = 2.5
    smallest_run: float = 2.0
    min_frozen: int = 10
    least_moving: float = 0.1
    min_moving: float = 0.5
    frame_gap: float = 0.5
    repeat_motion: float = 0.5
    repeat_factor: float = 3.0
    smallest_repeat: float = 0.3
    idle_motion: float = 0.05
    min_idle: int = 10
    idle_factor: float = 3.0
    farthest_lag: int = 64
    max_lag: int = 20
    far_lag: float = 0.8
    min_correlation: float = 0.3
    map_columns: int = 16
    map_rows: int = 256
    map_folds: int = 5
    map_ridge: float = 1e-4
    map_trim: float = 0.7
    map_unknown: float = 0.8
    lag_sample: int = 6
    map_sample: int = 40
    map_tail: float = 1.5
    map_tested: int = 500
    least_gain: float = 0.75
    offset_factor: float = 2.5
    least_offset: float = 0.25
    largest_offset: float = 0.4
    length_factor: float = 2.0
    scale_factor: float = 8.0
    near_share: float = 0.005
    near_duplicate: tuple[float, float] = (0.02, 0.2)
    least_range: float = 0.005
    steady_range: float = 0.5
    common_limit: float = 0.25
    settling: float = 3.0
    min_duplicate: int = 50
