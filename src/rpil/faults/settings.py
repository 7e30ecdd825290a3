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
    fence : float
        Distances of the upper quartile from the lower one, in logarithms, that a value may lie above the upper
        quartile. benchmarks/faults.py.
    max_spread : float
        Times that a value may be above the upper quartile by `fence`; where it were more, clean demonstrations differ
        so much that nothing can be known. benchmarks/faults.py.
    spike_factor, jump_factor : float
        Times the usual largest spike, and jump, of a demonstration. benchmarks/faults.py.
    smallest : float
        Added to both quartiles before their ratio is taken, so that it is finite; a share of the smallest spike or
        jump. benchmarks/faults.py.
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
        Share of the steps in motion in which a column changes, from which its leaps are looked at: what is
        touched leaps out of rest. benchmarks/faults.py.
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
    max_lag : int
        Steps. Lags between action and state that are looked at, in both directions.
    max_partners : int
        States, those most correlated with an action, of which one is chosen for it.
    max_shift, min_shift : int
        Steps by which a lag may differ from the usual one at most, and from which on that is a fault.
        benchmarks/faults.py.
    memories : tuple of int
        Steps that an action remembers, which are taken out before it is correlated with the state; the first with
        which there is a correlation. benchmarks/faults.py.
    min_correlation : float
        Correlation of an action with the state, in the pilot, from which their lag is looked at. benchmarks/faults.py.
    min_agreement : float
        Share of the demonstrations that must have the usual lag.
    shift_factor, smallest_gain : float
        Times the usual gain in agreement by a shift, and gain by which demonstrations do not differ; gains are relative
        to the usual agreement of the cross-correlations. benchmarks/faults.py.
    map_columns, map_rows, map_folds, map_ridge : int, int, int, float
        States, and actions, of the map between them; windows of a demonstration that are looked at; parts of the
        demonstrations, each judged by maps of the others; and the penalty of least squares, of variance 1.
    map_trim, map_unknown : float, float
        Share of the demonstrations that shape the maps, and of the variance that a map leaves over where it tells
        nothing.
    map_sample, map_tail, map_rest : int, float, float
        Demonstrations in which faults are tried to learn the gains where there is none, and distances of the upper
        quartile from the median beyond which a gain, and what is left over, are unusual. benchmarks/faults.py.
    map_tested : int
        Demonstrations, about, those with the most misfit, in which faults are tried at most.
    map_usual, map_power : float, float
        Share of the sample, that with the least misfit, and share of that in which a fault would be named, from which
        on its rule is one that knows. benchmarks/faults.py.
    map_reach : float
        Times the variance of a column in the others, up to which the maps are known. benchmarks/faults.py.
    least_gain, offset_gain : float
        Logarithm of likelihood that undoing a fault, and an offset, gains at least: the second is that of seven
        standard deviations between demonstrations. benchmarks/faults.py.
    least_offset : float
        Standard deviations of a column from which on an offset shall be named.
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
        Range of a column, relative to the median, or its inverse, within which demonstrations lie in which it moves.
    common_limit : float
        Share of the demonstrations that reach the lowest or highest value of a column, from which that is a limit of
        the robot, where it may rest.
    settling : float
        Times by which motion decays from the first to the last third of a tail of a controller that settles.
    min_duplicate : int
        Steps from which equal demonstrations of codes alone are duplicates: shorter ones are equal by chance.
    """

    min_demonstrations: int = 4
    pilot_demonstrations: int = 200
    pilot_steps: int = 50_000
    min_distinct: int = 20
    max_columns: int = 1_000
    fence: float = 3.0
    max_spread: float = 8.0
    spike_factor: float = 1.75
    jump_factor: float = 1.75
    smallest: float = 0.5
    change_factor: float = 1.5
    smallest_leap: float = 0.1
    frozen_factor: float = 2.5
    smallest_run: float = 2.0
    min_frozen: int = 12
    least_moving: float = 0.25
    min_moving: float = 0.5
    frame_gap: float = 0.5
    repeat_motion: float = 0.5
    repeat_factor: float = 3.0
    smallest_repeat: float = 0.3
    idle_motion: float = 0.05
    min_idle: int = 10
    idle_factor: float = 3.0
    max_lag: int = 20
    max_partners: int = 4
    max_shift: int = 10
    min_shift: int = 2
    memories: tuple[int, ...] = (3, 1)
    min_correlation: float = 0.3
    min_agreement: float = 0.75
    shift_factor: float = 3.0
    smallest_gain: float = 0.03
    map_columns: int = 16
    map_rows: int = 128
    map_folds: int = 5
    map_ridge: float = 1e-4
    map_trim: float = 0.7
    map_unknown: float = 0.8
    map_sample: int = 40
    map_tail: float = 2.5
    map_rest: float = 3.0
    map_usual: float = 0.85
    map_power: float = 0.85
    map_reach: float = 16.0
    offset_gain: float = 25.0
    least_offset: float = 0.5
    map_tested: int = 200
    least_gain: float = 1.0
    length_factor: float = 2.0
    scale_factor: float = 12.0
    near_share: float = 0.005
    near_duplicate: tuple[float, float] = (0.02, 0.2)
    least_range: float = 0.005
    steady_range: float = 0.25
    common_limit: float = 0.25
    settling: float = 1.25
    min_duplicate: int = 50
