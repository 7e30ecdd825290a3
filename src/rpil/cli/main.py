"""The command ``rpil``. Modules that are long to import are imported in the commands: ``rpil --help`` is fast."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rpil.cli import commands, options, terminal
from rpil.cli.audit import audit, closing_lines, print_finding
from rpil.cli.check import check
from rpil.cli.label import label, review
from rpil.cli.options import RunOptions, command_words, pop_columns
from rpil.cli.terminal import LOADING, print_lines, show_stages
from rpil.data.errors import DataError
from rpil.data.files import check_outputs
from rpil.data.text import STEP, TIMESTAMP, counted

if TYPE_CHECKING:
    from rpil.results.choice import Table


@click.group(
    "rpil", commands.Commands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(package_name="rpil")
@click.pass_context
def main(ctx: click.Context, /) -> None:
    """Find demonstrations that differ from the rest or are bad, and learn a policy from the others.

    FILE holds demonstrations: a table (.parquet, .csv) with one row per step and columns such as episode_index, action
    and observation.*, arrays (.npz, .hdf5, Zarr), a folder of tables, or data of LeRobot, robomimic and others. It may
    be larger than memory. rpil info FILE prints how it is read.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


UNDECIDED = "Until two answers contrast, only what you name is rejected; rpil audit says what to look at."
SHARE = "Keep the top of the ranking whatever the verdicts: .8 keeps four fifths, without those you label bad."
SET = "Print the set in one table, in Markdown: how each action moves, and problems for a trainer."

for command in (audit, check, label, review):
    main.add_command(command)


@main.command()
@click.argument("file", type=click.Path())
@click.option(
    "--format", "form", type=click.Choice(("text", "json")), default="text", show_default=True, help="What to print."
)
@click.option("--set", "table", is_flag=True, help=SET)
@options.outcome_option
@options.session_option
@options.with_options(*options.COLUMN_OPTIONS)
@click.pass_context
def info(ctx: click.Context, /, file: str, form: str, table: bool, **options: Any) -> None:
    """Print how a file is read: demonstrations, observations, actions, and what is ignored and why."""
    columns = pop_columns(options)
    recording = commands.open_recording(file, columns, lambda _: None)
    if table:
        from rpil.faults.checking import check as find_faults
        from rpil.faults.set_table import set_table

        found = set_table(recording, find_faults(recording), file)
        click.echo(terminal.to_json(found.to_dict(), "set") if form == "json" else "\n".join(found.lines()))
        return
    if form == "json":
        click.echo(terminal.to_json(recording.description.to_dict()))
    else:
        print_lines(recording.description.lines())
    recording.demonstrations  # noqa: B018  # what cannot be audited is an error
    if form == "text":
        operator = recording.description.operator_column
        more = ["--operator", operator] if operator and columns.operator is None else []
        click.echo(f"\nNext: {shlex.join([*command_words(ctx, 'audit', without=('memory',)), *more])}")


@main.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="POLICY", required=True, help="File for the policy, with any name."
)
@options.with_options(*options.FIT_OPTIONS)
@click.pass_context
def fit(ctx: click.Context, /, file: str, output: str, **options: Any) -> None:
    """Learn a policy from the demonstrations that can be trusted."""
    run = RunOptions.of(options)
    check_outputs((file, run.labels, *run.columns.files), [output])
    with show_stages(run.quiet) as progress:
        recording = commands.open_recording(file, run.columns, progress)
        progress(LOADING)
        from rpil.estimators.persistence import save
        from rpil.estimators.rpil import RPIL

        model = RPIL("auto", adversary=run.adversary, settings=ctx.obj, progress=progress)
        model.fit(recording, labels=run.labels)
        save(model, output)
    commands.tell_of_set_aside(recording)
    print_finding(model.audit_)
    print_lines(closing_lines(ctx, model.audit_))
    click.echo(f"Policy: {output}")


