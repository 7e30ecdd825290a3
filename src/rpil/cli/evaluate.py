"""``rpil evaluate``: a saved policy, or one of the user's own, is played."""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Iterator
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
    player: object = make()
    if isinstance(player, WithPredict):
        return player
    if callable(player):
        return OneByOne(player)
    raise DataError(
        f"{file}: {function}() returned {type(player).__name__}; return a function of an observation, or an object "
        "with predict."
    )


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
        what = f"{type(error).__name__}: {error}".replace("\n", " ").rstrip(".")
        raise DataError(f"{file}: it cannot be imported ({what}); run it with Python to see where.") from error
    return module
