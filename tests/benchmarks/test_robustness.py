"""The robustness grid: resumed as if never broken off, summed up as the protocol says, and told truthfully."""

from __future__ import annotations

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

CAR = "MountainCar-v0"
EPISODES = [(np.zeros((2, 1)), np.array([0, 1]))]


@pytest.fixture
def robustness(monkeypatch):
    import robustness

    return robustness


def rows_of(directory):
    """Finished work, without what the clock says, in an order of its own."""
    rows = [json.loads(line) for line in (directory / "draws.jsonl").read_text().splitlines()]
    for row in rows:
        row.pop("seconds", None)
        row.pop("job_seconds")
    return sorted(rows, key=lambda row: (row["seed"], row["kind"], row["method"]))


@pytest.fixture
def stubbed(robustness, monkeypatch):
    """The grid with figures that are computed from the seed alone, without any fit."""

    def fit(job, demonstrations, good, rollouts):
        found = row(job.methods[0], job.kind, job.seed, job.share, auroc=1.0, identifiable=job.kind != "shift")
        return {key: found[key] for key in found if key not in ("method", "env", "kind", "seed", "share")}

    def labelled(*given):
        return fit(*given) | {"return": -100.0}

    methods = {robustness.OURS: labelled, robustness.LABELLED: labelled}
    monkeypatch.setattr(robustness, "OWN", methods)
    monkeypatch.setattr(robustness, "reference", lambda env, seed, rollouts: reference(seed))
    monkeypatch.setattr(robustness, "simulate", lambda *given, **sizes: SimpleNamespace(episodes=EPISODES, is_good=[]))
    return robustness


def test_interrupted_run_is_resumed(stubbed, tmp_path, capsys):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    arguments = ["--quick", "--draws", "2", "--processes", "1", "--output"]
    status = stubbed.main([*arguments, str(whole)])
    assert "AUROC of 0.99 at least: reached" in capsys.readouterr().out
    rows = rows_of(whole)
    assert [row["method"] for row in rows if row["seed"] == 1000] == ["reference", "rpil", "rpil", "rpil, two labels"]

    lines = sorted((whole / "draws.jsonl").read_bytes().splitlines(keepends=True), key=lambda line: b"1001" in line)
    broken.mkdir()
    kept = b"".join(lines[:5])
    (broken / "draws.jsonl").write_bytes(kept + lines[5][:40])
    assert stubbed.main([*arguments, str(broken)]) == status
    assert (broken / "draws.jsonl").read_bytes().startswith(kept)
    assert rows_of(broken) == rows
    assert (broken / "robustness.png").read_bytes().startswith(b"\x89PNG")

    stamp = (broken / "draws.jsonl").stat().st_mtime_ns
    stubbed.main([*arguments, str(broken)])
    assert (broken / "draws.jsonl").stat().st_mtime_ns == stamp


@pytest.mark.slow
def test_rows_of_one_draw(robustness):
    reference, *_ = robustness.run(robustness.Job(CAR, "", 0, 1000, ("reference",)), 2)
    assert reference["expert"] > reference["random"]
    (alone,) = robustness.run(robustness.Job(CAR, "corrupted", 50, 1000, ("rpil",)), 2)
    assert sorted(alone["good"]) == [0] * 10 + [1] * 10
    assert np.mean((np.array(alone["expert_proba"]) > 0.5) == alone["good"]) == 1 - alone["wrong"]
    assert "return" in alone
    unlabelled, labelled = robustness.run(robustness.Job(CAR, "shift", 50, 1000, ("rpil", "rpil, two labels")), 2)
    assert sorted(labelled["good"]) == [0] * 9 + [1] * 9  # a labelled demonstration is not scored
    assert "return" in labelled
    assert "return" not in unlabelled


def test_rows_of_another_configuration_are_ignored(robustness, tmp_path):
    path = tmp_path / "draws.jsonl"
    key = {"env": CAR, "kind": "noisy", "share": 50, "seed": 1, "method": "rpil"}
    for features in ("raw", "spline"):
        with robustness.Results(path, {"rpil": {"features": features}}) as results:
            assert results.rows == {}
            results.add(key | {"wrong": 0.0})
            results.add(key | {"seed": 2, "error": "no"})
    with robustness.Results(path, {"rpil": {"features": "raw"}}) as results:
        assert list(results.rows) == [(CAR, "noisy", 50, 1, "rpil")]  # what failed is not finished
    assert len(path.read_text().splitlines()) == 4


