"""The set in one table: what it holds, how its actions move, and what a trainer will stumble over."""

import json

import numpy as np
import pandas as pd
import pytest

import rpil
from command_line import ok
from recordings import recording
from rpil.data.demonstrations import Block
from rpil.faults.set_table import contradicting, set_table


def frame(wraps=False, constant=False, idle=0, moved=()):
    rows = []
    for m, (x, a) in enumerate(recording(10)):
        x, a = (np.insert(values, [0] * idle, values[0], axis=0) for values in (x, a))
        if wraps:
            x, a = ((v + np.linspace(0, 12, len(v))[:, None] + np.pi) % (2 * np.pi) - np.pi for v in (x, a))
        if constant:
            a = a * [1, 1, 0]
        a = a + np.array([2.0 * (m in moved), 0, 0])
        columns = {f"state.{k}": x[:, k] for k in range(3)} | {f"action.{k}": a[:, k] for k in range(3)}
        done = (np.arange(len(x)) == len(x) - 1) * (m < 7)
        rows.append(pd.DataFrame({"episode": m, "timestamp": np.arange(len(x)) / 20, **columns, "success": done}))
    return pd.concat(rows)


def table_of(data, **options):
    read = rpil.open(data, observations="state.*", **options)
    return set_table(read, rpil.check(read), "FILE")


def test_a_clean_set_has_a_row_for_each_action_and_nothing_to_stumble_over():
    found = table_of(frame().assign(grade=lambda rows: rows["episode"]), outcome=("success", "grade"))
    facts = {"episodes": 10, "rate": 20, "cameras": None, "idle share": 0, "successes, success": 0.7}
    assert facts == {name: found.facts[name] for name in facts}
    assert [(row["constant"], row["wraps"], row["lag"]) for row in found.actions] == [(False, None, 2)] * 3
    assert all(0 < row["tracking error"] < 0.01 for row in found.actions)
    assert ("rate", "20 a second") in found.panels()[0]
    assert found.panels()[0][-1] == ("successes, success", "70%")
    assert found.panels()[1][1][4:7] == ("", "", "2")
    assert found.stumbles == []
    assert "stumble" not in "\n".join(found.lines())


def test_what_is_wrong_is_in_its_cell_and_has_a_remedy():
    found = table_of(frame(constant=True, idle=50))
    assert [found.actions[2][name] for name in ("low", "high", "at limits", "constant")] == [0, 0, None, True]
    assert found.panels()[1][3][1:5] == ("0", "0", "", "constant")
    assert found.facts["idle share"] == pytest.approx(50 / 225, abs=0.04)
    assert any(line.endswith("leave it out") for line in found.stumbles)
    assert any(
        line.endswith("; rpil check FILE --format json lists the steps to keep under trims") for line in found.stumbles
    )
    moved = sorted(table_of(frame(moved=(2, 3))).stumbles)
    said = [line.partition(" ")[2][:30] for line in moved]
    assert said == [f"demonstration {m}: action.0 is 2" for m in (2, 3)]
    assert moved[0].endswith("; rpil keep FILE -o NEW --without-faults offset")
    read = rpil.open(frame(moved=(2, 3)), observations="state.*")
    (line, _) = set_table(read, rpil.check(read), "my set.csv").stumbles
    assert line.endswith("; rpil keep 'my set.csv' -o NEW.csv --without-faults offset")
    wraps = [row["wraps"] for row in table_of(frame(wraps=True, constant=True)).actions]
    assert wraps == [pytest.approx(2 * np.pi), pytest.approx(2 * np.pi), None]


def test_the_table_is_markdown_and_json(tmp_path):
    path = tmp_path / "drive.csv"
    frame().to_csv(path, index=False)
    lines = ok("info", "--set", str(path)).stdout.splitlines()
    assert lines[0].startswith("| of the set ")
    at = next(k for k, line in enumerate(lines) if line.startswith("| action"))
    assert len({*map(len, lines[at : at + 5])}) == 1
    named = frame().rename(columns={"action.0": "action.a|<b>x"})
    named.to_csv(path, index=False)
    (row,) = (line for line in ok("info", "--set", str(path)).stdout.splitlines() if "&lt;b&gt;x" in line)
    assert row.startswith("| action.a\\|&lt;b&gt;x ")
    told = json.loads(ok("info", "--set", "--format", "json", str(path)).stdout)
    assert told["set"]["episodes"] == 10
    assert {type(row["low"]) for row in told["actions"]} == {float}


@pytest.mark.parametrize(("apart", "share"), [(0.0, 0.0), (5.0, 1.0)])
def test_actions_contradict_where_near_states_have_others(apart, share):
    states = np.tile(np.linspace(0, 50, 40), 2)[None]
    actions = np.repeat([[0.0], [apart]], 40, axis=0) + np.tile(np.linspace(0, 1, 40), 2)[:, None]
    block = Block(0, states.T, actions, np.array([0, 40, 80]))
    assert contradicting(states, block) == share
    single = Block(0, np.zeros((2, 1)), np.array([[0.0], [apart]]), np.arange(3))
    assert contradicting(np.zeros((1, 2)), single) == share
    codes = Block(0, states.T, (actions[:, 0] > 2).astype(int), np.array([0, 40, 80]))
    assert contradicting(states, codes) == share
    for away, near in ((0.24, True), (0.26, False)):
        assert contradicting(states + away * (np.arange(80) < 40), block) == share * near
        assert contradicting(states + away * (np.arange(80) < 20), block) == share  # of those that are near


def test_it_is_the_first_panel_of_the_page(tmp_path):
    frame(constant=True, idle=50).to_csv(tmp_path / "drive.csv", index=False)
    ok("audit", str(tmp_path / "drive.csv"), "--report", str(tmp_path / "page.html"), "-q")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.index('id="set"') < page.index('id="odd"')
    assert all(f"<td>{name}</td>" in page for name in ("tracking error", "constant"))
    assert "lists the steps to keep under trims" in page
