"""Simulated demonstrations: the good are the expert's, corruptions are what their names say, and the seed fixes all."""

from itertools import chain

import numpy as np
import pytest

from problems import refused
from rpil.data.spaces import Box, Discrete
from rpil.simulation.simulate import BAD_KINDS, CORRUPTIONS, expert, simulate

CAR = "MountainCar-v0"


@pytest.mark.parametrize("kind", BAD_KINDS)
def test_good_and_bad_are_labelled(kind):
    made = simulate(CAR, kind, n_good=3, n_bad=2, seed=0)
    assert sorted(made.is_good) == [0, 0, 1, 1, 1]
    assert made.returns.shape == (5,)
    assert len(made.episodes) == 5
    assert simulate(CAR, kind, n_good=0, n_bad=1, seed=0).is_good.tolist() == [0]
    agrees = np.array([(expert(CAR).predict(seen) == actions).mean() for seen, actions in made.episodes])
    assert (agrees[made.is_good == 1] == 1).all()
    assert agrees[made.is_good == 0].max() < 0.95


@pytest.mark.parametrize("kind", ["random", "noisy"])
def test_same_seed_same_bits_and_another_seed_others(kind):
    first, again, other = (simulate(CAR, kind, n_good=1, n_bad=2, seed=seed) for seed in (1, 1, 2))
    for one, two in zip(chain(*first.episodes), chain(*again.episodes), strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(first.returns, again.returns)
    for (observations, _), (others, _) in zip(first.episodes, other.episodes, strict=True):
        assert not np.array_equal(observations[0], others[0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((CAR, "evil", 1, 1), "'evil': choose one of corrupted, random, flip, shift, noisy, window, sensor"),
        (("Pendulum-v0", "flip", 1, 1), "'Pendulum-v0'.*MountainCar-v0, Acrobot-v1, LunarLander-v3"),
        ((CAR, "flip", 0, 0), "n_good = 0 and n_bad = 0"),
        ((CAR, "flip", 3, -1), "n_bad = -1"),
    ],
)
def test_errors_are_one_sentence(arguments, words):
    env_id, kind, n_good, n_bad = arguments
    with refused(words):
        simulate(env_id, kind, n_good=n_good, n_bad=n_bad, seed=0)


N, D, K = 2001, 3, 4
# One range around zero and one far from it.
BOX = Box(np.float32([-2, 10]), np.float32([2, 11]))


@pytest.fixture
def episode():
    # A seed that no corruption below uses, or the noise would repeat the observations.
    rng = np.random.default_rng(100)
    observations = rng.normal([0, 5, -2], [1, 0.1, 30], size=(N, D))
    observations.setflags(write=False)
    actions = rng.integers(K, size=N)
    actions.setflags(write=False)
    return observations, actions


@pytest.fixture
def continuous(episode):
    # Inside the box, some on its bounds.
    actions = BOX.bounded(np.random.default_rng(101).normal([0, 10.5], [1, 0.3], size=(N, 2)))
    actions.setflags(write=False)
    return episode[0], actions


def spoil(kind, episode, seed=0):
    space = Discrete(K) if episode[1].ndim == 1 else BOX
    return CORRUPTIONS[kind](*episode, space, np.random.default_rng(seed))


def assert_uniform(actions, n_actions=K):
    share = np.bincount(actions, minlength=n_actions) / len(actions)
    assert len(share) == n_actions
    p = 1 / n_actions
    np.testing.assert_allclose(share, p, atol=4 * np.sqrt(p * (1 - p) / len(actions)))


@pytest.mark.parametrize("of", ["episode", "continuous"])
@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_seeded_and_leaves_its_input_alone(kind, of, request):
    episode = request.getfixturevalue(of)
    before = [part.copy() for part in episode]
    first, again, other = (spoil(kind, episode, seed) for seed in (0, 0, 1))
    for one, two, part, copy in zip(first, again, episode, before, strict=True):
        np.testing.assert_array_equal(one, two)
        np.testing.assert_array_equal(part, copy)
        assert not np.shares_memory(one, part)
        assert (one.dtype, one.shape) == (part.dtype, part.shape)
    np.testing.assert_array_equal((first[0] == episode[0]).all(), kind != "sensor")
    is_random = kind not in ("flip", "shift")
    assert all(np.array_equal(one, two) for one, two in zip(first, other, strict=True)) != is_random


def assert_fills_the_box(actions):
    # Of a uniform draw every tenth of every range holds a tenth.
    for column, low, high in zip(actions.T.astype(float), BOX.low, BOX.high, strict=True):
        assert (column >= low).all()
        assert (column <= high).all()
        assert_uniform(np.minimum((column - low) / (high - low) * 10, 9).astype(int), 10)
    assert abs(np.corrcoef(actions.T)[0, 1]) < 4 / np.sqrt(len(actions))


def test_flip_mirrors_a_box_at_its_middle(continuous):
    _, actions = spoil("flip", continuous)
    np.testing.assert_allclose(actions[:, 0], -continuous[1][:, 0])
    np.testing.assert_allclose(actions[:, 1], 21 - continuous[1][:, 1], rtol=1e-6)
    np.testing.assert_allclose(spoil("flip", (continuous[0], actions))[1], continuous[1], rtol=1e-6)


def test_shift_moves_half_way_around_a_box(continuous):
    corners = np.array([[-2, 10], [-1, 10.25], [0.5, 10.75], [2, 11]], dtype=np.float32)
    _, moved = spoil("shift", (np.zeros((4, 1)), corners))
    np.testing.assert_array_equal(moved, [[0, 10.5], [1, 10.75], [-1.5, 10.25], [0, 10.5]])
    _, actions = spoil("shift", continuous)
    np.testing.assert_allclose(np.abs(actions - continuous[1]), np.tile([2, 0.5], (N, 1)), atol=1e-5)


@pytest.mark.parametrize("of_box", [False, True])
@pytest.mark.parametrize("kind", ["noisy", "window"])
def test_half_of_the_actions_are_drawn_anew_whole(kind, of_box):
    # The expert's action lies outside the space, so that every replaced step shows.
    for n in (1, 2, 7, N):
        before = np.full((n, 2), 99, dtype=np.float32) if of_box else np.full((n, 1), 99)
        actions = spoil(kind, (np.zeros((n, D)), before if of_box else before[:, 0]))[1].reshape(n, -1)
        drawn = (actions != 99).all(axis=1)
        assert drawn.sum() == (n + 1) // 2
        assert (actions[~drawn] == 99).all()
    (assert_fills_the_box if of_box else assert_uniform)(actions[drawn].squeeze())
    assert (np.diff(np.flatnonzero(drawn)) == 1).all() == (kind == "window")


def replaced(kind, seed):
    actions = spoil(kind, (np.zeros((100, D)), np.full(100, K)), seed)[1]
    return np.flatnonzero(actions != K)


def test_window_is_one_block_anywhere_and_noisy_chooses_every_step_equally_often():
    blocks = [replaced("window", seed) for seed in range(1000)]
    assert all((np.diff(steps) == 1).all() for steps in blocks)
    assert {int(steps[0]) for steps in blocks} == set(range(51))
    share = np.bincount(np.concatenate([replaced("noisy", seed) for seed in range(2000)]), minlength=100) / 2000
    # Five standard errors: a hundred steps are looked at.
    np.testing.assert_allclose(share, 0.5, atol=5 * np.sqrt(0.25 / 2000))


def test_sensor_keeps_actions_moments_and_types_but_no_observation_that_changes(episode):
    observations, actions = spoil("sensor", episode)
    np.testing.assert_array_equal(actions, episode[1])
    sd = episode[0].std(axis=0)
    assert (np.abs(observations.mean(axis=0) - episode[0].mean(axis=0)) < 4 * sd / np.sqrt(N)).all()
    np.testing.assert_allclose(observations.std(axis=0), sd, rtol=4 / np.sqrt(2 * N))
    for column in range(D):
        assert abs(np.corrcoef(observations[:, column], episode[0][:, column])[0, 1]) < 4 / np.sqrt(N)
    frozen = np.column_stack([np.ones(50), np.arange(50)]).astype(np.float32)
    observations, _ = spoil("sensor", (frozen, np.zeros(50, dtype=np.int64)))
    assert observations.dtype == np.float32
    np.testing.assert_array_equal(observations[:, 0], 1)
    assert (observations[:, 1] != frozen[:, 1]).all()
