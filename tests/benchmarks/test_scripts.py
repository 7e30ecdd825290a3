"""Every script runs on its smallest input, and benchmarks/results.py makes a page of what they wrote."""

from __future__ import annotations

import importlib
import json
from types import SimpleNamespace

import numpy as np
import pytest

import ablations
import acceptance
import paper
import peers
import results
import speed
import trust
from rpil import BehavioralCloning
from study import experiments
from study.experiments import METHODS, OURS, TRUST_ALL

pytestmark = pytest.mark.slow
PAPER = ["--env", "MountainCar-v0", "--draws", "2", "--rollouts", "2", "--seed", "3", "--processes", "1", "--peers"]
ARGUMENTS = {
    "acceptance": ["--quick"],
    "features": ["--quick", "--features", "raw", "--features", "auto"],
    "demonstrators": ["--quick"],
    "real": ["--quick", "--features", "raw", "--sets", "mountaincar_noisy"],
    "trust": ["--quick"],
    "ablations": ["--quick"],
    "claims": ["--quick", "--processes", "1"],
    "answers": ["--quick", "--processes", "1"],
    "worlds": ["--only", "noise,alike", "--seeds", "1", "--processes", "1"],
    "paper": PAPER,
    "speed": ["--quick", "--rows", "A,B,D,F,H,I,J,K,O,P"],  # not those that start a cluster or other interpreters
}
TRUST_WORLDS = (
    "simulated MountainCar-v0 flip 50 % 1000",
    "nothing shuffled actions discrete 0",
    "well-specified 20 x 10 uniform 0",
)


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
    assert not any(rows["walks 0"]["words"])
    cell = rows["MountainCar-v0 random 0"]
    assert cell["words"] == [1 if good else -1 for good in cell["good"]]


def test_worlds(written):
    rows = written.run("worlds")["rows"]
    assert len(rows) == 16
    noise, alike = ([row for row in rows if row["kind"] == kind] for kind in ("noise", "alike"))
    assert all(sum(good == 0 for good in row["good"]) in (3, 6, 12, 24) for row in noise)
    assert all(all(row["good"]) for row in alike)
    found = [(word, good) for row in noise for word, good in zip(row["words"], row["good"], strict=True)]
    assert found.count((-1, 0)) > 10 * found.count((-1, 1)) > 0


def test_answers(written):
    figures = {row["what"]: row["figure"] for row in written.run("answers")["rows"]}
    assert figures["8 random labels: AUROC of the rest"].startswith("1.000")
    assert figures["quick: the pair holds one good and one bad"] == "2 of 2"
    assert figures["one wrong answer alone: words"] == "0"


def test_acceptance(written, monkeypatch):
    monkeypatch.setattr(acceptance, "PAPER", ("corrupted",))
    monkeypatch.setattr(acceptance, "PARTLY", ())
    found = written.run("acceptance")
    assert found["provenance"]["seeds"] == "1000 to 1001"
    corrupted, shift = found["cells"]
    assert len(found["draws"]) == 4
    assert corrupted["auroc"] == pytest.approx(1.0)
    assert corrupted["wrong"] == 0
    assert corrupted["rpil"]["mean"] > corrupted["trust_all"]["mean"]
    assert shift["ambiguous"] == shift["both"] == 2
    assert shift["auroc_answered"] > 0.9


def test_paper(written, monkeypatch):
    """Peers see the number of good demonstrations; those that give no policy have no row."""
    tasks = []

    def task(**told):
        tasks.append(told)
        return SimpleNamespace(**told)

    methods = {
        "rpil": None,  # rpil and the oracle are in the tables without peers.py
        "oracle": None,
        "RM-ENT": lambda demonstrations, _: SimpleNamespace(policy=BehavioralCloning().fit(demonstrations)),
        "length": lambda demonstrations, _: SimpleNamespace(policy=None),
    }
    monkeypatch.setattr(peers, "METHODS", methods)
    monkeypatch.setattr(peers, "Task", task)
    monkeypatch.setattr(paper, "METHODS", {name: METHODS[name] for name in (TRUST_ALL, OURS)})
    monkeypatch.setattr(experiments, "OUR_FEATURES", "raw")
    found = written.run("paper")
    assert [table["table"] for table in found["tables"]] == [1, 2]
    for table in found["tables"]:
        assert "RM-ENT" in table["policies"]
        assert "length" not in table["policies"]
        assert table["policies"]["rpil"]["wrong"] == 0
    assert [(told["seed"], told["n_trusted"]) for told in tasks] == [(seed, 10) for seed in (3, 4) for _ in range(4)]


def test_features(written):
    cells = {cell["features"]: cell for cell in written.run("features")["cells"]}
    assert cells["auto"]["share"] >= 0.98 > cells["raw"]["share"]
    assert sum(cells["auto"]["chosen"].values()) == cells["auto"]["draws"] == 2


def test_demonstrators(written):
    whole, short = written.run("demonstrators")["rows"]
    assert (whole["steps"], short["steps"], whole["people"]) == (None, 10, 5)
    assert whole["knowing"] == pytest.approx(1.0)
    assert short["knowing"] > short["without"]  # ten steps, and thirty more of the same person


def test_real(written):
    found = written.run("real")
    assert list(found["sets"]) == ["mountaincar_noisy"]
    assert {row["method"] for row in found["ranking"]} == {"rpil", "length"}


def test_trust(written, monkeypatch):
    monkeypatch.setattr(trust, "QUICK", TRUST_WORLDS)
    found = written.run("trust")
    assert {row["set"] for row in found["sets"]} == set(TRUST_WORLDS)
    assert {row["method"] for row in found["rows"]} == {"rpil", "trimmed"}
    assert not any(row["failed"] or row["said"] for row in found["sets"])
    rows = {row["set"]: row for row in found["sets"]}
    assert rows[TRUST_WORLDS[0]]["labelled"]["auroc"] > 0.8
    assert found["provenance"]["seeds"] == "in the names of worlds"


def test_ablations(written, monkeypatch):
    name = "well-specified 20 x 10 uniform 0"
    monkeypatch.setattr(ablations, "QUICK", (name,))
    chosen = (ablations.DEFAULT, "no rivals", "ten folds")
    monkeypatch.setattr(ablations, "VARIANTS", {variant: ablations.VARIANTS[variant] for variant in chosen})
    found = written.run("ablations")["results"]
    assert tuple(found) == chosen
    assert found[ablations.DEFAULT][name]["auroc"] > 0.9
    assert found["ten folds"][name] != found[ablations.DEFAULT][name]


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
            assert np.isfinite([found[letter], *(found[key] for key in row.goals)]).all()
    for letter in "AB":  # both fits reach the same optimum: otherwise the ratio would compare nothing
        details = found["details"][letter]
        norms, names = details["gradient_norms"], details["compared_with"].values()
        assert details["same_norm"]
        assert max(norms[name] for name in names) <= 2 * norms["ours"] <= 2e-6
        assert details["auroc"] == 1.0


def test_results_page(written, capsys):
    """Every section of the page comes from the JSON that its script wrote."""
    if not written.kept:
        pytest.skip("no script has run: run the whole file")
    names = [name for name in written.kept if name in results.SECTIONS]
    results.main([word for name in names for word in (f"--{name}", str(written.folder / f"{name}.json"))])
    page = capsys.readouterr().out
    assert page.count("\n## ") >= len(names)
