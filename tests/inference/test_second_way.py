"""A second way: those that would be called unlike follow a rule of their own, also one that bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpil import RPIL
from rpil.data.demonstrations import Demonstrations
from rpil.inference.rivals import SecondWay
from rpil.inference.settings import RivalSettings


@pytest.mark.parametrize(("way", "finding"), [("own rule", "two groups"), ("noise", "some are unlike")])
def test_a_rule_that_bends_is_a_second_way_and_noise_is_none(way, finding):
    rng, episodes = np.random.default_rng(0), []
    for m in range(40):
        states = np.cumsum(rng.normal(0, 0.3, (60, 4)), axis=0)
        bent = np.tanh(states[:, 2:]) * np.sign(states[:, :2])
        other = bent if way == "own rule" else rng.normal(size=(60, 2))
        episodes.append((states, (other if m < 12 else states[:, :2]) + rng.normal(0, 0.05, (60, 2))))
    audit = RPIL("folded").fit(Demonstrations.from_episodes(episodes)).audit_
    assert audit.finding == finding
    assert [m for m in range(40) if audit.verdicts[m] == "unlike"] == ([] if way == "own rule" else [*range(12)])
    assert audit.identifiable is (way == "noise")
    assert [set(group) for group in audit.competing] == ([{*range(12, 40)}, {*range(12)}] if way == "own rule" else [])


OWN = SecondWay(gain=1.0, of_upper=2.0, shared=0.9, is_worse=False, is_credible=True, limits=RivalSettings())


@pytest.mark.parametrize(
    ("changes", "is_there"),
    [
        ({}, True),  # as strong as a third of the policy of the upper group, and stronger than that group's on these
        ({"is_credible": False}, False),
        ({"is_worse": True}, False),  # a noisy version of the policy of the upper group
        ({"shared": 1.1}, True),  # by chance
        ({"of_upper": 3.1}, False),  # weak, and shared
        ({"of_upper": 3.1, "shared": 0.4}, True),  # weak, and not shared
        ({"gain": 0.1, "of_upper": 3.1, "shared": 0.04, "is_credible": False}, False),
    ],
)
def test_a_second_way_is_strong_or_not_shared(changes, is_there):
    assert replace(OWN, **changes).is_there is is_there
