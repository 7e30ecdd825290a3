"""The paper's tables and figures: statistics of the played episodes, in any number of processes."""

from __future__ import annotations

import json
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.special import logit

from rpil import BehavioralCloning, Demonstrations, rollout, simulate
from rpil.data.errors import DataError
from rpil.simulation.experts import expert
from study import experiments
from study.experiments import EXPERIMENTS, EXPERT, METHODS, ORACLE, OURS, RAW_ORACLE, RAW_TRUST_ALL, RECIPE
from study.figures import draw
from study.recipe import PaperRecipe
from study.tables import markdown, one_draw, run, wrong

pytestmark = pytest.mark.slow
CAR = "MountainCar-v0"
SMALL = {"draws": 2, "rollouts": 3, "seed": 4, "environments": [CAR]}


def data(env_id=CAR, kind="corrupted", seed=0):
    made = simulate(env_id, kind, n_good=10, n_bad=10, seed=seed)
    return Demonstrations.from_episodes(made.episodes), made.is_good == 1


@pytest.fixture(scope="module")
def found():
    calls = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments, "OUR_FEATURES", "folded")  # "auto" takes five times as long
        made = run(**SMALL, progress=lambda done, n: calls.append((done, n)))
    assert calls == [(0, 2), (1, 2), (2, 2)]
    return made


def test_the_experiments_are_the_papers():
    cells = [(e.table, e.env_id.split("-")[0], e.kind) for e in EXPERIMENTS]
    kinds = ("corrupted", "random")
    pairs = [(env, kind) for env in ("MountainCar", "LunarLander", "Acrobot") for kind in kinds]
    assert cells == [(n, *pair) for n, pair in enumerate(pairs, start=1)]
    assert [e.prior for e in EXPERIMENTS] == [0.2, 0.2, 0.5, 0.5, 0.75, 0.75]


def test_table_is_the_statistics_of_its_draws(found):
    for table in found["tables"]:
        rows = [row for row in found["draws"] if row["table"] == table["table"]]
        assert [row["seed"] for row in rows] == table["seeds"] == [4, 5]
        assert set(table["policies"]) == {*METHODS, "expert", ORACLE, RAW_ORACLE}
        for name, policy in table["policies"].items():
            means = [row["returns"][name]["mean"] for row in rows]
            low, high = stats.t.interval(0.95, 1, np.mean(means), stats.sem(means))
            assert policy["mean"] == pytest.approx(np.mean(means))
            assert 2 * policy["half_width"] == pytest.approx(high - low)
            assert policy["paper_way"] == rows[0]["returns"][name]["paper_way"]
        for name in (RECIPE, OURS):
            assert table["policies"][name]["wrong"] == sum(row["wrong"][name] for row in rows)


def test_returns_are_those_of_the_rollouts(found):
    played = rollout(expert(CAR), CAR, n_episodes=3, seed=4).returns
    first = found["draws"][0]["returns"]["expert"]
    assert first["mean"] == pytest.approx(played.mean())
    assert first["paper_way"]["mean"] == pytest.approx(played.mean())
    assert first["paper_way"]["half_width"] == pytest.approx(stats.t.ppf(0.975, 2) * stats.sem(played))


def test_papers_way_is_the_first_twenty_rollouts():
    (row, _) = one_draw(CAR, 0, 25, {})
    played = rollout(expert(CAR), CAR, n_episodes=25, seed=0).returns
    assert row["returns"]["expert"]["mean"] == pytest.approx(played.mean())
    assert row["returns"]["expert"]["paper_way"]["mean"] == pytest.approx(played[:20].mean())


def test_oracles_do_not_depend_on_bad_demonstrations(found):
    corrupted, random = (t["policies"] for t in found["tables"])
    for name in ("expert", ORACLE, RAW_ORACLE):
        assert {k: v for k, v in corrupted[name].items() if k != "printed"} == random[name]
    assert corrupted[OURS]["wrong"] == random[OURS]["wrong"] == 0
    assert corrupted[OURS]["mean"] == pytest.approx(corrupted[ORACLE]["mean"], abs=3)


def test_numbers_do_not_depend_on_the_process(found):
    raw = EXPERT, RAW_ORACLE, RAW_TRUST_ALL  # whose features are not those of the fixture
    again = run(**SMALL, processes=2, methods={RAW_TRUST_ALL: METHODS[RAW_TRUST_ALL]})
    for row, other in zip(again["draws"], found["draws"], strict=True):
        assert [row["returns"][name] for name in raw] == [other["returns"][name] for name in raw]


def test_written_tables(found):
    assert json.loads(json.dumps(found)) == found
    written = markdown(found)
    assert "2 draws of the data, 3 rollouts a policy" in written
    assert "| paper's recipe, printed | -104.45 | -106.25 |" in written
    oracle = found["tables"][0]["policies"][ORACLE]
    assert f"| {ORACLE} | {oracle['mean']:.1f} ± {oracle['half_width']:.1f} |" in written


