"""Every script runs on its smallest input, and benchmarks/results.py makes a page of what they wrote."""

from __future__ import annotations

import importlib
import json
import re
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import ablations
import claims
import paper
import speed
from rpil import Demonstrations, formats, simulate
from study import experiments
from study.experiments import METHODS, OURS, TRUST_ALL
from worlds.simulated import of_paper

pytestmark = pytest.mark.slow
PAPER = ["--env", "MountainCar-v0", "--draws", "2", "--rollouts", "2", "--seed", "3", "--processes", "1"]
ARGUMENTS = {
    "claims": ["--quick", "--processes", "1"],
    "answers": ["--quick", "--processes", "1"],
    "peers": ["--quick", "--processes", "1"],
    "ablations": ["--quick"],
    "growth": ["--quick"],
    "paper": PAPER,
    "speed": [
        "--quick",
        "--rows",
        "A,D,J,K,O,P,W",
    ],  # not those that take seconds, or start processes
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Results by script: each script runs once."""
    folder, kept = tmp_path_factory.mktemp("scripts"), {}

    def run(script: str) -> dict:
        if script not in kept:
            path = folder / f"{script}.json"
            assert importlib.import_module(script).main([*ARGUMENTS[script], "--json", str(path)]) in (0, 1)
            kept[script] = json.loads(path.read_text())
        return kept[script]

    return SimpleNamespace(run=run, folder=folder, kept=kept)


def test_claims(written):
    rows = {row["name"]: row for row in written.run("claims")["rows"]}
    assert set(rows) == {"walks 0", "MountainCar-v0 corrupted 0", "MountainCar-v0 random 0"}
    assert len(rows["walks 0"]["first"]) == 5
    cell = rows["MountainCar-v0 random 0"]
    assert cell["verdicts"] == [0 if good else -1 for good in cell["good"]]


def test_answers(written):
    figures = {row["what"]: row["figure"] for row in written.run("answers")["rows"]}
    assert figures["8 random labels: AUROC of the rest"].startswith("1.000")
    assert figures["quick: the pair holds one good and one bad"] == "2 of 2"
    assert figures["one wrong answer alone: verdicts of the others"] == "0"


def test_kinds_of_recorded_sets(tmp_path):
    """Of a set of five named people, two of them good: audits of each kind, and of the people named."""
    made = simulate("MountainCar-v0", "noisy", n_good=8, n_bad=12, seed=0)
    order = np.argsort(-made.is_good, kind="stable")
    episodes = [made.episodes[m] for m in order]
    people = {"is_good": made.is_good[order], "episode_quality": made.is_good[order].astype(float)}
    people["demonstrator_ids"] = np.repeat(np.arange(5), 4)
    formats.write(tmp_path / "car.npz", Demonstrations.from_episodes(episodes), people)
    kinds = ["recorded", "half", "people"]
    jobs = [job for job in claims.jobs(tmp_path, 0, 0) if job.kind in kinds]
    assert [job.kind for job in jobs] == ["recorded", "half", "people", "people"]
    rows = {(job.kind, job.name): claims.audited(job) for job in jobs}
    assert len(rows["half", "car"]["good"]) == 8
    without, named = rows["people", "not named: car"], rows["people", "named: car"]
    assert named["log_odds"] == without["log_odds"] == rows["recorded", "car"]["log_odds"]
    assert named["verdicts"] == without["verdicts"]
    assert "| operators named | 1 |" in "\n".join(claims.report(list(rows.values())))


def test_peers(written):
    assert {row["method"]: row["auroc"] for row in written.run("peers")["rows"]}["rpil"] == 1.0


def test_paper(written, monkeypatch):
    monkeypatch.setattr(paper, "METHODS", {name: METHODS[name] for name in (TRUST_ALL, OURS)})
    monkeypatch.setattr(experiments, "OUR_FEATURES", "raw")
    found = written.run("paper")
    assert [table["table"] for table in found["tables"]] == [1, 2]
    assert all(table["policies"]["rpil"]["wrong"] == 0 for table in found["tables"])
    assert found["provenance"]["seeds"] == "3 to 4"
    asked = {"env": ["MountainCar-v0"], "draws": 2, "rollouts": 2, "seed": 3}
    assert found["provenance"]["arguments"] == asked
    assert written.run("claims")["provenance"]["arguments"] == {"quick": True}


def test_ablations(written, monkeypatch):
    chosen = (ablations.DEFAULT, "min_gap 3", "max_own_gain .3")
    monkeypatch.setattr(ablations, "RULES", {name: ablations.RULES[name] for name in chosen})
    of_answers = (ablations.DEFAULT, "min_proba .9", "min_proba .77")
    monkeypatch.setattr(ablations, "ANSWERS", {name: ablations.ANSWERS[name] for name in of_answers})
    found = written.run("ablations")
    assert not found["unfinished"]
    assert {*found["rules"]} == {*chosen}
    told = {
        name: sum(verdict != 0 for row in rows for verdict in row["verdicts"])
        for name, rows in found["answers"].items()
    }
    assert told["min_proba .9"] <= told[ablations.DEFAULT] <= told["min_proba .77"]


def test_another_value_changes_what_an_ablation_says():
    job = claims.Job("quick", "", partial(of_paper, "MountainCar-v0", "random", 0))
    rows = {
        name: ablations.audited(name, job) for name in (ablations.DEFAULT, "no group lies apart (min_distance 1e9)")
    }
    assert [sum(row["verdicts"]) for row in rows.values()] == [-10, 0]


def test_learner(tmp_path, capsys, monkeypatch):
    path, script = tmp_path / "learner.json", importlib.import_module("learner")
    monkeypatch.setattr(script, "SEEDS", script.SEEDS | {20: 2})
    assert script.main(["--quick", "--json", str(path)]) == 0
    cell, other, pole = json.loads(path.read_text())["rows"]
    assert abs(cell["RPIL()"] - cell["good alone"]) <= 0.02 < cell["good alone"] - cell["all"]
    assert other["four labels"] - other["good alone"] <= 0.03 < other["RPIL()"] - other["good alone"]
    assert pole["RPIL()"] >= 450 > pole["all"]
    distance = float(re.search(r"\| classes, 30% \| ([+-][\d.]+) \|", capsys.readouterr().out)[1])
    assert distance == pytest.approx(cell["good alone"] - cell["RPIL()"], abs=6e-4)


def test_driven(tmp_path, capsys):
    path = tmp_path / "driven.json"
    assert importlib.import_module("driven").main(["--quick", "--json", str(path)]) == 0
    cell, game = json.loads(path.read_text())["rows"]
    assert cell["RPIL()"] >= cell["good alone"] - 5 > cell["all alike"] + 50
    assert 0 <= min(game["RPIL()"], game["all alike"]) <= 100
    assert "1 of 2 cells in which the good ones alone gain" in capsys.readouterr().out


def test_growth(written):
    ((number, sizes),) = written.run("growth")["sizes"].items()
    assert number == "6"
    assert all(len(sizes[name]) == 2 and sizes[name][0] > sizes["read"][0] > 0 for name in ("info", "check", "audit"))


def test_speed(written):
    """Every row has a number or says why not; nothing is asserted of the time."""
    found = written.run("speed")
    assert found["quick"]
    assert set(found["threads"].values()) == {1}
    assert 0 < found["peak_gib"] < 16
    for letter, row in ((letter, speed.ROWS[letter]) for letter in found["details"]):
        details = found["details"][letter]
        for key in row.goals:
            assert ("skipped" in details) == (key not in found)
        if "skipped" not in details:
            assert np.isfinite([found[key] for key in row.goals]).all()
    details = found["details"]["A"]  # both fits reach the same optimum: otherwise the ratio would compare nothing
    norms, names = details["gradient_norms"], details["compared_with"].values()
    assert details["same_norm"]
    assert max(norms[name] for name in names) <= 2 * norms["ours"] <= 2e-6
    assert details["auroc"] == 1.0
