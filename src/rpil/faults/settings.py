"""Thresholds of the rules for recording faults.

A rule that compares demonstrations takes what is usual from themselves: a value is a fault where it is beyond `factor`
times the upper quartile over the demonstrations, or further where the quartiles lie far apart (`ComparingRule.fence`).
`benchmarks/faults.py` chose those that are marked *, on some of its data sets, and checks them on the others; the rest
were chosen by hand.
"""

from __future__ import annotations

# What a sample tells
FEWEST_DEMONSTRATIONS = 4  # from which it is known what is usual; with fewer, rules that compare are not applied
PILOT_DEMONSTRATIONS = 200  # spread evenly over the data, at most, that tell how each column moves
CACHE_STEPS = 8_192  # of a block: a dozen columns of them stay in a second-level cache
PILOT_STEPS = 50_000  # of these, at most
MIN_DISTINCT = 20  # values in the pilot from which a column is a measurement; codes and one-hot columns have fewer
MOST_COLUMNS = 1_000  # beyond which observations are images, whose columns no rule compares

# What is usual
FENCE = 3.0  # * distances of the upper quartile from the lower one, in logarithms, that a value may lie above it
TAIL = 2.5  # * distances of a quartile from the median, or standard deviations, within which clean demonstrations lie
LARGEST_SPREAD = 8.0  # * times above the upper quartile by `FENCE`; beyond it clean ones differ too much to know
FEW, FEW_SHARE, MOST_FEW = 4, 0.1, 0.25  # demonstrations, or share, that may have a fault before it is usual; at most
USUAL_FACTOR = 3.0  # times the usual number of idle steps, and the usual gain in agreement by a shift

# Leaps
LEAP_FACTOR = 1.75  # * times the usual largest spike, or jump, of a demonstration
SMALLEST_SHARE = 0.5  # * share of the smallest leap that is added to both quartiles, so that their ratio is finite
CHANGE_FACTOR = 1.5  # * times the usual largest change of a demonstration that a leap has at least
SMALLEST_LEAP = 0.1  # * standard deviations of the column that a leap has at least
LEAST_OF_ALL = 0.15  # logarithm added to the fence of the change of all columns together
NEXT_FACTOR, BEYOND_NEXT = 2.0, 0.35  # * times the usual second change of all columns together, and logarithm beyond
WIDTH = 3  # steps before and after a change that are not the next largest
NEXT_LEAP = 4.0  # times the usual second largest leap of a column and the smallest one
MOVING_SHARE = 0.25  # * share of the steps in motion in which a column changes: what is touched leaps out of rest
LEAST_MEMORY = 0.7  # rank correlation from step to step: below it a step says less than half about the next

# Rest
FROZEN_FACTOR = 2.5  # * times the usual longest run of one value
SMALLEST_RUN = 2.0  # steps by which such runs do not differ
MIN_FROZEN = 12  # steps; shorter runs of one value are no fault
FRAME_GAP = 0.5  # share of the time between two frames by which a time may be off
OTHER_RATE = 0.01  # share by which frames a second may differ from those that are declared, or usual
REPEAT_MOTION = 0.5  # motion, relative to the usual one, around a repeated frame: what moves does not stop for one step
SMALLEST_REPEAT = 3.0  # repeated rows by which demonstrations do not differ
LEAST_MOTION = 0.3  # share of that of the states around a row that repeats the action as well
REPEATED_ROWS = 4  # rows that repeat states and actions while states move, and twice the usual second largest number
STILL_SHARE = 0.2  # share of a demonstration at whose end no observation changes while the action does
SHUFFLED = 4  # one step of so many goes back where times are in no order
IDLE_MOTION = 0.05  # motion, relative to the usual one, below which a step is idle
MIN_IDLE = 10  # steps; shorter idle heads and tails are no fault
LONG_IDLE, IDLE_SHARE = 12, (0.16, 0.16, 0.2)  # steps, and share at ends and between, of rest that is always idle
SETTLING = 1.25  # times by which motion decays from the first to the last third of a tail of a controller that settles
NOISE_ROWS, QUIET, NOISE_OF_QUIET = 12, 0.1, 0.62  # rows that tell noise, share of quiet ones, what they have of it
LARGEST_BAND = 0.5  # spreads of a state: where rest may be farther apart, it does not tell rest from motion
REST_STEPS = 8  # within which what follows a rest is still of it
REST_ROWS, REST_WIDTHS = 7, (3, 8, 24)  # rows of a rest at least; widths whose means are compared with the next ones
REST_FAR, REST_DRIFT = 3.0, 2e-4  # standard errors that what rests may go, and spreads a row beside

