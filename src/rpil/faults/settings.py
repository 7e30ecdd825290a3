"""Settings of the rules for recording faults.

`benchmarks/faults.py` chose those that name it, on some of its data sets, and checks them on the others; the rest were
chosen by hand.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FaultSettings:
    """Thresholds of the rules.

    A rule that compares demonstrations takes what is usual from themselves: a value is a fault where it is beyond
    ``factor`` times the upper quartile over the demonstrations, or further where the quartiles lie far apart (`fence`).
    """

    min_demonstrations: int = 4
    """Demonstrations from which it is known what is usual; with fewer, rules that compare are not applied."""
    pilot_demonstrations: int = 200
    pilot_steps: int = 50_000
    """Demonstrations, spread evenly over the data, and steps, that tell how each column moves, at most."""
    min_distinct: int = 20
    """Distinct values in the pilot from which a column is a measurement; codes and one-hot columns have fewer."""
    max_columns: int = 1_000
    """Observation columns beyond which observations are images, whose columns no rule compares."""
    fence: float = 3.0
    """Distances of the upper quartile from the lower one, in logarithms, that a value may lie above the upper quartile.
    benchmarks/faults.py."""
    tail: float = 2.5
    """Distances of a quartile from the median beyond it, or standard deviations of a correlation, within which clean
    demonstrations lie. benchmarks/faults.py."""
    max_spread: float = 8.0
    """Times that a value may be above the upper quartile by `fence`; where it were more, clean demonstrations differ so
    much that nothing can be known. benchmarks/faults.py."""
    usual_factor: float = 3.0
    """Times the usual number of idle steps, and the usual gain in agreement by a shift."""
    leap_factor: float = 1.75
    """Times the usual largest spike, or jump, of a demonstration. benchmarks/faults.py."""
    smallest: float = 0.5
    """Added to both quartiles before their ratio is taken, so that it is finite; a share of the smallest spike or jump.
    benchmarks/faults.py."""
    change_factor: float = 1.5
    """Times the usual largest change of a demonstration that a spike or jump has at least. benchmarks/faults.py."""
    smallest_leap: float = 0.1
    """Standard deviations of the column that a spike or jump has at least. benchmarks/faults.py."""
    least_of_all: float = 0.15
    """Logarithm added to the fence of the change of all columns together."""
    least_moving: float = 0.25
    """Share of the steps in motion in which a column changes, from which its leaps are looked at: what is touched leaps
    out of rest. benchmarks/faults.py."""
    least_memory: float = 0.7
    """Rank correlation of a column from step to step, from which its leaps and its last step are looked at: below it a
    step says less than half about the next, and nothing goes on that could leap."""
    frozen_factor: float = 2.5
    """Times the usual longest run of one value. benchmarks/faults.py."""
    smallest_run: float = 2.0
    """Steps by which such runs do not differ."""
    min_frozen: int = 12
    """Steps. Shorter runs of one value are no fault."""
    frame_gap: float = 0.5
    """Share of the time between two frames by which a time may be off before a frame counts as dropped or repeated."""
    repeat_motion: float = 0.5
    """Motion, relative to the usual one, before and after a repeated row, from which the row is a repeated frame: what
    moves does not stand still for one step."""
    smallest_repeat: float = 3.0
    """Repeated rows by which demonstrations do not differ."""
    idle_motion: float = 0.05
    """Motion, relative to the usual one, below which a step is idle."""
    min_idle: int = 10
    """Steps. Shorter idle heads and tails are no fault."""
    settling: float = 1.25
    """Times by which motion decays from the first to the last third of a tail of a controller that settles."""
    max_lag: int = 20
    """Steps. Lags between action and state that are looked at, in both directions."""
    max_partners: int = 4
    """States, those most correlated with an action, of which one is chosen for it."""
    max_shift: int = 10
    """Steps by which a lag may differ from the usual one at most."""
    memories: tuple[int, ...] = (3, 1)
    """Steps that an action remembers, which are taken out before it is correlated with the state; the first with which
    there is a correlation. benchmarks/faults.py."""
    min_correlation: float = 0.3
    """Correlation of an action with the state from which their lag is looked at. benchmarks/faults.py."""
    smallest_gain: float = 0.03
    """Gain in agreement by a shift by which demonstrations do not differ, relative to the usual agreement of the
    cross-correlations. benchmarks/faults.py."""
    map_columns: int = 16
    map_rows: int = 128
    map_folds: int = 5
    map_ridge: float = 1e-4
    """States, and actions, of the map between them; windows of a demonstration that are looked at; parts of the
    demonstrations, each judged by maps of the others; and the penalty of least squares, of variance 1."""
    map_trim: float = 0.7
    map_unknown: float = 0.8
    """Share of the demonstrations that shape the maps, and of the variance that a map leaves over where it tells
    nothing."""
    map_sample: int = 40
    """Demonstrations in which faults are tried to learn the gains where there is none."""
    map_power: float = 0.85
    """Share of the sample, that with the least misfit, and share of that in which a fault would be named, from which on
    its rule is one that knows. benchmarks/faults.py."""
    map_reach: float = 16.0
    """Times the variance of a column in the others, up to which the maps are known. benchmarks/faults.py."""
    least_gain: float = 1.0
    offset_gain: float = 25.0
    """Logarithm of likelihood that undoing a fault, and an offset, gains at least: the second is that of seven standard
    deviations between demonstrations. benchmarks/faults.py."""
    least_offset: float = 0.5
    """Standard deviations of a column from which on an offset shall be named."""
    length_factor: float = 2.0
    """Times the usual length, or its inverse, and times the usual squared distance of last steps from the usual one.
    benchmarks/faults.py."""
    cut_length: float = 0.75
    """Share of the lower quartile of the lengths, below which a demonstration that ends elsewhere is cut off."""
    scale_factor: float = 12.0
    """Times the usual level and the usual change of a column, or their inverse. benchmarks/faults.py."""
    near_share: float = 0.005
    """Share of independent demonstrations that are taken for near duplicates."""
    near_duplicate: tuple[float, float] = (0.02, 0.2)
    """Distance of two demonstrations below which, whatever that share, they are near duplicates, and above which they
    are not; relative to the median distance from the nearest other one."""
    min_duplicate: int = 50
    """Steps from which equal demonstrations of codes alone are duplicates: shorter ones are equal by chance."""
    least_range: float = 0.005
    """Range of a column, relative to the lower quartile, below which it never moves."""
    steady_range: float = 0.25
    """Range of a column, relative to the median, or its inverse, within which demonstrations lie in which it moves."""
