"""Lockstep rollouts: the same episodes as one at a time, fixed by the seed, with honest intervals and clear errors."""

import sys
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from scipy import stats

from problems import refused
from rpil.data.errors import MissingExtraError
from rpil.data.spaces import Box, Discrete
from rpil.simulation.rollouts import Returns, ask, record, rollout
from rpil.simulation.simulate import expert


class Always:
    """One action, whatever is seen; remembers how many rows each call had."""

    def __init__(self, action):
        self.action = action
        self.batches = []

    def predict(self, observations):
        self.batches.append(len(observations))
        return np.array([self.action] * len(observations))


def one_at_a_time(policy, env_id, seed):
    env = gymnasium.make(env_id)
    observation, _ = env.reset(seed=seed)
    observations, actions, rewards, over = [], [], [], False
    while not over:
        observations.append(observation)
        answer = policy.predict(observation[None])[0]
        low_and_high = (env.action_space.low, env.action_space.high) if np.ndim(answer) else ()
        actions.append(np.clip(answer, *low_and_high).astype(np.float32) if np.ndim(answer) else int(answer))
        observation, reward, terminated, truncated, _ = env.step(actions[-1])
        rewards.append(reward)
        over = terminated or truncated
    env.close()
    return np.array(observations), np.array(actions), np.array(rewards)


@pytest.mark.parametrize("env_id", ["MountainCar-v0", "Acrobot-v1", "LunarLander-v3"])
def test_lockstep_equals_one_at_a_time(env_id):
    driver = expert(env_id)
    episodes = record(driver, env_id, n_episodes=5, seed=3)
    seeds = np.random.SeedSequence(3).generate_state(5).tolist()
    assert len(episodes) == 5
    for episode, seed in zip(episodes, seeds, strict=True):
        observations, actions, rewards = one_at_a_time(driver, env_id, seed)
        np.testing.assert_array_equal(episode.observations, observations)
        np.testing.assert_array_equal(episode.actions, actions)
        np.testing.assert_array_equal(episode.rewards, rewards)
    seen = rollout(driver, env_id, n_episodes=5, seed=3)
    np.testing.assert_allclose(seen.returns, [episode.rewards.sum() for episode in episodes], rtol=1e-12)


def test_episodes_of_one_run_start_differently_and_do_not_depend_on_how_many_there_are():
    driver = expert("MountainCar-v0")
    few, many = (rollout(driver, "MountainCar-v0", n_episodes=n, seed=5).returns for n in (3, 12))
    np.testing.assert_array_equal(few, many[:3])
    starts = {episode.observations[0].tobytes() for episode in record(driver, "MountainCar-v0", n_episodes=12, seed=5)}
    assert len(starts) == 12


def test_interval_is_students():
    returns = np.random.default_rng(0).normal(10, 3, size=25)
    seen = Returns.of(returns)
    wanted = stats.t.interval(0.95, 24, loc=returns.mean(), scale=stats.sem(returns))
    np.testing.assert_allclose(seen.ci95, wanted, rtol=1e-12)
    assert seen.ci95[0] < seen.mean == returns.mean() < seen.ci95[1]
    assert Returns.of(np.full(3, -200.0)).ci95 == (-200, -200)
    assert np.isnan(Returns.of(returns[:1]).ci95).all()


def test_progress_counts_up_to_the_number_of_episodes_and_a_state_may_be_given_beside_the_actions():
    calls, pair = [], SimpleNamespace(predict=lambda rows: (np.full(len(rows), 1.0), None))
    wanted = rollout(Always(1), "CartPole-v1", n_episodes=15, seed=0, progress=lambda *call: calls.append(call))
    np.testing.assert_array_equal(rollout(pair, "CartPole-v1", n_episodes=15, seed=0).returns, wanted.returns)
    finished = [done for done, _ in calls]
    assert finished == sorted(set(finished))
    assert finished[-1] == 15
    assert {total for _, total in calls} == {15}


