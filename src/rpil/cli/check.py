"""The command ``rpil check``: recording faults, by rules without a model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rpil.cli import commands, terminal
from rpil.cli.options import COLUMN_OPTIONS, OutputFile, format_option, pop_columns, quiet_option, with_options
from rpil.cli.terminal import show_stages
from rpil.data.errors import DataError
from rpil.data.files import check_outputs
from rpil.data.text import MAX_IDS, listed, printable

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.formats.recording import Recording

FAIL_ON = "Exit with code 1 if one of these rules finds a fault, or if there is a fault of this grade or worse."
MAX_FINDINGS = 30
"""Findings that are printed."""


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "--expected",
    type=click.Path(),
    metavar="FILE",
    help="Leave out these expected findings: JSON of rule to a list of ids.",
)
@click.option("-o", "--output", type=OutputFile(".csv", ".parquet", ".json"), help="Also write a row for each finding.")
@click.option("--fail-on", metavar="RULE[,RULE]|broken|suspect|any", help=FAIL_ON)
@click.option("--fps", type=click.FloatRange(0, min_open=True), help="Frames a second, if the recording does not say.")
@click.option("--video", is_flag=True, help="Also check the videos of a LeRobot folder; needs the extra video.")
@format_option
@quiet_option
@with_options(*COLUMN_OPTIONS)
def check(
    file: str, expected: str | None, output: str | None, fail_on: str | None, form: str, quiet: bool, **options: Any
) -> int:
    """Find recording faults: dropped frames, frozen sensors, spikes, lag, idle ends, duplicates and others.

    Rules compare each demonstration with the others; no model is fitted. docs/faults.md describes each rule.
    """
    check_outputs((file, expected), [output])
    with show_stages(quiet) as progress:
        from rpil.faults.checking import check as find_faults
        from rpil.faults.checking import of_files
        from rpil.faults.report import read_expected

        columns, fatal = pop_columns(options), _rules(fail_on)
        suppressed = read_expected(expected) if expected else {}
        # Missing values are findings, and damage alone is skipped.
        damage = replace(columns, skip_bad=columns.skip_bad and "damage", allow_missing=True)
        read: Recording | None = None
        try:
            read = commands.open_recording(file, damage, progress)
        except DataError as error:
            report = of_files(file, error, error.in_shell)
        if read is not None:
            progress("checking the steps, and looking at the videos" if options["video"] else "checking")
            looks = {"fps": options["fps"], "video": options["video"]}
            report = find_faults(read, expected=suppressed, skip_bad=bool(columns.skip_bad), **looks)
        if output:
            report.write(output)
    if read is not None:
        commands.tell_of_set_aside(read)
    if form == "json":
        click.echo(terminal.to_json(report.to_dict(), "check"))
    elif form == "text":
        terminal.print_lines(fault_lines(report))
    else:
        from rpil.cli import exchange

        found = exchange.of_faults(report.lines, read)
        click.echo(exchange.written(form, found, file, "rpil check", report.headline))
    return int(bool(fatal & set(report.counts)))


def _rules(fail_on: str | None) -> set[str]:
    """The rules that --fail-on names."""
    from rpil.faults.report import RULES, rule_name
    from rpil.faults.rule import GRADES

    rules: set[str] = set()
    for word in (word.strip() for word in (fail_on or "").split(",") if word.strip()):
        grades = GRADES if word == "any" else GRADES[: GRADES.index(word) + 1] if word in GRADES else ()
        rules |= {name for name, rule in RULES.items() if rule.grade in grades} or {rule_name(word, "--fail-on")}
    return rules


def fault_lines(report: FaultReport, n_findings: int = MAX_FINDINGS) -> list[str]:
    """A report in lines: the number of findings by rule, the worst findings, what is usual and what was not checked."""
    from rpil.faults.report import NUMBERS

    lines, n = [report.headline], len(report.findings)
    counts = sorted(report.counts.items(), key=lambda item: -item[1])
    if n:
        lines += ["", *(f"  {k:>6,}  {NUMBERS[rule]}  {rule}" for rule, k in counts)]
    if shown := report.lines[:n_findings]:
        width = max(len(printable(fault.id)) for fault in shown)
        lines += ["", "The worst first:" if n > 1 else "The finding:"]
        lines += [f"  {printable(f.id) or '-':<{width}}  {f.rule}: {terminal.to_one_line(f.sentence)}" for f in shown]
    if len(report.lines) > len(shown):
        lines.append(f"  ... and {len(report.lines) - len(shown):,} more; --format json prints all")
    if report.set_aside:
        lines += ["", f"Set aside, because values are missing: {listed(report.set_aside, MAX_IDS, ', ')}."]
    if report.n_expected:
        lines += ["", f"{report.n_expected:,} more {'is' if report.n_expected == 1 else 'are'} expected and left out."]
    if report.trims:
        steps = listed([f"{name}: {a} to {b - 1}" for name, (a, b) in report.trims.items()], MAX_IDS, ", ")
        n, m, heads = len(report.trims), report.n_demonstrations, sum(first > 0 for first, _ in report.trims.values())
        lines += ["", f"Idle ends of {n:,} of {m:,} may be trimmed ({heads:,} idle heads); steps to keep: {steps}."]
    lines += ["", f"Usual: {'; '.join(report.usual.values())}."] if report.usual else []
    reasons = [f"  {', '.join(rules)}: {terminal.to_one_line(reason)}" for reason, rules in report.reasons.items()]
    partly = ", ".join(f"{rule} ({len(names)})" for rule, names in report.unknown.items())
    reasons += [f"  in some columns, which hardly move or vary too much: {partly}"] if partly else []
    return [*lines, "", "Not checked:", *reasons] if reasons else lines
