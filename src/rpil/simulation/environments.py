"""Environments: Gymnasium's, with discrete observations as one-hot rows, and versions with discretised actions."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.spaces import Box, Discrete, Space

DISCRETISED: dict[str, tuple[str, NDArray[np.float32]]] = {
    "rpil/DiscretePendulum-v1": ("Pendulum-v1", np.linspace([-2.0], [2.0], 5, dtype=np.float32)),
}
"""Id -> the continuous environment, and the action (A,) of each of K choices, (K, A)."""


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
def make(env_id: str) -> Any:
    """Make a `gymnasium.Env` by its id with a version, or one of `DISCRETISED`.

    Its observations are one-hot rows (n,) where Gymnasium's own are one of n numbers. A `DataError` where Gymnasium
    does not know the id; a `MissingExtraError` where it, or a package that the environment needs, is not installed.
    """
    try:
        import gymnasium
    except ImportError as error:
        raise MissingExtraError("Playing a policy", "gym") from error
    from gymnasium import spaces
    from gymnasium.wrappers import FlattenObservation, TransformAction

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


def actions_of(env: Any) -> Space | None:
    """The space of the actions of a Gymnasium environment; None unless it is Discrete or a flat float Box."""
    from gymnasium import spaces

    space = env.action_space
    if isinstance(space, spaces.Discrete):
        return Discrete(int(space.n), int(space.start))
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.dtype.kind == "f":
        return Box(space.low, space.high)
    return None
