"""The scripts run, and what they write is true on the smallest cells."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rpil import BehavioralCloning, Demonstrations
from rpil.simulation.corruptions import KINDS

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_quick_acceptance(tmp_path, capsys, monkeypatch):
    main = runpy.run_path(str(BENCHMARKS / "acceptance.py"))["main"]
    path = tmp_path / "acceptance.json"
    main(["--quick", "--json", str(path)])
    printed = capsys.readouterr().out
    found = json.loads(path.read_text())
    assert found["provenance"]["seeds"] == "1000 to 1001"
    cells = {cell["kind"]: cell for cell in found["cells"]}
    assert set(cells) == {"corrupted", "random", "noisy", "window", "shift"}
    assert all(kind in printed for kind in cells)
    assert len(found["draws"]) == 2 * len(cells)
    for kind in ("corrupted", "random"):
        assert cells[kind]["auroc"] == pytest.approx(1.0)
        assert cells[kind]["wrong"] == 0
        assert cells[kind]["rpil"]["mean"] > cells[kind]["trust_all"]["mean"]
        assert cells[kind]["oracle"] == cells["random"]["oracle"]  # the good demonstrations do not depend on the kind
    assert cells["noisy"]["auroc"] == pytest.approx(1.0)
    assert cells["window"]["auroc"] == pytest.approx(1.0)
    assert cells["shift"]["ambiguous"] == 2
    assert cells["shift"]["wrong_labelled"] == 0


def test_smallest_paper(tmp_path, capsys, monkeypatch):
    asked = []

    def task(**told):
        asked.append(told)
        return SimpleNamespace(**told)

    def policy(demonstrations, task):
        return SimpleNamespace(policy=BehavioralCloning().fit(demonstrations))

    def nothing(demonstrations, task):
        return SimpleNamespace(policy=None)

    known = {
        "rpil": None,
        "oracle": None,
        "trust all": None,
        "paper's recipe": None,
        "RM-ENT": policy,
        "length": nothing,
    }
    monkeypatch.setitem(sys.modules, "peers", SimpleNamespace(METHODS=known, Task=task))
    script = runpy.run_path(str(BENCHMARKS / "paper.py"))
    path, folder = tmp_path / "paper.json", tmp_path / "paper"
    size = ["--env", "MountainCar-v0", "--draws", "2", "--rollouts", "2", "--seed", "3", "--processes", "1"]
    assert script["main"]([*size, "--peers", "--json", str(path), "--output", str(folder)]) == 0
    printed, found = capsys.readouterr().out, json.loads(path.read_text())
    assert [table["table"] for table in found["tables"]] == [1, 2]
    assert all(f"Table {n}. MountainCar-v0" in printed for n in (1, 2))
    for table in found["tables"]:
        assert "RM-ENT" in table["policies"]
        assert "length" not in table["policies"]
        assert table["policies"]["rpil"]["wrong"] == 0
    assert [(told["seed"], told["n_trusted"]) for told in asked] == [(seed, 10) for seed in (3, 4) for _ in range(4)]
    assert len(list(folder.glob("*.png"))) == 8
    assert "RM-ENT" in (folder / "tables.md").read_text(encoding="utf-8")


def test_quick_features(tmp_path, capsys, monkeypatch):
    script = runpy.run_path(str(BENCHMARKS / "features.py"))
    path = tmp_path / "features.json"
    assert script["main"](["--quick", "--json", str(path)]) == 0
    result = json.loads(path.read_text())
    cells = {cell["features"]: cell for cell in result["cells"]}
    printed = capsys.readouterr().out
    assert all(kind in printed for kind in cells)
    assert cells["auto"]["share"] >= 0.98 > cells["raw"]["share"]
    assert sum(cells["auto"]["chosen"].values()) == cells["auto"]["draws"] == 2
    assert "98% of the expert's return reached" in script["markdown"](result)


def test_quick_calibration(tmp_path, capsys, monkeypatch):
    path = tmp_path / "calibration.json"
    script = runpy.run_path(str(BENCHMARKS / "calibration.py"))
    assert script["main"](["--quick", "--json", str(path)]) == 0
    found = json.loads(path.read_text())
    assert found["ece"] <= 0.05
    sizes = {row["kind"]: len(row["good"]) for row in found["signal"]}
    assert sizes == {kind: 18 if kind in ("flip", "shift") else 20 for kind in KINDS}  # without the labelled ones
    assert found["n_judged"] == sum(len(row["good"]) for row in found["signal"] if not row["ambiguous"])
    assert sum(of["n"] for of in found["bins"]) == found["n_judged"]
    assert set(found["accused"]) == {"all good", "all random", "all noisy", "actions shuffled", "steps shuffled"}
    assert sum(map(sum, found["accused"].values())) <= 5  # of 100
    assert "Expected calibration error over" in capsys.readouterr().out


@pytest.mark.parametrize(("env", "seed"), [("Acrobot-v1", 800), ("LunarLander-v3", 803)])
def test_who_is_alike_by_chance_accuses_nobody(env, seed, monkeypatch):
    """Of these demonstrations of random actions a few predict each other rather well, if asked by hearsay."""
    without_signal = runpy.run_path(str(BENCHMARKS / "calibration.py"))["without_signal"]
    assert without_signal(env, "all random", seed)["accused"] == 0


def test_expected_calibration_error(monkeypatch):
    """Right on average in every bin is calibrated; sure and wrong is not."""
    of = runpy.run_path(str(BENCHMARKS / "calibration.py"))["expected_calibration_error"]
    assert of(np.full(10, 0.75), np.arange(10) < 8) == pytest.approx(0.05)
    assert of(np.array([0.95, 0.05]), np.array([False, True])) == pytest.approx(0.95)
    assert of(np.array([1.0, 0.0]), np.array([True, False])) == 0.0


def test_shuffled_demonstrations_do_not_differ(monkeypatch):
    """All states and actions stay, lengths too; what belongs together is lost."""
    shuffled = runpy.run_path(str(BENCHMARKS / "calibration.py"))["shuffled"]
    state = np.arange(60.0)
    made = Demonstrations(state[:, None], state.astype(int) % 3, np.array([0, 10, 30, 60]))
    for name in ("actions shuffled", "steps shuffled"):
        found = shuffled(made, name, np.random.default_rng(0))
        np.testing.assert_array_equal(found.lengths, made.lengths)
        np.testing.assert_array_equal(np.sort(found.observations[:, 0]), state)
        np.testing.assert_array_equal(np.sort(found.actions), np.sort(made.actions))
        kept = (found.observations[:, 0] % 3 == found.actions).all()
        assert kept == (name == "steps shuffled")


def test_quick_labels(tmp_path, capsys, monkeypatch):
    script = runpy.run_path(str(BENCHMARKS / "labels.py"))
    path = tmp_path / "labels.json"
    assert script["main"](["--quick", "--json", str(path)]) == 0
    result = json.loads(path.read_text())
    curve = {(row["how"], row["k"]): row for row in result["curve"]}
    assert set(curve) == {(how, k) for how in ("suggested", "random") for k in (1, 3)}
    assert curve["suggested", 1]["auroc"] == pytest.approx(1.0)  # most are bad, and of one mind: a label settles it
    assert curve["suggested", 1]["without"] < 0.5
    assert curve["suggested", 1]["all"] == pytest.approx(1.0)
    assert curve["random", 3]["without"] < 0.5
    for row in result["rows"]:
        assert len(set(row["asked"])) == row["k"] == row["questions"]
    known = script["Truth"](np.array([True, False, False, True]), np.array([False, False, True, False]), np.zeros(4))
    assert script["questions"]([1, 2, 0, 3], known, 2) == [1, 2, 0]  # nobody knows of 1
    assert script["questions"]([3, 1, 0, 2], known, 9) == [3, 1, 0, 2]
    assert "mountaincar_flip" in capsys.readouterr().out


def test_quick_speed(tmp_path, capsys, monkeypatch):
    """Every row is there, or says why not; nothing is asserted of the time."""
    script = runpy.run_path(str(BENCHMARKS / "speed.py"))
    path = tmp_path / "speed.json"
    assert script["main"](["--quick", "--json", str(path)]) == 0
    printed, found = capsys.readouterr().out, json.loads(path.read_text())
    assert found["quick"]
    assert set(found["threads"].values()) == {1}
    assert found["provenance"]["seeds"] == 0
    assert 0 < found["peak_gib"] < 16
    for letter, row in script["ROWS"].items():
        details = found["details"][letter]
        for key in row.goals:
            assert f"\n{key} " in printed
            assert ("skipped" in details) == (key not in found)
        if "skipped" in details:
            assert f"skipped: {details['skipped']}" in printed
        else:
            assert np.isfinite([found[letter], *(found[key] for key in row.goals)]).all()
    for letter in "AB":  # the same problem, solved as well by both: else the ratio would compare nothing
        details = found["details"][letter]
        norms, names = details["gradient_norms"], details["compared_with"].values()
        assert details["same_norm"]
        assert max(norms[name] for name in names) <= 2 * norms["ours"] <= 2e-6
        assert details["auroc"] == 1.0


def test_the_norm_that_fits_are_compared_by(monkeypatch):
    """Is zero at scikit-learn's optimum, and the gradient by finite differences elsewhere."""
    from sklearn.linear_model import LogisticRegression

    from speed_fits import gradient_norm

    rng = np.random.default_rng(0)
    x, codes, weight = rng.normal(size=(300, 4)), rng.integers(0, 3, size=300), rng.random(300)
    design, ridge = np.column_stack([x, np.ones(300)]), np.array([0.5, 0.5, 0.5, 0.5, 0.0])
    best = LogisticRegression(C=2.0, tol=1e-10, max_iter=1000).fit(x, codes, sample_weight=weight)
    optimum = np.vstack([best.coef_.T, best.intercept_])
    assert gradient_norm(design, codes, weight, ridge, optimum) < 1e-8

    def loss(weights):
        logits = design @ weights
        log_proba = logits - np.log(np.exp(logits).sum(axis=1, keepdims=True))
        return -weight @ log_proba[np.arange(300), codes] + 0.5 * (ridge[:, None] * weights**2).sum()

    off = optimum + rng.normal(size=optimum.shape)
    step = 1e-6 * np.eye(off.size).reshape(-1, *off.shape)
    slopes = [(loss(off + one) - loss(off - one)) / 2e-6 for one in step]
    found = gradient_norm(design, codes, weight, ridge, off)
    assert found == pytest.approx(np.abs(slopes).max() / weight.sum(), rel=1e-5)


