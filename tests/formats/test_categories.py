"""Observations that are text, and last actions as observations."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

import rpil
from episode_rows import PHASES, N, T, episodes, written
from rpil.data.errors import DataError


@pytest.mark.parametrize("on_disk", [False, True])
@pytest.mark.parametrize("suffix", ["csv", "parquet", "folder"])
@pytest.mark.parametrize("history", [0, 2])
def test_text_and_last_actions_are_the_same_observations_everywhere(history, suffix, on_disk, tmp_path):
    table = episodes()
    read = rpil.open(written(table, suffix, tmp_path), history=history, on_disk=on_disk).demonstrations
    assert isinstance(read, rpil.Dataset) == on_disk
    last = ("action[-1]", "action[-2]")[:history]
    assert read.observation_names == ("phase=grasp", "phase=lift", "phase=reach", "x", *last)
    some = read.select([5, 1, 2])
    own = table.filter(pa.array(np.isin(np.repeat(np.arange(N), T), [1]))).to_pydict()
    observations, actions = some.episode(1)
    np.testing.assert_array_equal(observations[:, :3], np.array(own["phase"])[:, None] == ["grasp", "lift", "reach"])
    np.testing.assert_array_equal(observations[:, 3], own["x"])
    for k in range(1, history + 1):
        np.testing.assert_array_equal(observations[:k, 3 + k], 0)
        np.testing.assert_array_equal(observations[k:, 3 + k], actions[:-k, 0])


def test_each_discrete_action_is_a_number_of_the_last_ones():
    moves = np.tile(["left", "right", "left", "stop", "right"], N * T // 5)
    only = episodes(action=moves, x=None, phase=None, time_s=None)
    read = rpil.read(only, history=1)
    assert read.observation_names == ("action[-1]=left", "action[-1]=right", "action[-1]=stop")
    assert read.observations[:4].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]]
    assert not read.observations[::T].any()
    with pytest.raises(DataError, match="no column holds observations"):
        rpil.read(only)
    with pytest.raises(DataError, match="history= is -1; give the number of last actions"):
        rpil.read(only, history=-1)
    with pytest.raises(DataError, match=f"demonstrations have at most {T} steps; give history= fewer"):
        rpil.read(only, history=T)


@pytest.mark.parametrize(
    ("texts", "options", "is_read"),
    [
        ({"phase": PHASES[np.arange(N * T) // T % 3]}, {}, False),  # describes the episodes
        ({"phase": PHASES[np.arange(N * T) // T % 3]}, {"observations": ["phase", "x"]}, True),
        ({"observation.phase": PHASES[np.arange(N * T) // T % 3], "observation.x": np.arange(N * T) / 7}, {}, True),
        ({"phase": [f"p{k % 21}" for k in range(N * T)]}, {}, False),
        ({"phase": [f"p{k % 20}" for k in range(N * T)]}, {}, True),
        ({"phase": [f"a sentence with {k % 5} of more than forty letters" for k in range(N * T)]}, {}, False),
        ({"reward_note": PHASES[np.arange(N * T) % 3]}, {}, False),
        ({"phase": ["p0"] * 150 + [f"p{k}" for k in range(150)]}, {}, False),  # of which a table has the first alone
    ],
)
def test_which_text_is_observed(texts, options, is_read, tmp_path, monkeypatch):
    monkeypatch.setattr("rpil.formats.arrow.GUESSED_ROWS", 140)
    name, *_ = texts
    recording = rpil.open(episodes(**{"phase": None} | texts), **options)
    assert any("=" in one for one in recording.demonstrations.observation_names) == is_read
    assert is_read or recording.description.ignored[name] == "text"


def test_few_rows_tell_nothing_of_many_texts():
    table = episodes(phase=[f"p{k % 15}" for k in range(N * T)])
    assert rpil.open(table.slice(0, 125)).description.ignored["phase"] == "text"
    assert rpil.open(table.slice(0, 150)).demonstrations.n_observations == 16


def test_a_text_that_is_missing_is_a_missing_value():
    phases = [*PHASES[np.arange(N * T) // 5 % 3]]
    phases[30] = None
    with pytest.raises(DataError, match="demonstration 'e1', step 5: observation 'phase=grasp' is nan"):
        rpil.read(episodes(phase=phases))
    assert len(rpil.open(episodes(phase=phases), skip_bad=True).demonstrations) == N - 1
    assert [found.rule for found in rpil.check(episodes(phase=phases)).findings][:1] == ["missing values"]


def test_classes_and_numbers_of_an_action_are_last_ones_each_as_it_is():
    rng = np.random.default_rng(1)
    skill = np.array(["pick", "place"])[rng.integers(2, size=N * T)]
    table = episodes(action=None, phase=None, **{"action.skill": skill, "action.angle": rng.normal(size=N * T)})
    read = rpil.read(table, action=["action.skill", "action.angle"], history=1)
    assert read.observation_names == ("x", "action.skill[-1]=pick", "action.skill[-1]=place", "action.angle[-1]")
    np.testing.assert_array_equal(read.observations[1:T, 1:3], skill[: T - 1, None] == ["pick", "place"])
    np.testing.assert_array_equal(read.observations[1:T, 3], table["action.angle"].to_numpy()[: T - 1])
