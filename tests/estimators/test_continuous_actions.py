"""Continuous actions from end to end: EM, what is trusted, what is learned, kept and shown."""

from __future__ import annotations

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, LogisticRegression
from sklearn.metrics import r2_score, roc_auc_score

from problems import Toy, continuous_zoo, make, make_continuous, pooled_state
from rpil import Settings
from rpil.cli import main as cli
from rpil.data import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import AmbiguousWarning, DataError
from rpil.data.spaces import Box
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.persistence import load, save
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.mixture.adversaries.box import UniformBox
from rpil.mixture.adversaries.named import ADVERSARIES
from rpil.mixture.em import e_step, run_em
from rpil.mixture.settings import MixtureSettings
from rpil.simulation.simulate import simulate
from small import mixture

ZOO = continuous_zoo(0)
STEPS = (40, 60)
MANY: dict[str, Any] = {"n_good": 10, "n_bad": 10, "steps": STEPS}
ESTIMATORS = [RPIL(), BehavioralCloning(), RMEnt()]


def right(model: RPIL, toy: Toy) -> bool:
    return model.audit_.verdicts == tuple(np.where(toy.is_good, "expert", "adversary"))


def means(toy: Toy) -> np.ndarray:
    """What the expert means to do."""
    return toy.observations @ toy.weights[:-1] + toy.weights[-1]


def one_sentence(error: Any) -> bool:
    message = str(error.value)
    return message.endswith(".") and ". " not in message.replace("\n", " ")


# ---- EM --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ADVERSARIES["continuous"])
def test_objective_never_falls(which):
    for name, toy in ZOO.items():
        problem = toy.problem()
        state = pooled_state(problem, which)
        history = run_em(problem, state, MixtureSettings(max_iter=12, tol=0.0)).history
        assert np.isfinite(history).all(), name
        assert np.diff(history).min() >= -1e-9 * np.abs(history).max(), name


@pytest.mark.parametrize("which", ADVERSARIES["continuous"])
def test_objective_never_falls_with_splines(which):
    for seed in range(3):
        problem = make_continuous("window", seed).problem("spline")
        history = run_em(problem, pooled_state(problem, which), MixtureSettings(max_iter=12, tol=0.0)).history
        assert np.diff(history).min() >= -1e-9 * np.abs(history).max()


def test_experts_with_actions_on_the_bounds_of_the_box_are_trusted():
    """Most of their actions are at a bound: a straight line misses these, and random ones look more of one mind."""
    rng, is_good, lengths = np.random.default_rng(0), np.arange(30) % 3 > 0, np.full(30, 100)
    observations = rng.normal(size=(3000, 6))
    wanted = observations @ rng.normal(scale=1.1, size=(6, 2)) + 0.1 * rng.normal(size=(3000, 2))
    random = rng.uniform(-1.0, 1.0, size=(3000, 2))
    actions = np.where(np.repeat(is_good, lengths)[:, None], np.clip(wanted, -1.0, 1.0), random)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    audit = RPIL().fit(Demonstrations.from_arrays(observations, actions, offsets)).audit_
    assert audit.verdicts == tuple(np.where(is_good, "expert", "adversary"))


def test_one_outlying_step_does_not_decide_a_verdict():
    """Under a Gaussian its density would be e^-5000; the box and the tails forgive it."""
    toy = make_continuous("random", 0, **MANY)
    spoiled = replace(toy, actions=toy.actions.copy())
    spoiled.actions[3] = toy.space.high
    spoiled.actions[toy.offsets[4]] = toy.space.low
    model = RPIL(action_box=(toy.space.low, toy.space.high)).fit(spoiled.demonstrations)
    assert right(model, toy)


# ---- RPIL ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("n_parts", [1, 2])
@pytest.mark.parametrize("kind", ["random", "noisy", "window"])
def test_adversaries_are_found_and_the_experts_policy_is_learned(kind, n_parts, seed):
    toy = make_continuous(kind, seed, n_parts=n_parts, **MANY)
    model = RPIL().fit(toy.demonstrations)
    assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0
    assert right(model, toy) or kind == "window"
    assert model.audit_.identifiable
    np.testing.assert_array_equal(model.log_odds_, model.audit_.log_odds)
    truth = model.space_.act(means(toy))
    naive = BehavioralCloning().fit(toy.demonstrations)
    ours, theirs = (np.abs(m.predict(toy.observations) - truth).mean() for m in (model, naive))
    assert ours < 0.05
    assert ours < theirs or kind != "random"  # heavy tails alone forgive half of the steps


