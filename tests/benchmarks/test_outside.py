"""The table of outside worlds, on a world so small that all of it takes seconds."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rpil
from rpil_outside import running, submitted
from rpil_outside.__main__ import BEGIN, END, TELLING, main
from rpil_outside.columns import COLUMNS, Deed, auroc, best
from rpil_outside.goals import goals, of_ranking
from rpil_outside.ours import Case
from rpil_outside.peers import ALL, PEERS, NotMadeForIt, common
from rpil_outside.peers.common import design, policy, targets
from rpil_outside.table import of_worth, page, read, summarised, whole
from rpil_outside.worlds import WORLDS

BLIND = {ALL, "random 60 %"}
"""Columns that rank nothing."""
BY_ERRORS = {"QoQ"}
"""Columns by which large errors, of either sign, come first: what they compute is tested instead."""
FEW = [ALL, "length alone", "oracle", "success flag"]


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


def test_peers_are_short():
    for path in Path(PEERS[ALL].__file__).parent.glob("*.py"):
        lines = path.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= (120 if path.stem == "common" else 60), path.name


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


def test_a_second_run_adds_only_what_is_missing(tmp_path):
    arguments = ["run", "tiny", "--seeds", "2", "--json", str(tmp_path), "--quick", "--columns"]
    first, second, third = Tiny(), Tiny(), Tiny()
    main([*arguments, *FEW], {"tiny": first})
    assert len(first.driven) == 4 * 3  # the flag and the oracle give the same weights, which are driven once
    before = {path.name: path.read_text() for path in tmp_path.glob("*.json")}
    main([*arguments, *FEW], {"tiny": second})
    assert not second.driven
    assert before == {path.name: path.read_text() for path in tmp_path.glob("*.json")}
    main([*arguments, *FEW, "SAL"], {"tiny": third})
    assert len(third.driven) == 4
    assert set(json.loads((tmp_path / "tiny_one-bad_0.json").read_text())["columns"]) == {*FEW, "SAL"}
    with pytest.raises(SystemExit, match="with --quick"):
        main([name for name in arguments if name != "--quick"] + FEW, {"tiny": third})


def test_a_folder_of_figures_has_one_commit(tmp_path, monkeypatch, out):
    arguments = ["run", "tiny", "--seeds", "1", "--json", str(tmp_path), "--quick", "--columns", ALL]
    main(arguments, {"tiny": Tiny()})
    monkeypatch.setattr(running, "commit", lambda: "0123456789ab")
    with pytest.raises(SystemExit, match="not of 0123456789ab; give another folder"):
        main([*arguments, "oracle"], {"tiny": Tiny()})
    first, second = read(out)
    with pytest.raises(SystemExit, match="run them on one"):
        page([first, second | {"commit": "0123456789ab"}])


def test_a_night_runs_a_seed_of_all_worlds_before_the_next(tmp_path, monkeypatch, capsys):
    order, lacking = [], Tiny()
    lacking.needs = ("no_such_package",)
    monkeypatch.setattr("rpil_outside.__main__.run", lambda world, cells, seeds, *_: order.append((cells, *seeds)))
    worlds = {"tiny": Tiny(), "lacking": lacking, "other": Tiny()}
    assert main(["night", "--seeds", "2", "--json", str(tmp_path)], worlds) == 0
    assert order == [(["one bad", "three bad"], seed) for seed in (0, 0, 1, 1)]
    assert capsys.readouterr().err == "tiny is left out: it needs no_such_package.\n"


def test_a_night_has_cells_of_each_world():
    assert set(TELLING) == set(WORLDS)
    assert all(set(cells) <= set(WORLDS[name].cells) for name, cells in TELLING.items())


def test_the_table_is_written_between_the_marks_of_a_page(out, tmp_path, capsys):
    path = tmp_path / "page.md"
    path.write_text(f"# Title\n\n{BEGIN}\nold\n{END}\n\nNotes.\n")
    for _ in range(2):
        assert main(["table", str(out), "--brief", "--page", str(path)], {}) == 0
    main(["table", str(out), "--brief"], {})
    assert path.read_text() == f"# Title\n\n{BEGIN}\n\n{capsys.readouterr().out}\n{END}\n\nNotes.\n"
    path.write_text("# Title\n")
    with pytest.raises(SystemExit, match="write them where the tables belong"):
        main(["table", str(out), "--page", str(path)], {})


def test_goals_are_named_with_what_missed_them():
    def draw(cell, seed, kept, asked):
        policies = {ALL: 50.0, "oracle": 65.0, "rpil keep": kept, "rpil 4 asked": asked}
        aurocs = {"rpil 8 asked": 0.7, "SAL": 0.8 if seed else 0.66, "oracle": 1.0}
        rows = {name: {"policy": policies.get(name), "auroc": aurocs.get(name)} for name in [*policies, *aurocs]}
        return {"world": "w", "cell": cell, "seed": seed, "columns": rows}

    draws = [draw("a", 0, 50, 61), draw("a", 1, 50, 63), draw("b", 0, 50, 44), draw("b", 1, 50, 44)]
    found = [here for _, here in goals({"w": draws})]
    assert found[0] == "missed: 4 asked -6.0 (w); as asked: keep"
    assert found[1] == "met: 1 of 2; 0 by 4 random, 0 by 8 asked, 0 by 8 random"
    assert found[2] == "missed, 1 of 1: w 0.70 (SAL 0.73); not "  # within the noise of the first
    assert found[3] == "not run"
    assert of_ranking({"w": [draws[1]]}) == "missed, 0 of 1: ; not w 0.70 (SAL 0.80)"


def test_the_table_leads_with_the_worst_cell(out, capsys):
    assert main(["table", str(out)], {"tiny": Tiny()}) == 0
    text = capsys.readouterr().out
    head, detail = text.split("## tiny")
    rows = [line.split(" | ") for line in detail.splitlines() if line.startswith("| ")]
    assert [row[0].lstrip("| ") for row in rows[2:]] == list(COLUMNS)
    assert rows[0][1] == "worst cell, less all"
    assert re.match(r"Commit [0-9a-f]{12}", head)
    draws = read(out)
    found = summarised(draws, "PSD")
    assert f"| PSD | {whole(found.worst)} | {whole(found.worst)}/{whole(found.gain)} |" in head
    assert main(["table", str(out), "--brief"], {"tiny": Tiny()}) == 0
    brief = capsys.readouterr().out
    assert brief.split("Goals.")[1].strip() == head.split("Goals.")[1].strip()
    assert f"| PSD | {found.worst:+.1f} | – | tiny | {found.gain:+.1f} |" in brief
    assert "AUROC, mean" in head
    assert "AUROC, mean" not in brief


def test_a_draw_that_is_not_finished_is_left_out(out):
    first, second = read(out)
    half = second | {"columns": {ALL: second["columns"][ALL]}}
    assert page([first, half]) == page([first])


def test_a_world_that_lacks_a_package_says_so(tmp_path):
    world = Tiny()
    world.needs = "json", "no_such_package"
    with pytest.raises(SystemExit, match="tiny needs no_such_package: pip install"):
        main(["run", "tiny", "--json", str(tmp_path)], {"tiny": world})


def test_cells_that_gain_where_the_oracle_does():
    def draw(cell, *policies):
        return {"world": "w", "cell": cell, "columns": dict(zip([ALL, "oracle", "x"], map(row, policies), strict=True))}

    def row(policy):
        return {"policy": policy}

    assert of_worth([draw("a", 0, 12, 11), draw("b", 50, 70, 55), draw("c", 90, 95, 100)], "x") == "1/2"


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


def test_submitted_scores_give_the_row_of_the_column(out, tmp_path, capsys):
    made = Tiny().make("three bad", 0, True)
    path = tmp_path / "theirs.csv"
    lengths = dict(zip(made.demonstrations.ids, made.demonstrations.lengths.tolist(), strict=True))
    rows = [["id", "score"], *([name, -n] for name, n in reversed(lengths.items()))]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    assert main(["score", str(path), "tiny", "three bad", "0", "--quick"], {"tiny": Tiny()}) == 0
    theirs = capsys.readouterr().out.splitlines()[-1].split(" | ")[1:-1]
    draws = [draw for draw in read(out) if draw["cell"] == "three bad"]
    found = summarised(draws, "length alone")
    assert theirs[0] == f"{found.worst:+.1f}"
    assert theirs[5:8] == [f"{found.policy:.1f}", f"{found.auroc:.3f}", f"{found.auroc:.3f}"]


def test_submitted_weights_of_steps(tmp_path):
    data = Tiny().make("one bad", 0, True).demonstrations
    path, weight = tmp_path / "steps.csv", np.arange(data.n_steps) % 7 / 7
    rows = [f"{m},{t},{weight[data.offsets[m] + t]}" for m in range(14) for t in range(data.lengths[m])]
    path.write_text("\n".join(["id,step,score", *rows]))
    np.testing.assert_allclose(submitted.read(path, data).weights, weight)
    path.write_text("\n".join(["id,step,score", *rows[1:]]))
    with pytest.raises(SystemExit, match="look at '0', step 0"):
        submitted.read(path, data)


def test_a_column_is_not_scored_on_what_it_was_told():
    made = Tiny().make("three bad", 0, True)
    case, score = Case(made, 0), np.zeros(14)
    score[made.good] = 1.0
    wrong = np.flatnonzero(made.good)[0]
    score[wrong] = -1.0
    weights = best(score, case.data.lengths)
    assert auroc(Deed(score, weights), case) < 1.0
    assert auroc(Deed(score, weights, told=(str(wrong),)), case) == 1.0
