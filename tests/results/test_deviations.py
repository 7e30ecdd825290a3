"""What a demonstration does in its worst steps, compared with the actions of the trusted there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpil
from audits import make_audit
from rpil.data.demonstrations import Demonstrations
from rpil.data.spaces import Box, Discrete
from rpil.results.deviations import MAX_STEPS, deviations

RATIO = np.ones(80)
RATIO[50:56] = -2.0
AUDIT = make_audit(("typical", "unlike"), step_log_ratio=RATIO, lengths=[40, 40])


def test_most_frequent_other_action_is_named_with_the_action_of_the_trusted() -> None:
    actions = np.zeros(80, dtype=int)
    actions[50:54] = 2

    def outputs(rows: np.ndarray) -> np.ndarray:
        np.testing.assert_array_equal(np.sort(rows), np.arange(50, 56))
        return np.log(np.tile([0.2, 0.7, 0.1], (len(rows), 1)))

    phrases = deviations(AUDIT, Discrete(3), np.array(["left", "none", "right"]), actions, outputs)
    assert phrases == ("", "it takes action right where the trusted most likely take none (4 of its 6 worst steps)")
    assert replace(AUDIT, deviations=phrases).reasons[1].endswith(f": {phrases[1]}.")


def test_actions_that_the_trusted_take_too_are_no_deviation() -> None:
    phrases = deviations(
        AUDIT, Discrete(2), np.arange(2), np.zeros(80, dtype=int), lambda rows: np.log([[0.9, 0.1]] * len(rows))
    )
    assert phrases == ("", "")


def test_part_furthest_from_the_trusted_is_named_in_units_of_their_spread() -> None:
    rng = np.random.default_rng(0)
    actions = rng.normal(size=(80, 2)) * [1.0, 0.1]
    actions[50:56] = [2.0, -1.0]  # 2 and 10 standard deviations
    box = Box(np.array([-5.0, -5.0]), np.array([5.0, 5.0]))
    _, phrase = deviations(AUDIT, box, np.empty(0), actions, lambda rows: np.zeros((len(rows), 2)))
    spread = 1.4826 * np.median(np.abs(actions[:40, 1]))
    assert phrase == f"part 1 of its action is too low by {1 / spread:.1f} times the spread of the trusted"
    assert 7 < 1 / spread < 14
    _, named = deviations(AUDIT, box, np.empty(0), actions, lambda rows: np.zeros((len(rows), 2)), ("arm", "grip"))
    assert named == phrase.replace("part 1", "part grip")
    # A part that is constant among the trusted has no spread to compare with.
    wider, box = np.column_stack([actions, np.zeros(80)]), Box(np.full(3, -5.0), np.full(3, 5.0))
    _, same = deviations(AUDIT, box, np.empty(0), wider, lambda rows: np.zeros((len(rows), 3)))
    assert same == phrase


def test_no_more_than_the_worst_steps_of_a_long_stretch_are_compared() -> None:
    ratio = np.concatenate([np.ones(50), -np.linspace(1, 2, 50)])
    audit = make_audit(("typical", "unlike"), step_log_ratio=ratio, lengths=[50, 50])
    asked = []

    def outputs(rows: np.ndarray) -> np.ndarray:
        asked.extend(rows.tolist())
        return np.log([[0.9, 0.1]] * len(rows))

    _, phrase = deviations(audit, Discrete(2), np.arange(2), np.ones(100, dtype=int), outputs)
    assert sorted(asked) == list(range(100 - MAX_STEPS, 100))
    assert f"{MAX_STEPS} of its {MAX_STEPS} worst steps" in phrase


@pytest.mark.parametrize("changes", [{"finding": "nobody stands out"}, {"verdicts": ("open", "unlike")}])
def test_without_trusted_demonstrations_nothing_is_compared(changes: dict[str, object]) -> None:
    def outputs(rows: np.ndarray) -> np.ndarray:
        raise AssertionError

    assert deviations(replace(AUDIT, **changes), Discrete(2), np.arange(2), np.ones(80, dtype=int), outputs) == ()


def test_fit_names_the_corrupted_window_and_the_action_and_a_file_keeps_both(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    episodes = []
    for m in range(12):
        states = rng.normal(size=(60, 2))
        actions = np.where(states[:, 0] > 0, "right", "left")
        if m >= 9:
            actions[20:50] = "stop"
        episodes.append((states, actions))
    model = rpil.RPIL().fit(Demonstrations.from_episodes(episodes))
    assert model.audit_.verdicts[9:] == ("unlike",) * 3
    for reason in model.audit_.reasons[9:]:
        first, last = (int(word) for word in reason.partition("steps ")[2].split()[0:3:2])
        assert abs(first - 20) <= 1
        assert abs(last - 49) <= 1
        assert "it takes action stop where the trusted most likely take" in reason
    rpil.save(model, tmp_path / "model.rpil")
    assert rpil.load(tmp_path / "model.rpil").audit_.reasons == model.audit_.reasons
