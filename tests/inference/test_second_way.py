"""A second way: those that would be called outliers follow a rule of their own, also one that bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hand_made import Written, same_actions
from rpil import RPIL
from rpil.data.demonstrations import Demonstrations
from rpil.inference import rivals
from rpil.inference.rivals import SecondWay
from rpil.inference.settings import JudgeSettings, RivalSettings


@pytest.mark.parametrize(("way", "finding"), [("own rule", "two groups"), ("noise", "outliers")])
def test_a_rule_that_bends_is_a_second_way_and_noise_is_none(way, finding):
    rng, episodes = np.random.default_rng(0), []
    for m in range(40):
        states = np.cumsum(rng.normal(0, 0.3, (60, 4)), axis=0)
        bent = np.tanh(states[:, 2:]) * np.sign(states[:, :2])
        other = bent if way == "own rule" else rng.normal(size=(60, 2))
        episodes.append((states, (other if m < 12 else states[:, :2]) + rng.normal(0, 0.05, (60, 2))))
    audit = RPIL("folded").fit(Demonstrations.from_episodes(episodes)).audit_
    assert audit.finding == finding
    assert [m for m in range(40) if audit.verdicts[m] == "outlier"] == ([] if way == "own rule" else [*range(12)])
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


UPPER = np.arange(8) < 4


def second_way(monkeypatch, of_upper, own, shared, **limits):
    """Of the last four of eight demonstrations: gains by the policy of the upper group, by their own, and shared."""
    settings = JudgeSettings(rivals=replace(RivalSettings(), **limits))
    gains = {True: np.append([of_upper] * 4, [-9.0] * 4), False: np.append([-9.0] * 4, own)}
    seen = []

    def written(few, seed, held_out):
        seen.append(
            Written(few, lambda group: gains[bool(group[0])], settings, gains_at=lambda group: np.full(8, shared))
        )
        return seen[0]

    monkeypatch.setattr(rivals, "held_out_model", written)
    return SecondWay.of(same_actions(8), UPPER, ~UPPER, settings), seen[0]


def test_gains_of_a_second_way_by_hand(monkeypatch):
    found, model = second_way(monkeypatch, 2.0, [0.9, 1.0, 1.1, 1.0], 0.7)
    assert (found.gain, found.of_upper, found.shared) == pytest.approx((1.0, 2.0, 0.7))
    assert (found.is_credible, found.is_worse) == (True, False)
    assert second_way(monkeypatch, -2.0, [1.0] * 4, 0.7)[0].of_upper == 0.0
    ((fitted_to, scale_of),) = (pair for one in model.copies for pair in one.scaled)
    assert (fitted_to.tolist(), scale_of.tolist()) == (UPPER.tolist(), (~UPPER).tolist())


SPREAD = [0.3, 0.4, 0.5, 0.6]  # the robust standard error is 1.858 x .1 / 2 = .0929, and .45 is 4.84 of it


@pytest.mark.parametrize(
    ("own", "limit", "credible"),
    [([0.21] * 4, 2, True), ([0.19] * 4, 2, False), ([-1.0] * 4, 2, False), (SPREAD, 4.8, True), (SPREAD, 4.9, False)],
)
def test_a_second_way_gains_more_than_noise_does_and_than_its_standard_errors(monkeypatch, own, limit, credible):
    assert second_way(monkeypatch, 2.0, own, 0.0, standard_errors=limit)[0].is_credible is credible


@pytest.mark.parametrize(("shared", "is_worse"), [(0.9, False), (1.1, True)])
def test_a_noisy_version_gains_less_by_its_own_policy(monkeypatch, shared, is_worse):
    assert second_way(monkeypatch, 2.0, [1.0] * 4, shared)[0].is_worse is is_worse


@pytest.mark.parametrize(
    ("limits", "n"), [({"max_steps": 11}, 3), ({"max_steps": 10}, 2), ({"max_entries": 20}, 2), ({}, 4)]
)
def test_few_steps_of_either_group_are_enough(monkeypatch, limits, n):
    """Demonstrations of five steps with two features: so many of each group that the last begins before the limit."""
    data = same_actions(8)
    most = min(RivalSettings(**limits).max_steps, RivalSettings(**limits).max_entries // data.features.shape[1])
    few, lower = rivals._sample(data, UPPER, ~UPPER, most)
    assert (few.n_demonstrations, lower.tolist()) == (2 * n, [False] * n + [True] * n)
