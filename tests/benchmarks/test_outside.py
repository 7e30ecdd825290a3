"""The table of outside worlds, on a world so small that all of it takes seconds."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

import rpil
from rpil_outside import running
from rpil_outside.__main__ import TELLING, main
from rpil_outside.columns import COLUMNS, Deed, auroc, best
from rpil_outside.ours import Case
from rpil_outside.peers import ALL, PEERS, NotMadeForIt, common
from rpil_outside.peers.common import design, policy, targets
from rpil_outside.table import page, read, summarised
from rpil_outside.worlds import WORLDS

BLIND = {ALL, "random 60 %"}
"""Columns that rank nothing."""
BY_ERRORS = {"QoQ"}
"""Columns by which large errors, of either sign, come first: what they compute is tested instead."""


@dataclass(frozen=True, eq=False)
class Made:
    demonstrations: rpil.Demonstrations
    good: np.ndarray
    success: np.ndarray | None = None
    good_steps: np.ndarray | None = None


class Tiny:
    """A point goes to the middle; the bad ones miss it to one side, for longer, and shake."""

    name, source, licence, published = "tiny", "this test", "MIT", "nothing"
    cells = "one bad", "three bad"
    whole = 50.0

    def __init__(self) -> None:
        self.driven: list[np.ndarray] = []

    def make(self, cell: str, seed: int, quick: bool, discrete: bool = False) -> Made:
        n_bad, rng = 1 if cell == "one bad" else 3, np.random.default_rng([seed, self.cells.index(cell)])
        good = rng.permutation(14) >= n_bad
        episodes = []
        for is_good in good:
            at, rows = rng.uniform(-1, 1, 2), []
            for _ in range(20 if is_good else 40):
                way = np.clip(-2 * at, -1, 1) + (0.02 if is_good else 0.3) * rng.normal(size=2) + (not is_good)
                rows.append((at, int(way[0] > 0) if discrete else way))
                at = at + 0.2 * way
            episodes.append(tuple(map(np.array, zip(*rows, strict=True))))
        return Made(rpil.Demonstrations.from_episodes(episodes), good, good.astype(int))

    def drive(self, cell: str, made: Made, weights: np.ndarray, seed: int, quick: bool) -> float:
        """How near least squares come to the rule of the good ones."""
        self.driven.append(weights)
        data = made.demonstrations
        weighted = data.observations * weights[:, None]
        fit = np.linalg.lstsq(weighted.T @ data.observations, weighted.T @ data.actions, rcond=None)[0]
        return 100 - 10 * float(np.abs(fit + 2 * np.eye(2)).sum())


@pytest.fixture(autouse=True, scope="module")
def small_policies():
    """Peers with few features and trees, for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(common, "N_RANDOM", 12)
        patch.setattr(common, "N_TREES", 3)
        yield


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Every column, run once."""
    folder = tmp_path_factory.mktemp("outside")
    main(["run", "tiny", "--seeds", "1", "--json", str(folder), "--quick"], {"tiny": Tiny()})
    return folder


@pytest.mark.parametrize("name", sorted(set(PEERS) - BLIND - BY_ERRORS))
def test_a_bad_demonstration_ranks_below_the_median(name):
    made = Tiny().make("one bad", 1, True)
    case = Case(made, 1)
    answers = case.random_answers(8) | {str(m): bool(made.good[m]) for m in np.flatnonzero(~made.good)}
    given = answers if hasattr(PEERS[name], "N_ANSWERS") else {}
    score, again = (PEERS[name].score(made, given, 1) for _ in range(2))
    assert score.shape == (14,)
    assert score[~made.good][0] < np.median(score)
    np.testing.assert_array_equal(score, again)


def test_influence_is_what_a_little_more_weight_does_to_the_loss():
    """QoQ's largest influence of a step, by fits with a little more weight on it."""
    made, more = Tiny().make("three bad", 0, True), 1e-3
    good = int(np.flatnonzero(made.good)[0])
    X, Y, owner = design(made.demonstrations), targets(made.demonstrations), made.demonstrations.groups
    other = int(np.flatnonzero(made.good)[1])
    asked, rows = np.flatnonzero(owner == good), np.flatnonzero(owner == other)

    def losses(weight):
        return 0.5 * ((Y - X @ policy(X, Y, weight))[asked] ** 2).sum(axis=1)

    changes = [losses(np.ones(len(X))) - losses(1 + more * (np.arange(len(X)) == n)) for n in rows]
    expected = np.mean([change.max() / more for change in changes])
    score = PEERS["QoQ"].score(made, {str(good): True}, 0)
    np.testing.assert_allclose(score[other], expected, rtol=0.01)


