"""One pass over the rows: what the parts of the action are, and columns that repeat the last action, are found."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

import rpil
from rpil import DataError


def described(monkeypatch, batch=100, names=("moves", "last", "still"), last=None, **options):
    """Two demonstrations of 20 steps whose observation ``last`` is the action of the step before."""
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    action = np.random.default_rng(0).normal(size=(40, 2))
    before = np.concatenate([np.zeros((1, 2)), action[:-1]])
    before[20] = 0.0
    if last:
        before = last(before)
    values = {"moves": action + 1, "last": before, "still": np.zeros((40, 2))}
    columns = {"episode": np.repeat([0, 1], 20), "action": action.tolist()}
    table = pa.table(columns | {f"obs.{name}": values[name].tolist() for name in names})
    return rpil.open(table, **options).describe()


@pytest.mark.parametrize("batch", [1, 7, 20, 100])
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
SKILL, BUTTON, DIAL, SPEED = (
    RNG.choice(["go", "stop"], STEPS),
    RNG.integers(3, size=STEPS),
    *RNG.normal(size=(2, STEPS)),
)


def opened(parts, **options):
    """Four demonstrations with these columns of the action."""
    table = pa.table({"episode": np.repeat(range(4), STEPS // 4), "state": RNG.normal(size=STEPS), **parts})
    return rpil.open(table, **options)


@pytest.mark.parametrize("batch", [7, 1000])
@pytest.mark.parametrize(
    ("parts", "options", "classes"),
    [
        ({"action.dial": DIAL, "action.skill": SKILL}, {}, (("go", "stop"), ())),
        ({"action.b": BUTTON, "action.c": BUTTON % 2}, {}, ((0, 1, 2), (0, 1))),
        ({"action.b": BUTTON.astype(float), "action.c": 1.0 * (BUTTON % 2)}, {}, ((0, 1, 2), (0, 1))),
        ({"action.b": BUTTON, "action.dial": DIAL}, {}, ()),
        ({"action.b": BUTTON, "action.dial": DIAL}, {"action_kind": "discrete"}, ((0, 1, 2), ())),
        ({"action.b": BUTTON, "action.c": np.arange(STEPS)}, {}, ((0, 1, 2), ())),
        ({"action.b": BUTTON, "action.c": BUTTON}, {"action_kind": "continuous"}, ()),
        ({"action.skill": SKILL, "action.to": np.stack([DIAL, SPEED], 1).tolist()}, {}, (("go", "stop"), (), ())),
        ({"action": np.stack([BUTTON, BUTTON % 2], 1).tolist()}, {}, ((0, 1, 2), (0, 1))),
        ({"action": np.stack([BUTTON, BUTTON % 2], 1).tolist()}, {"exclude": "action.1"}, ()),
        ({"action": np.stack([BUTTON, 1.0 * (BUTTON % 2)], 1).tolist()}, {}, ()),
        ({"action": np.stack([BUTTON, DIAL], 1).tolist()}, {"action_kind": "discrete"}, None),
        ({"skill": SKILL, "dial": DIAL}, {"action": "dial,skill"}, (("go", "stop"), ())),
    ],
)
def test_which_parts_of_an_action_are_classes(parts, options, classes, batch, monkeypatch):
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    recording = opened(parts, **options)
    if classes is None:
        with pytest.raises(DataError, match="not whole, which cannot be discrete"):
            len(recording.demonstrations)
        return
    found = recording.demonstrations
    assert found.part_classes == classes
    if classes:
        kind = recording.describe().action_kind
        assert kind == ("discrete" if all(classes) else "discrete and continuous")
        for name, values in zip(found.action_names, found.action_values, strict=True):
            if name in parts:
                np.testing.assert_array_equal(values, parts[name])


def test_one_text_with_the_prefix_of_an_action_is_the_action():
    assert opened({"action.skill": SKILL}).demonstrations.classes.tolist() == ["go", "stop"]


@pytest.mark.parametrize("name", ["action", "action.word"])
@pytest.mark.parametrize("batch", [7, 1000])
def test_rare_texts_are_one_class(name, batch, monkeypatch):
    monkeypatch.setattr("rpil.formats.rows.BATCH_ROWS", batch)
    words = np.where(np.arange(STEPS) % 2 > 0, SKILL, [f"remark {k}" for k in range(STEPS)])
    parts = {name: words} | ({"action.dial": DIAL} if name != "action" else {})
    recording = opened(parts)
    known = np.where(np.arange(STEPS) % 2 > 0, SKILL, "(rare)")
    found = recording.demonstrations
    np.testing.assert_array_equal(found.actions if name == "action" else found.action_values[0], known)
    said = f"{name}: 2 of 62 texts are classes, all others (50% of the steps) one, (rare)."
    assert said in recording.describe().notes


def test_a_text_cannot_be_a_number():
    with pytest.raises(DataError, match="the actions are text, which cannot be continuous"):
        opened({"action.dial": DIAL, "action.skill": SKILL}, action_kind="continuous").demonstrations.select(0)


def test_a_missing_class_is_named():
    skill = SKILL.tolist()
    skill[33] = None
    with pytest.raises(DataError, match=r"demonstration 1.*column 'action.skill' has no value"):
        opened({"action.dial": DIAL, "action.skill": skill}).demonstrations.select(0)
    kept = opened({"action.dial": DIAL, "action.skill": skill}, skip_bad=True).demonstrations
    assert kept.ids == (0, 2, 3)
