"""The command ``rpil audit``: at most 25 lines of 80 columns, or with ``--all`` a row for every demonstration."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from rpil.cli import commands, options, terminal
from rpil.cli.options import LABELS_FILE, RunOptions, Value, command_words
from rpil.cli.terminal import THEN_RUN, fit, line_width, print_lines, show_stages, table_lines
from rpil.data.files import check_outputs
from rpil.data.text import MAX_LISTED_NAMES, counted, listed, printable
from rpil.results.vocabulary import PLURALS, SIDES, short_id

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.formats.scan import Description
    from rpil.results.record import Audit


@click.command()
@click.argument("file", type=click.Path())
@click.option("--report", type=options.OutputFile(".html"), help="Also write a report as a web page.")
@click.option(
    "--weights", type=options.OutputFile(".parquet", ".csv"), help="Also write a training weight for every step."
)
@click.option(
    "--verdicts",
    type=options.OutputFile(".csv", ".parquet", ".json"),
    help="Also write a table with one row for every demonstration.",
)
@click.option(
    "--keep",
    type=options.OutputFile(".json"),
    help="Also write the ids of the demonstrations to keep, all but the rejected ones, as LeRobot takes them.",
)
@click.option(
    "--fail-on",
    callback=options.verdict_limit,
    metavar="outlier|bad[:N]",
    help="Exit with code 1 if more than N demonstrations (default: 0) are outliers or bad.",
)
@click.option(
    "--annotate",
    type=click.Path(),
    metavar="NEW",
    help="Also write a copy of this folder of LeRobot 3.0, with the verdict and the score of each episode in "
    "meta/episodes, for episode_filter.",
)
@click.option("--all", "all_rows", is_flag=True, help="Print a row for each demonstration, with its whole reason.")
@options.format_option
@options.with_options(*options.SEGMENT_OPTIONS, options.faults_option, *options.JUDGE_OPTIONS)
@click.pass_context
def audit(ctx: click.Context, /, file: str, all_rows: bool, form: str, fail_on: str | None, **options: Value) -> int:
    """Print which demonstrations to look at first, and which differ from the rest or are bad.

    It fits no final policy; rpil fit does, with the same verdicts.
    """
    outputs = {title: options.pop(title) for title in commands.OUTPUTS}
    lists = outputs["keep"] is not None or outputs["ranges"] is not None
    if not lists and options["without_faults"]:
        raise click.UsageError("--without-faults says what --keep lists: give --keep OUT.json")
    idle, pattern = options.pop("idle"), options.pop("ranges_id") or "{id}"
    if outputs["ranges"] is None and (idle, pattern) != ("keep", "{id}"):
        raise click.UsageError("--idle and --ranges-id say what --ranges writes: give --ranges OUT.json")
    with show_stages(bool(options["quiet"])) as progress:
        given = RunOptions.of(options)
        files = (path for title, path in outputs.items() if title != "annotate")
        check_outputs((file, given.labels, given.reference, *given.columns.files), files)
        if outputs["annotate"] is not None:
            from rpil.formats.registry import find

            find(file).check_annotate(outputs["annotate"])
        run = commands.judge(file, given, progress)
        recording, faults = run.recording, commands.look_for_faults(run.recording, progress, rules=given.without_faults)
        faulty = commands.faulty_ids(given, faults) if lists else frozenset[str]()
        run = replace(run, faults=faults, faulty=faulty, idle=idle, pattern=pattern)
        said = commands.write_outputs(outputs, run, progress)
    result = run.audit
    if form == "json":
        of_data = {"run": result.run_id, "input": recording.description.to_dict()}
        beside = {"faults": faults.to_dict(), "keep": run.choice.to_dict()}
        click.echo(terminal.to_json(of_data | result.to_dict() | beside, "audit"))
    elif form != "text":
        from rpil.cli import exchange
        from rpil.results.result import headline

        found = [*exchange.of_audit(result, recording), *exchange.of_faults(faults.lines, recording)]
        click.echo(exchange.written(form, found, file, "rpil audit", headline(result)))
    else:
        within = fit(result.method[0], line_width(), 2) if result.within else ()
        head = recording.description.short() if all_rows else head_lines(recording.description)
        print_audit(result, [*head, *within, ""], faults, closing_lines(ctx, result), all_rows)
    for title, lines in said.items():
        click.echo(f"{title.capitalize()}: {outputs[title]}", err=form != "text")
        if form == "text" and not given.quiet:
            print_lines(lines)
    return commands.tell_if_too_many(result, fail_on) if fail_on else 0


def closing_lines(ctx: click.Context, audit: Audit) -> list[str]:
    """The next step, with the command to run then; nothing if the user wants it quiet."""
    if ctx.params["quiet"]:
        return []
    return ["", *next_steps(audit, ctx.params["labels"] or LABELS_FILE, command_words(ctx, str(ctx.info_name)))]


MAX_LINES, MIN_ROWS, MAX_ROWS = 25, 2, 8
"""Lines of an audit, and rows of its table, unless all are asked for."""

N_NAMED, N_FOUND = 3, 12
"""Operators that are named, and demonstrations to label next; those that the finding names, and members of a group."""

ANSWER = "Answer in {} (id,label; docs/command-line.md), or let rpil label ask."
SIDE_COLOURS = {"upper": "green", "open": "yellow", "lower": "red"}


def print_audit(
    audit: Audit, head: Sequence[str], faults: FaultReport, closing: Sequence[str], all_rows: bool = False
) -> None:
    """Print what to look at first, the lines of the `head`, the finding, recording `faults`, the table of those to look
    at, notes, and the lines of the `closing`."""
    from rpil.results.result import first_sentence, look_first, verdict_sentence

    width, faulty = line_width(), faults.odd
    rules: dict[Hashable, str] = {found.id: found.rule for found in reversed(faults.lines)}  # the worst of each
    above = [*fit(first_sentence(audit, faulty), width, 2), *head, *finding_lines(audit), *odd_lines(faults), ""]
    counts = fit(f"{verdict_sentence(audit)}{'' if all_rows else ' All: --all.'}", width)
    notes = [*_notes(audit, all_rows, width)]
    room = MAX_LINES - len([*above, *counts, *closing]) - 1
    below = [*counts, *(notes if all_rows else notes[: max(room - MIN_ROWS, 0)]), *closing]
    room = MAX_LINES - len([*above, *below]) - 1
    shown = look_first(audit, faulty)[: min(MAX_ROWS, max(MIN_ROWS, room))]
    if all_rows or not shown:
        shown = audit.ranking()[::-1].tolist()[: None if all_rows else MIN_ROWS]
    print_lines(above)
    columns = _columns(audit, shown, all_rows, [rules.get(audit.ids[m], "") for m in shown])
    for line in table_lines(columns, None if all_rows and not sys.stdout.isatty() else width):
        click.echo(line)
    print_lines(below)


def head_lines(description: Description) -> list[str]:
    """A few lines on the input: the size, the action, and what else a user should know."""
    width, action = line_width(), f"Action: {listed(description.actions, MAX_LISTED_NAMES, ', ')}."
    notes = (fit(note, width, 1)[0] for note in description.notes[:2])
    return [*fit(description.short()[0], width, 2), *fit(action, width, 1), *notes]


def finding_lines(audit: Audit) -> list[str]:
    """The finding, and every doubt."""
    from rpil.results.result import headline

    sentences = headline(audit, N_FOUND), *(f"Doubt: {doubt}" for doubt in audit.doubts)
    return [line for sentence in sentences for line in fit(sentence, line_width(), 2)]


def print_finding(audit: Audit) -> None:
    """Print the finding, the doubts, and how many demonstrations have which verdict."""
    from rpil.results.result import verdict_sentence

    print_lines([*finding_lines(audit), verdict_sentence(audit)])


def odd_lines(report: FaultReport) -> list[str]:
    """How many recordings are odd, and the worst one; or that there is none, and what was not looked for."""
    if not report.findings:
        return fit(report.headline, line_width(), 2)
    worst, n = report.lines[0], len({found.id for found in report.findings} - {""})
    odd = f"{counted(n, 'recording')} {'are' if n > 1 else 'is'} odd"
    which = f"{odd}{', most of all' if n > 1 else ':'} {short_id(worst.id)}"
    which = which if worst.id != "" else f"{odd}; the whole set" if n else "The whole set is odd"
    return [*fit(f"{which}: {worst.sentence}.", line_width(), 2), "  All: rpil check."]


def _columns(audit: Audit, shown: Sequence[int], all_rows: bool, odd: list[str]) -> dict[str, list[str]]:
    """The verdict, or else the place, the score, what is `odd` in the recording, where to look and why, without what is
    the same of all; or the whole reason where `all_rows` are printed."""
    from rpil.results.reasons import at_a_glance

    digits, words = 1 + 2 * (abs(audit.log_odds).max() < 1), audit.verdicts
    coloured = [click.style(words[m], fg=SIDE_COLOURS[SIDES[words[m]]]) for m in shown]
    columns = {
        "id": [printable(audit.ids[m]) if all_rows else short_id(audit.ids[m]) for m in shown],
        **({"place": [f"{audit.ranks[m]:,}" for m in shown]} if {*words} == {"open"} else {"verdict": coloured}),
        "score": [f"{round(value, digits) + 0.0:+,.{digits}f}" for value in audit.log_odds[[*shown]].tolist()],
    }
    if all_rows:
        more = {"why": [printable(audit.reasons[m]) for m in shown]}
    else:
        glances = zip(*(at_a_glance(audit, audit.reasons[m], m) for m in shown), strict=True)
        more = dict(zip(("where", "why"), map(list, glances), strict=True))
    return columns | ({"fault": odd} if any(odd) else {}) | {name: own for name, own in more.items() if len({*own}) > 1}


def _notes(audit: Audit, all_rows: bool, width: int) -> Iterator[str]:
    """Contradicting labels, operators, groups and notes, a line each, or whole."""
    lower, sentences = audit.vocabulary.lower, list[str]()
    if audit.contradicting:
        names = listed(audit.contradicting, MAX_LISTED_NAMES, ", ")
        sentences.append(f"Look again: the labels of {names} contradict the other answers.")
    counts = [(who, audit.verdict_counts(who.demonstrations)[lower]) for who in audit.demonstrators]
    counts.sort(key=lambda one: -one[1] / len(one[0].demonstrations))  # the largest share first
    shares = [f"{short_id(who.name)} {n:,} of {len(who.demonstrations):,}" for who, n in counts if n]
    if shares:
        names = listed(shares, len(shares) if all_rows else N_NAMED, ", ")
        sentences.append(f"{PLURALS.get(lower, lower).capitalize()} by operator: {names}.")
    sentences += [f"Group {letter}, {len(ids):,}: {listed(ids, N_FOUND, ', ')}" for letter, ids in audit.groups.items()]
    for sentence in [*sentences, *audit.notes]:
        yield from fit(sentence, width, None if all_rows else 1)


def next_steps(audit: Audit, labels_file: str, command: Sequence[str]) -> list[str]:
    """The next step: the question whose answer says most, or the demonstrations to label, and the command to run
    then, which is `command` with ``--labels``."""
    if not audit.question and audit.finding == "nothing could be learned":
        return ["Check that the observations contain what the actions depend on."]
    if not (to_label := audit.suggest_labels(N_NAMED)):
        return []
    sentences = audit.question or f"Best to label first: {listed(to_label, N_NAMED, ', ')}.", ANSWER.format(labels_file)
    lines = [line for sentence in sentences for line in fit(sentence, line_width(), 2)]
    return [*lines, f"{THEN_RUN}{shlex.join([*command, '--labels', labels_file])}"]
