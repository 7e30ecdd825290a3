"""What rules measure of each demonstration, against loops over its steps; and what is learned of sound recordings."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.data.demonstrations import Block
from rpil.faults import measured_columns, settings, tracking
from rpil.faults.checking import check
from rpil.faults.measured_columns import MeasuredColumns, MovingBlock, column_labels, learn_columns, part_means, pilot
from rpil.faults.motion import Jump, Spike
from rpil.faults.rule import Learned
from rpil.faults.still import largest

RNG = np.random.default_rng(0)
LENGTHS = (9, 1, 2, 3, 4, 12)
OFFSETS = np.cumsum([0, *LENGTHS])
CLEAN = recording()


def each(values):
    return [values[:, a:b] for a, b in itertools.pairwise(OFFSETS)]


def test_sums_and_tops_of_each_demonstration():
    values = RNG.integers(0, 3, size=(4, OFFSETS[-1])).astype(float)
    np.testing.assert_allclose(part_means(values, OFFSETS)[:, 0], [part.mean(axis=1) for part in each(values)])
    top, step = largest(values, OFFSETS)
    np.testing.assert_array_equal(top, [part.max(axis=1) for part in each(values)])
    np.testing.assert_array_equal(step, [part.argmax(axis=1) for part in each(values)])


@pytest.mark.parametrize(("n", "steps", "expected"), [(150, 1, 150), (999, 1, 200), (200, 250, 200), (201, 251, 100)])
def test_a_sample_is_spread_over_the_data(n, steps, expected):
    data = demonstrations([(np.zeros((steps, 1)), np.zeros((steps, 1)))] * n)
    block, numbers = pilot(data)
    assert (len(numbers), len(block.observations)) == (expected, expected * steps)
    assert (numbers[0], numbers[-1] >= n - 3) == (0, True)
    assert np.ptp(np.diff(numbers)) <= 1


@pytest.mark.parametrize(("width", "values", "n"), [(1000, 20, 1000), (1001, 20, 0), (3, 19, 0)])
def test_columns_are_measured_unless_they_are_pixels_or_codes(width, values, n):
    states = np.arange(40)[:, None] % values * np.linspace(3.1, 9.1, width)
    block = Block(0, states, np.zeros(40, dtype=int), np.arange(0, 41, 5))
    assert len(learn_columns(block, np.arange(8), ("x",) * width).columns.names) == n


WRAPPED = np.r_[0:340:20, 358, 2, 10:200:20]


@pytest.mark.parametrize(
    ("values", "turn"),
    [
        *((WRAPPED * turn / 360, turn) for turn in (360, 2 * np.pi, 1024, 4096, 8192, 16384, 65536)),
        (WRAPPED * 0.85, 0),
        (WRAPPED * 1.02, 0),  # it fills more than a turn
        (np.r_[WRAPPED, 100], 0),  # other leaps
        (np.r_[WRAPPED, 150], 360),
        (np.r_[0.0:20, 350:330:-1, 0:20], 0),  # it came from afar
        (np.r_[0:10:2, 358, 1, 359, 2, 8:350:6], 360),  # to and fro, by noise
        (np.r_[0.0, 330, 0, 330], 0),
    ],
)
def test_an_angle_wraps_where_it_leaps_by_a_turn_and_came_nearer(values, turn):
    change = np.diff(values, prepend=values[0])
    assert measured_columns._turn(values.astype(float), change.astype(float), np.abs(change)) == pytest.approx(turn)


@pytest.mark.parametrize(
    ("zeros", "moving", "n"),
    [
        ([1, 1, 0, 0, 0], 1, 2), ([1] * 9 + [0], 1, 9), ([1] * 10 + [0], 1, 0), ([1, 0.5, 0.5], 1, 1),
        ([1, 0.6, 0.5], 1, 0),  # it is at 0 in most steps of the others
        ([1, 0, 0], 0, 0), ([1, 0, 0, 0], np.array([[0], [1], [0], [1]]), 1),
        ([1, 0, 0, 0, 0], np.array([[0], [1], [0], [1], [0]]), 0),
    ],
)  # fmt: skip
def test_columns_are_not_recorded_where_two_are_0_that_move_in_most_others(zeros, moving, n):
    zeros = np.array(zeros, dtype=float)[:, None]
    ranges = moving * (zeros < 1)
    for columns, expected in ((1, 0), (2, n)):
        found = measured_columns.not_recorded(np.tile(ranges, columns), np.tile(zeros, columns))
        assert found.sum(axis=0).tolist() == [expected] * columns


def test_noise_is_that_of_the_rows_at_rest_and_of_an_encoder():
    rng, offsets = np.random.default_rng(0), np.arange(0, 2001, 10)
    path = np.tile(np.sin(np.linspace(0, 3, 100)), 20) + rng.normal(size=200).repeat(10) * 100
    values = np.array([path + 0.2 * rng.normal(size=2000), np.round(path / 0.3) * 0.3, np.ones(2000)])
    size = np.abs(np.diff(values, prepend=values[:, :1]))
    size[:, offsets[:-1]] = 0.0
    found = measured_columns._noise_at_rest(SimpleNamespace(values=values, size=size, offsets=offsets))
    np.testing.assert_allclose(found, [0.2, 0.3 / 12**0.5, 0.0], rtol=0.1)


def test_four_columns_of_length_1_in_every_step_are_a_quaternion():
    values = np.random.default_rng(0).normal(size=(9, 8))
    values[0, :4] /= np.linalg.norm(values[0, :4])
    values[:, 4:] /= np.linalg.norm(values[:, 4:], axis=1, keepdims=True)
    assert [*measured_columns._quaternions(values)] == [4]


def test_spikes_and_jumps_are_the_largest_of_each_demonstration():
    values = RNG.normal(size=(3, OFFSETS[-1])).round(1)
    values[:, -1] = values[:, -2]
    values[0, -3] += 9.0
    every = MeasuredColumns((*"abc",), np.arange(3), np.arange(3) > 1, np.array([0.5, 1.0, 2]), *np.ones((3, 3)))
    block = MovingBlock.of(Block(0, values[:2].T, values[2:].T, OFFSETS), np.arange(len(LENGTHS)), every)
    spikes, step, largest, next_spikes, _ = Spike.measure(block, None)
    jumps, after, _, of_all, _, _, next_jumps, _ = Jump.measure(block, None)
    for m, part in enumerate(each(values)):
        n = part.shape[1]
        for c, x in enumerate(part):
            d = np.pad(np.abs(np.diff(x)), 2)  # d[t + 1] leads to step t
            spike, jump = [0.0] * n, [0.0] * n
            for t in range(1, n - 1):
                if (x[t] - x[t - 1]) * (x[t + 1] - x[t]) < 0:
                    spike[t] = max(min(d[t + 1], d[t + 2]) - max(d[t], d[t + 3] if t < n - 2 else 0), 0)
            for t in range(2, n - 1):
                around = max(d[t], d[t + 2])
                jump[t] = d[t + 1] - around if d[t + 1] > 2 * around else 0
            assert spikes[m, c] == pytest.approx(max(spike))
            assert jumps[m, c] == pytest.approx(max(jump))
            assert (largest[m, c], spike[step[m, c]]) == (d.max(), max(spike))
            assert jump[after[m, c]] == max(jump)
            for top, every_one, at in ((next_spikes, spike, step), (next_jumps, jump, after)):
                rest = [x for t, x in enumerate(every_one) if abs(t - at[m, c]) > 3]
                assert top[m, c] == pytest.approx(max(rest, default=0.0))
        size = np.log1p(np.abs(np.diff(part, axis=1)) / every.scale[:, None]).mean(axis=0)  # size[t - 1] leads to t
        own = [size[t - 1] - max(*size[t - 3 : t - 1], *size[t : t + 2]) for t in range(3, n - 2)]
        assert of_all[m, 0] == pytest.approx(max([0.0, *own]))


def test_series_are_whitened_by_what_an_action_remembers():
    values, memory = RNG.normal(size=OFFSETS[-1]), np.array([0.5, -0.25])
    white = tracking.whitened(values, memory, OFFSETS)
    for a, b in itertools.pairwise(OFFSETS):
        x = values[a:b] - values[a:b].mean()
        own = [x[t] - 0.5 * x[t - 1] + 0.25 * x[t - 2] if t > 1 else 0.0 for t in range(b - a)]
        np.testing.assert_allclose(white[a:b], own, atol=1e-12)
    assert tracking._memory(values[:3], np.array([0, 1, 3]), 2).tolist() == [0, 0]
    rows = tracking._memory(values, OFFSETS, 2)
    past, now = [], []
    for a, b in itertools.pairwise(OFFSETS):
        x = values[a:b] - values[a:b].mean()
        past += [[x[t - 1], x[t - 2]] for t in range(2, b - a)]
        now += [x[t] for t in range(2, b - a)]
    np.testing.assert_allclose(rows, np.linalg.lstsq(np.array(past), np.array(now), rcond=None)[0])


def test_correlations_are_those_within_demonstrations():
    driver, change, most = RNG.normal(size=OFFSETS[-1]), RNG.normal(size=(2, OFFSETS[-1])), 3
    found = tracking._correlations(driver, change, OFFSETS, most)
    own = [tracking._own_correlations(driver, each, OFFSETS, most) for each in change]
    norms = np.sqrt((driver**2).sum() * (change**2).sum(axis=1))
    for k in range(-most, most + 1):
        total = np.zeros(2)
        for m, (a, b) in enumerate(itertools.pairwise(OFFSETS)):
            pairs = [(t, t + k) for t in range(a, b) if a <= t + k < b]
            sums = [sum(driver[t] * change[c, s] for t, s in pairs) for c in range(2)]
            power = np.sqrt((driver[a:b] ** 2).sum() * (change[:, a:b] ** 2).sum(axis=1))
            np.testing.assert_allclose([own[c][m, k + most] for c in range(2)], sums / power, atol=1e-12)
            total += sums
        np.testing.assert_allclose(found[:, k + most], total / norms, atol=1e-12)


def test_what_is_learned_of_sound_recordings():
    """The numbers are those of today: whatever changes one of them changes what is found."""
    rng = np.random.default_rng(1)
    noisy = [(x + rng.normal(size=x.shape) * [0.1, 0, 0.02], a) for x, a in CLEAN]
    data = demonstrations(noisy)
    learned = Learned.of(data)
    assert learned.pairs == ()  # which commands need not
    sample = learn_columns(*pilot(data), column_labels(data))
    found, _ = tracking.find_lag(sample, settings.MAX_LAG, ())
    pairs = [(pair.action, pair.state, pair.of_change, len(pair.memory), pair.lag) for pair in found]
    assert pairs == [(4, 1, False, 3, 2), (5, 2, False, 3, 2), (3, 0, False, 1, 2)]
    correlations = [pair.correlation for pair in found]
    np.testing.assert_allclose(correlations, [0.9865782, 0.5068785, 0.3330825], rtol=1e-5)

    tracked = learned.tracked
    assert (tracked.action.tolist(), tracked.state.tolist(), tracked.lag) == ([3, 4, 5], [0, 1, 2], 2)
    assert tracked.is_command
    assert tracked.fits.all()
    related = [
        [0.3328708, 0.1046817, 0.1583162],
        [0.03284762, 0.9881349, 0.1614088],
        [0.07525565, 0.1750798, 0.8587367],
    ]
    found = tracking._related(sample, np.arange(3, 6), np.arange(3), settings.MAX_LAG)
    np.testing.assert_allclose(found, related, rtol=1e-5)  # the largest over the lags


def test_the_action_may_follow_the_state_or_be_its_speed():
    report = check(demonstrations([(a, x) for x, a in CLEAN]))
    assert report.usual == {"lag": "action 0 follows observation 0 after 2 steps"}
    pairs = Learned.of(demonstrations([(np.cumsum(a, axis=0) - a, a) for _, a in CLEAN])).pairs
    assert {(pair.state - pair.action, pair.of_change, pair.lag) for pair in pairs} == {(-3, True, 1)}