@pytest.mark.parametrize(("n_good", "n_bad"), [(4, 12), (3, 27)])
def test_adversaries_in_the_majority_are_found(n_good, n_bad):
    toy = make_continuous("random", 2, n_good=n_good, n_bad=n_bad, steps=STEPS)
    assert right(RPIL().fit(toy.demonstrations), toy)


@pytest.mark.parametrize("features", ["spline", "poly", "auto"])
def test_every_kind_of_features_with_continuous_actions(features):
    toy = make_continuous("random", 1, **MANY)
    model = RPIL(features).fit(toy.demonstrations)
    assert right(model, toy)
    score = r2_score(model.space_.act(means(toy)), model.predict(toy.observations))
    assert score > 0.98
    assert any(f"linear in {model.features_.kind} features" in sentence for sentence in model.audit_.assumptions)


def test_auto_features_fit_a_nonlinear_expert():
    toy = make_continuous("random", 0, **MANY)
    good = toy.is_good[toy.groups]
    curve = 3 * toy.observations[:, 0] * toy.observations[:, 1]
    actions = np.where(good, curve + 0.2 * np.random.default_rng(0).normal(size=len(good)), toy.actions[:, 0])[:, None]
    data = Demonstrations.from_arrays(toy.observations, actions, toy.offsets)
    model = RPIL("auto", settings=Settings(judge_features="poly")).fit(data)
    assert model.features_.kind == "poly"
    assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0


@pytest.mark.parametrize("bad", ["noisy", "window"])
def test_expert_with_a_policy_in_two_parts_is_one_expert(bad):
    # A straight line sees two experts in a lander, and trusts half of each demonstration.
    made = simulate("LunarLanderContinuous-v3", bad, n_good=10, n_bad=10, seed=1000)
    model = RPIL().fit(Demonstrations.from_episodes(made.episodes))
    assert roc_auc_score(made.is_good, model.log_odds_) == 1.0
    verdicts = np.array(model.audit_.verdicts)
    assert (verdicts[made.is_good == 0] == "adversary").all()
    assert not (verdicts[made.is_good == 1] == "adversary").any()