def test_other_file_is_refused(robustness, tmp_path):
    path = tmp_path / "draws.jsonl"
    path.write_text("not ours\n")
    with pytest.raises(SystemExit, match=r"draws\.jsonl, line 1"):
        robustness.Results(path, {})
    assert path.read_text() == "not ours\n"


def test_jobs_go_draw_by_draw_and_peers_come_last(robustness):
    options = SimpleNamespace(
        environments=[CAR], kinds=["noisy", "flip"], shares=[25, 75], first_seed=7, draws=2, peer_draws=1
    )
    jobs = robustness.jobs(options, ("length", "random"))
    assert [(job.seed, job.kind, job.share) for job in jobs] == [
        *((seed, *cell) for seed in (7, 8) for cell in [("", 0), *CELLS]),
        *((7, *cell) for cell in CELLS),
    ]
    assert [job.methods for job in jobs[:5]] == [
        ("reference",), ("rpil",), ("rpil",), ("rpil",), ("rpil", "rpil, two labels")
    ]  # fmt: skip
    assert all(job.methods == ("length", "random") for job in jobs[10:])


CELLS = [("noisy", 25), ("noisy", 75), ("flip", 25), ("flip", 75)]


def row(method="rpil", kind="noisy", seed=0, share=50, **scores):
    mine = {"env": CAR, "kind": kind, "share": share, "seed": seed, "method": method, "seconds": 1.0 + seed}
    told = {"identifiable": True, "prior": 0.5, "adversary": "uniform", "features": "spline"}
    return mine | told | {"auroc": 1.0, "wrong": 0.0, "expert_proba": [0.9, 0.2], "good": [1, 0]} | scores


def reference(seed, oracle=-100.0):
    mine = {"env": CAR, "kind": "", "share": 0, "seed": seed, "method": "reference"}
    return mine | {"oracle": oracle, "random": -200.0, "expert": -99.0}


def test_means_intervals_and_goals_of_a_cell(robustness):
    returns, auroc, wrong = [-100.0, -104.0, -120.0], [1.0, 1.0, 0.94], [0.005, 0.01, 0.0]
    rows = [reference(seed) for seed in range(3)] + [
        row(seed=seed, auroc=auroc[seed], wrong=wrong[seed]) | {"return": returns[seed]} for seed in range(3)
    ]
    found = robustness.summary(rows, 6)
    (cell,) = found["cells"]
    scores = [1.0, 0.96, 0.8]
    low, high = stats.t.interval(0.95, 2, np.mean(scores), stats.sem(scores))
    assert cell["return"] == pytest.approx({"mean": np.mean(scores), "low": low, "high": high, "min": 0.8, "max": 1.0})
    assert cell["auroc"]["mean"] == pytest.approx(0.98)
    assert cell["wrong"]["mean"] == pytest.approx(0.005)
    assert cell["brier"] == pytest.approx((0.01 + 0.04) / 2)
    assert (cell["draws"], cell["seconds"], cell["adversaries"]) == (3, 2.0, {"uniform": 3})
    assert cell["missed"] == ["return", "AUROC"]  # a half percent wrong is no more than that, however it is rounded
    assert cell["seeds"] == [1, 2]
    assert not found["reached"]
    assert found["missed"]["return"] == [f"{CAR} noisy 50 %"]
    assert found["missed"]["verdicts"] == []
    told = robustness.table(found)
    assert "0.920" in told
    assert "AUROC of 0.99 at least: missed in 1 of 1 cells" in told
    assert "wrong verdicts of 0.5 % at most: reached" in told


def test_unknowable_cells_score_the_labelled_fit_and_ask_for_ambiguity(robustness):
    def rows(*identifiable):
        seeds = range(len(identifiable))
        return [
            *(reference(seed) for seed in seeds),
            *(row(kind="flip", seed=s, identifiable=identifiable[s], auroc=0.0, wrong=1.0) for s in seeds),
            *(row("rpil, two labels", "flip", seed) | {"return": -101.0} for seed in seeds),
        ]

    silent = robustness.summary(rows(False, False), 6)
    assert silent["reached"]
    assert silent["cells"][0]["return"]["mean"] == pytest.approx(0.99)
    guessed = robustness.summary(rows(False, True), 6)
    assert guessed["cells"][0]["seeds"] == [1]
    assert guessed["missed"] == {
        "return": [],
        "AUROC": [],
        "verdicts": [],
        "words": [],
        "ambiguous": [f"{CAR} flip 50 %"],
    }


