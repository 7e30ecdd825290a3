"""The files that ``rpil audit`` writes beside what it prints."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.cli.commands import AuditRun
from rpil.cli.options import RunOptions
from rpil.cli.terminal import StageProgress
from rpil.data.text import MAX_LISTED_NAMES, listed, printable

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.results.choice import Asked, Choice
    from rpil.results.record import Audit
    from rpil.results.view import About

OUTPUTS = ("weights", "verdicts", "keep", "report", "annotate")
"""The options that name these files, in the order in which they are written."""


def write_outputs(paths: Mapping[str, str | None], run: AuditRun, progress: StageProgress) -> None:
    """Write the files of `OUTPUTS` whose paths are given."""
    audit = run.audit
    for title, path in ((title, paths[title]) for title in OUTPUTS):
        if path is None:
            continue
        from rpil.formats import write_weights
        from rpil.formats.registry import find
        from rpil.results.choice import write_kept, write_verdicts
        from rpil.results.html.page import write_page

        progress(f"writing {path}")
        if title == "weights":
            steps = audit.ids, audit.offsets, audit.step_weight, audit.expert_proba, audit.log_odds
            write_weights(path, *steps, run.recording.step_columns)
            if audit.step_weight.min() == audit.step_weight.max():
                why = "because nothing says who is good; two answers do, one good and one bad"
                warnings.warn(f"{path}: every step weighs the same, {why}.", stacklevel=1)
        elif title == "verdicts":
            findings = run.faults.findings if run.faults else ()
            write_verdicts(path, audit, audit.table(run.demonstrators, run.recording.tasks, findings))
        elif title == "keep":
            write_kept(path, audit, run.choice)
            if not run.choice.kept:
                warnings.warn(f"{path}: it lists no demonstration, because all are rejected.", stacklevel=1)
        elif title == "report":
            write_page(path, audit, about(run))
        else:
            table, names = audit.table(), {"verdict": "verdict", "score": "log_odds", "rejected_by": "rejected_by"}
            ids = [*map(str, audit.ids)]
            rows = {f"rpil/{name}": dict(zip(ids, table[own], strict=True)) for name, own in names.items()}
            find(run.source).annotate(path, rows)


def about(run: AuditRun) -> About:
    """What the report shows beside the audit."""
    from rpil.data.privacy import for_others
    from rpil.results.view import About, no_faults

    read, lerobot = run.recording.description, run.recording.description.format.startswith("LeRobot")
    hub, source = re.match(r"hf://datasets/([\w.-]+/[\w.-]+)", run.source), for_others(run.source)
    return About(
        title=f"Audit of {Path(source).name}",
        source=source,
        read=tuple(map(for_others, read.short())),
        lost=run.lost,
        faults=run.faults or no_faults(),
        tasks=run.recording.tasks,
        demonstrators=run.demonstrators,
        lerobot=lerobot,
        hub=hub[1] if hub and lerobot else "",
    )


def lines_after_output(title: str, path: str, run: AuditRun) -> list[str]:
    """What the file at `path`, an output, leaves out, and what to do with it where the tool that wrote the data takes
    it."""
    from rpil.formats.registry import find

    if title == "annotate":
        keeps = 'episode_filter=lambda episode: not episode["rpil/rejected_by"]'
        return [f"For LeRobot: LeRobotDataset({Path(path).name!r}, root={path!r}, {keeps})"]
    if title == "weights":
        return [*find(run.source).format.notes_on_weights]
    every, ids = run.recording.ids or run.audit.ids, run.choice.kept if title == "keep" else ()
    lines = []
    if title == "keep":
        rejected = [*run.choice.lines(), ""]
        lines = [f"{len(ids):,} of {len(run.audit.ids):,} kept. {rejected[0]}".rstrip(), *rejected[1:-1]]
        lines += look_lines(run.audit, run.choice, run.faults)
    if len(ids) in (0, len(every)):  # nothing was chosen
        return lines
    return [*lines, *run.lost, *find(run.source).commands_to_keep(every, ids, path)]


def choice_asked(
    options: RunOptions, report: FaultReport | None, share: float | None = None, at_least: float | None = None
) -> Asked:
    """What a user asks for; a line on stderr where a rule that was named could not be applied."""
    from rpil.results.choice import Asked

    unknown, faults = (report.not_checked, report.findings) if report else ({}, ())
    for rule in filter(unknown.__contains__, options.without_faults):
        click.echo(f"note: --without-faults: {rule} was not checked, because {unknown[rule]}.", err=True)
    faulty = {str(fault.id) for fault in faults if fault.rule in options.without_faults}
    return Asked(share, at_least, {*options.ignore}, faulty)


def look_lines(audit: Audit, choice: Choice, report: FaultReport | None = None) -> Iterator[str]:
    """What to look at until answers contrast: the lowest of the ranking that are kept, the odd ones where they are
    known, and the question."""
    if choice.asked.by_number or audit.anchor == "named adversary" or audit.answers.once(audit.copy_of).contrast:
        return
    kept = {*choice.kept}
    odd = [name for name in (report.odd if report else ()) if name in kept]
    lowest = [audit.ids[m] for m in audit.ranking()[::-1].tolist() if audit.ids[m] in kept][:MAX_LISTED_NAMES]
    yield f"Look at {listed(lowest)}, the lowest of the ranking{f'; and at odd recordings: {listed(odd)}' * bool(odd)}."
    pair = audit.pair if audit.question else audit.suggest_labels(1)
    if pair:
        yield audit.question or f"Is it good or bad: {printable(pair[0])}?"


def tell_if_too_many(audit: Audit, limit: str | None) -> int:
    """The exit code under a `verdict_limit`: 1, with a line on stderr, if more are outliers or bad than allowed."""
    from rpil.results.vocabulary import PLURALS, SIDES

    (verdict, _, most), lower = (limit or "").partition(":"), audit.vocabulary.lower
    # Those called outliers without an answer are not bad; those called bad differ from the good ones.
    count = sum(SIDES[one] == "lower" and (verdict == "outlier" or one != "outlier") for one in audit.verdicts)
    if limit is None or count <= int(most or 0):
        return 0
    who = f"{count:,} of {len(audit.ids):,} demonstrations are {PLURALS.get(lower, lower)}"
    click.echo(f"rpil: {who}, and --fail-on {limit} allows {int(most or 0):,}.", err=True)
    return 1
