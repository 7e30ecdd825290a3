"""Adversaries by name, for each kind of actions."""

import numpy as np
import pytest

from problems import make_continuous, refused, ridge
from rpil.data.spaces import Discrete
from rpil.mixture.adversaries.box import UniformBox
from rpil.mixture.adversaries.discrete import Confusion, Uniform
from rpil.mixture.adversaries.named import ADVERSARIES, adversary
from rpil.policies.linear import linear_policy

PROBLEM = make_continuous("noisy", 0).problem()
FRESH = linear_policy(PROBLEM.space, ridge(PROBLEM), len(PROBLEM.actions))


@pytest.mark.parametrize("name", ["complement", "confusion", "constant", "evil"])
def test_names_are_those_of_adversaries_and_others_are_refused(name):
    for space in (PROBLEM.space, Discrete(3)):
        for known in ADVERSARIES[space.kind]:
            assert adversary(known, space, FRESH).name == known
    with refused(f"'{name}' for continuous actions; choose auto, uniform, marginal"):
        adversary(name, PROBLEM.space, FRESH)
    with refused("'evil' for discrete actions; choose auto, constant, uniform"):
        adversary("evil", Discrete(3), FRESH)


def test_an_instance_is_unchanged_and_a_confusion_must_have_the_actions_of_the_data():
    box, confusion = UniformBox(3.0), Confusion.given(np.eye(2))
    assert adversary(box, PROBLEM.space, FRESH) is box
    assert adversary(Uniform(), Discrete(2), FRESH) == Uniform()
    assert adversary(confusion, Discrete(2), FRESH) is confusion
    with refused("2 x 2 was given for 3 actions"):
        adversary(confusion, Discrete(3), FRESH)
