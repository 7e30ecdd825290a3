"""Worlds of a disc that is pushed, worlds that are kept, and the cells of the report, by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import policy_value
from value import cells, pushing
from value.rules import ALL, RULES, Judged, weights_of
from value.worlds import DISC_TASKS, OLDER_TASKS, TASKS, family, make_world


@pytest.mark.parametrize("task", DISC_TASKS)
def test_a_mixture_has_its_share_of_others(task):
    """Recorded careless episodes succeed, though most careless episodes do not; a second way is good."""
    mixture = pushing.MIXTURES[task.removeprefix("disc ")]
    world = make_world(task, 24, 0.25, 3)
    others = np.isin(world.kinds, mixture.others)
    assert family(task) == "disc"
    assert others.sum() == 6
    assert set(np.array(world.kinds)[~others]) == set(mixture.usual)
    np.testing.assert_array_equal(world.is_good, ~others | (task == "disc second way"))
    for m, kind in enumerate(world.kinds):
        assert world.success[m] or not pushing.DRIVERS[kind].must_succeed
    again = make_world(task, 24, 0.25, 3)
    np.testing.assert_array_equal(again.demonstrations.actions, world.demonstrations.actions)


def test_weights_that_are_equal_but_for_rounding_share_a_policy(monkeypatch):
    world = make_world("disc slow", 4, 0.5, 0)
    n_steps = world.demonstrations.n_steps
    nearly = SimpleNamespace(step_weight=0.3 + 1e-15 * np.arange(n_steps))
    judged = Judged(world.demonstrations)
    monkeypatch.setitem(vars(judged), "audit", nearly)
    np.testing.assert_array_equal(weights_of(RULES["step weights"], world, judged, 0), np.ones(n_steps))


def rows_of(rule, values, share=0.5, task="disc careless"):
    key = {"n": 400, "share": share, "task": task, "learner": "network", "rule": rule}
    return [key | {"seed": seed, "success": value} for seed, value in enumerate(values)]


def test_the_worst_cell_has_the_lowest_lower_end():
    """A mean of -10 with a wide interval is worse than one of -20 with none; t(.975, 2) = 4.303. A seed that one rule
    has alone is not compared."""
    rows = rows_of(ALL, [0.8, 0.8, 0.8]) + rows_of("keep", [0.6, 0.6, 0.6])
    rows += rows_of(ALL, [0.8] * 4, 0.9) + rows_of("keep", [0.6, 0.7, 0.8], 0.9)
    rows += rows_of(ALL, [0.8, 0.8], 0.25) + rows_of("keep", [0.0, 0.0], 0.25)  # of too few seeds
    found = cells.cells_of(rows)
    assert [cell.place[-1] for cell in found] == [0.5, 0.9]
    wide = found[1].minus_all["keep"]
    assert (wide.mean, wide.half) == pytest.approx((-0.1, 4.3027 * 0.1 / np.sqrt(3)), abs=1e-4)
    line = cells.worst(found).splitlines()[-1]
    assert (
        line == "| keep | disc, network | disc careless, 400, 90% | 80.0 | -10.0 ± 24.8 | -34.8 | 2 of 2 | 24.8 | 3 |"
    )
    table = cells.cell_tables(found)[0].splitlines()
    assert table[-3:] == [
        "| disc careless, 400, 50% | 80.0 | -20.0 ± 0.0 |",
        "| disc careless, 400, 90% | 80.0 | -10.0 ± 24.8 |",
        "| mean | 80.0 | -15.0 |",
    ]


def test_a_preset_fixes_values_and_gives_way_to_what_is_given():
    options = policy_value.parse(["--preset", "disc", "--seeds", "7", "--out", "x.jsonl"])
    cell = policy_value.left(options, [])[0][0]
    assert options.seeds == [7]
    assert options.tasks == list(DISC_TASKS)
    assert (cell["n"], cell["episodes"], cell["steps"]) == (400, 1000, 1000)
    older = policy_value.parse(["--out", "x.jsonl"])
    assert (older.tasks, older.episodes) == (list(OLDER_TASKS), 25)
    assert policy_value.left(older, [])[0][0]["steps"] == 2000
    assert {task for preset in policy_value.PRESETS.values() for task in preset["tasks"]} <= {*TASKS}


def test_steps_that_are_drawn_follow_their_weights():
    """Two laws, of which one has nine times the weight: the constant that is learned lies at their mean."""
    pytest.importorskip("torch", reason="pip install 'rpil[value]': torch is missing")
    from rpil.data.demonstrations import Demonstrations
    from value.learners import DISC_TRAINING, drawn_network

    states = np.random.default_rng(0).normal(size=(10, 50, 2))
    law = np.repeat([1.0, -1.0], 5)[:, None, None] * np.ones((10, 50, 1))
    data = Demonstrations.from_episodes(list(zip(states, law, strict=True)))
    policy = drawn_network(data, np.repeat([0.9, 0.1], 250), 0, replace(DISC_TRAINING, steps=200))
    assert policy.predict(np.zeros((1, 2)))[0, 0] == pytest.approx(0.8, abs=0.25)