def test_continuous_actions_are_clipped_when_executed_and_recorded():
    far, bound = (record(Always([torque]), "Pendulum-v1", n_episodes=2, seed=0) for torque in (1e300, 2.0))
    for one, two in zip(far, bound, strict=True):
        assert (one.actions.shape, one.actions.dtype) == ((200, 1), np.float32)
        np.testing.assert_array_equal(one.actions, 2)
        np.testing.assert_array_equal(one.observations, two.observations)
        np.testing.assert_array_equal(one.rewards, two.rewards)


@pytest.mark.parametrize(
    ("policy", "env_id", "words"),
    [
        (Always(0), "not an id", "cannot make 'not an id'"),
        (Always([0.5]), "CartPole-v1", r"shape \(2, 1\): predict must return one finite action"),
        (Always([0, 0]), "Pendulum-v1", r"shape \(2, 2\): predict must return one finite action"),
        (Always(0.5), "LunarLanderContinuous-v3", r"shape \(2,\): predict must return one finite action"),
        (Always([np.nan]), "Pendulum-v1", "float64 .* one finite action"),
        (Always(0), "Blackjack-v1", "Blackjack-v1 has Tuple .* only flat observations"),
        (Always(2), "CartPole-v1", "CartPole-v1 .* one finite action"),
        (SimpleNamespace(predict=lambda rows: rows), "CartPole-v1", r"shape \(2, 4\): predict must return one"),
    ],
)
def test_errors_are_one_sentence_with_the_place(policy, env_id, words):
    with refused(words):
        rollout(policy, env_id, n_episodes=2, seed=0)
    with refused("n_episodes is 0"):
        rollout(policy, env_id, n_episodes=0, seed=0)


CLASSES, TWO_NUMBERS = Discrete(3, start=5), Box(np.float32([-1, 0]), np.float32([1, 10]))


def answered(answer, space, n):
    return ask(SimpleNamespace(predict=lambda rows: np.asarray(answer)), np.zeros((n, 1)), "Env-v0", space)


@pytest.mark.parametrize("answer", [[5, 7], [5.0, 7.0], np.array([5, 7], dtype=np.uint8)])
def test_whole_numbers_among_the_actions_are_taken(answer):
    actions = answered(answer, CLASSES, 2)
    assert actions.dtype == np.int64
    np.testing.assert_array_equal(actions, [5, 7])


def test_numbers_in_a_box_are_clipped_and_take_the_precision_of_its_bounds():
    actions = answered([[-3.0, 4.0], [0.25, 1e300]], TWO_NUMBERS, 2)
    assert actions.dtype == np.float32
    np.testing.assert_array_equal(actions, [[-1, 4], [0.25, 10]])
    np.testing.assert_array_equal(answered([[3, 4]], TWO_NUMBERS, 1), [[1, 4]])


NO_CLASSES = [[0, 5], [5, 8], [5.5, 6], [np.nan, 5], [np.inf, 5], [[5], [6]], [5]]
NO_ROW = [[0.0, 0.0], [[0.0]], [[0.0, np.nan]], [[-np.inf, 0.0]], [["a", "b"]], [[True, False]]]


@pytest.mark.parametrize(
    ("space", "n", "answer"), [*((CLASSES, 2, one) for one in NO_CLASSES), *((TWO_NUMBERS, 1, one) for one in NO_ROW)]
)
def test_other_answers_are_refused(space, n, answer):
    with refused("predict must return one finite action"):
        answered(answer, space, n)


def test_missing_gymnasium_and_physics_engine_name_the_extra(monkeypatch):
    # Forget the module, so that it is imported again and misses what it needs.
    monkeypatch.delitem(sys.modules, "gymnasium.envs.box2d.lunar_lander", raising=False)
    monkeypatch.delitem(sys.modules, "gymnasium.envs.box2d", raising=False)
    monkeypatch.setitem(sys.modules, "Box2D", None)
    with pytest.raises(MissingExtraError, match=r"LunarLander-v3 needs .* 'rpil\[gym\]'"):
        rollout(Always(0), "LunarLander-v3", n_episodes=1, seed=0)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'rpil\[gym\]'"):
        rollout(Always(0), "CartPole-v1", n_episodes=1, seed=0)