# Lags
MAX_LAG = 20  # steps between action and state that are looked at, in both directions
MAX_PARTNERS = 4  # states, those most correlated with an action, of which one is chosen for it
MAX_SHIFT = 10  # steps by which a lag may differ from the usual one at most
MEMORIES = 3, 1  # * steps that an action remembers, taken out before it is correlated: the first with a correlation
MIN_CORRELATION = 0.3  # * of an action with the state, from which their lag is looked at
SMALLEST_GAIN = 0.03  # * gain by a shift, relative to the usual agreement, by which clean ones do not differ
OPPOSITE = 0.6  # share of the usual correlation, with the other sign, that an action of the other sign has
LEAST_RELATED = 0.5  # correlation of an observation with an action from which on they go together

# Commands and their states
SAME_UNIT = 0.3  # of a slope, or a logarithm of it, from 1 within which a command is in the unit of its state
TRACKS, SURE = 0.5, 0.8  # squared correlation from which a state follows its command, and from which that is sure
GAP_QUANTILES, GAP_WIDTH = (0.05, 0.5, 0.95), 3.29  # of command less state; standard deviations between them
ERRORS, LEAST_GAP = 3.0, 0.2  # tracking errors, and spreads of the action, that command and state lie apart
LEAST_USUAL_GAP = 0.5  # spreads of the action, where many lie apart
OTHER_FITS = 5.0  # times less of an action is left by another state than by its own
OTHER_UNIT, UNITS, UNIT_ERROR = 3.0, (57.29578, 1000.0), 0.05  # times larger; known units, and how near in logarithms
IS_STATE = 0.05  # share of what is left beside, below which the state of the same step is the action
LAG_PAIRS = 16  # that tell it, at most
LAG_FITS, LAG_BETTER = 0.3, 2.0  # share that is left where a lag is known; times more at others, squared one step off

# The whole set
TOUCHED = 0.6  # share of the demonstrations within a limit that touch it
BEYOND_LIMIT = 0.05  # share of the range of an action that passes a limit
GOES_ON = 1.2  # mean logarithm of the change, in usual ones and 1 more, to the next demonstration, if it goes on
APART, ALIKE = 2.0, 0.15  # ranges that two groups lie apart; share of motion by which they may differ once undone
BY_CHANCE = 4.0  # standard errors by which two parts that are alike differ
NEAR_STATE = 0.25  # spreads of each column that states lie apart which are near, whose actions are compared

# Angles that wrap
TURNS = (360.0, 6.283185307179586, 1024.0, 4096.0, 8192.0, 16384.0, 65536.0)  # degrees, radians, encoders
NEAR_TURN, WITHIN_TURN = 0.85, 1.01  # share of a turn of a leap at least, and of all values at most
APPROACH = 4  # steps before a leap in which it came nearer, in most of the leaps

# Whole demonstrations
LENGTH_FACTOR = 2.0  # * times the usual length, or its inverse
SCALE_FACTOR = 12.0  # * times the usual level and the usual change of a column, or their inverse
NEIGHBOUR_ROWS = 1_024  # points whose distances to all others are in memory together
PARTS = 8  # of time, whose means are compared
MIN_DUPLICATE = 50  # steps from which equal demonstrations of codes are duplicates: shorter ones are equal by chance
LEAST_RANGE = 0.005  # range of a column, relative to the median, below which it never moves
STEADY_RANGE = 0.25  # the same, or its inverse, within which demonstrations lie in which it moves
LEAST_SPREAD = 0.02  # standard deviations of a column by which demonstrations differ, at least
LEAST_STEPS = 20  # steps of a demonstration from which its scale, and the sign of a column, are known
MOST_ZERO = 0.9  # share of demonstrations without a column, at most
MOST_ABSENT = 0.5  # share of demonstrations without a column, and of steps of others in which it is 0, at most
