"""Two groups in words: sizes, facts that clearly differ, and parts of the action."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.channels import CHANNELS, normal_scores
from rpil.inference.rivals import Contrast
from rpil.results.facts import groups_differ

GROUPS = np.arange(8), np.arange(8, 14)


def data(discrete=False, names=()):
    actions = np.zeros(14, dtype=int) if discrete else np.zeros((14, 3))
    space = Discrete(3) if discrete else Box(-np.ones(3), np.ones(3))
    return FitData(np.ones((14, 1)), actions, np.arange(15), space, np.zeros(14, dtype=int), action_names=names)


def columns(**channels):
    values = np.zeros((14, len(CHANNELS)))
    for name, column in channels.items():
        values[:, CHANNELS.index(name.replace("_", " "))] = column
    return normal_scores(values)


def contrast(share=(0.1, 0.7, 0.2), use=((0.0, 1.5, 0.25), (0.0, -2.0, 0.5)), spread=0.0):
    parts = sorted(((j, one) for j, one in enumerate(share) if one), key=lambda part: -part[1])
    return Contrast(tuple(parts), np.array(use), np.full(3, spread), np.array([140.0, 1210.0]))


UP = np.arange(14.0)
NAMES = ("pan", "lift\x1b", "grip")


def test_two_groups_in_two_sentences():
    found = groups_differ(GROUPS, columns(length=UP, motion=UP, short_path=-UP), contrast(), data(names=NAMES))
    assert found == (
        "The two groups: B takes longer (median 1,210 against 140 steps), pauses less and has a longer path.",
        "The two groups: they differ most in parts lift\\x1b (70% of the evidence; median 1.5 in A, -2 in B) "
        "and grip (20% of the evidence; median 0.25 in A, 0.5 in B) of the action.",
    )


@pytest.mark.parametrize(("spread", "named"), [(6.9, True), (7.1, False)])
def test_medians_are_named_only_where_they_are_apart(spread, named):
    """They are 3.5 apart in the first part that is named."""
    found = groups_differ(GROUPS, columns(), contrast(spread=spread), data(names=NAMES))[1]
    assert ("median 1.5 in A, -2 in B" in found) == named
    assert "grip (20% of the evidence; in how it follows the state)" in found


def test_discrete_actions_and_names_that_are_not_given():
    use = ((0.25, 0.5, 0.25), (0.75, 0.0, 0.25))
    one, two = groups_differ(GROUPS, columns(), contrast((0.9, 0.1, 0.0), use), data(discrete=True))
    assert one.endswith(": in length, pauses, smoothness and path they hardly differ.")
    assert two == (
        "The two groups: they differ most where they take action 0 (90% of the evidence; 25% of the steps of "
        "A, 75% of B)."
    )


@pytest.mark.parametrize(
    ("channel", "sign", "phrase"),
    [
        ("length", -1, "is shorter"),
        ("motion", -1, "pauses more"),
        ("smoothness", 1, "is smoother"),
        ("smoothness", -1, "is less smooth"),
        ("short_path", 1, "has a shorter path"),
    ],
)
def test_directions_of_facts(channel, sign, phrase):
    sentence = groups_differ(GROUPS, columns(**{channel: sign * UP}), contrast(), data())[0]
    assert f": B {phrase}" in sentence


def test_what_may_be_chance_is_not_said():
    mixed = np.array([0.0, 2, 4, 6, 8, 10, 12, 13, 1, 3, 5, 7, 9, 11])
    few = np.arange(2), np.arange(2, 4)
    for groups, values in ((GROUPS, mixed), (few, UP), (GROUPS, np.zeros(14))):
        assert "they hardly differ" in groups_differ(groups, columns(length=values), contrast(), data())[0]
