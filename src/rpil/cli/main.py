"""The command ``rpil``. Modules that take long to import are imported inside the commands, so that ``rpil --help``
is fast."""

from __future__ import annotations

import shlex
import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rpil.cli import commands, terminal
from rpil.cli.check import audit_fault_lines, check
from rpil.cli.commands import (
    Commands,
    CommandSettings,
    audit_by_task,
    check_paths,
    connect_engine,
    fit_rpil,
    open_recording,
)
from rpil.cli.completion import install_completion
from rpil.cli.evaluate import evaluate
from rpil.cli.info import info
from rpil.cli.keep import convert, keep
from rpil.cli.label import LABELS_FILE, label
from rpil.cli.options import (
    ERROR_CHOICE,
    FitOptions,
    OutputFile,
    WordLimit,
    command_words,
    json_option,
    pop_columns,
    quiet_option,
    seed_option,
    with_fit_options,
    with_judge_options,
)
from rpil.cli.options_file import file_argument
from rpil.cli.outputs import OUTPUTS, Audited, judged_within, lines_after_output, tell_if_too_many, write_outputs
from rpil.cli.progress import StageProgress, show_stages
from rpil.cli.review import review

if TYPE_CHECKING:
    from rpil.results.record import Audit

N_LABELS = 3
"""Demonstrations that an audit proposes to label."""


def _show_stages(quiet: bool) -> AbstractContextManager[StageProgress]:
    return show_stages(quiet, CommandSettings.current().timing)


