"""The benchmark of trust: data on disk, peers, what is kept of a run that was broken off, and a quick run."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.metrics import roc_auc_score

from rpil.data.errors import DataError

WORLDS = ["well-specified 20 x 10 uniform 0", "well-specified 20 x 10 uniform 1"]


# ---- data on disk ----------------------------------------------------------------------------------------------------


def save(folder: Path, name: str, leave_out: tuple[str, ...] = (), **changed) -> Path:
    ids = np.repeat([7, 3, 5, 4], [3, 2, 4, 1])
    arrays = {
        "observations": np.arange(20.0).reshape(10, 2),
        "actions": np.arange(10) % 3,
        "episode_ids": ids,
        "is_good": np.array([1, 0, -1, 1]),  # of 3, 4, 5 and 7
    } | changed
    path = folder / f"{name}.npz"
    np.savez(path, **{key: array for key, array in arrays.items() if key not in leave_out})
    return path


def test_data_in_any_order_and_with_little_in_it(tmp_path):
    from trust_data import read

    world = read(save(tmp_path, "some"))
    np.testing.assert_array_equal(world.episode_ids, np.repeat([0, 1, 2, 3], [2, 1, 4, 3]))
    np.testing.assert_array_equal(world.observations[:3, 0], [6, 8, 18])  # steps 3 and 4, then step 9
    np.testing.assert_array_equal(world.actions[-3:], [0, 1, 2])
    np.testing.assert_array_equal(world.is_good, [1, 0, -1, 1])
    assert world.quality is None
    assert world.demonstrations.ids == (0, 1, 2, 3)


def test_families_and_what_is_left_out(tmp_path):
    from trust_data import data_cells

    for name in ("rat_one", "vild_one", "metaworld_one", "unheard_of"):
        save(tmp_path, name)
    save(tmp_path, "told")
    (tmp_path / "told.json").write_text('{"family": "dogs"}')
    save(tmp_path, "all_good", is_good=np.ones(4, dtype=int))
    save(tmp_path, "no_truth", ("is_good",))
    save(tmp_path, "no_actions", ("actions",))
    save(tmp_path, "too_few", is_good=np.array([1, 0]))
    save(tmp_path, "taken")
    (tmp_path / "taken.json").write_text('{"family": "styles"}')
    (tmp_path / "broken.npz").write_text("nothing")
    found, skipped = data_cells(tmp_path)
    assert {name: cell.family for name, cell in found.items()} == {
        "metaworld_one": "robot arms",
        "rat_one": "animals",
        "told": "dogs",
        "unheard_of": "other",
        "vild_one": "control agents",
    }
    text = "\n".join(skipped)
    assert len(skipped) == 6
    assert "no_actions.npz: no array is called 'actions'" in text
    assert "too_few.npz: 'is_good' has shape (2,) for 4 demonstrations" in text
    assert text.count("does not name both good and bad") == 2
    assert "taken.json: the family 'styles' is that of generated worlds" in text
    assert "broken.npz: it cannot be read" in text
    assert str(tmp_path) not in text
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="there are no NPZ files"):
        data_cells(tmp_path / "empty")


# ---- peers -----------------------------------------------------------------------------------------------------------


def test_held_out_likelihoods_agree_with_scikit_learn():
    import trust_peers
    from trust_worlds import styles, well_specified

    folds = np.random.default_rng(0).permutation(20) % 5
    for world in (well_specified(20, 30, "uniform", 0), styles(10, 50, 40, 20, True, 0)):
        X, y, group = world.observations, world.actions, world.episode_ids
        score = trust_peers.PEERS["pooled"](X, y, group)
        expected, error = np.empty(len(y)), np.empty(y.shape)
        for fold in range(5):
            asked = (folds == fold)[group]
            if y.ndim == 1:
                policy = LogisticRegression(C=100, max_iter=1000).fit(X[~asked], y[~asked])
                expected[asked] = policy.predict_log_proba(X[asked])[np.arange(asked.sum()), y[asked]]
            else:
                error[asked] = y[asked] - Ridge(1.0).fit(X[~asked], y[~asked]).predict(X[asked])
        if y.ndim == 2:  # Student's density with four degrees of freedom, up to a constant
            expected = -2.5 * np.log1p((error / (np.median(np.abs(error), axis=0) / 0.741)) ** 2 / 4).sum(axis=1)
        else:
            expected = np.maximum(expected, np.log(1e-3))
        expected = np.bincount(group, expected) / np.bincount(group)
        assert np.corrcoef(score, expected)[0, 1] > 0.995
        shuffled = np.random.default_rng(1).permutation(len(group))
        mixed = trust_peers.PEERS["length"](X[shuffled], y[shuffled], 100 - group[shuffled])
        np.testing.assert_array_equal(mixed, np.bincount(group)[::-1])


@pytest.mark.slow
def test_the_best_three_fifths_teach(monkeypatch):
    import trust_peers
    from trust_worlds import well_specified

    taught = []
    real = trust_peers.held_out

    def watched(data, best):
        taught.append(best.copy())
        return real(data, best)

    monkeypatch.setattr(trust_peers, "held_out", watched)
    world = well_specified(20, 30, "uniform", 0)
    score = trust_peers.PEERS["trimmed"](world.observations, world.actions, world.episode_ids)
    assert [best.sum() for best in taught] == [20, 12, 12, 12]
    assert world.is_good[taught[-1]].sum() == 10
    assert roc_auc_score(world.is_good, score) == 1.0


@pytest.mark.slow
def test_peers_answer_or_say_that_they_cannot():
    from trust_peers import PEERS
    from trust_worlds import styles, well_specified

    world, continuous = well_specified(20, 30, "uniform", 0), styles(10, 50, 40, 6, True, 0)
    for name, peer in PEERS.items():
        score = peer(world.observations, world.actions, world.episode_ids)
        assert score.shape == (20,)
        if "length" not in name:
            assert roc_auc_score(world.is_good, score) > 0.95, name
        if name in ("cleanlab", "paper's recipe"):
            with pytest.raises(DataError, match="the actions are continuous, which it is not made for"):
                peer(continuous.observations, continuous.actions, continuous.episode_ids)
        else:
            assert np.isfinite(peer(continuous.observations, continuous.actions, continuous.episode_ids)).all()


# ---- what is kept ----------------------------------------------------------------------------------------------------


@pytest.fixture
def run(monkeypatch, tmp_path):
    """The script on two worlds with stand-ins for methods; what it was asked; the file."""
    import trust

    asked = []

    def answer(cell, method):
        asked.append((cell.name, method))
        if run.breaks and len(asked) == run.breaks:
            raise KeyboardInterrupt
        world = cell.make()
        if run.fails == method:
            return trust.truth_of(world), {"set": cell.name, "method": method, "seconds": 0.0, "error": "no"}
        found = {"scores": trust.plain(world.is_good), "length": [0.0] * 20, "finding": "some are unlike", "groups": []}
        found |= {"verdicts": ["typical"] * 20, "expert_proba": [0.5] * 20}
        return trust.truth_of(world), {"set": cell.name, "method": method, "seconds": 0.0} | found

    monkeypatch.setattr(trust, "answer", answer)
    path = tmp_path / "trust.json"
    names = [part for name in WORLDS for part in ("--worlds", name)]
    run = SimpleNamespace(breaks=0, fails=None, asked=asked, path=path, trust=trust)
    run.go = lambda *more: (asked.clear(), trust.main([*names, "--json", str(path), *more]))[1]
    return run


def test_a_run_that_was_broken_off_goes_on(run):
    run.breaks = 3
    with pytest.raises(KeyboardInterrupt):
        run.go()
    held = json.loads(run.path.read_text())  # whole, though the run ended in the middle
    assert [(row["set"], row["method"]) for row in held["rows"]] == run.asked[:2]
    done, run.breaks = run.asked[:2], 0
    run.go()
    assert set(run.asked).isdisjoint(done)
    assert len(run.asked) == 2
    run.go()
    assert run.asked == []
    held = json.loads(run.path.read_text())
    assert [row["set"] for row in held["sets"]] == WORLDS
    assert held["sets"][0]["ranking"]["trimmed"]["auroc"] == 1.0
    assert [file.name for file in run.path.parent.iterdir()] == [run.path.name]


def test_other_code_is_run_again(run, monkeypatch):
    run.go()
    run.trust.digest.cache_clear()
    changed = run.path.with_name("changed.py")
    changed.write_text("x = 1")
    before = run.trust.code_of
    monkeypatch.setattr(run.trust, "code_of", lambda ours: (*before(ours), changed) if ours else before(ours))
    run.go()
    assert [method for _, method in run.asked] == ["rpil", "rpil"]  # the peers' code is what it was
    assert len(json.loads(run.path.read_text())["rows"]) == 4


def test_what_failed_is_told_and_tried_again(run, capsys):
    run.fails = "rpil"
    assert run.go() == 1
    printed = capsys.readouterr().out
    assert f"{WORLDS[0]}, rpil failed: no" in printed
    assert "| an answer in every world | **missed** | 0 of 2 |" in printed
    run.fails = None
    run.go()
    assert [method for _, method in run.asked] == ["rpil", "rpil"]
    assert "| an answer in every world | **met** | 2 of 2 |" in capsys.readouterr().out


def test_a_method_that_raises_is_written_down(monkeypatch):
    import trust
    from trust_worlds import cells

    def broken(*given):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setitem(trust.SINGLE, "pooled", broken)
    truth, row = trust.answer(cells()[WORLDS[0]], "pooled")
    assert row["error"] == "ZeroDivisionError: by nothing"
    assert len(truth["extra"]["oracle_log_ratio"]) == len(truth["lengths"]) == 20


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--methods", "nobody"], "there is no method 'nobody'"),
        (["--worlds", "nowhere"], "no world and no family is called 'nowhere'"),
        (["--data", "."], "there are no NPZ files"),
        (["--json", "other.json"], "other.json: it holds no results of this script"),
    ],
)
def test_bad_options_are_one_sentence(arguments, said, capsys, monkeypatch, tmp_path):
    import trust

    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(SystemExit):
        trust.main(arguments)
    assert said in capsys.readouterr().err.strip().splitlines()[-1]


def test_labels_are_the_truth_about_who_is_asked():
    import trust
    from trust_worlds import simulated, styles

    world = simulated("MountainCar-v0", "flip", 50, 1000)
    labels = trust.labels_for(world, SimpleNamespace(pair=()))
    assert {world.is_good[m]: label for m, label in labels.items()} == {1: "good", 0: "bad"}
    assert trust.labels_for(simulated("MountainCar-v0", "noisy", 50, 1000), None) == {}
    world = styles(30, 50, 200, 6, False, 0)
    style = world.extra["style"]
    first, second = (int(np.flatnonzero(style == k)[-1]) for k in (0, 1))
    for pair in ((first, second), (second, first), ()):
        labels = trust.labels_for(world, SimpleNamespace(pair=pair))
        assert {*pair} <= labels.keys()
        assert {(style[m], label) for m, label in labels.items()} == {(0, "good"), (1, "bad")}
    assert trust.labels_for(styles(5, 50, 40, 6, False, 0), SimpleNamespace(pair=(0,))) == {}