@pytest.mark.parametrize("kind", ["flipped", "smooth"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_of_two_consistent_groups_only_a_label_names_the_expert(kind, seed):
    toy = make_continuous(kind, seed, steps=STEPS)
    with pytest.warns(AmbiguousWarning, match="two groups of demonstrations act in two different ways"):
        blind = RPIL().fit(toy.demonstrations)
    assert not blind.audit_.identifiable
    assert {frozenset(group) for group in blind.audit_.competing} == {frozenset(toy.ids[:6]), frozenset(toy.ids[6:])}
    for labels in ({"d0": "expert"}, {"d11": "adversary"}, {"d1": "expert", "d7": "adversary"}):
        told = RPIL().fit(toy.demonstrations, labels=labels)
        assert told.audit_.identifiable
        assert right(told, toy), labels
        assert np.abs(told.predict(toy.observations) - told.space_.act(means(toy))).mean() < 0.1


def test_noisy_and_clean_demonstrations_form_no_rival_groups():
    for kind in ("random", "noisy", "window", "none"):
        with warnings.catch_warnings():
            warnings.simplefilter("error", AmbiguousWarning)
            assert RPIL().fit(make_continuous(kind, 3, **MANY).demonstrations).audit_.identifiable


def test_no_adversary_among_equal_demonstrations():
    toy = make_continuous("none", 0, **MANY)
    audit = RPIL().fit(toy.demonstrations).audit_
    assert audit.finding == "nobody stands out"
    assert set(audit.verdicts) == {"uncertain"}


@pytest.mark.parametrize("which", ADVERSARIES["continuous"])
@pytest.mark.parametrize("kind", ["random", "none"])
def test_every_named_adversary_of_continuous_actions(which, kind):
    toy = make_continuous(kind, 0, **MANY)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AmbiguousWarning)
        model = RPIL(adversary=which).fit(toy.demonstrations)
    assert model.audit_.adversary == which
    assert np.isfinite(model.log_odds_).all()
    if kind == "random" and which != "own policy":  # which may be either's
        assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0


def test_adversary_instance_and_fixed_prior():
    toy = make_continuous("random", 0, **MANY)
    box = Box.around(toy.actions)
    model = RPIL(adversary=UniformBox(box.log_volume), settings=mixture(prior=0.5)).fit(toy.demonstrations)
    assert right(model, toy)
    assert model.audit_.prior.mean == 0.5


def test_constant_part_of_an_action_and_no_noise():
    for name in ("a part that never moves", "no noise at all"):
        toy = ZOO[name]
        model = RPIL().fit(toy.demonstrations)
        assert roc_auc_score(toy.is_good, model.log_odds_) == 1.0, name
        predicted = model.predict(toy.observations)
        assert np.isfinite(predicted).all()
    still = RPIL().fit(ZOO["a part that never moves"].demonstrations)
    np.testing.assert_allclose(still.predict(toy.observations)[:, 1], 3.0, atol=1e-3)


def test_regressor_as_policy():
    toy = make_continuous("random", 1, **MANY)
    model = RPIL(policy=LinearRegression()).fit(toy.demonstrations)
    assert right(model, toy)
    assert r2_score(model.space_.act(means(toy)), model.predict(toy.observations)) > 0.98
    with pytest.raises(DataError, match="The policy LogisticRegression is no regressor and the actions are continuous"):
        RPIL(policy=LogisticRegression()).fit(toy.demonstrations)
    with pytest.raises(DataError, match="The policy LinearRegression is a regressor and the actions are discrete"):
        RPIL(policy=LinearRegression()).fit(make("random", 0).demonstrations)


def test_score_demonstrations_of_new_data():
    toy, new = (make_continuous("random", 0, **MANY) for _ in range(2))
    model = RPIL(action_box=(toy.space.low, toy.space.high)).fit(toy.demonstrations.select(slice(0, 20, 2)))
    fresh = new.demonstrations.select(slice(1, 20, 2))
    found = model.score_demonstrations(fresh)
    np.testing.assert_array_equal(found > 0, new.is_good[1::2])
    single = [model.score_demonstrations(fresh.select([m]))[0] for m in range(10)]
    np.testing.assert_allclose(single, found)
    arrays = model.score_demonstrations(fresh.observations, fresh.actions, groups=fresh.groups)
    np.testing.assert_array_equal(arrays, found)
    with pytest.raises(DataError, match="the actions are discrete, and the fitted ones were not") as error:
        model.score_demonstrations(make("random", 0, n_observations=3).demonstrations)
    assert one_sentence(error)
    with pytest.raises(DataError) as error:  # another number of parts
        model.score_demonstrations(make_continuous("random", 0, n_parts=1).demonstrations)
    assert one_sentence(error)


def test_score_demonstrations_outside_the_box():
    """What nobody did while it was fitted is no reason to fail."""
    toy = make_continuous("random", 0, **MANY)
    model = RPIL().fit(toy.demonstrations)
    far = Demonstrations.from_arrays(toy.observations, 10 * toy.actions, toy.offsets)
    found = model.score_demonstrations(far)
    assert np.isfinite(found).all()
    assert (found < 0).all()


def test_same_seed_gives_same_bits_for_arrays_and_demonstrations():
    toy = make_continuous("noisy", 0)
    one, two = (RPIL(random_state=3).fit(toy.demonstrations) for _ in range(2))
    three = RPIL(random_state=3).fit(toy.observations, toy.actions, groups=toy.groups)
    for other in (two, three):
        np.testing.assert_array_equal(one.log_odds_, other.log_odds_)
        np.testing.assert_array_equal(one.policy_.weights, other.policy_.weights)
        np.testing.assert_array_equal(one.policy_.cholesky, other.policy_.cholesky)


def test_units_of_the_actions_do_not_matter():
    toy = make_continuous("noisy", 0, **MANY)
    unit, shift = np.array([1e-3, 40.0]), np.array([3.0, -500.0])
    other = replace(toy, actions=toy.actions * unit + shift)
    one, two = (RPIL().fit(t.demonstrations) for t in (toy, other))
    np.testing.assert_allclose(two.log_odds_, one.log_odds_, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose((two.predict(toy.observations) - shift) / unit, one.predict(toy.observations), atol=1e-4)


# ---- the scikit-learn face -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_parts", [1, 2])
@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_predictions_lie_in_the_box(estimator, n_parts):
    toy = make_continuous("random", 0, n_parts=n_parts)
    model = clone(estimator).fit(toy.demonstrations)
    assert len(model.classes_) == 0
    assert isinstance(model.space_, Box)
    np.testing.assert_array_equal(model.space_.low, toy.actions.min(axis=0))
    predicted = model.predict(100 * toy.observations)
    assert predicted.shape == (len(toy.actions), n_parts)
    assert ((model.space_.low <= predicted) & (predicted <= model.space_.high)).all()
    assert (predicted == model.space_.high).any()
    log_prob = model.log_prob(toy.observations, toy.actions)
    assert log_prob.shape == (len(toy.actions),)
    assert model.coef_.shape == (n_parts, 3)
    linear = toy.observations @ model.coef_.T + model.intercept_
    np.testing.assert_allclose(model.predict(toy.observations), model.space_.act(linear), atol=1e-9)
    for method in ("predict_proba", "predict_log_proba"):
        with pytest.raises(DataError, match="The actions are continuous") as error:
            getattr(model, method)(toy.observations)
        assert one_sentence(error)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_score_is_r_squared(estimator):
    toy = make_continuous("noisy", 0, n_bad=2)
    model = clone(estimator).fit(toy.demonstrations)
    expected = r2_score(toy.actions, model.predict(toy.observations))
    assert model.score(toy.observations, toy.actions) == pytest.approx(expected)


def test_behavioral_cloning_without_outliers_is_least_squares():
    toy = make_continuous("none", 0, n_good=30, n_bad=0, steps=(100, 100))
    ours = BehavioralCloning().fit(toy.observations, toy.actions)
    theirs = LinearRegression().fit(toy.observations, toy.actions)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, atol=0.01)
    np.testing.assert_allclose(ours.intercept_, theirs.intercept_, atol=0.01)


def test_sample_weight_of_continuous_actions():
    toy = make_continuous("random", 0)
    good = toy.is_good[toy.groups]
    weighted = BehavioralCloning().fit(toy.observations, toy.actions, sample_weight=good)
    alone = BehavioralCloning().fit(toy.observations[good], toy.actions[good])
    np.testing.assert_allclose(
        weighted.predict(toy.observations[good]), alone.predict(toy.observations[good]), atol=0.02
    )


def test_one_dimensional_float_actions():
    toy = make_continuous("random", 0, n_parts=1)
    columns = Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets)
    flat = Demonstrations.from_arrays(toy.observations, toy.actions[:, 0], toy.offsets)
    models = [RPIL().fit(data) for data in (columns, flat)]
    np.testing.assert_array_equal(models[0].log_odds_, models[1].log_odds_)
    assert models[1].predict(toy.observations).shape == (len(toy.actions), 1)
    # scikit-learn's own checks want one-dimensional floats refused: they look like a regression
    with pytest.raises(ValueError, match="continuous") as error:
        RPIL().fit(toy.observations, toy.actions[:, 0], groups=toy.groups)
    assert one_sentence(error)