@click.group("rpil", Commands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rpil")
@click.option(
    "--install-completion",
    metavar="[bash|zsh|fish]",
    is_flag=False,
    flag_value="",
    expose_value=False,
    is_eager=True,
    callback=install_completion,
    help="Let the shell complete commands, options and files; by default the shell of $SHELL.",
)
@click.pass_context
def main(ctx: click.Context, /) -> None:
    """Find out which demonstrations are unlike the others, or bad, and learn a policy from the rest.

    FILE holds demonstrations as .parquet, .csv or .npz: one row per step, with columns such as episode_index, action
    and observation.*. It can also be a folder of .parquet or .csv files, or the address of one, larger than the memory.
    rpil info FILE tells how it is read.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


for command in (check, info, label, review, keep, convert, evaluate):
    main.add_command(command)


@main.command()
@file_argument
@click.option("--report", type=OutputFile(".html"), metavar="OUT.html", help="Also write a report as a web page.")
@click.option(
    "--weights",
    type=OutputFile(".parquet", ".csv"),
    metavar="OUT.parquet|OUT.csv",
    help="Also write a training weight for every step.",
)
@click.option(
    "--verdicts",
    type=OutputFile(".csv", ".parquet", ".json"),
    metavar="OUT.csv|OUT.parquet|OUT.json",
    help="Also write a table with one row for every demonstration.",
)
@click.option(
    "--keep",
    type=OutputFile(".json"),
    metavar="OUT.json",
    help="Also write the ids of the demonstrations to keep, all but unlike or bad ones, as LeRobot takes them.",
)
@click.option(
    "--fail-on",
    type=WordLimit(),
    metavar="unlike|bad[:N]",
    help="Exit with code 1 where more than N demonstrations, by default 0, are unlike or bad.",
)
@click.option("--suggest", metavar="K", type=click.IntRange(1), help="Name the K labels that would say most.")
@click.option("--all", "all_rows", is_flag=True, help="Print all demonstrations, not the worst and doubtful ones only.")
@json_option
@with_judge_options
@click.pass_context
def audit(
    ctx: click.Context,
    /,
    file: str,
    suggest: int | None,
    all_rows: bool,
    json_wanted: bool,
    fail_on: str | None,
    **options: Any,
) -> int:
    """Print how far each demonstration can be trusted, the least trusted first.

    No policy is kept: with --features auto none are chosen for one, and the verdicts are those of rpil fit.
    """
    start = time.perf_counter()
    outputs = {title: options.pop(title) for title in OUTPUTS}
    quiet, stream, scheduler = (options.pop(name) for name in ("quiet", "stream", "scheduler"))
    reference = options.pop("reference")
    check_paths((file, options["labels"], options["operator"], reference), *outputs.values())
    stream = commands.resolve_stream(file, stream, scheduler, reference)
    if options["features"] == "auto":
        options["features"] = "folded"  # the judge's features; no final policy is kept, so none need be chosen
    with _show_stages(quiet) as progress:
        columns = pop_columns(options)
        with connect_engine(scheduler, progress) as engine:
            read = open_recording(file, columns, progress, stream)
            good = commands.read_reference(reference, file, columns, progress)
            result, who = audit_by_task(file, read, FitOptions(**options), progress, engine, good)
        progress("looking for recording faults")
        from rpil.faults.recorded import faults_of
        from rpil.faults.settings import FaultSettings

        faults = faults_of(read, None, None, False, FaultSettings())
        audited = Audited(result, file, read, faults, who)
        write_outputs(outputs, audited, time.perf_counter() - start, progress)
    if json_wanted:
        suggested = {"suggested": result.suggest_labels(suggest)} if suggest else {}
        click.echo(
            terminal.to_json(
                {"run": result.run_id, "input": read.description.to_dict()}
                | result.to_dict()
                | {"faults": faults.to_dict()}
                | suggested
            )
        )
    else:
        terminal.print_lines([*read.description.short(), *judged_within(result), ""])
        terminal.print_audit(result, all_rows)
        terminal.print_lines(audit_fault_lines(faults, result, file))
        _print_next_steps(ctx, result, quiet and not suggest, n_labels=suggest or N_LABELS)
    for title, path in outputs.items():
        if path is not None:
            click.echo(f"{title.capitalize()}: {path}", err=json_wanted)
            if not json_wanted and not quiet:
                terminal.print_lines(lines_after_output(title, path, audited))
    return tell_if_too_many(result, fail_on)


@main.command()
@file_argument
@click.option(
    "-o", "--output", type=click.Path(), metavar="POLICY", required=True, help="File for the policy, with any name."
)
@click.option(
    "--method",
    type=click.Choice(("rpil", "cloning", "rment")),
    default="rpil",
    show_default=True,
    help="Trust the demonstrations as audited, trust all, or trust the N that one policy explains best.",
)
@click.option("--trusted", metavar="N", type=click.IntRange(1), help="Number of demonstrations for --method rment.")
@with_fit_options
@click.pass_context
def fit(ctx: click.Context, /, file: str, output: str, method: str, trusted: int | None, **options: Any) -> None:
    """Learn a policy from the demonstrations that can be trusted."""
    quiet, stream, scheduler = (options.pop(name) for name in ("quiet", "stream", "scheduler"))
    if method != "rpil":
        _refuse_rpil_options(ctx, method)
    if (method == "rment") != (trusted is not None):
        raise click.UsageError("--method rment and --trusted N need each other: give both or neither", ctx)
    check_paths((file, options["labels"], options["operator"]), output)
    stream = commands.resolve_stream(file, stream, scheduler)
    with _show_stages(quiet) as progress, connect_engine(scheduler, progress) as engine:
        recording = open_recording(file, pop_columns(options), progress, stream)
        demonstrations = recording.demonstrations
        progress("starting")
        from rpil.estimators.cloning import BehavioralCloning
        from rpil.estimators.persistence import save
        from rpil.estimators.rment import RMEnt
        from rpil.estimators.rpil import RPIL

        model: BehavioralCloning | RMEnt | RPIL
        if method == "rpil":
            model, _ = fit_rpil(file, recording, FitOptions(**options), progress, engine)
        else:
            progress("learning")
            if trusted is None:
                model = BehavioralCloning(features=options["features"])
            else:
                model = RMEnt(trusted, options["features"], random_state=options["seed"])
            model.fit(commands.load_into_memory(demonstrations))
        save(model, output)
    commands.tell_of_set_aside(recording)
    size = f"{len(demonstrations):,} demonstrations ({demonstrations.n_steps:,} steps)"
    if isinstance(model, RPIL):
        click.echo(f"{terminal.finding_sentence(model.audit_)}\n{terminal.verdict_sentence(model.audit_)}")
        _print_next_steps(ctx, model.audit_, quiet)
    elif trusted is None:
        click.echo(f"All of {size} were trusted alike.")
    else:
        click.echo(f"{trusted:,} of {size} were trusted: those that one policy explains best.")
    play = shlex.join(["rpil", "evaluate", output, "--env"])
    click.echo(f"Policy: {output}" if quiet else f"Policy: {output}; to play it: {play} ID")


def _refuse_rpil_options(ctx: click.Context, method: str) -> None:
    """Refuse options that only --method rpil has."""
    names = "labels", "operator", "outcome", "resume", "adversary"
    given = [name for name in names if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    if given:
        message = f"--{min(given)} has no effect with --method {method}: leave it out, or use --method rpil"
        raise click.UsageError(message, ctx)
    for name in ("scheduler", "stream"):
        if ctx.params[name]:
            raise click.UsageError(f"--method {method} needs all data in memory: leave out --{name}", ctx)


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
    with _show_stages(quiet) as progress:
        from rpil import formats

        formats.check_format(output)
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
    "-o",
    "--output",
    type=OutputFile(".html"),
    metavar="OUT.html",
    default="rpil-demo.html",
    show_default=True,
    help="The report.",
)
@json_option
@seed_option
@quiet_option
def demo(episodes: int, output: str, json_wanted: bool, seed: int, quiet: bool) -> None:
    """Run rpil on two data sets that come with it.

    One is of people who play a cooking game, the other of a lunar lander.
    """
    check_paths((), output)
    with _show_stages(quiet) as progress:
        from rpil.cli.demo import run

        result = run(episodes=episodes, seed=seed, progress=progress)
        progress("writing the report")
        result.write_report(output)
    if json_wanted:
        click.echo(terminal.to_json(result.to_dict()))
    else:
        click.echo("\n".join(result.sentences()))
    click.echo(f"Report: {output}", err=json_wanted)


def _print_next_steps(ctx: click.Context, audit: Audit, quiet: bool, n_labels: int = N_LABELS) -> None:
    """Print what to do next, with the command to run then; nothing if `quiet`."""
    if quiet:
        return
    labels = ctx.params["labels"] or LABELS_FILE
    click.echo(terminal.next_steps(audit, labels, shlex.join(command_words(ctx, str(ctx.info_name))), n_labels))
