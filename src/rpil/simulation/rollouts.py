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

from rpil.data.errors import DataError, MissingExtraError, in_words
from rpil.data.spaces import Box, Discrete, Space
from rpil.numerics.types import Array


@runtime_checkable
class Player(Protocol):
    """Anything that maps observations (n, D) to actions (n,) or (n, A): an expert, an estimator, a classifier."""

    def predict(self, observations: Array, /) -> object: ...


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
    """Observations of the policy before each action, (n, D); the observation after the last action is not kept."""
    actions: Array
    """Actions that were taken, (n,) int64 or (n, A) floats, which are clipped to the box of the environment."""
    rewards: NDArray[np.float64]


def rollout(
    policy: Player, env_id: str, *, n_episodes: int, seed: int, progress: Callable[[int, int], None] | None = None
) -> Returns:
    """Play a policy and report its return.

    Parameters
    ----------
    policy : object with `predict`
        Maps observations (n, D) to actions: numbers of actions (n,), or continuous ones (n, A), which are clipped to
        the box of the environment; or (n,) where A is 1.
    env_id : str
        An id for `rpil.simulation.rollouts.make`, such as "LunarLander-v3", with flat observations, and actions that
        are discrete or a flat box.
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
    policy: Player, env_id: str, *, n_episodes: int, seed: int, progress: Callable[[int, int], None] | None = None
) -> list[RecordedEpisode]:
    """Play a policy in lockstep and keep every step; the parameters and errors are those of `rollout`.

    The episodes are in the order of the seeds; those of a deterministic policy do not depend on their number.
    """
    if n_episodes < 1:
        return []
    steps: list[tuple[Array, ...]] = []
    envs: list[Any] = []
    seeds = np.random.SeedSequence(seed).generate_state(n_episodes).tolist()
    try:
        # One environment per episode, never reused: a physics engine may keep state beyond a reset.
        envs = [make(env_id) for _ in seeds]
        space = actions_of(envs[0])
        running, active = np.arange(n_episodes), list(envs)
        observations = np.array([env.reset(seed=start)[0] for env, start in zip(envs, seeds, strict=True)])
        while active:
            actions = ask(policy, observations, env_id, space)
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


def ask(policy: Player, observations: Array, env_id: str, space: Space) -> Array:
    """The actions of the policy for all running episodes; a `DataError` where they are no actions of the space."""
    predicted = policy.predict(observations)
    # Stable-Baselines3 returns the actions and the state of the policy.
    answer = np.asarray(predicted[0] if isinstance(predicted, tuple) else predicted)
    n, actions = len(observations), answer
    if isinstance(space, Discrete):
        fits = answer.shape == (n,) and np.isin(answer, np.arange(space.start, space.start + space.n)).all()
    else:
        actions = answer[:, None] if answer.shape == (n,) and space.n_parts == 1 else answer
        fits = actions.shape == (n, space.n_parts) and answer.dtype.kind in "iuf" and np.isfinite(answer).all()
    if not fits:
        raise DataError(
            f"In {env_id} the policy answered {len(observations)} observations with {answer.dtype} of shape "
            f"{answer.shape}: predict must return one finite action of the environment for each."
        )
    return actions.astype(np.int64) if isinstance(space, Discrete) else space.bounded(actions)


def make(env_id: str) -> Any:
    """Make a `gymnasium.Env` by its id with a version, or by "module:id" where another module registers it.

    A `DataError` where it cannot be made; a `MissingExtraError` where Gymnasium, or a package that the environment
    needs, is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "hide")  # else the import of some environments prints a line
    with warnings.catch_warnings():  # Gymnasium changes the filters when it is imported
        try:
            import gymnasium
        except ImportError as error:
            raise MissingExtraError("Playing a policy", "gym") from error
        try:
            # The checker slows each step, and registered environments have passed it before.
            return gymnasium.make(env_id, disable_env_checker=True)
        except gymnasium.error.DependencyNotInstalled as error:
            raise MissingExtraError(f"The environment {env_id}", "gym") from error
        except (gymnasium.error.Error, ModuleNotFoundError) as error:
            raise DataError(
                f"Gymnasium cannot make {env_id!r} ({in_words(error)}): check the name, its version and its module."
            ) from error


def actions_of(env: Any) -> Space:
    """The actions of an environment; a `DataError` unless they are Discrete or a flat float Box, and observations flat.

    Other environments cannot be played.
    """
    from gymnasium import spaces

    observed, acted = env.observation_space, env.action_space
    if isinstance(observed, spaces.Box) and len(observed.shape) == 1:
        if isinstance(acted, spaces.Discrete):
            return Discrete(int(acted.n), int(acted.start))
        if isinstance(acted, spaces.Box) and len(acted.shape) == 1 and acted.dtype.kind == "f":
            return Box(acted.low, acted.high)
    raise DataError(
        f"{env.spec.id} has {type(observed).__name__} observations and {type(acted).__name__} actions, but only flat "
        "observations, and actions that are Discrete or a flat Box, can be played: wrap it or choose another."
    )
