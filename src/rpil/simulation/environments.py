"""Environments: Gymnasium's, with discrete observations as one-hot rows, versions with discretised actions, and the
tasks of Meta-World's robot arm."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.spaces import Box, Discrete, Space

Untyped = Any
"""What Gymnasium has no types for."""

DISCRETISED: dict[str, tuple[str, NDArray[np.float32]]] = {
    "rpil/DiscretePendulum-v1": ("Pendulum-v1", np.linspace([-2.0], [2.0], 5, dtype=np.float32)),
}
"""Id -> the continuous environment, and the action (A,) of each of K choices, (K, A)."""


METAWORLD = re.compile(r"(metaworld:|Meta-World/)(?P<task>[a-z-]+-v\d+)")
"""Ids of the tasks of Meta-World."""


@contextmanager
def kept_process_settings() -> Iterator[None]:
    """Undo changes to warning filters and environment variables: Gymnasium makes some when it is imported."""
    before = dict(os.environ)
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "hide")  # else the import of some environments prints a line
    with warnings.catch_warnings():
        try:
            yield
        finally:
            for name in os.environ.keys() - before.keys():
                del os.environ[name]
            os.environ.update({name: value for name, value in before.items() if os.environ.get(name) != value})


@kept_process_settings()
def make(env_id: str) -> Untyped:
    """Make a `gymnasium.Env` by its id with a version, one of `DISCRETISED`, or a task of Meta-World, which is called
    "metaworld:reach-v3" or "Meta-World/reach-v3".

    Its observations are one-hot rows (n,) where Gymnasium's own are one of n numbers. A `DataError` where Gymnasium
    does not know the id; a `MissingExtraError` where it, or a package that the environment needs, is not installed.
    """
    try:
        import gymnasium
    except ImportError as error:
        raise MissingExtraError("Playing a policy", "gym") from error
    from gymnasium import spaces
    from gymnasium.wrappers import FlattenObservation, TransformAction

    arm_task = METAWORLD.fullmatch(env_id)
    if arm_task:
        return _make_arm(env_id, arm_task["task"])
    base_id, choices = DISCRETISED.get(env_id, (env_id, None))
    try:
        # The checker slows each step, and registered environments have passed it before.
        env = gymnasium.make(base_id, disable_env_checker=True)
    except gymnasium.error.DependencyNotInstalled as error:
        raise MissingExtraError(f"The environment {env_id}", "gym") from error
    except (gymnasium.error.Error, ModuleNotFoundError) as error:
        raise DataError(
            f"Gymnasium has no environment {env_id!r}: check the name and its version with gymnasium.pprint_registry()."
        ) from error
    if choices is not None:
        env = TransformAction(env, choices.__getitem__, spaces.Discrete(len(choices)))
    return FlattenObservation(env) if isinstance(env.observation_space, spaces.Discrete) else env


def _make_arm(env_id: str, task: str) -> Untyped:
    """A task of Meta-World, with a goal in the observation that the seed of each reset draws."""
    from gymnasium import Wrapper

    try:
        from metaworld.env_dict import ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE as TASKS
    except ImportError as error:
        raise MissingExtraError(f"The environment {env_id}", "value") from error
    if f"{task}-goal-observable" not in TASKS:
        raise DataError(f"Meta-World has no task {task!r}: check the name, such as reach-v3 or pick-place-v3.")

    class Arm(Wrapper[Untyped, Untyped, Untyped, Untyped]):
        """Meta-World itself ignores the seed of a reset."""

        def reset(
            self, *, seed: int | None = None, options: dict[str, Untyped] | None = None
        ) -> tuple[Untyped, dict[str, Untyped]]:
            if seed is not None:
                env.seed(seed)
            return self.env.reset(options=options)

    make: Untyped = TASKS[f"{task}-goal-observable"]  # typed as the base class, which takes no seed
    env = make(seed=0)
    env._freeze_rand_vec = False  # a new goal at each reset ...
    env.seeded_rand_vec = True  # ... that comes from the seed, and not from NumPy's global stream
    return Arm(env)


def success_of(info: Mapping[str, object]) -> float:
    """1 or 0 as a step reports success, under the names that robot environments give it; NaN where it does not."""
    value = info.get("success", info.get("is_success"))
    return float("nan") if value is None else float(bool(value))


def actions_of(env: Untyped) -> Space | None:
    """The space of the actions of a Gymnasium environment; None unless it is Discrete or a flat float Box."""
    from gymnasium import spaces

    space = env.action_space
    if isinstance(space, spaces.Discrete):
        return Discrete(int(space.n), int(space.start))
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.dtype.kind == "f":
        return Box(space.low, space.high)
    return None
