"""``rpil evaluate``: a saved policy is played."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from rpil.cli.options import json_option, quiet_option, seed_option
from rpil.cli.progress import show_stages
from rpil.cli.terminal import to_json

if TYPE_CHECKING:
    from rpil.simulation.rollouts import Returns


@click.command()
@click.argument("policy", type=click.Path(), metavar="POLICY")
@click.option(
    "--env",
    metavar="ID",
    required=True,
    help="Name of the environment in Gymnasium, as LunarLander-v3; module:ID where a module registers it.",
)
@click.option("--episodes", type=click.IntRange(1), default=100, show_default=True, help="Number of episodes to play.")
@json_option
@seed_option
@quiet_option
def evaluate(policy: str, env: str, episodes: int, json_wanted: bool, seed: int, quiet: bool) -> None:
    """Play a POLICY that rpil fit saved: its mean return, and its successes where the environment reports them."""
    with show_stages(quiet) as progress:
        from rpil.estimators.persistence import load
        from rpil.simulation.rollouts import rollout

        def count(done: int, total: int) -> None:
            progress(f"playing {env}, {done} of {total}")

        played = rollout(load(policy), env, n_episodes=episodes, seed=seed, progress=count)
    click.echo(to_json(values(played)) if json_wanted else "\n".join(sentences(played, env)))


def values(played: Returns) -> dict[str, object]:
    """What ``--json`` prints."""
    printed: dict[str, object] = {"mean": played.mean, "ci95": played.ci95, "returns": played.returns.tolist()}
    if played.success is not None:
        printed |= {
            "success_rate": float(played.success.mean()),
            "success_ci95": played.success_ci95,
            "success": played.success.tolist(),
            "median_steps_to_success": played.median_steps,
        }
    return printed


def sentences(played: Returns, env: str) -> Iterator[str]:
    """The mean return and the share of successes, in words."""
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