@main.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="NEW", required=True, help="A new file or folder, or ids.json: a list."
)
@click.option("--share", metavar="S", type=click.FloatRange(0, 1, min_open=True), help=SHARE)
@click.option(
    "--verdicts",
    type=click.Path(),
    metavar="FILE",
    help="Judge nothing, and keep by this file: the CSV of rpil audit --verdicts, the list of --keep, or labels.",
)
@options.with_options(options.faults_option, *options.JUDGE_OPTIONS)
def keep(file: str, output: str, share: float | None, verdicts: str | None, **options: Any) -> None:
    """Write the demonstrations to keep to a new file of the same format, or the list of their ids to ids.json.

    It rejects those that you label bad, and those with an outcome of 0. Once two answers contrast, it also rejects
    those that the audit calls bad. With --share it chooses by the ranking instead.
    """
    from rpil.formats.registry import find

    source, given = find(file), RunOptions.of(options)
    source.check_output(output, given.columns)
    with show_stages(given.quiet) as progress:
        from rpil.results.choice import choose, lost_places, verdicts_about

        waits, named, faulty = False, set[str](), set[str]()
        if verdicts is None:
            run = commands.judge(file, given, progress)
            read, known = run.recording, run.audit.answers.once(run.audit.copy_of)
            waits = run.audit.anchor != "named adversary" and share is None and not known.contrast
            table: Table = run.audit.table()
        else:
            read = commands.open_recording(file, replace(given.columns, allow_missing=True), progress)
            table, named = verdicts_about(verdicts, read.demonstrations.ids, read.ids)
        if rules := given.without_faults:
            faulty = commands.faulty_ids(given, commands.look_for_faults(read, progress, True, rules))
        choice = choose(table, share, faulty)
        if not choice.kept:
            judged_by = f"the verdicts of {verdicts}" if verdicts else "the audit"
            ways = ("name fewer faults", faulty), ("choose with --share", "log_odds" in table), ("change labels", True)
            remedy = ", or ".join(way for way, helps in ways if helps)
            raise DataError(f"{file}: no demonstration is left by {judged_by}; {remedy}.")
        lost = () if given.quiet else lost_places(read.demonstrations, choice.kept)
        progress(f"writing {output}")
        read.keep(choice.kept, output)
    commands.tell_of_set_aside(read)
    click.echo(f"Kept {len(choice.kept):,} of {len(read.ids):,} demonstrations: {output}")
    if n_unnamed := len({*map(str, choice.kept)} - named) * bool(verdicts):
        click.echo(f"{n_unnamed:,} of these are not named in {verdicts}: --only IDS keeps some alone.")
    print_lines(choice.lines())
    if not given.quiet:
        of_list = "These ids are kept; rpil convert with --only IDS writes a table of them."
        print_lines([*([UNDECIDED] * waits), *lost, *([of_list] * source.is_list(output))])


@main.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="OUT.parquet|OUT.csv|OUT.npz", required=True, help="The file to write."
)
@click.option(
    "--ranges", type=click.Path(), metavar="JSON", help="Write only these rows, each range as a demonstration."
)
@options.quiet_option
@options.with_options(*options.COLUMN_OPTIONS)
def convert(file: str, output: str, ranges: str | None, quiet: bool, **options: Any) -> None:
    """Write the demonstrations as one table, or as NumPy's arrays: one row per step.

    The table has the observations, the actions, the times, and each demonstration's operator and task; nothing else.
    """
    columns = pop_columns(options)
    with show_stages(quiet) as progress:
        from rpil import formats
        from rpil.formats.registry import writer_of
        from rpil.formats.table import step_columns

        writer_of(output)
        check_outputs((file, operator := columns.operator, ranges), [output])
        recording = commands.open_recording(file, columns, progress)
        demonstrations = recording.demonstrations.select(slice(None))  # in memory
        ids, known = [*map(str, demonstrations.ids)], recording.times()
        times = known.timestamps
        if times is None and known.fps:
            times = step_columns(ids, demonstrations.offsets)[STEP] / known.fps
        if ranges is not None:
            from rpil.segments.ranges import cut_out

            demonstrations, ids, rows = cut_out(demonstrations, ranges)
            times = None if times is None else times[rows]
        operators = formats.read_demonstrators(operator, recording) if operator else dict(recording.operators)
        about = {"operator": operators, "task": recording.tasks}
        truth: dict[str, Any] = {what: [str(of.get(m, "")) for m in ids] for what, of in about.items() if of}
        truth |= {} if times is None else {TIMESTAMP[0]: times}
        progress(f"writing {output}")
        formats.write(output, demonstrations, truth)
    commands.tell_of_set_aside(recording)
    click.echo(f"{counted(len(demonstrations), 'demonstration')}, {demonstrations.n_steps:,} steps: {output}")


@main.command()
@click.option(
    "-o", "--output", type=options.OutputFile(".html"), default="rpil-demo.html", show_default=True, help="The report."
)
@options.quiet_option
def demo(output: str, quiet: bool) -> None:
    """Audit real people who play a cooking game, and compare the ranking with their score."""
    check_outputs((), [output])
    with show_stages(quiet) as progress:
        from rpil.cli.demo import run

        sentence = run(output, progress)
    click.echo(f"{sentence}\nReport: {output}")
