"""The commands: what they print and write."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import types
import warnings
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import ENV, call, ok, refused
from rpil import formats
from rpil.estimators.persistence import load


def test_help_and_version():
    assert call().stdout == ok("--help").stdout == ok("-h").stdout
    for command in ("audit", "fit", "evaluate", "simulate", "demo"):
        assert command in ok("--help").stdout
        assert "--quiet" in ok(command, "--help").stdout
    assert rpil.__version__ in ok("--version").stdout


HELP = """
import sys
from click.testing import CliRunner
from rpil.cli.main import main

for command in main.commands:
    assert CliRunner().invoke(main, [command, "--help"]).exit_code == 0, command
sys.exit(str({"numpy", "scipy", "sklearn", "rich", "pyarrow", "matplotlib", "jinja2", "gymnasium"} & {*sys.modules}))
"""


def test_help_of_every_command_imports_no_slow_module():
    assert subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True).stderr == "set()\n"


@pytest.mark.parametrize("command", [[], ["audit"], ["simulate"]])
def test_help_is_fast(command):
    took = []
    for _ in range(3):
        before = os.times()
        subprocess.run([Path(sys.executable).parent / "rpil", *command, "--help"], check=True, capture_output=True)
        after = os.times()  # of the processor: other processes take time, too
        took.append(after.children_user + after.children_system - before.children_user - before.children_system)
    assert min(took) < 0.3


def test_simulate_writes_demonstrations_with_their_truth(folder):
    demonstrations = formats.read(folder / "good.parquet")
    assert len(demonstrations) == 12
    table = pq.read_table(folder / "good.parquet")
    assert {"is_good", "episode_return"} <= set(table.column_names)
    assert set(table["is_good"].to_pylist()) == {0, 1}


@pytest.mark.parametrize("name", ["a.parquet", "a.csv", "a.npz"])
def test_simulate_writes_continuous_actions(name):
    result = ok(
        "simulate", "--env", "LunarLanderContinuous-v3", "--kind", "random", "--good", 1, "--bad", 1, "-o", name
    )
    assert "1 good and 1 bad (random) demonstrations of LunarLanderContinuous-v3" in result.stdout
    demonstrations = formats.read(name)
    assert demonstrations.actions.shape == (demonstrations.n_steps, 2)
    assert len(demonstrations) == 2


def test_simulate_is_reproducible():
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        result = ok(
            "simulate", "--env", ENV, "--kind", "flip", "--good", 1, "--bad", 1, "-o", f"{name}.csv", "--seed", seed
        )
        assert f"1 good and 1 bad (flip) demonstrations of {ENV}" in result.stdout
        assert f"Next: rpil audit {name}.csv" in result.stdout
    a, b, c = (Path(f"{name}.csv").read_bytes() for name in "abc")
    assert a == b != c


def test_fit_reports_two_groups_until_an_answer(folder):
    raw = "--features", "raw"  # none are chosen, which takes time
    result = ok("fit", folder / "shifted.parquet", "-o", "p", "--quiet", *raw)
    assert "Two groups" in result.stdout
    assert result.stdout.splitlines()[-1] == "Policy: p"
    assert result.stderr == ""
    Path("l.json").write_text('{"0": "good", "1": "good", "10": "bad", "11": "bad"}')
    result = ok("fit", folder / "shifted.parquet", "-o", "p", "--labels", "l.json", *raw)
    assert result.stdout.startswith("By your answers: ")
    good, unsure, bad = map(int, re.search(r"(\d+) good, (\d+) open, (\d+) bad", result.stdout).groups())
    assert min(good, bad) >= 2
    assert max(good, bad) <= 6
    assert good + unsure + bad == 12
    assert "Two groups" not in result.stdout


def test_fit_and_evaluate(folder):
    model = load(folder / "policy")
    assert model.features == "auto"
    assert model.observation_names_ == formats.read(folder / "good.parquet").observation_names
    result = ok("evaluate", folder / "policy", "--env", ENV, "--episodes", 5, "--json", "--seed", 3)
    assert result.stderr == ""
    found = json.loads(result.stdout)
    assert list(found) == ["mean", "ci95", "returns"]
    assert len(found["returns"]) == 5
    assert found["mean"] == pytest.approx(np.mean(found["returns"]))
    assert found["ci95"][0] < found["mean"] < found["ci95"][1]
    assert found["mean"] > -150  # the expert's is -103, a random policy's -200
    text = ok("evaluate", folder / "policy", "--env", ENV, "--episodes", 5, "--seed", 3).stdout
    assert text.startswith(f"Mean return {found['mean']:.1f} (95 % interval ")
    assert text.endswith(f"over 5 episodes of {ENV}.\n")


def test_one_episode_has_no_interval(folder):
    result = ok("evaluate", folder / "policy", "--env", ENV, "--episodes", 1, "--json")
    assert json.loads(result.stdout, parse_constant=pytest.fail)["ci95"] == [None, None]
    assert "in one episode" in ok("evaluate", folder / "policy", "--env", ENV, "--episodes", 1).stdout


class FakeDemo:
    """Stands for the real one, which takes a minute and has tests of its own."""

    def __init__(self, **arguments):
        arguments.pop("progress")("working")
        self.arguments = arguments

    def sentences(self):
        return [f"It works with {self.arguments}."]

    def write_report(self, path):
        Path(path).write_text("report")


def test_demo(monkeypatch):
    monkeypatch.setitem(sys.modules, "rpil.cli.demo", types.SimpleNamespace(run=FakeDemo))
    given = ok("demo", "--episodes", 7, "--seed", 2).stdout.splitlines()
    assert given == ["It works with {'episodes': 7, 'seed': 2}.", "Report: rpil-demo.html"]
    assert Path("rpil-demo.html").read_text() == "report"
    refused("no folder nowhere", "demo", "--output", "nowhere/r.html")


def test_warnings_are_printed_once_as_notes(monkeypatch):
    def warn(**arguments):
        warnings.warn("\x1b[33mWatch\nout.\x1b[0m", UserWarning, stacklevel=1)
        warnings.warn("\x1b[33mWatch\nout.\x1b[0m", UserWarning, stacklevel=1)
        return FakeDemo(**arguments)

    monkeypatch.setitem(sys.modules, "rpil.cli.demo", types.SimpleNamespace(run=warn))
    assert ok("demo").stderr == "note: Watch out.\n"
