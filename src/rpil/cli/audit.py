"""The command ``rpil audit``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from rpil.cli import commands, terminal
from rpil.cli.label import LABELS_FILE
from rpil.cli.options import (
    CHOICE_NAMES,
    CHOICE_OPTIONS,
    JUDGE_OPTIONS,
    OutputFile,
    RunOptions,
    Value,
    command_words,
    format_option,
    verdict_limit,
    with_options,
)
from rpil.cli.printed_audit import head_lines, next_steps, print_audit
from rpil.cli.terminal import show_stages

if TYPE_CHECKING:
    from rpil.results.record import Audit


@click.command()
@click.argument("file", type=click.Path())
@click.option("--report", type=OutputFile(".html"), help="Also write a report as a web page.")
@click.option("--weights", type=OutputFile(".parquet", ".csv"), help="Also write a training weight for every step.")
@click.option(
    "--verdicts",
    type=OutputFile(".csv", ".parquet", ".json"),
    help="Also write a table with one row for every demonstration.",
)
@click.option(
    "--keep",
    type=OutputFile(".json"),
    help="Also write the ids of the demonstrations to keep, all but bad ones, as LeRobot takes them.",
)
@click.option(
    "--fail-on",
    callback=verdict_limit,
    metavar="outlier|bad[:N]",
    help="Exit with code 1 where more than N demonstrations, by default 0, are outliers or bad.",
)
@click.option(
    "--annotate",
    type=click.Path(),
    metavar="NEW",
    help="Also write a copy of this folder of LeRobot 3.0, with the verdict and the score of each episode in "
    "meta/episodes, for episode_filter.",
)
@click.option("--all", "all_rows", is_flag=True, help="Print a row for each demonstration, with its whole reason.")
@format_option
@with_options(*CHOICE_OPTIONS, *JUDGE_OPTIONS)
@click.pass_context
def audit(
    ctx: click.Context,
    /,
    file: str,
    all_rows: bool,
    form: str,
    fail_on: str | None,
    **options: Value,
) -> int:
    """Print which demonstrations differ from the rest, or are bad, the lowest scores first.

    No policy is kept: with --features auto none are chosen for one, and the verdicts are those of rpil fit.
    """
    outputs = {title: options.pop(title) for title in commands.OUTPUTS}
    if outputs["keep"] is None and any(options[name] for name in CHOICE_NAMES):
        raise click.UsageError("--ignore and --without-faults say what --keep lists: give --keep OUT.json")
    with show_stages(bool(options["quiet"])) as progress:
        given = RunOptions.of(options, guess=fail_on is None and outputs["keep"] is None)
        files = (path for title, path in outputs.items() if title != "annotate")
        commands.check_paths((file, given.labels, given.reference, *given.columns.files), *files)
        if outputs["annotate"] is not None:
            from rpil.formats.registry import find

            find(file).check_annotate(outputs["annotate"])
        run = commands.judge(file, given, progress)
        recording, faults = run.recording, commands.look_for_faults(run.recording, progress, rules=given.without_faults)
        run = replace(run, faults=faults, asked=commands.choice_asked(given, faults) if outputs["keep"] else None)
        commands.write_outputs(outputs, run, progress)
    result = run.audit
    if form == "json":
        of_data = {"run": result.run_id, "input": recording.description.to_dict()}
        beside = {"faults": faults.to_dict(), "keep": run.choice.to_dict()}
        click.echo(terminal.to_json("audit", of_data | result.to_dict() | beside))
    elif form != "text":
        from rpil.cli import exchange
        from rpil.results.overview import headline

        found = [*exchange.of_audit(result), *exchange.of_faults(faults.findings)]
        click.echo(exchange.written(form, found, file, "rpil audit", headline(result)))
    else:
        within = terminal.fit(result.assumptions[0], terminal.line_width(), 2) if result.within else ()
        head = recording.description.short() if all_rows else head_lines(recording.description)
        print_audit(result, [*head, *within, ""], faults, closing_lines(ctx, result), all_rows)
    for title, path in outputs.items():
        if path is not None:
            click.echo(f"{title.capitalize()}: {path}", err=form != "text")
            if form == "text" and not given.quiet:
                terminal.print_lines(commands.lines_after_output(title, path, run))
    return commands.tell_if_too_many(result, fail_on)


def closing_lines(ctx: click.Context, audit: Audit) -> list[str]:
    """What to do next, with the command to run then; nothing if the user wants it quiet."""
    if ctx.params["quiet"]:
        return []
    labels = ctx.params["labels"] or LABELS_FILE
    return ["", *next_steps(audit, labels, command_words(ctx, str(ctx.info_name)))]
