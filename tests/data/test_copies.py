"""Copies of demonstrations: which are the same, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.copies import Copies, copies_among, digests
from rpil.data.demonstrations import Demonstrations

LENGTHS = {"a": 3, "b": 2, "c": 4}


def named(letters, whole=False):
    """A demonstration for each letter, the same for the same letter."""
    episodes = {}
    for letter, length in LENGTHS.items():
        values = np.random.default_rng(ord(letter)).normal(size=(length, 2))
        episodes[letter] = (np.round(10 * values) if whole else values), np.arange(length)
    return Demonstrations.from_episodes([episodes[letter] for letter in letters])


def test_copies_have_the_place_of_the_first_of_them():
    copies = copies_among(named("bacabb"))
    assert copies.any
    np.testing.assert_array_equal(copies.first, [0, 1, 2])
    np.testing.assert_array_equal(copies.place, [0, 1, 2, 1, 0, 0])


def test_rows_lead_to_the_steps_of_the_first():
    every = named("bacabb")
    copies = copies_among(every)
    once = every.select(copies.first)
    rows = copies.rows(every.offsets)
    np.testing.assert_array_equal(once.observations[rows], every.observations)
    np.testing.assert_array_equal(once.actions[rows], every.actions)


def test_one_other_step_or_bit_is_no_copy():
    every = named("aab")
    observations = every.observations.copy()
    observations[4, 1] = np.nextafter(observations[4, 1], 9)
    assert not Copies.of(digests(observations, every.actions, every.offsets)).any
    actions = every.actions.copy()
    actions[4] += 1
    assert not Copies.of(digests(every.observations, actions, every.offsets)).any


@pytest.mark.parametrize("letters", ["abc", "aaa"])
def test_without_copies_or_without_others_all_are_their_own(letters):
    copies = copies_among(named(letters))
    assert not copies.any
    assert copies.sentence == ""
    np.testing.assert_array_equal(copies.first, [0, 1, 2])
    np.testing.assert_array_equal(copies.place, [0, 1, 2])


def test_what_is_counted_and_not_measured_may_be_equal_by_chance():
    assert not copies_among(named("aab", whole=True)).any


@pytest.mark.parametrize(
    ("letters", "sentence"),
    [
        ("aab", "One demonstration is a copy of 1 other: each is judged once."),
        ("bacabb", "3 demonstrations are copies of 2 others: each is judged once."),
    ],
)
def test_the_sentence_counts_copies(letters, sentence):
    assert copies_among(named(letters)).sentence == sentence
