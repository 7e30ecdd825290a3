"""The parts of the scripts, on results built by hand."""

from __future__ import annotations

import importlib
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import acceptance
import demonstrators
import features
import options
import speed
from rpil import Demonstrations
from speed_fits import gradient_norm


def acceptance_row(kind: str, seed: int, **changed: object) -> dict:
    row = {"features": "raw", "env": "MountainCar-v0", "kind": kind, "seed": seed, "seconds": 0.5, "auroc": 1.0}
    row |= {"given": 20, "wrong": 0, "identifiable": True, "rpil": -100.0, "oracle": -100.0 + seed, "trust_all": -150.0}
    return row | changed


def test_acceptance_goals_of_a_cell():
    def missed(kind: str, **changed: object) -> list[str]:
        return acceptance.summary([acceptance_row(kind, seed, **changed) for seed in (0, 1)])["missed"]

    assert missed("corrupted") == []
    assert missed("corrupted", wrong=1) == ["verdicts"]
    assert missed("corrupted", given=19) == []
    assert missed("corrupted", given=18) == ["words"]
    assert missed("random", rpil=-101.0) == ["return"]  # one standard error of the oracle is 0.5
    assert missed("random", seconds=1.1) == ["time"]
    assert missed("noisy", auroc=0.989) == ["auroc"]
    right = {"both": True, "auroc_answered": 1.0, "identifiable": False}
    assert missed("shift", **right) == []
    assert missed("shift", **right | {"identifiable": True}) == ["ambiguous"]
    assert missed("shift", **right | {"both": False}) == ["pair"]
    assert missed("shift", **right | {"auroc_answered": 0.98}) == ["answered"]


def test_acceptance_table_has_a_line_for_each_cell():
    cells = [acceptance.summary([acceptance_row("random", seed, wrong=1) for seed in (0, 1)])]
    cells += [
        acceptance.summary(
            [acceptance_row("shift", s, both=True, auroc_answered=1.0, identifiable=False) for s in (0, 1)]
        )
    ]
    _, played, coherent = acceptance.table(cells).splitlines()
    assert played.split()[:3] == ["raw", "MountainCar-v0", "random"]
    assert played.endswith("verdicts")
    assert "-100.0 ± 0.0" in played
    assert "ambiguous 2/2" in coherent


def test_features_goal_for_the_share_of_the_experts_return():
    def row(kind: str, seed: int, value: float) -> dict:
        found = {"env": "Acrobot-v1", "seed": seed, "features": kind, "seconds": 1.0, "chosen": "spline", "ridge": 0.01}
        return found | {"return": value, "expert": -80.0, "random": -480.0, "share": (value + 480) / 400}

    rows = [row("auto", seed, value) for seed, value in ((0, -80.0), (1, -100.0))]
    cell = features.summary("Acrobot-v1", "auto", rows)
    assert cell["share"] == pytest.approx(0.975)  # 1 and .95
    assert (cell["worst"], cell["missed"], cell["chosen"]) == (pytest.approx(0.95), True, {"spline 1e-02": 2})
    assert "missed (0.975)" in features.markdown({"cells": [cell]})
    assert "0.975" in features.table([cell])


def test_speed_table_says_what_is_reached_missed_and_skipped():
    found = {"A": 0.5, "H": 0.5, "details": {"C": {"skipped": "no data"}}, "peak_gib": 20.0, "quick": True}
    lines = speed.table(found, ["A", "H", "C"]).splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["A", "H", "C"]
    assert lines[1].endswith("reached")  # at most 1
    assert lines[2].endswith("missed")  # at least .6
    assert lines[3].endswith("skipped: no data")
    assert "above" in lines[-1]


def test_gradient_norm_is_zero_at_the_optimum_and_agrees_with_finite_differences():
    """Is zero at scikit-learn's optimum, and the gradient by finite differences elsewhere."""
    from sklearn.linear_model import LogisticRegression

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


def test_unknown_rows_are_refused(capsys):
    with pytest.raises(SystemExit):
        speed.main(["--rows", "A,X"])
    assert "no row X" in capsys.readouterr().err


def test_cut_keeps_consecutive_steps_of_each_demonstration():
    state = np.arange(60.0)
    made = Demonstrations(state[:, None], state.astype(int) % 3, np.array([0, 5, 30, 60]), ids=("c", "a", "b"))
    found = demonstrators.cut(made, 10, np.random.default_rng(0))
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
        ("robustness", ["--shares", "100", "--output", "x"], "--shares: 100 is more than 99"),
        ("demonstrators", [], "say where the NPZ files are: --data DIR"),
        ("real", ["--json", "no/real.json"], "--json: no/real.json: there is no folder no; make it first"),
    ],
)
def test_bad_options_give_a_message(script, arguments, match, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    main = importlib.import_module(script).main
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert match in capsys.readouterr().err


def test_json_is_replaced_only_when_complete(tmp_path):
    path = tmp_path / "found.json"
    options.write_json(path, {"rows": [1]})
    with pytest.raises(TypeError):
        options.write_json(path, {"rows": [1, object()]})
    assert json.loads(path.read_text()) == {"rows": [1]}
    assert [file.name for file in tmp_path.iterdir()] == ["found.json"]


def test_helpers_of_tests_and_benchmarks_have_different_names():
    """All of them are imported by their base names."""
    root = Path(__file__).parents[2]
    modules = [*(root / "tests").glob("*.py"), *(root / "benchmarks").glob("*.py")]
    twice = [name for name, n in Counter(path.name for path in modules).items() if n > 1]
    assert twice == []
