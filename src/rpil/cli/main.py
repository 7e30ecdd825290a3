"""The command ``rpil``. Modules that take long to import are imported inside the commands, so that ``rpil --help``
is fast."""

from __future__ import annotations

import shlex
from typing import Any

import click

from rpil.cli import commands, terminal
from rpil.cli.audit import audit, closing_lines
from rpil.cli.check import check, print_set
from rpil.cli.commands import Commands, check_paths
from rpil.cli.keep import convert, keep
from rpil.cli.label import label, review
from rpil.cli.options import (
    COLUMN_OPTIONS,
    FIT_OPTIONS,
    OutputFile,
    RunOptions,
    command_words,
    outcome_option,
    pop_columns,
    quiet_option,
    seed_option,
    session_option,
    with_options,
)
from rpil.cli.printed_audit import finding_lines, verdict_sentence
from rpil.cli.terminal import LOADING, show_stages


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


SET = "The set in one table, in Markdown: how each action moves, and what a trainer will stumble over."

for command in (audit, check, label, review, keep, convert):
    main.add_command(command)


@main.command()
@click.argument("file", type=click.Path())
@click.option(
    "--format", "form", type=click.Choice(("text", "json")), default="text", show_default=True, help="What to print."
)
@click.option("--set", "table", is_flag=True, help=SET)
@outcome_option
@session_option
@with_options(*COLUMN_OPTIONS)
@click.pass_context
def info(ctx: click.Context, /, file: str, form: str, table: bool, **options: Any) -> None:
    """Print how a file is read: demonstrations, observations, actions, and what is ignored and why."""
    columns = pop_columns(options, guess=True)
    recording = commands.open_recording(file, columns, lambda _: None)
    if table:
        print_set(recording, file, form)
        return
    if form == "json":
        click.echo(terminal.to_json(recording.description.to_dict()))
    else:
        terminal.print_lines(recording.description.lines())
    recording.demonstrations  # noqa: B018  # what cannot be audited is an error
    if form == "text":
        words = command_words(ctx, "audit", without=())
        operator = recording.description.operator_column
        more = ["--operator", operator] if operator and columns.operator is None else []
        click.echo(f"\nNext: {shlex.join([*words, *more])}")


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
    check_paths((file, run.labels, *run.columns.files), output)
    with show_stages(run.quiet) as progress:
        recording = commands.open_recording(file, run.columns, progress)
        progress(LOADING)
        from rpil.estimators.persistence import save
        from rpil.estimators.rpil import RPIL

        model = RPIL(run.features, adversary=run.adversary, random_state=run.seed, settings=ctx.obj, progress=progress)
        model.fit(recording, labels=run.labels)
        save(model, output)
    commands.tell_of_set_aside(recording)
    terminal.print_lines([*finding_lines(model.audit_), verdict_sentence(model.audit_)])
    terminal.print_lines(closing_lines(ctx, model.audit_))
    click.echo(f"Policy: {output}")


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
    click.echo("\n".join([*result.sentences, f"Report: {output}"]))
