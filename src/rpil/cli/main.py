"""The command ``rpil``. Modules that take long to import are imported inside the commands, so that ``rpil --help``
is fast."""

from __future__ import annotations

import shlex
from typing import Any

import click

from rpil.cli import commands, terminal
from rpil.cli.audit import audit, closing_lines, report
from rpil.cli.check import check
from rpil.cli.commands import Commands, check_paths
from rpil.cli.evaluate import evaluate
from rpil.cli.info import info
from rpil.cli.keep import convert, keep
from rpil.cli.label import label
from rpil.cli.options import ERROR_CHOICE, FIT_OPTIONS, OutputFile, RunOptions, quiet_option, seed_option, with_options
from rpil.cli.printed_audit import finding_lines, verdict_sentence
from rpil.cli.progress import LOADING, show_stages
from rpil.cli.review import review


@click.group("rpil", Commands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rpil")
@click.pass_context
def main(ctx: click.Context, /) -> None:
    """Find out which demonstrations differ from the rest, or are bad, and learn a policy from the rest.

    FILE holds demonstrations: a table (.parquet, .csv) with one row per step and columns such as episode_index, action
    and observation.*, arrays (.npz, .hdf5, Zarr), a folder of tables, or data of LeRobot, robomimic and others. It may
    be larger than the memory. rpil info FILE tells how it is read.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


for command in (audit, report, check, info, label, review, keep, convert, evaluate):
    main.add_command(command)


@main.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="POLICY", required=True, help="File for the policy, with any name."
)
@with_options(*FIT_OPTIONS)
@click.pass_context
def fit(ctx: click.Context, /, file: str, output: str, **options: Any) -> None:
    """Learn a policy from the demonstrations that can be trusted."""
    run = RunOptions.of(options)
    check_paths((file, run.labels, *run.columns.files.values()), output)
    with show_stages(run.quiet) as progress:
        recording, _ = commands.read_data(file, run, progress)
        progress(LOADING)
        from rpil.estimators.persistence import save
        from rpil.estimators.rpil import RPIL

        model = RPIL(run.features, adversary=run.adversary, random_state=run.seed, settings=ctx.obj, progress=progress)
        model.fit(recording, labels=run.labels)
        save(model, output)
    commands.tell_of_set_aside(recording)
    terminal.print_lines([*finding_lines(model.audit_), verdict_sentence(model.audit_)])
    terminal.print_lines(closing_lines(ctx, model.audit_))
    play = shlex.join(["rpil", "evaluate", output, "--env"])
    is_played = not run.quiet and model.space_.kind != "product"
    click.echo(f"Policy: {output}; to play it: {play} ID" if is_played else f"Policy: {output}")


@main.command()
@click.option("--env", metavar="ID", required=True, help="An environment with a built-in expert, as MountainCar-v0.")
@click.option("--kind", type=ERROR_CHOICE, required=True, help="The error in the bad demonstrations.")
@click.option("--good", type=click.IntRange(0), required=True, help="Number of demonstrations of the expert.")
@click.option("--bad", type=click.IntRange(0), required=True, help="Number of demonstrations with the error.")
@click.option(
    "-o", "--output", type=click.Path(), metavar="FILE", required=True, help="A .parquet, .csv or .npz file to write."
)
@seed_option
@quiet_option
def simulate(env: str, kind: str, good: int, bad: int, output: str, seed: int, quiet: bool) -> None:
    """Make demonstrations of known quality.

    Good and bad are in a random order. The columns is_good and episode_return hold the truth, which no method reads.
    """
    check_paths((), output)
    with show_stages(quiet) as progress:
        from rpil import formats

        formats.writer_of(output)
        progress(f"playing {good + bad} episodes of {env}")
        from rpil.data.demonstrations import Demonstrations
        from rpil.simulation.simulate import simulate

        simulation = simulate(env, kind, n_good=good, n_bad=bad, seed=seed)
        demonstrations = Demonstrations.from_episodes(simulation.episodes, source=env)
        truth = {"is_good": simulation.is_good, "episode_return": simulation.returns}
        formats.write(output, demonstrations, truth)
    made = f"{good} good and {bad} bad ({kind}) demonstrations of {env}"
    click.echo(f"{made}, {demonstrations.n_steps:,} steps: {output}")
    if not quiet:
        click.echo(f"Next: {shlex.join(['rpil', 'audit', output])}")


@main.command()
@click.option("--episodes", type=click.IntRange(2), default=100, show_default=True, help="Episodes for each policy.")
@click.option(
    "-o", "--output", type=OutputFile(".html"), default="rpil-demo.html", show_default=True, help="The report."
)
@seed_option
@quiet_option
def demo(episodes: int, output: str, seed: int, quiet: bool) -> None:
    """Run rpil on two data sets that come with it.

    One is of people who play a cooking game, the other of a lunar lander.
    """
    check_paths((), output)
    with show_stages(quiet) as progress:
        from rpil.cli.demo import run

        result = run(episodes=episodes, seed=seed, progress=progress)
        progress("writing the report")
        result.write_report(output)
    click.echo("\n".join([*result.sentences(), f"Report: {output}"]))
