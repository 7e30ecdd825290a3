"""Actions of several parts, of which some are classes: the judge and the policy take them as a product."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score

import rpil
from rpil import RPIL, BehavioralCloning, DataError, Demonstrations, RMEnt, formats
from rpil.cli.main import main
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box, Product
from rpil.inference.held_out import held_out_model, log_reference
from rpil.inference.settings import HeldOutSettings
from rpil.policies.linear import linear_policy
from rpil.simulation.rollouts import rollout
from small import small_rpil

N, STEPS = 16, 30
GOOD = np.arange(N) >= 4
SKILLS = np.array(["grip", "reach", "turn"])


def recorded(seed=0, n=N, good=GOOD):
    """States, a skill, and a number whose sign depends on the skill; bad ones take the sign of another."""
    rng = np.random.default_rng(seed)
    states = rng.uniform(-1, 1, (n * STEPS, 3))
    skill = (4 * states @ rng.normal(size=(3, 3)) + rng.gumbel(size=(n * STEPS, 3))).argmax(axis=1)
    followed = np.where(np.repeat(good, STEPS), skill, (skill + rng.integers(1, 3, len(skill))) % 3)
    number = np.choose(followed, [states[:, 0], -states[:, 0], states[:, 2]]) + 0.2 * rng.normal(size=len(skill))
    return states, skill, number


def frame(states, parts, n=N):
    columns = {f"state.{d}": column for d, column in enumerate(states.T)}
    return pa.table({"episode": np.repeat(np.arange(n), STEPS), **columns, **parts})


@pytest.fixture(scope="module")
def table():
    states, skill, number = recorded()
    return frame(states, {"action.x": number, "action.skill": SKILLS[skill]})


@pytest.fixture(scope="module")
def demonstrations(table):
    return rpil.read(table)


def test_texts_among_numbers_are_classes_that_come_first(demonstrations):
    assert demonstrations.part_classes == (tuple(SKILLS), ())
    assert demonstrations.action_names == ("action.skill", "action.x")
    np.testing.assert_array_equal(demonstrations.action_values[0], SKILLS[recorded()[1]])
    again = rpil.read(formats.table.from_demonstrations(demonstrations, {}))
    assert again.part_classes == demonstrations.part_classes
    np.testing.assert_array_equal(again.actions, demonstrations.actions)


def test_a_file_of_arrays_cannot_hold_them(demonstrations, tmp_path):
    with pytest.raises(DataError, match="NPZ holds actions whose parts are all numbers"):
        formats.write(tmp_path / "a.npz", demonstrations)


def test_parameters_are_judged_by_the_rule_of_their_skill(table):
    assert roc_auc_score(GOOD, rpil.audit(table).log_odds) == 1.0
    numbers_alone = rpil.audit(table, exclude="action.skill").log_odds
    assert roc_auc_score(GOOD, numbers_alone) < 0.95


def test_the_probability_is_the_product_of_that_of_the_classes_and_of_the_numbers_given_them(demonstrations):
    d = demonstrations
    space = Product(d.part_classes, Box.around(d.actions[:, 1:]))
    data = FitData(np.hstack([d.observations, np.ones((d.n_steps, 1))]), d.actions, d.offsets, space)
    skills, numbers = data.factors
    np.testing.assert_array_equal(skills.actions, d.actions[:, 0])
    one_hot = np.eye(3)[skills.actions]
    within = (one_hot[:, :, None] * data.features[:, None]).reshape(d.n_steps, -1)
    np.testing.assert_array_equal(numbers.features, np.hstack([within, data.features]))
    settings, weight = HeldOutSettings(), np.ones(d.n_steps)
    model = held_out_model(data, 0, settings)
    own = [each.evaluate(weight, 1e-3) for each in model.models]
    np.testing.assert_array_equal(model.evaluate(weight, 1e-3), own[0] + own[1])
    parts = model.log_prob_of_parts(weight, 1e-3)
    np.testing.assert_allclose(parts.sum(axis=1), own[0] + own[1])
    every = np.ones(N, dtype=bool)
    of_factors = [log_reference(each, every, settings) for each in data.factors]
    np.testing.assert_array_equal(log_reference(data, every, settings), of_factors[0] + of_factors[1])


def test_many_features_have_one_constant_within_each_class():
    space = Product((tuple("abc"), ()), Box(np.zeros(1), np.ones(1)))
    features, actions = np.arange(400.0).reshape(2, 200), np.array([[2.0, 0.5], [0.0, 0.5]])
    given = space.given(features, actions)
    np.testing.assert_array_equal(given[:, 3:], features)
    np.testing.assert_array_equal(given[:, :3], [[0, 0, features[0, -1]], [features[1, -1], 0, 0]])


def test_other_demonstrations_are_judged_by_their_classes_and_not_by_codes(demonstrations, tmp_path):
    model = RPIL().fit(demonstrations)
    rpil.save(model, tmp_path / "model.rpil")
    again, every = rpil.load(tmp_path / "model.rpil"), model.score_demonstrations(demonstrations)
    np.testing.assert_array_equal(again.score_demonstrations(demonstrations), every)
    few = demonstrations.select([5])
    kept = np.isin(few.action_values[0], ["reach", "turn"])  # codes 1 and 2 are 0 and 1 among them
    codes = np.column_stack([few.actions[kept, 0] - 1, few.actions[kept, 1]])
    offsets, names = [0, kept.sum()], demonstrations.observation_names
    same = Demonstrations(few.observations[kept], few.actions[kept], offsets, part_classes=few.part_classes)
    other = Demonstrations(few.observations[kept], codes, offsets, part_classes=(("reach", "turn"), ()))
    assert names == few.observation_names
    np.testing.assert_array_equal(model.score_demonstrations(same), model.score_demonstrations(other))
    unknown = Demonstrations(few.observations[kept], codes, offsets, part_classes=(("reach", "wave"), ()))
    with pytest.raises(DataError, match="'wave' is not among the fitted ones"):
        model.score_demonstrations(unknown)
    with pytest.raises(DataError, match="the parts of the action that are classes are not the fitted ones"):
        model.score_demonstrations(Demonstrations(few.observations, few.actions, [0, STEPS]))


@pytest.mark.parametrize("model", [BehavioralCloning(), RMEnt(0.5), RPIL(), RPIL("auto")])
def test_a_policy_is_the_product_of_its_factors(demonstrations, model, tmp_path):
    d = demonstrations
    rpil.save(model.fit(d), tmp_path / "policy")
    again, features = rpil.load(tmp_path / "policy"), model.features_.design(d.observations)
    predicted, log_prob = model.predict(d.observations), model.log_prob(d.observations, d.actions)
    np.testing.assert_array_equal(again.predict(d.observations), predicted)
    np.testing.assert_array_equal(again.log_prob(d.observations, d.actions), log_prob)
    skills, numbers = (factor.model for factor in model.policy_.factors)
    (proba,) = model.predict_proba(d.observations)
    np.testing.assert_array_equal(proba, np.exp(skills.outputs(features)))
    np.testing.assert_array_equal(predicted[:, 0], proba.argmax(axis=1))
    mean = [numbers.outputs(model.space_.given(features, each)) for each in (d.actions, predicted)]
    expected = np.log(proba)[np.arange(d.n_steps), d.actions[:, 0].astype(int)]
    np.testing.assert_allclose(log_prob, expected + numbers.log_prob(mean[0], d.actions[:, 1:]))
    np.testing.assert_array_equal(predicted[:, 1:], model.space_.numbers.act(mean[1]))
    away = predicted[:, 1] - d.actions[:, 1]
    explained = 1 - (away**2).sum() / ((d.actions[:, 1] - d.actions[:, 1].mean()) ** 2).sum()
    share = (predicted[:, 0] == d.actions[:, 0]).mean()
    assert model.score(d.observations, d.actions) == pytest.approx((share + explained) / 2)


def test_the_policy_of_each_factor_is_that_of_its_own_fit(demonstrations):
    """Also where the factors have other sizes than the features: a part of one class, and one of four."""
    d, rng = demonstrations, np.random.default_rng(0)
    other = rng.integers(4, size=d.n_steps)
    codes = np.column_stack([np.zeros(d.n_steps), d.actions[:, 0], other])
    classes = (("only",), tuple(SKILLS), (0, 1, 2, 3))
    several = Demonstrations(d.observations, codes, d.offsets, part_classes=classes)
    model = BehavioralCloning().fit(several)
    alone = [BehavioralCloning().fit(d.observations, part.astype(int)) for part in codes[:, 1:].T]
    proba = model.predict_proba(d.observations)
    np.testing.assert_array_equal(proba[0], 1.0)
    for of_part, one in zip(proba[1:], alone, strict=True):
        np.testing.assert_allclose(of_part, one.predict_proba(d.observations), atol=1e-7)
    predicted = np.column_stack([one.predict(d.observations) for one in alone])
    np.testing.assert_array_equal(model.predict(d.observations)[:, 1:], predicted)


@pytest.mark.parametrize("n_features", [3, 200])
def test_numbers_have_a_constant_within_each_class(n_features):
    space = Product((tuple("abc"), ()), Box(np.zeros(1), np.ones(1)))
    ridge = np.append(np.full(n_features, 2.0), 0.0)
    numbers = linear_policy(space, ridge, 10.0).factors[1].model
    given = space.given(np.ones((1, n_features + 1)), np.zeros((1, 2)))
    np.testing.assert_array_equal(numbers.ridge, np.append(np.full(given.shape[1] - 1, 2.0), 0.0))


@pytest.mark.parametrize("wrong", [[[3.0, 0.0]], [[-1.0, 0.0]], [[0.5, 0.0]], [[np.nan, 0.0]], [[0.0]], [0.0]])
def test_actions_are_as_predict_has_them(demonstrations, wrong):
    model = BehavioralCloning().fit(demonstrations)
    with pytest.raises(DataError, match=r"give 2 parts .*, and each class as its number in space_\.part_classes"):
        model.log_prob(demonstrations.observations[:1], np.array(wrong))


def test_a_file_with_the_policy_of_other_actions_is_refused(demonstrations, tmp_path):
    d = demonstrations
    several, model = BehavioralCloning().fit(d), BehavioralCloning()
    for actions in (d.actions[:, 0].astype(int), d.actions[:, 1:]):
        model.fit(d.observations, actions).policy_ = several.policy_
        rpil.save(model, tmp_path / "policy")
        with pytest.raises(DataError, match="do not belong together"):
            rpil.load(tmp_path / "policy")


@pytest.mark.parametrize("given", [{"adversary": "uniform"}, {"policy": HistGradientBoostingClassifier()}])
def test_adversaries_and_policies_of_the_user_have_one_part(demonstrations, given):
    with pytest.raises(DataError, match="Only the linear policy takes actions of several parts"):
        RPIL(**given).fit(demonstrations)


def test_one_policy_is_learned_from_several_tasks(table):
    tasks = pa.array(np.repeat(["a", "b"], N // 2 * STEPS))
    model = RPIL().fit(rpil.open(table.append_column("task", tasks), task="task"))
    assert len(model.policy_.factors) == 2


def test_bounds_are_of_numbers_alone(demonstrations):
    with pytest.raises(DataError, match="which no action_box fits"):
        RPIL(action_box=(-1, 1)).fit(demonstrations)


def test_a_policy_is_learned_by_the_command_and_played_in_no_environment_of_one_part(table, tmp_path):
    pq.write_table(table, tmp_path / "a.parquet")
    run = CliRunner().invoke(main, ["fit", str(tmp_path / "a.parquet"), "-o", str(tmp_path / "policy")])
    assert run.exit_code == 0, run.output
    policy = rpil.load(tmp_path / "policy")
    assert policy.predict(np.zeros((2, 3))).shape == (2, 2)
    with pytest.raises(DataError, match=r"shape \(2, 2\): predict must return one finite number for each"):
        rollout(policy, "Pendulum-v1", n_episodes=2, seed=0)


@pytest.mark.parametrize("numbers", [True, False])
def test_a_sample_of_many_is_judged_and_weighed_alike_on_disk_and_in_memory(tmp_path, numbers):
    good = np.arange(120) >= 40
    states, skill, number = recorded(1, 120, good)
    parts = {"action.skill": SKILLS[skill], "action.x": number if numbers else (number > 0).astype(int)}
    pq.write_table(frame(states, parts, 120), tmp_path / "a.parquet")
    data = rpil.open(tmp_path / "a.parquet", on_disk=True).demonstrations
    assert data.part_classes == (tuple(SKILLS), () if numbers else (0, 1))
    read = rpil.read(tmp_path / "a.parquet")
    here, there = small_rpil().fit(read), small_rpil().fit(data)
    for name in ("log_odds", "step_weight", "step_log_ratio"):
        found, expected = getattr(there.audit_, name), getattr(here.audit_, name)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)
    assert len(there.audit_.step_weight) == 120 * STEPS
    direct = BehavioralCloning().fit(read, sample_weight=there.audit_.step_weight)
    of_steps = [model.log_prob(states, read.actions) for model in (there, direct)]
    np.testing.assert_allclose(*of_steps, rtol=0.02, atol=0.02)
    if numbers:  # classes are taken for independent, given the state
        assert roc_auc_score(good, there.audit_.log_odds) > 0.95


def test_a_class_that_others_hardly_choose_there_is_named():
    good = np.arange(40) >= 8
    states, skill, _ = recorded(2, 40, good)
    bad = np.repeat(~good, STEPS) & (np.arange(40 * STEPS) % 3 > 0)
    astray = np.where(bad, (skill + 1) % 3, skill)
    noise = np.random.default_rng(0).normal(size=len(skill))
    audit = rpil.audit(
        frame(states, {"action.skill": SKILLS[astray], "action.x": noise}, 40), labels={0: "bad", 20: "good"}
    )
    assert roc_auc_score(good, audit.log_odds) > 0.95
    assert {part.name for part in audit.traces[0].parts} <= {"action.skill", "action.x"}
    assert any("which is rare there" in phrase for phrase in audit.deviations)


def test_demonstrations_that_are_all_good_get_no_verdict():
    for seed in range(3):
        states, skill, number = recorded(seed, good=np.ones(N, dtype=bool))
        audit = rpil.audit(frame(states, {"action.skill": SKILLS[skill], "action.x": number}))
        assert {*audit.verdicts} == {"open"}


class Learner:
    """A softmax of frequencies for the skill, and a regression within each skill for the number."""

    def __init__(self):
        self.rule, self.share = np.zeros((3, 4)), np.full(3, 1 / 3)


def log_prob(learner, observations, actions):
    seen = np.column_stack([observations, np.ones(len(observations))])
    skill = actions[:, 0].astype(int)
    errors = actions[:, 1] - np.einsum("nd,nd->n", seen, learner.rule[skill])
    return np.log(learner.share)[skill] - errors**2 / 0.18 - 0.5 * np.log(0.18 * np.pi)


def train(learner, observations, actions, weights):
    seen = np.column_stack([observations, np.ones(len(observations))])
    for k in range(3):
        root = np.sqrt(weights * (actions[:, 0] == k))[:, None]
        learner.rule[k] = np.linalg.lstsq(root * seen, root[:, 0] * actions[:, 1], rcond=None)[0]
        learner.share[k] = (root.sum() + 1) / (np.sqrt(weights).sum() + 3)


def test_the_judge_runs_around_a_policy_of_the_user(demonstrations):
    found = rpil.reweight(Learner(), demonstrations, log_prob=log_prob, train=train)
    assert roc_auc_score(GOOD, found.audit.log_odds) > 0.95
