"""What a demonstration does in its worst steps, compared with the actions of the trusted there."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.settings import HeldOutSettings
from rpil.results.evidence import MAX_STEPS, StepEvidence, deviations

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


def test_actions_that_the_trusted_take_too_are_no_deviation() -> None:
    actions = np.zeros(80, dtype=int)
    assert deviations(AUDIT, compared(actions, proba=np.full(80, 0.9)), np.arange(2)) == ("", "")


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


@pytest.mark.parametrize("still", [0.0, 12.5])
def test_a_part_that_moves_in_the_others_alone_is_named_first(still: float) -> None:
    actions = np.random.default_rng(0).normal(size=(120, 2)) * [1.0, 10.0]
    actions[90:96, 0] = 9.0  # most of the evidence
    assert "arm is 9" in phrase_of(actions[40:], ("arm", "elbow"))
    actions[80:, 1] = still
    offsets, labels = np.array([0, 40, 80, 120]), np.zeros(3, dtype=int)
    box = Box(np.full(2, -99.0), np.full(2, 99.0))
    data = FitData(np.ones((120, 1)), actions, offsets, box, labels, action_names=("arm", "elbow"))
    audit = make_audit(("open", "open", "outlier"), step_log_ratio=np.append(np.ones(40), RATIO), lengths=[40, 40, 40])
    rest = np.array([True, True, False])
    evidence = StepEvidence.of(data, np.arange(3), np.zeros((120, 2)), rest, HeldOutSettings())
    phrases = deviations(audit, evidence, np.empty(0))
    assert phrases == ("", "", f"elbow stays at {still:g}, and moves in the others")


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


def test_no_more_than_the_worst_steps_of_a_long_stretch_are_compared() -> None:
    ratio = np.concatenate([np.ones(50), -np.linspace(1, 2, 50)])
    audit = make_audit(("open", "outlier"), step_log_ratio=ratio, lengths=[50, 50])
    _, phrase = deviations(audit, compared(np.ones(100, dtype=int)), np.arange(2))
    assert f"{MAX_STEPS} of its {MAX_STEPS} worst steps" in phrase


@pytest.mark.parametrize(
    "changes",
    [{"finding": "no outliers"}, {"anchor": "answers", "finding": "answered", "verdicts": ("open", "bad")}],
)
def test_without_trusted_demonstrations_nothing_is_compared(changes: dict[str, object]) -> None:
    assert deviations(replace(AUDIT, **changes), compared(np.ones(80, dtype=int)), np.arange(2)) == ()
