"""Adversaries by name, for each kind of actions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import make_continuous, refused, ridge
from rpil.data.errors import DataError
from rpil.data.spaces import Discrete
from rpil.mixture.adversaries.box import UniformBox
from rpil.mixture.adversaries.discrete import Confusion, Uniform
from rpil.mixture.adversaries.named import ADVERSARIES, adversary
from rpil.policies.linear import LinearPolicy, linear_policy

TOY = make_continuous("noisy", 0)
PROBLEM = TOY.problem()


def fresh() -> LinearPolicy:
    """A policy that has seen no data."""
    return linear_policy(PROBLEM.space, ridge(PROBLEM), len(PROBLEM.actions))


def test_names_are_those_of_adversaries():
    for space in (PROBLEM.space, Discrete(3)):
        for name in ADVERSARIES[space.kind]:
            assert adversary(name, space, fresh()).name == name


@pytest.mark.parametrize("name", ["complement", "confusion", "constant", "evil"])
def test_unknown_names(name):
    for wrong, space, words in (
        (name, PROBLEM.space, "continuous actions; choose auto, uniform, marginal"),
        ("evil", Discrete(3), "discrete actions; choose auto, constant, uniform"),
    ):
        with refused(f"'{wrong}' for {words}"):
            adversary(wrong, space, fresh())


def test_adversary_instance_is_unchanged():
    given = UniformBox(3.0)
    assert adversary(given, PROBLEM.space, fresh()) is given
    assert adversary(Uniform(), Discrete(2), fresh()) == Uniform()
    assert replace(given, log_volume=2.0).log_prob(PROBLEM.features, TOY.actions, TOY.actions)[0] == -2.0


def test_given_confusion_must_have_the_actions_of_the_data():
    given = Confusion.given(np.eye(2))
    assert adversary(given, Discrete(2), fresh()) is given
    with pytest.raises(DataError, match="2 x 2 was given for 3 actions"):
        adversary(given, Discrete(3), fresh())
