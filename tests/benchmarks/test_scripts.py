"""Every script runs on its smallest input, and benchmarks/results.py makes a page of what they wrote."""

from __future__ import annotations

import importlib
import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import ablations
import ranking
import soak
import speed

pytestmark = pytest.mark.slow
ARGUMENTS = {
    "claims": ["--quick", "--processes", "1"],
    "answers": ["--quick", "--processes", "1"],
    "peers": ["--quick", "--processes", "1"],
    "ablations": ["--quick"],
    "growth": ["--quick"],
    "ranking": ["--quick"],
    "speed": ["--quick", "--rows", "A,D,J,K,O,P,W"],  # not those that take seconds, or start processes
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
    assert written.run("claims")["provenance"]["arguments"] == {"quick": True}
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


def test_peers(written):
    assert {row["method"]: row["auroc"] for row in written.run("peers")["rows"]}["rpil"] == 1.0


def test_ranking(written):
    found = written.run("ranking")
    assert 0 <= found["pendulum"]["0"] <= 1  # one draw says little: the mean of twenty is about .65
    assert set(found["point mass"]) == {"stuck, continuous", "stuck, discrete"}
    pairs = (2 + 0.5 + 1) / 4
    assert ranking.auroc(np.array([3.0, 1.0, 1.0, 0.0]), np.array([1, 1, 0, 0])) == pytest.approx(pairs)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_audits_and_answers_leave_no_file_and_no_thread_and_growth_is_seen():
    first, last = soak.compared(soak.soak(10, 2, show=False))
    assert soak.faults(first, last, most_growth=0.1) == []  # ten audits are few: allocators still grow
    before = {"MB": 200.0, "blocks": 1000, "files": 8, "threads": 1}
    assert soak.faults(before, before | {"MB": 203.9}) == []
    assert len(soak.faults(before, {"MB": 204.1, "blocks": 1021, "files": 9, "threads": 2})) == 4


def test_ablations(written, monkeypatch):
    for of in ("RULES", "ANSWERS"):
        monkeypatch.setattr(ablations, of, {ablations.DEFAULT: getattr(ablations, of)[ablations.DEFAULT]})
    found = written.run("ablations")
    assert not found["unfinished"]
    assert [sum(row["verdicts"]) for row in found["rules"][ablations.DEFAULT]] == [-10]


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


def test_episodes(tmp_path):
    episodes = importlib.import_module("episodes")
    folder = importlib.import_module("speed_audits").lerobot_folder(tmp_path / "made", 20, 100, 4)
    here, disk = (episodes.in_a_process(folder, place) for place in ("in memory", "from disk"))
    assert here["words"] == disk["words"]
    assert disk["seconds"] > 0
    assert 0.05 < disk["GB"] < 2
    sizes = {n: {"seconds": 36e-3 * n, "GB": n / 1e6} for n in (100, 10, 1000)}
    fits = {str(n): dict.fromkeys(episodes.PLACES, size) for n, size in sizes.items()}
    rows = episodes.markdown(fits).splitlines()
    assert [row.split(" |")[0] for row in rows[2:5]] == ["| 10", "| 100", "| 1,000"]
    assert rows[5].endswith("| 100.0 h, 10 GB | 100.0 h, 10 GB | 100.0 h, 10 GB |")


def test_growth_is_seen_below_the_noise_of_resident_memory_and_noise_is_none():
    noise = np.resize([-5.0, 0.0, 5.0], 50)
    still, growing = (
        [{"MB": 200 + up * k + noise[k], "blocks": 1, "files": 1, "threads": 1} for k in range(50)] for up in (0, 0.2)
    )
    assert soak.faults(*soak.compared(still)) == []
    assert [fault[:3] for fault in soak.faults(*soak.compared(growing))] == ["MB:"]