def test_unknown_rows_are_refused(monkeypatch, capsys):
    with pytest.raises(SystemExit):
        runpy.run_path(str(BENCHMARKS / "speed.py"))["main"](["--rows", "A,X"])
    assert "no row X" in capsys.readouterr().err


def test_quick_demonstrators(tmp_path, capsys, monkeypatch):
    script = runpy.run_path(str(BENCHMARKS / "demonstrators.py"))
    path = tmp_path / "demonstrators.json"
    assert script["main"](["--quick", "--json", str(path)]) == 0
    result = json.loads(path.read_text())
    whole, short = result["rows"]
    assert (whole["steps"], short["steps"], whole["people"]) == (None, 10, 5)
    assert whole["knowing"] == pytest.approx(1.0)
    assert short["knowing"] > short["without"]  # ten steps borrow from the thirty of the same person
    assert "mountaincar five people" in capsys.readouterr().out
    assert "Whole demonstrations: 1.000 without, 1.000 knowing" in script["markdown"](result)


def test_what_is_cut_out_of_demonstrations(monkeypatch):
    cut = runpy.run_path(str(BENCHMARKS / "demonstrators.py"))["cut"]
    state = np.arange(60.0)
    made = Demonstrations(state[:, None], state.astype(int) % 3, np.array([0, 5, 30, 60]), ids=("c", "a", "b"))
    found = cut(made, 10, np.random.default_rng(0))
    assert tuple(found.ids) == ("c", "a", "b")
    np.testing.assert_array_equal(found.lengths, [5, 10, 10])
    for (observations, actions), low, high in zip(found, made.offsets, made.offsets[1:], strict=False):
        assert (np.diff(observations[:, 0]) == 1).all()
        assert low <= observations[0, 0] <= observations[-1, 0] < high
        np.testing.assert_array_equal(actions, observations[:, 0] % 3)


