"""The parts of the action that hold the evidence, and the band of the rest around them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge

import rpil
from audits import make_audit
from rpil.data.copies import Copies
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.estimators.task import Task
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import Judgement, judge
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.results.summary import StepEvidence, by_held_out_policies, deviations

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
    return found if options.get("discrete") else replace(found, action_names=("shoulder", "elbow", "wrist"))


def judged() -> tuple[Judgement, FitData]:
    given = demonstrations()
    task = Task.of(given)
    features = FeatureMap.fit("folded", given.observations, settings=FeatureSettings())
    data = task.data(given, features)
    return judge(data, held_out_model(data, HeldOutSettings()), JudgeSettings()), data


def by_judgement(judgement: Judgement, data: FitData) -> StepEvidence:
    model, copies = held_out_model(data, HeldOutSettings()), Copies.of(np.arange(data.n_demonstrations))
    return by_held_out_policies(judgement, model, copies, HeldOutSettings())


def test_the_parts_sum_to_the_log_ratios_of_the_judge_less_those_of_the_median_of_the_rest() -> None:
    judgement, data = judged()
    compared = by_judgement(judgement, data)
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
    compared = by_judgement(judgement, data)
    learned = actions - features @ np.linalg.lstsq(features, actions, rcond=None)[0]
    true = 2 * 1.645
    assert np.diff(np.quantile(learned, [0.05, 0.95]))[0] < 0.9 * true
    assert 0.97 * true < np.median(compared.high - compared.low) < 1.1 * true


IS_OFF = r"at step \d+: elbow is .*; others there have .*"
IS_STOP = ".*it takes action stop where others mostly take another.*"


@pytest.mark.parametrize(
    ("own", "words"), [(None, IS_OFF), (Ridge(), IS_OFF), (None, IS_STOP), (LogisticRegression(), IS_STOP)]
)
def test_the_part_with_the_fault_and_the_action_that_others_do_not_take_are_named(own: object, words: str) -> None:
    audit = rpil.RPIL(policy=own).fit(demonstrations(n_steps=100, discrete=words == IS_STOP, stop=100)).audit_
    assert all(re.fullmatch(words, audit.deviations[m]) for m in BAD)


RATIO = np.ones(80)
RATIO[50:56] = -2.0
AUDIT = make_audit(("open", "outlier"), step_log_ratio=RATIO, lengths=[40, 40])


def compared(actions: np.ndarray, names: tuple[str, ...] = (), proba: np.ndarray | None = None) -> StepEvidence:
    """Discrete actions with a probability of 0.3, or `proba`; or continuous ones beside a policy with the mean 0."""
    n_parts = actions.shape[1] if actions.ndim > 1 else 0
    space = Box(np.full(n_parts, -99.0), np.full(n_parts, 99.0)) if n_parts else Discrete(3)
    offsets, labels = np.array([0, len(actions) // 2, len(actions)]), np.zeros(2, dtype=int)
    data = FitData(np.ones((len(actions), 1)), actions, offsets, space, labels, action_names=names)
    chance = np.full(len(actions), 0.3) if proba is None else proba
    expected = np.zeros((len(actions), n_parts)) if n_parts else np.log(chance)
    return StepEvidence.of(data, np.arange(2), expected, np.array([True, False]), HeldOutSettings())


def test_most_frequent_action_that_the_trusted_mostly_do_not_take_is_named() -> None:
    actions = np.zeros(80, dtype=int)
    actions[50:54] = 2
    proba = np.where(actions == 2, 0.1, 0.8)
    phrases = deviations(AUDIT, compared(actions, proba=proba), np.array(["left", "none", "right"]))
    assert phrases == ("", "it takes action right where others mostly take another (4 of its 6 worst steps)")
    assert replace(AUDIT, deviations=phrases).reasons[1].endswith(f": {phrases[1]}.")


def phrase_of(actions: np.ndarray, names: tuple[str, ...] = ()) -> str:
    return deviations(AUDIT, compared(actions, names), np.empty(0))[1]


def test_part_with_most_of_the_evidence_is_named_with_its_value_beside_the_band_of_the_trusted() -> None:
    rng = np.random.default_rng(0)
    actions = rng.normal(size=(80, 2)) * [1.0, 10.0]
    actions[50:56] = [2.0, -70.0]  # 2 and 7 standard deviations
    low, high = np.quantile(actions[:40, 1], [0.05, 0.95])
    said = f"is -70; others there have {low:.0f} to {high:.0f}"
    phrase = phrase_of(actions, ("arm", "elbow"))
    assert re.fullmatch(rf"at step 1[0-5]: elbow {re.escape(said)}", phrase)
    assert phrase_of(actions) == phrase.replace("elbow", "action part 1")
    assert phrase_of(actions[:, 1:]) == phrase.replace("elbow", "action")
    # A part that is constant holds no evidence.
    assert phrase_of(np.column_stack([actions, np.zeros(80)]), ("arm", "elbow", "grip")) == phrase


@pytest.mark.parametrize(
    ("value", "low", "high", "said"),
    [
        (41.3, 55.2, 61.8, "41; others there have 55 to 62"),
        (0.5, 0.512, 0.561, "0.50; others there have 0.51 to 0.56"),
        (3.0, 0.0, 0.0, "3; others there have 0"),
    ],
)
def test_values_have_the_digits_that_tell_them_apart(value: float, low: float, high: float, said: str) -> None:
    actions = np.repeat([low, high, value, value], 20)[:, None]
    actions[:40] = np.tile([low, high], 20)[:, None]
    assert f" is {said}" in phrase_of(actions)


def test_what_stays_within_the_band_is_no_deviation() -> None:
    actions = np.tile([-1.0, 1.0], 40)[:, None]
    assert phrase_of(actions) == ""


@pytest.mark.parametrize(
    "changes", [{"finding": "no outliers"}, {"anchor": "answers", "finding": "answered", "verdicts": ("open", "bad")}]
)
def test_without_trusted_demonstrations_nothing_is_compared(changes: dict[str, object]) -> None:
    assert deviations(replace(AUDIT, **changes), compared(np.ones(80, dtype=int)), np.arange(2)) == ()
