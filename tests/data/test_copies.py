"""Copies of demonstrations: which are the same, bit for bit."""

import numpy as np
import pytest

from rpil.data.copies import Copies, copies_among, digests
from rpil.data.demonstrations import Demonstrations


def named(letters, whole=False):
    """A demonstration for each letter, the same for the same letter."""
    episodes = {}
    for letter, length in {"a": 3, "b": 2, "c": 4}.items():
        values = np.random.default_rng(ord(letter)).normal(size=(length, 2))
        episodes[letter] = (np.round(10 * values) if whole else values), np.arange(length)
    return Demonstrations.from_episodes([episodes[letter] for letter in letters])


@pytest.mark.parametrize(
    ("letters", "first", "place", "sentence"),
    [
        ("abc", [0, 1, 2], [0, 1, 2], ""),
        ("aab", [0, 2], [0, 0, 1], "One demonstration is a copy of 1 other: each is judged once."),
        ("bacabb", [0, 1, 2], [0, 1, 2, 1, 0, 0], "3 demonstrations are copies of 2 others: each is judged once."),
    ],
)
def test_copies_have_the_place_of_the_first_of_them(letters, first, place, sentence):
    copies = copies_among(named(letters))
    assert (copies.any, copies.all_same, copies.sentence) == (letters != "abc", False, sentence)
    np.testing.assert_array_equal(copies.first, first)
    np.testing.assert_array_equal(copies.place, place)


def test_one_other_step_or_bit_is_no_copy():
    every = named("aab")
    observations = every.observations.copy()
    observations[4, 1] = np.nextafter(observations[4, 1], 9)
    assert not Copies.of(digests(observations, every.actions, every.offsets)).any
    actions = every.actions.copy()
    actions[4] += 1
    assert not Copies.of(digests(every.observations, actions, every.offsets)).any


def test_where_all_are_copies_of_one_all_are_judged_and_have_what_the_first_has():
    copies = copies_among(named("aaa"))
    assert copies.any
    assert copies.all_same
    assert copies.sentence == "All 3 demonstrations are copies of one: there is nothing to compare."
    np.testing.assert_array_equal(copies.judged, [0, 1, 2])
    np.testing.assert_array_equal(copies.copy_of, [0, 0, 0])
    np.testing.assert_array_equal(copies.rows(named("aaa").offsets), [0, 1, 2] * 3)


@pytest.mark.parametrize(("unit", "shift"), [(1.0, 0.0), (0.5, 0.0), (1.0, 0.5)])
def test_where_observations_come_again_demonstrations_may_be_equal_by_chance(unit, shift):
    walks = [[0, 1, 0, 1], [0, 1, 0, 1], [1, 0, 1, 1]]
    episodes = [(unit * np.array(walk, dtype=float)[:, None] + shift, np.arange(4)) for walk in walks]
    assert not copies_among(Demonstrations.from_episodes(episodes)).any
    measured = [(states, actions[:, None] / 3) for states, actions in episodes]
    assert copies_among(Demonstrations.from_episodes(measured)).any
