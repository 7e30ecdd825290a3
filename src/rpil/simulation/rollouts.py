"""Playing a policy in an environment: its mean return with an interval, or the episodes themselves.

All episodes run in lockstep, so the policy sees one batch per time step instead of one row per episode and step.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.spaces import Box, Discrete, Space
from rpil.numerics.types import Array

Untyped = Any
"""What Gymnasium has no types for."""


@runtime_checkable
class Player(Protocol):
    """Anything that maps observations (n, D) to actions (n,) or (n, A): an expert, an estimator, a classifier."""

    def predict(self, observations: Array, /) -> object: ...


class RandomPolicy:
    """Uniform draws from K actions or a box, whatever the observation.

    The draws come from one stream, which a later `predict` of the same object continues."""

    def __init__(self, actions: Space, seed: int) -> None:
        self._actions = actions
        self._rng = np.random.default_rng(seed)

    def predict(self, observations: Array) -> Array:
        """Draw an action for every observation (n, D): (n,), or (n, A) where actions are continuous."""
        return self._actions.draw(len(observations), self._rng)


@dataclass(frozen=True, eq=False)
class Returns:
    """Undiscounted returns of a policy."""

    mean: float
    ci95: tuple[float, float]
    """Low and high end of the 95 % t interval of the mean over these episodes; (nan, nan) for a single episode."""
    returns: NDArray[np.float64]
    """The return of every episode, (n_episodes,)."""

    @classmethod
    def of(cls, returns: NDArray[np.float64]) -> Returns:
        """Summarise the returns (n_episodes,) of one policy."""
        n, mean = len(returns), float(returns.mean())
        half_width = float(stdtrit(n - 1, 0.975) * returns.std(ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
        return cls(mean, (mean - half_width, mean + half_width), returns)


@dataclass(frozen=True, eq=False)
class RecordedEpisode:
    """One recorded episode of n steps."""

    observations: Array
    """What the policy saw before each action, (n, D); the observation after the last action is not kept."""
    actions: Array
    """What was done, (n,) int64 or (n, A) floats, which are clipped to the box of the environment."""
    rewards: NDArray[np.float64]


def rollout(
    policy: Player,
    env_id: str,
    *,
    n_episodes: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Returns:
    """Play a policy and report its return.

    Parameters
    ----------
    policy : object with `predict`
        Maps observations (n, D) to actions: numbers of actions (n,), or continuous ones (n, A), which are clipped to
        the box of the environment; or (n,) where A is 1.
    env_id : str
        An id for `rpil.simulation.rollouts.make`, such as "LunarLander-v3", with flat or discrete observations, and
        actions that are discrete or a flat box. A discrete observation is passed to the policy as a one-hot row.
    n_episodes : int
        At least 1.
    seed : int
        Determines every start. The start of episode i does not depend on `n_episodes`, so two policies played with one
        seed are compared on the same starts.
    progress : callable, optional
        Called as `progress(n_finished, n_episodes)` whenever episodes finish.

    Returns
    -------
    Returns

    Raises
    ------
    DataError
        If the environment is unknown or of another kind, or does not fit the policy.
    MissingExtraError
        If Gymnasium, or a package that the environment needs, is not installed.
    """
    if n_episodes < 1:
        raise DataError(f"rollout needs at least one episode but n_episodes is {n_episodes}: raise it.")
    episodes = record(policy, env_id, n_episodes=n_episodes, seed=seed, progress=progress)
    return Returns.of(np.array([episode.rewards.cumsum()[-1] for episode in episodes]))


def record(
    policy: Player,
    env_id: str,
    *,
    n_episodes: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> list[RecordedEpisode]:
    """Play a policy in lockstep and keep every step; the parameters and errors are those of `rollout`.

    The episodes are in the order of the seeds; those of a deterministic policy do not depend on their number.
    """
    if n_episodes < 1:
        return []
    steps: list[tuple[Array, ...]] = []
    envs: list[Untyped] = []
    seeds = np.random.SeedSequence(seed).generate_state(n_episodes).tolist()
    try:
        # One environment per episode, never reused: a physics engine may keep state beyond a reset.
        envs = [make(env_id) for _ in seeds]
        space = _actions_to_play(env_id, envs[0])
        running, active = np.arange(n_episodes), list(envs)
        observations = np.array([env.reset(seed=start)[0] for env, start in zip(envs, seeds, strict=True)])
        while active:
            actions = _actions(policy, observations, env_id, space)
            # Python ints: environments check each discrete action, which costs far more on NumPy scalars.
            orders = actions.tolist() if actions.ndim == 1 else actions
            outcomes = [env.step(order) for env, order in zip(active, orders, strict=True)]
            following, rewards, terminated, truncated, _ = zip(*outcomes, strict=True)
            steps.append((running, observations, actions, np.array(rewards, dtype=np.float64)))
            going = ~np.logical_or(terminated, truncated)
            running, observations = running[going], np.array(following)[going]
            if len(running) < len(active):
                active = [env for env, goes in zip(active, going, strict=True) if goes]
                if progress is not None:
                    progress(n_episodes - len(active), n_episodes)
    finally:
        for env in envs:
            env.close()
    owner, *columns = (np.concatenate(column) for column in zip(*steps, strict=True))
    order = np.argsort(owner, kind="stable")  # the steps of each episode stay in the order of time
    ends = np.cumsum(np.bincount(owner))[:-1]
    return [RecordedEpisode(*parts) for parts in zip(*(np.split(one[order], ends) for one in columns), strict=True)]


def _actions_to_play(env_id: str, env: Untyped) -> Space:
    """The actions of `env`; a `DataError` if its spaces are not supported."""
    from gymnasium import spaces

    observed, actions = env.observation_space, actions_of(env)
    if not isinstance(observed, spaces.Box) or len(observed.shape) != 1 or actions is None:
        raise DataError(
            f"{env_id} has {type(observed).__name__} observations of shape {observed.shape} and "
            f"{type(env.action_space).__name__} actions, but only flat Box or Discrete observations and actions can be "
            "played: wrap it or choose another."
        )
    return actions


def _actions(policy: Player, observations: Array, env_id: str, space: Space) -> Array:
    """The actions of the policy for all running episodes; a `DataError` where they are no actions of the space."""
    predicted = policy.predict(observations)
    # Stable-Baselines3 returns the actions and the state of the policy.
    answer = np.asarray(predicted[0] if isinstance(predicted, tuple) else predicted)
    actions = space.executed(answer, len(observations))
    if actions is None:
        raise DataError(
            f"In {env_id} the policy answered {len(observations)} observations with {answer.dtype} of shape "
            f"{answer.shape}: predict must return {space.expected} for each."
        )
    return actions


def make(env_id: str) -> Untyped:
    """Make a `gymnasium.Env` by its id with a version, or by "module:id" where another module registers it.

    Its observations are one-hot rows (n,) where Gymnasium's own are one of n numbers. A `DataError` where Gymnasium
    does not know the id; a `MissingExtraError` where it, or a package that the environment needs, is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "hide")  # else the import of some environments prints a line
    with warnings.catch_warnings():  # Gymnasium changes the filters when it is imported
        try:
            import gymnasium
        except ImportError as error:
            raise MissingExtraError("Playing a policy", "gym") from error
        try:
            # The checker slows each step, and registered environments have passed it before.
            env = gymnasium.make(env_id, disable_env_checker=True)
        except gymnasium.error.DependencyNotInstalled as error:
            raise MissingExtraError(f"The environment {env_id}", "gym") from error
        except (gymnasium.error.Error, ModuleNotFoundError) as error:
            missing = getattr(error.__cause__, "name", None)
            if missing and not f"{env_id.partition(':')[0]}.".startswith(f"{missing}."):
                raise DataError(f"The environment {env_id!r} needs the module {missing!r}: install it.") from error
            raise DataError(
                f"Gymnasium has no environment {env_id!r}: check the name and its version with "
                "gymnasium.pprint_registry()."
            ) from error
        is_discrete = isinstance(env.observation_space, gymnasium.spaces.Discrete)
        return gymnasium.wrappers.FlattenObservation(env) if is_discrete else env


def actions_of(env: Untyped) -> Space | None:
    """The space of the actions of a Gymnasium environment; None unless it is Discrete or a flat float Box."""
    from gymnasium import spaces

    space = env.action_space
    if isinstance(space, spaces.Discrete):
        return Discrete(int(space.n), int(space.start))
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.dtype.kind == "f":
        return Box(space.low, space.high)
    return None
