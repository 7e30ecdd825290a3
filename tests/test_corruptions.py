"""Each corruption does what its name says, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.corruptions import CORRUPTIONS, KINDS, RANDOM

N, D, K = 2001, 3, 4


@pytest.fixture
def episode():
    # A seed that no corruption below uses, or the noise would repeat the observations.
    rng = np.random.default_rng(100)
    observations = rng.normal([0, 5, -2], [1, 0.1, 30], size=(N, D))
    observations.setflags(write=False)
    actions = rng.integers(K, size=N)
    actions.setflags(write=False)
    return observations, actions


def spoil(kind, episode, seed=0, n_actions=K):
    return CORRUPTIONS[kind](*episode, n_actions, np.random.default_rng(seed))


def assert_uniform(actions, n_actions=K):
    share = np.bincount(actions, minlength=n_actions) / len(actions)
    assert len(share) == n_actions
    p = 1 / n_actions
    np.testing.assert_allclose(share, p, atol=4 * np.sqrt(p * (1 - p) / len(actions)))


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_seeded_and_leaves_its_input_alone(kind, episode):
    before = [part.copy() for part in episode]
    first, again = spoil(kind, episode), spoil(kind, episode)
    for one, two, part, copy in zip(first, again, episode, before, strict=True):
        np.testing.assert_array_equal(one, two)
        np.testing.assert_array_equal(part, copy)
        assert not np.shares_memory(one, part)
        assert one.dtype == part.dtype
        assert one.shape == part.shape


@pytest.mark.parametrize("kind", ["corrupted", "noisy", "window", "sensor"])
def test_another_seed_spoils_otherwise(kind, episode):
    first, other = spoil(kind, episode, 0), spoil(kind, episode, 1)
    assert not all(np.array_equal(one, two) for one, two in zip(first, other, strict=True))


@pytest.mark.parametrize("kind", [kind for kind in CORRUPTIONS if kind != "sensor"])
def test_observations_stay_the_experts(kind, episode):
    np.testing.assert_array_equal(spoil(kind, episode)[0], episode[0])


def test_corrupted_draws_uniformly_whatever_the_expert_did(episode):
    _, actions = spoil("corrupted", episode)
    assert_uniform(actions)
    for k in range(K):
        assert_uniform(actions[episode[1] == k])


@pytest.mark.parametrize(("n_actions", "wanted"), [(2, [1, 0]), (3, [2, 1, 0]), (4, [3, 1, 2, 0])])
def test_flip_swaps_first_and_last(n_actions, wanted):
    actions = np.arange(n_actions)
    flipped = CORRUPTIONS["flip"](np.zeros((n_actions, 1)), actions, n_actions, np.random.default_rng(0))[1]
    np.testing.assert_array_equal(flipped, wanted)


def test_shift_moves_every_action_on_by_one():
    shifted = CORRUPTIONS["shift"](np.zeros((5, 1)), np.array([0, 1, 2, 3, 0]), 4, np.random.default_rng(0))[1]
    np.testing.assert_array_equal(shifted, [1, 2, 3, 0, 1])


@pytest.mark.parametrize("kind", ["noisy", "window"])
def test_half_of_the_actions_are_drawn_anew(kind):
    # The expert's action lies outside the draws, so that every replaced step shows.
    for n in (1, 2, 7, N):
        actions = spoil(kind, (np.zeros((n, D)), np.full(n, K)))[1]
        assert (actions != K).sum() == (n + 1) // 2
    assert_uniform(actions[actions != K])


def replaced(kind, seed):
    actions = spoil(kind, (np.zeros((100, D)), np.full(100, K)), seed)[1]
    return np.flatnonzero(actions != K)


def test_window_is_one_block_anywhere():
    starts = set()
    for seed in range(1000):
        steps = replaced("window", seed)
        np.testing.assert_array_equal(np.diff(steps), 1)
        starts.add(int(steps[0]))
    assert starts == set(range(51))


def test_noisy_chooses_every_step_equally_often():
    share = np.bincount(np.concatenate([replaced("noisy", seed) for seed in range(2000)]), minlength=100) / 2000
    # Five standard errors: a hundred steps are looked at.
    np.testing.assert_allclose(share, 0.5, atol=5 * np.sqrt(0.25 / 2000))


def test_sensor_keeps_actions_and_moments_but_no_observation(episode):
    observations, actions = spoil("sensor", episode)
    np.testing.assert_array_equal(actions, episode[1])
    sd = episode[0].std(axis=0)
    assert (np.abs(observations.mean(axis=0) - episode[0].mean(axis=0)) < 4 * sd / np.sqrt(N)).all()
    np.testing.assert_allclose(observations.std(axis=0), sd, rtol=4 / np.sqrt(2 * N))
    for column in range(D):
        assert abs(np.corrcoef(observations[:, column], episode[0][:, column])[0, 1]) < 4 / np.sqrt(N)


def test_sensor_keeps_float32_and_a_constant_column():
    frozen = np.column_stack([np.ones(50), np.arange(50)]).astype(np.float32)
    observations, _ = spoil("sensor", (frozen, np.zeros(50, dtype=np.int64)))
    assert observations.dtype == np.float32
    np.testing.assert_array_equal(observations[:, 0], 1)
    assert (observations[:, 1] != frozen[:, 1]).all()


def test_kinds_are_the_protocols_and_random_is_no_function():
    assert set(KINDS) == {"corrupted", "random", "flip", "shift", "noisy", "window", "sensor"}
    assert len(KINDS) == 7
    assert RANDOM == "random"
    assert RANDOM not in CORRUPTIONS
