"""``rpil evaluate``: a saved policy, or one of the user's own, is played."""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.cli.commands import CommandSettings
from rpil.cli.options import json_option, quiet_option, seed_option
from rpil.cli.progress import show_count
from rpil.cli.terminal import to_json
from rpil.data.errors import DataError

if TYPE_CHECKING:
    from rpil.numerics.types import Array
    from rpil.simulation.rollouts import Policy, Returns

OWN_POLICY = re.compile(r"(?P<file>.+\.py):(?P<function>\w+)")
"""A Python file, and the function in it that returns a policy."""


@click.command()
@click.argument("policy", type=click.Path(), metavar="POLICY|FILE.py:FUNCTION")
@click.option(
    "--env",
    metavar="ID",
    required=True,
    help="Name of the environment in Gymnasium, as LunarLander-v3, or of a task of Meta-World, as metaworld:reach-v3.",
)
@click.option("--episodes", type=click.IntRange(1), default=100, show_default=True, help="Number of episodes to play.")
@json_option
@seed_option
@quiet_option
def evaluate(policy: str, env: str, episodes: int, json_wanted: bool, seed: int, quiet: bool) -> None:
    """Play a policy, and print its mean return, and its successes where the environment reports them.

    POLICY was saved by rpil fit. FILE.py:FUNCTION is your own: FILE.py is imported, which runs it, and FUNCTION() must
    return a function of one observation that returns an action, or an object whose predict does so for rows of them.
    """
    with show_count(f"playing {env}", quiet, CommandSettings.current().timing) as progress, loaded(policy) as player:
        from rpil.simulation.rollouts import rollout

        played = rollout(player, env, n_episodes=episodes, seed=seed, progress=progress)
    click.echo(to_json(_values(played)) if json_wanted else "\n".join(_sentences(played, env)))


def _values(played: Returns) -> dict[str, object]:
    values: dict[str, object] = {"mean": played.mean, "ci95": played.ci95, "returns": played.returns.tolist()}
    if played.success is not None:
        values |= {
            "success_rate": float(played.success.mean()),
            "success_ci95": played.success_ci95,
            "success": played.success.tolist(),
            "median_steps_to_success": played.median_steps,
        }
    return values


def _sentences(played: Returns, env: str) -> Iterator[str]:
    n = len(played.returns)
    if n == 1:
        yield f"Return {played.mean:.1f} in one episode of {env}."
    else:
        low, high = played.ci95
        yield f"Mean return {played.mean:.1f} (95 % interval {low:.1f} to {high:.1f}) over {n:,} episodes of {env}."
    if played.success is not None:
        low, high = (100 * end for end in played.success_ci95)
        rate = f"{100 * played.success.mean():.0f} % (95 % interval {low:.0f} to {high:.0f} %)"
        after = f", after a median of {played.median_steps:g} steps" if played.success.any() else ""
        yield f"Success in {int(played.success.sum()):,} of {n:,} episodes: {rate}{after}."


@contextmanager
def loaded(policy: str) -> Iterator[Policy]:
    """The policy in a file that rpil saved, or the one that a function in a Python file returns.

    That file is imported, which runs it; modules beside it can be imported within the block.
    """
    own = OWN_POLICY.fullmatch(policy)
    if policy.endswith(".py") and os.path.isfile(policy) and not zipfile.is_zipfile(policy):
        raise DataError(f"{policy}: name the function in it that returns a policy, as {policy}:FUNCTION.")
    if own is None or os.path.exists(policy):
        from rpil.estimators.persistence import load

        yield load(policy)
        return
    folder, before = os.path.dirname(os.path.abspath(own["file"])), sys.dont_write_bytecode
    sys.path.insert(0, folder)
    sys.dont_write_bytecode = True  # nothing is left beside the user's file
    try:
        yield _own_policy(own["file"], own["function"])
    finally:
        sys.path.remove(folder)
        sys.dont_write_bytecode = before


def _own_policy(file: str, function: str) -> Policy:
    from rpil.simulation.rollouts import OneByOne
    from rpil.simulation.rollouts import Policy as WithPredict

    make = getattr(_imported(file), function, None)
    if not callable(make):
        raise DataError(f"{file}: it has no function {function!r}; write one that returns a policy.")
    try:
        inspect.signature(make).bind()
    except (TypeError, ValueError) as error:
        raise DataError(f"{file}: {function} needs arguments; name a function without any.") from error
    player: object = _told(make, f"{file}: {function}()")()
    if isinstance(player, WithPredict):
        return _OwnPolicy(player, player.predict, f"{file}: predict of what {function}() returned")
    if callable(player):
        return OneByOne(_OwnPolicy(player, player, f"{file}: the function that {function}() returned"))
    raise DataError(
        f"{file}: {function}() returned {type(player).__name__}; return a function of an observation, or an object "
        "with predict."
    )


class _OwnPolicy:
    """What the user's function returned, as it is, but that each error is one sentence, which says `where`."""

    def __init__(self, player: object, act: Callable[[Array], object], where: str) -> None:
        self._player, self._act, self._where = player, _told(act, where), where

    def __call__(self, observation: Array) -> object:
        return self._act(observation)

    def predict(self, observations: Array) -> object:
        return self._act(observations)

    def __getattr__(self, name: str) -> object:
        value = getattr(self._player, name)
        return _told(value, self._where) if callable(value) else value


def _told(call: Callable[..., object], where: str) -> Callable[..., object]:
    """The same function, whose errors are one sentence that says `where`."""

    def told(*arguments: object) -> object:
        try:
            return call(*arguments)
        except DataError:
            raise
        except Exception as error:  # whatever the user's code raises
            raise DataError(f"{where} failed ({_what(error)}); call it in Python to see where.") from error

    return told


def _what(error: Exception) -> str:
    """An error in one line, within a sentence."""
    return f"{type(error).__name__}: {error}".replace("\n", " ").rstrip(".: ")


def _imported(file: str) -> object:
    """The module that a Python file makes; its errors in one sentence with the line."""
    if not os.path.isfile(file):
        raise DataError(f"{file}: there is no such file; check the path.")
    name = f"rpil_own_policy_{Path(file).stem}"  # of no other module
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise DataError(f"{file}: it cannot be imported; check that it is Python.")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the user's code raises
        del sys.modules[name]
        raise DataError(f"{file}: it cannot be imported ({_what(error)}); run it with Python to see where.") from error
    return module