@pytest.mark.parametrize(
    ("script", "arguments", "match"),
    [
        ("acceptance", ["--draws", "1"], "--draws: 1 is less than 2"),
        ("paper", ["--draws", "1"], "--draws: 1 is less than 2"),
        ("features", ["--draws", "1"], "--draws: 1 is less than 2"),
        ("features", ["--draws", "few"], "--draws: 'few' is no whole number"),
        ("labels", ["--labels", "0"], "--labels: 0 is less than 1"),
        ("calibration", ["--shares", "100"], "--shares: 100 is more than 99"),
        ("robustness", ["--shares", "100", "--output", "x"], "--shares: 100 is more than 99"),
        ("demonstrators", [], "say where the NPZ files are: --data DIR"),
        ("real", ["--json", "no/real.json"], "--json: no/real.json: there is no folder no; make it first"),
    ],
)
def test_bad_options_are_one_sentence(script, arguments, match, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    main = runpy.run_path(str(BENCHMARKS / f"{script}.py"))["main"]
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert match in capsys.readouterr().err


def test_json_is_never_half_written(tmp_path, monkeypatch):
    write_json = runpy.run_path(str(BENCHMARKS / "options.py"))["write_json"]
    path = tmp_path / "found.json"
    write_json(path, {"rows": [1]})
    with pytest.raises(TypeError):
        write_json(path, {"rows": [1, object()]})
    assert json.loads(path.read_text()) == {"rows": [1]}
    assert [file.name for file in tmp_path.iterdir()] == ["found.json"]