@pytest.mark.parametrize(
    ("box", "words"),
    [
        ((-1.0, 1.0), r"demonstration 'd\d+': action [01] is -?[\d.]+, outside the declared box from -1 to 1; widen"),
        (([-99.0, -0.1], [99.0, 0.1]), "action 1 is .*, outside the declared box from -0.1 to 0.1; widen action_box"),
        ((1.0, -1.0), "is empty or unbounded; give finite low < high"),
        ((-np.inf, np.inf), "is empty or unbounded"),
        ((np.nan, 1.0), "is empty or unbounded"),
        (([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]), r"give \(low, high\), numbers or one for each part"),
        (5.0, r"give \(low, high\)"),
        ((1.0, 2.0, 3.0), r"give \(low, high\)"),
        (("a", "b"), r"give \(low, high\)"),
    ],
)
def test_action_box_that_does_not_fit_is_refused_in_one_sentence(box, words):
    toy = make_continuous("random", 0)
    with pytest.raises(DataError, match=words) as error:
        RPIL(action_box=box).fit(toy.demonstrations)
    assert one_sentence(error)


def test_declared_action_box_is_kept():
    toy = make_continuous("random", 0)
    model = RPIL(action_box=([-50, -40], 60)).fit(toy.demonstrations)
    np.testing.assert_array_equal(model.space_.low, [-50, -40])
    np.testing.assert_array_equal(model.space_.high, [60, 60])


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_invalid_continuous_actions_are_refused_in_one_sentence(estimator):
    toy = make_continuous("random", 0)
    same = Demonstrations.from_arrays(toy.observations, np.full_like(toy.actions, 0.5), toy.offsets)
    with pytest.raises(DataError, match="every action is the same; give demonstrations with two at least") as error:
        clone(estimator).fit(same)
    assert one_sentence(error)
    spoiled = toy.actions.copy()
    spoiled[3, 1] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        clone(estimator).fit(toy.observations, spoiled)


