"""Facts beside the words: ranks by the columns of an audit, sessions and the order."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.inference.channels import CHANNELS, normal_scores
from rpil.results.reasons import RANKS, groups_differ, known_facts, style_in_words


def columns(n=4, **channels):
    """The columns of demonstrations: channels that are named, others of 0, and the group of scores."""
    values = np.zeros((n, len(CHANNELS)))
    for name, column in channels.items():
        values[:, CHANNELS.index(name.replace("_", " "))] = column
    return np.column_stack([normal_scores(values), np.full(n, 9.0)])


@pytest.mark.parametrize(
    ("channel", "fact", "ranks"),
    [
        ("length", "length", [0.125, 0.375, 0.625, 0.875]),
        ("smoothness", "smoothness", [0.125, 0.375, 0.625, 0.875]),
        ("motion", "pauses", [0.875, 0.625, 0.375, 0.125]),
        ("short_path", "path", [0.875, 0.625, 0.375, 0.125]),
    ],
)
def test_a_fact_is_the_rank_of_its_channel_and_grows_with_its_name(channel, fact, ranks):
    found = known_facts(columns(**{channel: [1.0, 2.0, 3.0, 50.0]}), None)
    assert set(found) == set(RANKS)
    assert found[fact] == tuple(ranks), "to six digits"
    assert all(values == pytest.approx([0.5] * 4) for name, values in found.items() if name != fact)


def test_a_style_names_the_length_and_the_ranks_that_are_far_from_the_middle():
    lengths = np.array([20, 40, 50, 100])
    facts = {"pauses": (0.1, 0.2, 0.5, 0.9), "smoothness": (0.5, 0.36, 0.6, 0.9), "length": (0.1, 0.4, 0.6, 0.9)}
    assert style_in_words(facts, lengths, [0]) == "0.44 of the median length, pauses less"
    assert style_in_words(facts, lengths, [2]) == "1.11 of the median length"
    assert style_in_words(facts, lengths, [2, 3]) == "1.67 of the median length, pauses more, is smoother"
    assert style_in_words({}, lengths, [0, 1, 2, 3]) == "1.00 of the median length"


GROUPS, UP = (np.arange(8), np.arange(8, 14)), np.arange(14.0)


def differ(lengths=UP, **channels):
    (sentence,) = groups_differ(GROUPS, columns(14, **channels), lengths)
    assert sentence.startswith("The two groups: ")
    assert sentence.endswith(".")
    return sentence[16:-1]


def test_how_two_groups_differ():
    lengths = np.repeat([140, 1210], [8, 6])
    found = differ(lengths=lengths, length=UP, motion=UP, short_path=-UP)
    assert found == "B takes longer (median 1,210 against 140 steps), pauses less and has a longer path"


@pytest.mark.parametrize(
    ("groups", "values"),
    [
        (GROUPS, [0, 2, 4, 6, 8, 10, 12, 13, 1, 3, 5, 7, 9, 11]),
        ((np.arange(2), np.arange(2, 4)), UP),  # few: so by chance
        ((np.arange(5), np.arange(5, 9)), np.arange(9.0)),  # by chance in 2 of 126 orders
        ((np.arange(40), np.arange(40, 80)), np.append(np.arange(40), np.arange(40) + 14)),  # certain and small
        (GROUPS, [0] * 14),
    ],
)
def test_what_may_be_chance_or_is_small_is_not_said(groups, values):
    found = groups_differ(groups, columns(len(values), length=values), np.arange(len(values)))
    assert found == ("The two groups: in length, pauses, smoothness and path they hardly differ.",)


@pytest.mark.parametrize(
    ("channel", "sign", "phrase"),
    [
        ("length", -1, "is shorter (median 10 against 4 steps)"),
        ("motion", -1, "pauses more"),
        ("smoothness", 1, "is smoother"),
        ("smoothness", -1, "is less smooth"),
        ("short_path", 1, "has a shorter path"),
    ],
)
def test_directions_of_facts(channel, sign, phrase):
    assert differ(**{channel: sign * UP}) == f"B {phrase}"
    swapped = np.r_[UP[:7], 8, 7, UP[9:]]
    assert differ(**{channel: sign * swapped}) == f"B {phrase}", "one pair of 48 is the other way round"