def test_influence_on_returns_is_that_of_the_formula():
    """CUPID's score of a demonstration, by the change of the returns' weighted likelihood with its weight."""
    made, more = Tiny().make("three bad", 0, True), 1e-4
    data, X, Y = made.demonstrations, design(made.demonstrations), targets(made.demonstrations)
    returns = np.where(np.arange(14) == 5, 0.0, made.success - made.success.mean())[data.groups]

    def worth(weight):
        return -0.5 * (returns * ((Y - X @ policy(X, Y, weight)) ** 2).sum(axis=1)).sum()

    change = worth(1 + more * (data.groups == 5)) - worth(np.ones(len(X)))
    score = PEERS["CUPID's formula"].score(made, {}, 0)
    np.testing.assert_allclose(score[5], change / more / data.lengths[5], rtol=0.01)


@pytest.mark.parametrize("name", sorted(set(PEERS) - BLIND - {"Counter-BC"}))
def test_peers_take_classes(name):
    made = Tiny().make("three bad", 0, True, discrete=True)
    assert np.isfinite(COLUMNS[name](Case(made, 0)).score).all()


def test_what_a_method_is_not_made_for_is_said():
    made = Tiny().make("three bad", 0, True, discrete=True)
    with pytest.raises(NotMadeForIt, match="classes"):
        PEERS["Counter-BC"].score(made, {}, 0)
    with pytest.raises(NotMadeForIt, match="success"):
        PEERS["success flag"].score(Made(made.demonstrations, made.good), {}, 0)


def test_every_column_is_run(out):
    draws = read(out)
    assert [draw["cell"] for draw in draws] == ["one bad", "three bad"]
    for draw in draws:
        assert list(draw["columns"]) == list(COLUMNS)
        assert draw["columns"]["oracle"]["auroc"] == 1.0
        assert draw["columns"]["oracle"]["policy"] > draw["columns"][ALL]["policy"]
        assert draw["columns"][ALL]["auroc"] == 0.5
        stored = json.loads((out / f"tiny_{draw['cell'].replace(' ', '-')}_0.json").read_text())["columns"]["oracle"]
        assert draw["columns"]["oracle"]["policy"] == pytest.approx(2 * stored["policy"])  # in points of what is whole


def test_a_folder_of_figures_has_one_commit(tmp_path, monkeypatch, out):
    arguments = ["run", "tiny", "--seeds", "1", "--json", str(tmp_path), "--quick", "--columns", ALL]
    main(arguments, {"tiny": Tiny()})
    monkeypatch.setattr(running, "commit", lambda: "0123456789ab")
    with pytest.raises(SystemExit, match="not of 0123456789ab; give another folder"):
        main([*arguments, "oracle"], {"tiny": Tiny()})
    first, second = read(out)
    with pytest.raises(SystemExit, match="run them on one"):
        page([first, second | {"commit": "0123456789ab"}])


def test_a_night_has_cells_of_each_world_whose_files_are_there(tmp_path, monkeypatch, capsys):
    assert set(TELLING) == set(WORLDS)
    assert all(set(cells) <= set(WORLDS[name].cells) for name, cells in TELLING.items())
    monkeypatch.setenv("RPIL_DATA", str(tmp_path))
    main(["night", "--json", str(tmp_path), "--quick"], {"overcooked": WORLDS["overcooked"]})
    assert "overcooked is left out: it needs " in capsys.readouterr().err


def test_differences_are_paired_and_their_intervals_are_students():
    def draw(cell, seed, everything, other):
        row = {"auroc": 0.5, "policy": everything, "seconds": 1.0}
        return {"cell": cell, "seed": seed, "columns": {ALL: row, "other": row | {"policy": other}}}

    draws = [draw("a", 0, 10, 12), draw("a", 1, 50, 56), draw("b", 0, 10, 9), draw("b", 1, 30, 25)]
    found = summarised(draws, "other")
    assert (found.worst, found.worst_cell, found.gain, found.policy) == (-3.0, "b", 0.5, 25.5)
    spread = np.sqrt((2 * 2.0**2 + 2 * 2.0**2) / 2)  # deviations of 2 from the mean in each cell
    np.testing.assert_allclose(found.detectable, 4.3026527 * spread / np.sqrt(2))
    np.testing.assert_allclose(found.gain_interval, 4.3026527 * spread / 2)


def test_a_column_is_not_scored_on_what_it_was_told():
    made = Tiny().make("three bad", 0, True)
    case, score = Case(made, 0), np.zeros(14)
    score[made.good] = 1.0
    wrong = np.flatnonzero(made.good)[0]
    score[wrong] = -1.0
    weights = best(score, case.data.lengths)
    assert auroc(Deed(score, weights), case) < 1.0
    assert auroc(Deed(score, weights, told=(str(wrong),)), case) == 1.0