def test_methods_get_the_same_demonstrations_and_no_truth(found):
    seen = []

    def other(demonstrations, experiment, seed):
        seen.append((demonstrations, experiment.table, seed))
        return BehavioralCloning().fit(demonstrations)

    more = run(**SMALL, methods={"other": other, "ranks only": lambda *given: None})
    assert [given[1:] for given in seen] == [(1, 4), (2, 4), (1, 5), (2, 5)]
    assert all(type(given[0]) is Demonstrations for given in seen)
    np.testing.assert_array_equal(seen[1][0].observations, data(kind="random", seed=4)[0].observations)
    assert set(more["tables"][0]["policies"]) == {"other", "expert", ORACLE, RAW_ORACLE}
    assert more["tables"][0]["policies"][RAW_ORACLE] == found["tables"][0]["policies"][RAW_ORACLE]


def test_probability_of_one_half_is_wrong():
    assert wrong([0.9, 0.5, 0.1, 0.5, 0.6], np.array([1, 1, 0, 0, 0])) == 3


# --- the recipe -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["corrupted", "random"])
def test_recipe_is_a_fixed_point_of_the_papers_equations(kind):
    demonstrations, good = data(kind=kind)
    model = PaperRecipe(0.2).fit(demonstrations)
    assert wrong(model.expert_proba_, good) == 0
    # M-step: nothing but a weighted fit of the expert's term
    weight = np.repeat(model.expert_proba_, demonstrations.lengths)
    fit = BehavioralCloning("raw", C=1e6).fit(demonstrations, sample_weight=weight)
    observations, actions = demonstrations.observations, demonstrations.actions
    np.testing.assert_allclose(model.predict_proba(observations), fit.predict_proba(observations), atol=1e-3)
    # E-step: the raw complement, the given prior, sums of logs
    taken = model.predict_proba(observations)[np.arange(len(actions)), actions]
    log_odds = logit(0.2) + np.add.reduceat(np.log(taken) - np.log1p(-taken), demonstrations.offsets[:-1])
    np.testing.assert_allclose(model.log_odds_, log_odds, rtol=1e-6)


def test_recipe_with_one_newton_step_can_trust_no_demonstration():
    demonstrations, good = data("LunarLander-v3", seed=116)
    assert PaperRecipe(newton=1).fit(demonstrations).expert_proba_.max() < 0.5
    assert wrong(PaperRecipe().fit(demonstrations).expert_proba_, good) == 0


def test_recipe_starts_from_the_pooled_fit_and_stops():
    demonstrations, _ = data()
    start, early, late = (PaperRecipe(0.2, max_iter=n).fit(demonstrations) for n in (0, 1, 101))
    pooled = BehavioralCloning("raw", C=1e6).fit(demonstrations)
    np.testing.assert_allclose(start.coef_, pooled.coef_, rtol=1e-2, atol=1e-2)
    assert (start.n_iter_, early.n_iter_) == (0, 1)
    assert 1 < late.n_iter_ < 101
    with pytest.raises(DataError, match=r"prior 2\.0 is no probability"):
        PaperRecipe(2.0).fit(demonstrations)


# --- the figures ----------------------------------------------------------------------------------------------------


def test_figures(tmp_path):
    paths = draw(tmp_path / "figures", seed=4)
    assert [p.name.split("-")[1] for p in paths] == list("1234567")
    assert sorted(paths) == sorted((tmp_path / "figures").iterdir())
    for path in paths:
        head = path.read_bytes()[:24]
        assert head.startswith(b"\x89PNG\r\n\x1a\n")
        width, height = struct.unpack(">II", head[16:24])
        assert 800 < width < 2000
        assert 500 < height < 2000
        assert 10_000 < path.stat().st_size < 500_000


def test_colours_are_those_of_actions_even_where_one_is_never_taken():
    from matplotlib.colors import to_rgba

    from study.figures import ACTION_COLOURS, _car

    policy = SimpleNamespace(predict=lambda observations: np.full(len(observations), 2))
    figure = _car([("right only", policy, np.zeros((3, 2)), np.array([2, 2, 2]))])
    (ax,) = figure.axes
    for drawn in (*ax.images, *ax.collections):
        for action, colour in enumerate(ACTION_COLOURS):
            assert drawn.cmap(drawn.norm(action)) == to_rgba(colour)


def test_file_in_place_of_a_folder_gives_a_message(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(DataError, match="it is a file; give the path of a folder"):
        draw(tmp_path / "file", seed=4)
    with pytest.raises(DataError, match="the folder cannot be made"):
        draw(tmp_path / "file" / "below", seed=4)
    assert (tmp_path / "file").read_text() == "mine"