def test_action_box_for_discrete_actions_is_refused_in_one_sentence():
    with pytest.raises(DataError, match="the actions are discrete, which no action_box fits; leave it out") as error:
        RPIL(action_box=(0, 1)).fit(make("random", 0).demonstrations)
    assert one_sentence(error)


# ---- what is kept, shown and told ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "estimator",
    [
        *ESTIMATORS,
        *(RPIL(adversary=which) for which in ADVERSARIES["continuous"]),
        RPIL("spline", action_box=([-50.0, -40.0], 60.0)),
    ],
    ids=lambda e: f"{type(e).__name__} {getattr(e, 'adversary', '')}",
)
@pytest.mark.filterwarnings("ignore::rpil.AmbiguousWarning")
def test_loaded_estimator_predicts_the_same_bits(estimator, tmp_path):
    toy = make_continuous("noisy", 0)
    model = clone(estimator).fit(toy.demonstrations)
    save(model, tmp_path / "p")
    loaded = load(tmp_path / "p")
    np.testing.assert_array_equal(loaded.predict(toy.observations), model.predict(toy.observations))
    np.testing.assert_array_equal(
        loaded.log_prob(toy.observations, toy.actions), model.log_prob(toy.observations, toy.actions)
    )
    assert len(loaded.classes_) == 0
    np.testing.assert_array_equal(loaded.space_.high, model.space_.high)
    if isinstance(model, RPIL):
        data = toy.demonstrations
        np.testing.assert_array_equal(loaded.score_demonstrations(data), model.score_demonstrations(data))
        assert loaded.audit_.to_dict() == model.audit_.to_dict()
    save(loaded, tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == (tmp_path / "p").read_bytes()


@pytest.mark.parametrize("name", ["swings.npz", "swings.parquet", "swings.csv"])
def test_file_formats_with_continuous_actions(name, tmp_path):
    """What is read back is what was written, so that the commands need but one sort of file."""
    toy = make_continuous("random", 0, **MANY)
    formats.write(tmp_path / name, Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets), {})
    read = formats.read(tmp_path / name)
    np.testing.assert_array_equal(read.observations, toy.observations)
    np.testing.assert_array_equal(read.actions, toy.actions)
    np.testing.assert_array_equal(read.offsets, toy.offsets)


def test_commands_with_continuous_actions(tmp_path, monkeypatch):
    name = "swings.csv"

    def ok(*arguments: Any) -> str:
        result = CliRunner().invoke(cli.main, [str(argument) for argument in arguments])
        assert result.exit_code == 0, result.output
        return result.stdout

    monkeypatch.chdir(tmp_path)
    toy = make_continuous("random", 0, **MANY)
    formats.write(Path(name), Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets), {})
    audit = json.loads(ok("audit", name, "--json", "--report", "r.html", "--weights", "w.csv"))
    verdicts = {entry["id"]: entry["verdict"] for entry in audit["demonstrations"]}
    assert [verdicts[m] for m in range(20)] == np.where(toy.is_good, "expert", "adversary").tolist()
    page = Path("r.html").read_text()
    assert name in page
    assert re.search(r"\bnan\b", page) is None
    assert len(Path("w.csv").read_text().splitlines()) == len(toy.actions) + 1
    ok("fit", name, "-o", "policy", "--features", "raw")
    assert load("policy").predict(toy.observations).shape == toy.actions.shape
    other = json.loads(ok("audit", name, "--json", "--adversary", "own-policy"))
    assert other["adversary"] == "own policy"


def test_adversary_for_other_actions_is_refused():
    toy = make_continuous("random", 0)
    for which in ("complement", "confusion", "constant", "normalised complement"):
        with pytest.raises(DataError, match=f"'{which}' for continuous actions; choose auto, uniform") as error:
            RPIL(adversary=which).fit(toy.demonstrations)
        assert one_sentence(error)


def test_the_audit_of_an_e_step_is_finite_for_long_demonstrations():
    toy = make_continuous("random", 0, n_good=2, n_bad=2, steps=(3000, 3000))
    problem = toy.problem()
    state = pooled_state(problem, "uniform")
    posterior = e_step(problem, state, state.policy.outputs(problem.features))
    assert np.isfinite(posterior.log_odds).all()
    assert np.isfinite(posterior.expert).all()
