"""The paper's tables: statistics of the played episodes."""

import json

import numpy as np
import pytest
from scipy import stats
from scipy.special import logit

import paper
from rpil import BehavioralCloning, Demonstrations, simulate
from study import experiments
from study.experiments import METHODS, ORACLE, OURS, RAW_ORACLE, RECIPE
from study.recipe import PaperRecipe
from study.tables import wrong

pytestmark = pytest.mark.slow
CAR = "MountainCar-v0"
SMALL = ["--env", CAR, "--draws", "2", "--rollouts", "3", "--seed", "4", "--processes", "1"]


@pytest.fixture(autouse=True, scope="module")
def fast():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments, "OUR_FEATURES", "folded")  # "auto" takes five times as long
        yield


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    path = tmp_path_factory.mktemp("paper") / "paper.json"
    assert paper.main([*SMALL, "--json", str(path)]) == 0
    return json.loads(path.read_text())


def test_table_is_the_statistics_of_its_draws(found):
    assert [table["table"] for table in found["tables"]] == [1, 2]
    assert found["provenance"]["seeds"] == "4 to 5"
    assert found["provenance"]["arguments"] == {"env": [CAR], "draws": 2, "rollouts": 3, "seed": 4}
    for table in found["tables"]:
        assert table["policies"][OURS]["wrong"] == 0
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


def test_recipe_is_a_fixed_point_of_the_papers_equations():
    assert wrong([0.9, 0.5, 0.1, 0.5, 0.6], np.array([1, 1, 0, 0, 0])) == 3  # one half is wrong
    made = simulate(CAR, "corrupted", n_good=10, n_bad=10, seed=0)
    demonstrations = Demonstrations.from_episodes(made.episodes)
    model = PaperRecipe(0.2).fit(demonstrations)
    assert wrong(model.expert_proba_, made.is_good == 1) == 0
    # M-step: nothing but a weighted fit of the expert's term
    weight = np.repeat(model.expert_proba_, demonstrations.lengths)
    fit = BehavioralCloning("raw", C=1e6).fit(demonstrations, sample_weight=weight)
    observations, actions = demonstrations.observations, demonstrations.actions
    np.testing.assert_allclose(model.predict_proba(observations), fit.predict_proba(observations), atol=1e-3)
    # E-step: the raw complement, the given prior, sums of logs
    taken = model.predict_proba(observations)[np.arange(len(actions)), actions]
    log_odds = logit(0.2) + np.add.reduceat(np.log(taken) - np.log1p(-taken), demonstrations.offsets[:-1])
    np.testing.assert_allclose(model.log_odds_, log_odds, rtol=1e-6)
