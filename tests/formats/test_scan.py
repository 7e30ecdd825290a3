"""One pass over the rows: what the parts of the action are, and columns that repeat the last action, are found."""

import numpy as np
import pyarrow as pa
import pytest

import rpil
from rpil import DataError


def described(monkeypatch, batch=100, names=("moves", "last", "still"), last=None, **options):
    """Two demonstrations of 20 steps whose observation ``last`` is the action of the step before."""
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", batch)
    action = np.random.default_rng(0).normal(size=(40, 2))
    before = np.concatenate([np.zeros((1, 2)), action[:-1]])
    before[20] = 0.0
    if last:
        before = last(before)
    values = {"moves": action + 1, "last": before, "still": np.zeros((40, 2))}
    columns = {"episode": np.repeat([0, 1], 20), "action": action.tolist()}
    table = pa.table(columns | {f"obs.{name}": values[name].tolist() for name in names})
    return rpil.open(table, **options).description


@pytest.mark.parametrize("batch", [7, 100])
def test_a_column_that_repeats_the_last_action_is_no_observation(batch, monkeypatch):
    said = described(monkeypatch, batch)
    assert said.observations == ("moves.0", "moves.1", "still.0", "still.1")
    assert said.ignored["obs.last"] == "it repeats the last action"
    assert not any("last" in name for name in said.ranges)


@pytest.mark.parametrize(
    "options",
    [
        {"last": lambda before: 0 * before},
        {"last": lambda before: before + 9 * (np.arange(40) == 30)[:, None], "batch": 7},
        {"names": ["last"]},
        {"observations": "obs.last"},
    ],
)
def test_a_column_that_repeats_it_almost_or_that_is_all_there_is_stays(options, monkeypatch):
    assert "last.0" in described(monkeypatch, **options).observations


STEPS = 120
RNG = np.random.default_rng(1)
SKILL, BUTTON = RNG.choice(["go", "stop"], STEPS), RNG.integers(3, size=STEPS)
DIAL, SPEED = RNG.normal(size=(2, STEPS))


def opened(parts, **options):
    """Four demonstrations with these columns of the action."""
    table = pa.table({"episode": np.repeat(range(4), STEPS // 4), "state": RNG.normal(size=STEPS), **parts})
    return rpil.open(table, **options)


@pytest.mark.parametrize(
    ("parts", "options", "reason"),
    [
        ({"action.b": BUTTON, "action.c": BUTTON % 2}, {}, "2 numbers"),
        ({"action.b": BUTTON, "action.c": BUTTON}, {"action_kind": "continuous"}, "2 numbers"),
        ({"action.b": BUTTON}, {}, "a column of a continuous action"),
        ({"action": np.stack([BUTTON, BUTTON % 2], 1).tolist()}, {"exclude": "action.1"}, "a column of a"),
        ({"skill": SKILL, "dial": DIAL, "speed": SPEED}, {"action": "dial,speed"}, "2 numbers"),
    ],
)
def test_several_columns_of_numbers_are_continuous(parts, options, reason, monkeypatch):
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 7)
    recording = opened(parts, **options)
    said, found = recording.description, recording.demonstrations
    assert (said.action_kind, found.is_discrete) == ("continuous", False)
    assert said.action_reason.startswith(reason)
    for name, values in zip(found.action_names, found.actions.T, strict=True):
        if name in parts:
            np.testing.assert_array_equal(values, parts[name])


@pytest.mark.parametrize(
    ("parts", "options", "said"),
    [
        ({"action.dial": DIAL, "action.skill": SKILL}, {}, "action.skill (text), action.dial (numbers)"),
        ({"action.skill": SKILL, "action.hand": SKILL}, {}, "action.skill, action.hand (text); name"),
        (
            {"action.skill": SKILL, "action.to": np.stack([DIAL, SPEED], 1).tolist()},
            {},
            "action.skill (text), action.to.0, action.to.1 (numbers)",
        ),
        ({"action.b": BUTTON, "action.dial": DIAL}, {"action_kind": "discrete"}, "action.b, action.dial (numbers)"),
    ],
)
def test_of_an_action_with_classes_among_its_parts_one_must_be_named(parts, options, said, monkeypatch):
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 7)
    recording = opened(parts, **options)
    with pytest.raises(DataError, match=r"^the frame: the action has several parts: ") as caught:
        len(recording.demonstrations)
    assert said in str(caught.value)
    assert str(caught.value).endswith("; name the part to judge with action=.")
    assert caught.value.in_shell.endswith("; name the part to judge with --action.")
    described = recording.description
    assert (described.action_kind, said.split(";")[0] in described.action_reason) == ("refused", True)


LIST = {"action": np.stack([BUTTON, DIAL], 1).tolist()}


@pytest.mark.parametrize(
    ("parts", "options", "classes"),
    [
        ({"action.dial": DIAL, "action.skill": SKILL}, {"action": "action.skill"}, ["go", "stop"]),
        ({"action.skill": SKILL}, {}, ["go", "stop"]),
        ({"action.b": BUTTON, "action.dial": DIAL}, {"action": "action.b"}, [0, 1, 2]),
        (LIST, {"action": "action.0", "action_kind": "discrete"}, [0, 1, 2]),
        ({"action": BUTTON[:, None].astype(float).tolist()}, {"action_kind": "discrete"}, [0, 1, 2]),
    ],
)
def test_a_part_that_is_named_may_be_discrete(parts, options, classes):
    found = opened(parts, **options).demonstrations
    assert found.classes.tolist() == classes
    assert found.actions.tolist() == (SKILL if classes[0] == "go" else BUTTON).tolist()


def test_a_text_cannot_be_a_number_nor_a_number_that_is_not_whole_a_class():
    with pytest.raises(DataError, match="the actions are text, which cannot be continuous"):
        opened({"action.skill": SKILL}, action_kind="continuous").demonstrations.select(0)
    with pytest.raises(DataError, match="not whole, which cannot be discrete"):
        len(opened(LIST, action="action.1", action_kind="discrete").demonstrations)