def test_goals_are_missed_while_work_is_missing_or_the_oracle_plays_like_chance(robustness):
    rows = [reference(0), row() | {"return": -100.0}]
    assert robustness.summary(rows, 2)["reached"]
    unfinished = robustness.summary(rows, 3)
    assert (unfinished["missing"], unfinished["reached"]) == (1, False)
    assert "1 pieces of work" in robustness.table(unfinished)
    blind = robustness.summary([reference(0, oracle=-200.0), rows[1]], 2)
    assert blind["cells"][0]["return"] is None
    assert blind["cells"][0]["missed"] == ["return"]


def test_methods_are_compared_on_shared_knowable_draws(robustness):
    rows = [
        reference(0),
        reference(1),
        row(seed=0, auroc=0.8) | {"return": -110.0},
        row(seed=1, auroc=0.0) | {"return": -200.0},  # no peer has this draw
        row(seed=0, share=90) | {"return": -100.0},
        row(seed=0, kind="flip", auroc=0.0),
        *(row("length", seed=0, share=share, auroc=0.6) for share in (50, 90)),
        row("length", seed=0, kind="flip", auroc=0.0),
    ]
    ours, theirs = robustness.summary(rows, len(rows))["methods"]
    assert (ours["method"], ours["cells"], ours["draws"]) == ("rpil", 2, 2)
    assert ours["auroc"] == pytest.approx({"mean": 0.9, "worst": 0.8})
    assert ours["normalised"] == pytest.approx({"mean": 0.95, "worst": 0.9})
    assert theirs["auroc"] == pytest.approx({"mean": 0.6, "worst": 0.6})
    assert theirs["normalised"] is None


def test_heat_map_frames_missed_cells(robustness, tmp_path):
    rows = [reference(0)]
    rows += [row(kind=kind, auroc=0.9) | {"return": -100.0} for kind in ("noisy", "window")]
    rows += [row(kind="flip"), row("rpil, two labels", "flip") | {"return": -100.0}]
    figure = robustness.heat_map(robustness.summary(rows, len(rows))["cells"], tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    returns, auroc, wrong = figure.axes
    assert [len(ax.patches) for ax in (returns, auroc, wrong)] == [0, 2, 1]
    assert [text.get_text() for text in auroc.texts] == ["0.900", "0.900", "1.000"]
    assert "0.0%\n1 guessed" in [text.get_text() for text in wrong.texts]
    assert [label.get_text() for label in wrong.get_xticklabels()] == ["flip*", "noisy", "window"]


@pytest.mark.slow
def test_peers_run_and_failures_are_written_down(robustness, tmp_path, monkeypatch, capsys):
    def fails(demonstrations, task):
        assert not hasattr(task, "good")
        raise ValueError("not today")

    def clones(demonstrations, task):
        assert vars(task).keys() == {"features", "seed", "good"}  # the oracle is told who is good, and nobody else
        assert (task.features, task.seed) == (robustness.CHOSEN, 1000)
        policy = robustness.BehavioralCloning(task.features).fit(demonstrations.select(task.good))
        return SimpleNamespace(scores=task.good.astype(float), policy=policy)

    code = tmp_path / "peers.py"
    code.touch()
    peers = SimpleNamespace(
        __file__=str(code), METHODS={"rpil": fails, "oracle": clones, "fails": fails}, Task=SimpleNamespace
    )
    monkeypatch.setitem(sys.modules, "peers", peers)
    arguments = ["--quick", "--kinds", "noisy", "--peers", "--processes", "1", "--output", str(tmp_path)]
    assert robustness.main(arguments) == 1
    seen = capsys.readouterr()
    assert "fails ValueError: not today" in seen.err
    assert "1 pieces of work are not done, or failed" in seen.out
    ours, oracle = json.loads((tmp_path / "summary.json").read_text())["methods"]
    assert ours["method"] == "rpil"
    assert oracle["auroc"]["mean"] == 1.0
    assert oracle["normalised"]["mean"] == pytest.approx(1.0)
    n_lines = len((tmp_path / "draws.jsonl").read_text().splitlines())
    robustness.main(arguments)  # what failed is tried again, and nothing else
    assert len((tmp_path / "draws.jsonl").read_text().splitlines()) == n_lines + 1
