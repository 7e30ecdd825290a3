"""Environments of Gymnasium, with discrete observations as one-hot rows."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import Any

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.spaces import Box, Discrete, Space

Untyped = Any
"""What Gymnasium has no types for."""


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
