"""The parts of the action that hold the evidence, and the band of the rest around them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge

import rpil
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.estimators.task import Task
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import Judgement, judge
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.results.evidence import by_held_out_policies

NAMES = ("shoulder", "elbow", "wrist")
BAD = range(16, 20)


def episodes(n_steps: int = 60, discrete: bool = False, stop: int = 50) -> list[tuple[np.ndarray, np.ndarray]]:
    """Twenty demonstrations; in steps 20 to 49 the elbow of the last four is off by 2, or they take another action."""
    rng = np.random.default_rng(0)
    found = []
    for m in range(20):
        states = rng.normal(size=(n_steps, 3))
        actions = states @ np.array([[1, 0, 0.5], [0, 1, 0], [0, 1, 1.0]])
        actions += rng.normal(size=actions.shape) * [0.2, 0.3, 0.4]
        off = slice(20, stop) if m in BAD else slice(0)
        actions[off] += [0.0, 2.0, 0.3]
        words = np.where(states[:, 0] > 0, "right", "left")
        words[off] = "stop"
        found.append((states, words if discrete else actions))
    return found


def demonstrations(**options: object) -> Demonstrations:
    found = Demonstrations.from_episodes(episodes(**options))
    return found if options.get("discrete") else replace(found, action_names=NAMES)


def judged() -> tuple[Judgement, FitData]:
    given = demonstrations()
    task = Task.of(given)
    features = FeatureMap.fit("folded", given.observations, settings=FeatureSettings())
    data = task.data(given, features)
    return judge(data, held_out_model(data, HeldOutSettings()), JudgeSettings()), data


def test_the_parts_sum_to_the_log_ratios_of_the_judge_less_those_of_the_median_of_the_rest() -> None:
    judgement, data = judged()
    compared = by_held_out_policies(judgement, held_out_model(data, HeldOutSettings()), None, HeldOutSettings())
    less = judgement.log_ratio - compared.nats.sum(axis=1)
    # The errors of the rest have another scale than those of the demonstrations that taught the policies.
    assert np.ptp(less) < 0.02 * np.ptp(judgement.log_ratio)
    np.testing.assert_array_equal(np.flatnonzero(judgement.claims.lower), BAD)
    rest = ~judgement.claims.lower
    np.testing.assert_allclose(np.median(data.sum_steps(compared.nats)[rest], axis=0), 0, atol=1e-9)


def test_the_band_holds_nine_in_ten_steps_where_policies_learn_their_own_steps_by_heart() -> None:
    """There is a feature for every few steps: of steps that a policy learned from, the errors are smaller."""
    rng = np.random.default_rng(1)
    features = np.column_stack([rng.normal(size=(300, 60)), np.ones(300)])
    actions, box = rng.normal(size=(300, 1)), Box(np.full(1, -9.0), np.full(1, 9.0))
    data = FitData(features, actions, np.arange(0, 301, 12), box, np.zeros(25, dtype=int))
    judgement = judge(data, held_out_model(data, HeldOutSettings()), JudgeSettings())
    compared = by_held_out_policies(judgement, held_out_model(data, HeldOutSettings()), None, HeldOutSettings())
    learned = actions - features @ np.linalg.lstsq(features, actions, rcond=None)[0]
    true = 2 * 1.645
    assert np.diff(np.quantile(learned, [0.05, 0.95]))[0] < 0.9 * true
    assert 0.97 * true < np.median(compared.high - compared.low) < 1.1 * true


@pytest.mark.parametrize("own", [None, Ridge()])
def test_the_part_with_the_fault_is_named(own: object) -> None:
    audit = rpil.RPIL(policy=own).fit(demonstrations(n_steps=100, stop=100)).audit_
    assert all(re.fullmatch(r"at step \d+: elbow is .*; others there have .*", audit.deviations[m]) for m in BAD)


@pytest.mark.parametrize("own", [None, LogisticRegression()])
def test_the_action_that_others_do_not_take_is_named(own: object) -> None:
    audit = rpil.RPIL(policy=own).fit(demonstrations(n_steps=100, discrete=True, stop=100)).audit_
    assert all("it takes action stop where others mostly take another" in audit.deviations[m] for m in BAD)
