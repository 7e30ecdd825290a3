"""Simulated demonstrations: the good are the expert's, the bad are spoiled as asked, and the seed fixes all."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from problems import refused
from rpil.simulation.simulate import BAD_KINDS, expert, simulate

CAR = "MountainCar-v0"


def assert_same(first, second):
    assert len(first) == len(second)
    for (observations, actions), (others, other_actions) in zip(first, second, strict=True):
        np.testing.assert_array_equal(observations, others)
        np.testing.assert_array_equal(actions, other_actions)


def those(made, good):
    """The episodes that are good, or bad, in their order."""
    return [episode for episode, is_good in zip(made.episodes, made.is_good, strict=True) if is_good == good]


@pytest.mark.parametrize("kind", BAD_KINDS)
def test_good_and_bad_are_labelled(kind):
    made = simulate(CAR, kind, n_good=3, n_bad=2, seed=0)
    assert sorted(made.is_good) == [0, 0, 1, 1, 1]
    assert made.returns.shape == (5,)
    assert len(made.episodes) == 5
    agrees = np.array([(expert(CAR).predict(seen) == actions).mean() for seen, actions in made.episodes])
    assert (agrees[made.is_good == 1] == 1).all()
    assert agrees[made.is_good == 0].max() < 0.95


def test_order_is_random_and_of_the_seed():
    orders = [simulate(CAR, "flip", n_good=6, n_bad=6, seed=seed).is_good for seed in (0, 0, 1, 2)]
    np.testing.assert_array_equal(orders[0], orders[1])
    assert len({tuple(order) for order in orders[1:]}) == 3
    for order in orders:
        assert 0 < order[:6].sum() < 6


@pytest.mark.parametrize("kind", ["random", "noisy"])
def test_same_seed_same_bits_and_another_seed_others(kind):
    first, again, other = (simulate(CAR, kind, n_good=1, n_bad=2, seed=seed) for seed in (1, 1, 2))
    assert_same(first.episodes, again.episodes)
    np.testing.assert_array_equal(first.returns, again.returns)
    for (observations, _), (others, _) in zip(first.episodes, other.episodes, strict=True):
        assert not np.array_equal(observations[0], others[0])


def test_the_first_episodes_depend_on_neither_kind_nor_number_of_bad():
    few, many, other = (
        simulate(CAR, kind, n_good=2, n_bad=n, seed=4) for kind, n in (("noisy", 2), ("noisy", 4), ("random", 1))
    )
    assert_same(those(few, 0), those(many, 0)[:2])
    for made in (many, other):
        assert_same(those(few, 1), those(made, 1))


def test_spoiled_returns_are_the_experts_but_for_random():
    assert (simulate(CAR, "flip", n_good=2, n_bad=4, seed=5).returns > -200).all()
    made = simulate(CAR, "random", n_good=2, n_bad=4, seed=5)
    assert (made.returns[made.is_good == 1] > -200).all()
    assert (made.returns[made.is_good == 0] == -200).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((CAR, "evil", 1, 1), "'evil': choose one of corrupted, random, flip, shift, noisy, window, sensor"),
        (("Pendulum-v0", "flip", 1, 1), "'Pendulum-v0'.*MountainCar-v0"),
        ((CAR, "flip", 0, 0), "n_good = 0 and n_bad = 0"),
        ((CAR, "flip", 3, -1), "n_bad = -1"),
    ],
)
def test_errors_are_one_sentence(arguments, words):
    env_id, kind, n_good, n_bad = arguments
    with refused(words):
        simulate(env_id, kind, n_good=n_good, n_bad=n_bad, seed=0)


@pytest.mark.slow
def test_warning_filters_stay_as_they_were_and_no_environment_prints():
    """In a process of its own, where Gymnasium is imported for the first time."""
    code = "import warnings\nfrom rpil import DataError, rollout, simulate\nbefore = list(warnings.filters)\n"
    code += "for name in ('LunarLander-v3', 'Acrobot-v1'): simulate(name, 'random', n_good=1, n_bad=1, seed=0)\n"
    code += "try: rollout(None, 'Blackjack-v1', n_episodes=1, seed=0)\nexcept DataError: pass\n"
    code += "print(warnings.filters == before)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"
