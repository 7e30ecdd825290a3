"""Simulated demonstrations: the good are the expert's, the bad are spoiled as asked, and the seed fixes all."""

from __future__ import annotations

from itertools import chain

import numpy as np
import pytest

from problems import refused
from rpil.simulation.simulate import BAD_KINDS, expert, simulate

CAR = "MountainCar-v0"


@pytest.mark.parametrize("kind", BAD_KINDS)
def test_good_and_bad_are_labelled(kind):
    made = simulate(CAR, kind, n_good=3, n_bad=2, seed=0)
    assert sorted(made.is_good) == [0, 0, 1, 1, 1]
    assert made.returns.shape == (5,)
    assert len(made.episodes) == 5
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
