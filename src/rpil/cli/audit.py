"""The commands ``rpil audit`` and ``rpil report``."""

from __future__ import annotations

import shlex
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from rpil.cli import terminal
from rpil.cli.commands import audit_data, check_paths, look_for_faults, read_data, show_stages
from rpil.cli.label import LABELS_FILE
from rpil.cli.options import (
    CHOICE_NAMES,
    CHOICE_OPTIONS,
    JUDGE_OPTIONS,
    OutputFile,
    RunOptions,
    Value,
    VerdictLimit,
    command_words,
    format_option,
    json_option,
    with_options,
)
from rpil.cli.outputs import (
    OUTPUTS,
    choice_asked,
    exit_code,
    lines_after_output,
    tell_if_too_many,
    write_outputs,
)

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.results.record import Audit

MAX_REASONS = 10
"""Demonstrations with low trust whose faults are printed beside an audit."""


@click.command()
@click.argument("file", type=click.Path())
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
    help="Also write the ids of the demonstrations to keep, all but outliers and bad ones, as LeRobot takes them.",
)
@click.option(
    "--save",
    type=OutputFile(".rpil"),
    metavar="RUN.rpil",
    help="Also write the audit, from which rpil report makes its report again.",
)
@click.option(
    "--fail-on",
    type=VerdictLimit(),
    metavar="outlier|bad[:N]",
    help="Exit with code 1 where more than N demonstrations, by default 0, are outliers or bad.",
)
@click.option("--all", "all_rows", is_flag=True, help="Print all demonstrations, not the worst and doubtful ones only.")
@click.option(
    "--annotate",
    type=click.Path(),
    metavar="NEW",
    help="Also write a copy of this folder of LeRobot 3.0, with the verdict and the score of each episode in "
    "meta/episodes, for episode_filter.",
)
@json_option
@format_option
@with_options(*CHOICE_OPTIONS, *JUDGE_OPTIONS)
@click.pass_context
def audit(
    ctx: click.Context,
    /,
    file: str,
    all_rows: bool,
    json_wanted: bool,
    form: str,
    fail_on: str | None,
    **options: Value,
) -> int:
    """Print how far each demonstration can be trusted, the least trusted first.

    No policy is kept: with --features auto none are chosen for one, and the verdicts are those of rpil fit.
    """
    start = time.perf_counter()
    outputs = {title: options.pop(title) for title in OUTPUTS}
    if outputs["keep"] is None and any(options[name] for name in CHOICE_NAMES):
        raise click.UsageError("--ignore, --without-faults and --yes say what --keep lists: give --keep OUT.json")
    with show_stages(bool(options["quiet"])) as progress:
        given = RunOptions.of(options, guess=fail_on is None and outputs["keep"] is None)
        files = (path for title, path in outputs.items() if title != "annotate")
        check_paths((file, given.labels, given.operator, given.reference), *files)
        if outputs["annotate"] is not None:
            from rpil.formats.registry import find

            find(file).check_annotate(outputs["annotate"])
        recording, reference = read_data(file, given, progress)
        run = audit_data(file, recording, reference, given, progress)
        faults = look_for_faults(recording, progress, rules=given.without_faults)
        run = replace(run, faults=faults, asked=choice_asked(given, faults) if outputs["keep"] else None)
        write_outputs(outputs, run, time.perf_counter() - start, progress)
    result, form = run.audit, "json" if json_wanted else form
    if form == "json":
        click.echo(
            terminal.to_json(
                terminal.schema("audit")
                | {"run": result.run_id, "input": recording.description.to_dict()}
                | result.to_dict()
                | {"faults": faults.to_dict(), "keep": run.choice.to_dict()}
            )
        )
    elif form != "text":
        from rpil.cli import exchange

        found = [*exchange.of_audit(result), *exchange.of_faults(faults.findings)]
        click.echo(exchange.written(form, found, file, ("rpil audit", terminal.finding_lines(result)[0])))
    else:
        judged_within = result.assumptions[:1] if result.within else ()
        terminal.print_lines([*recording.description.short(), *judged_within, ""])
        terminal.print_audit(result, all_rows)
        terminal.print_lines(fault_lines(faults, result, file))
        print_next_steps(ctx, result, given.quiet)
    for title, path in outputs.items():
        if path is not None:
            click.echo(f"{title.capitalize()}: {path}", err=form != "text")
            if form == "text" and not given.quiet:
                terminal.print_lines(lines_after_output(title, path, run))
    undecided = exit_code(run.choice, given.yes) if outputs["keep"] else 0
    return tell_if_too_many(result, fail_on) or undecided


@click.command()
@click.argument("run", type=click.Path())
@click.option(
    "-o", "--output", type=OutputFile(".html"), metavar="OUT.html", required=True, help="The report, a web page."
)
def report(run: str, output: str) -> None:
    """Write the report of an audit again, from the RUN that rpil audit --save wrote."""
    check_paths((run,), output)
    from rpil.results.html.page import Article, write_page
    from rpil.results.record import Audit
    from rpil.results.saved import read_audit

    write_page(output, [Article(read_audit(run, Audit)[1])])
    click.echo(f"Report: {output}")


def print_next_steps(ctx: click.Context, audit: Audit, quiet: bool) -> None:
    """Print what to do next, with the command to run then; nothing if `quiet`."""
    if quiet:
        return
    labels = ctx.params["labels"] or LABELS_FILE
    click.echo(terminal.next_steps(audit, labels, shlex.join(command_words(ctx, str(ctx.info_name)))))


def fault_lines(report: FaultReport, audit: Audit, file: str) -> list[str]:
    """The recording faults beside an audit: how many, and those that may explain low trust."""
    from rpil.faults.report import explain
    from rpil.results.vocabulary import SIDES

    if not report.findings:
        return ["No recording faults found."]
    counts = ", ".join(f"{count} {rule}" for rule, count in report.counts.items())
    lines = [
        f"Recording faults, which do not change the trust: {counts}; {shlex.join(['rpil', 'check', file])} lists them."
    ]
    distrusted = [name for name, verdict in zip(audit.ids, audit.verdicts, strict=True) if SIDES[verdict] == "lower"]
    reasons = [(name, reason) for name in distrusted if (reason := explain(report.findings, name))]
    return lines + [f"  {name}: {reason}" for name, reason in reasons[:MAX_REASONS]]
