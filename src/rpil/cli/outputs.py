"""The files that ``rpil audit`` writes beside what it prints."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.cli.commands import AuditRun, tell_if_interrupted
from rpil.cli.label import WITHOUT
from rpil.cli.options import CHOICE_NAMES, RunOptions, command_words
from rpil.cli.progress import StageProgress
from rpil.data.text import printable

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.results.choice import Asked, Choice
    from rpil.results.record import Audit
    from rpil.results.view import About

UNDECIDED = 3
"""The exit code where a list to keep is written, and holds outliers for want of answers."""

OUTPUTS = ("weights", "verdicts", "keep", "report", "save", "annotate")
"""The options that name these files, in the order in which they are written."""


def write_outputs(paths: Mapping[str, str | None], run: AuditRun, seconds: float, progress: StageProgress) -> None:
    """Write the files of `OUTPUTS` whose paths are given; the audit took so many `seconds`."""
    if not any(paths.values()):  # what follows imports the report
        return
    from rpil.formats.columns_file import write_weights
    from rpil.formats.registry import find
    from rpil.results.html.page import Article, write_page
    from rpil.results.saved import write_audit
    from rpil.results.step_weights import why_equal
    from rpil.results.verdict_table import verdict_columns, write_kept, write_verdicts
    from rpil.results.view import make_view

    audit, findings = run.audit, run.faults.findings if run.faults else ()

    def write_keep(path: str) -> None:
        write_kept(path, audit, run.choice)
        if not run.choice.kept:
            warnings.warn(f"{path}: it lists no demonstration, because all are rejected.", stacklevel=1)

    def write_step_weights(path: str) -> None:
        steps = audit.ids, audit.offsets, audit.step_weight, audit.expert_proba, audit.log_odds
        write_weights(path, *steps, run.recording.step_columns)
        if reason := why_equal(audit):
            warnings.warn(f"{path}: {reason}", stacklevel=1)

    def write_annotated(path: str) -> None:
        columns = {"rpil/verdict": audit.verdicts, "rpil/score": audit.log_odds.tolist()}
        by_id = {name: dict(zip(map(str, audit.ids), values, strict=True)) for name, values in columns.items()}
        find(run.source).annotate(path, by_id)

    writers: dict[str, Callable[[str], None]] = {
        "weights": write_step_weights,
        "verdicts": lambda path: write_verdicts(
            path, audit, verdict_columns(audit, run.demonstrators, findings, run.recording.tasks)
        ),
        "keep": write_keep,
        "report": lambda path: write_page(path, [Article(make_view(audit, about(run, seconds)))]),
        "save": lambda path: write_audit(path, audit, about(run, seconds)),
        "annotate": write_annotated,
    }
    for title in OUTPUTS:
        path = paths[title]
        if path is not None:
            progress(f"writing {path}")
            writers[title](path)
            tell_if_interrupted(f"{path} is written")


def about(run: AuditRun, seconds: float | None = None) -> About:
    """What the report shows beside the audit, which the command made in so many `seconds`."""
    from rpil.data.privacy import for_others, without_secrets
    from rpil.results.saved import NOT_SHARED
    from rpil.results.view import About

    words = command_words(click.get_current_context(), "audit", (*WITHOUT, *NOT_SHARED, *CHOICE_NAMES))
    read, lerobot = run.recording.description, run.recording.description.format.startswith("LeRobot")
    hub, source = re.match(r"hf://datasets/([\w.-]+/[\w.-]+)", run.source), for_others(run.source)
    return About(
        title=f"Audit of {Path(source).name}",
        source=source,
        read=tuple(map(for_others, read.short())),
        lost=run.lost,
        faults=run.faults,
        tasks=run.recording.tasks,
        demonstrators=run.demonstrators,
        lerobot=lerobot,
        hub=hub[1] if hub and lerobot else "",
        command=for_others(shlex.join(map(without_secrets, words))),
        seconds=seconds,
    )


def lines_after_output(title: str, path: str, run: AuditRun) -> list[str]:
    """What the file at `path`, an output, leaves out, and what to do with it where the tool that wrote the data takes
    it."""
    from rpil.formats.registry import find

    if title == "annotate":
        keeps = 'episode_filter=lambda episode: episode["rpil/verdict"] not in ("outlier", "bad")'
        return [f"For LeRobot: LeRobotDataset({Path(path).name!r}, root={path!r}, {keeps})"]
    if title == "weights":
        return [*find(run.source).format.notes_on_weights]
    every, ids = run.recording.ids or run.audit.ids, run.choice.kept if title == "keep" else ()
    lines = []
    if title == "keep":
        rejected = [*run.choice.lines(), ""]
        lines = [f"{len(ids):,} of {len(run.audit.ids):,} kept. {rejected[0]}".rstrip(), *rejected[1:-1]]
        lines += deciding_lines(run.audit, run.choice) if run.choice.undecided else ()
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


def exit_code(choice: Choice, is_accepted: bool) -> int:
    """`UNDECIDED` where demonstrations are undecided, which is said on stderr, unless that is accepted; else 0."""
    if choice.undecided:
        click.echo(f"rpil: {choice.reason}", err=True)
    return UNDECIDED if choice.undecided and not is_accepted else 0


def deciding_lines(audit: Audit, choice: Choice) -> Iterator[str]:
    """The question of an audit that leaves outliers undecided, and how many are kept by two answers to it,
    either way, and by the ranking."""
    from rpil.results.verdict_table import choice_of

    share, pair = audit.settings.keep.example_share, audit.pair if audit.question else audit.suggest_labels(1)
    if pair:
        yield audit.question or f"Is it good or bad: {printable(pair[0])}?"
    # Answers to an audit of tasks, or beside a reference, are learned from in another way when it is made again.
    for labels in (("good", "bad"), ("bad", "good")) if audit.columns.size and pair and not audit.own_reasons else ():
        answers = dict(zip(pair, labels, strict=False))
        said = " and ".join(f"{printable(name)} is {label}" for name, label in answers.items())
        n = len(choice_of(audit.answered(answers), choice.asked).kept)
        yield f"  If {said}, {n:,} of {len(audit.ids):,} are kept."
    if audit.within:
        yield f"  Two answers about each of the {audit.within} with outliers decide; rpil label asks for them."
    by_rank = choice_of(audit, replace(choice.asked, share=share)).kept
    yield f"  --share {share:g} would keep {len(by_rank):,}, those that rank highest."


def tell_if_too_many(audit: Audit, limit: str | None) -> int:
    """The exit code under a `verdict_limit`: 1, with a line on stderr, if more are outliers or bad than allowed."""
    from rpil.results.vocabulary import PLURALS, SIDES

    (verdict, _, most), lower = (limit or "").partition(":"), audit.vocabulary.lower
    # Those called outliers without an answer are not bad; those called bad differ from the good ones.
    verdicts = audit.verdicts if verdict == "outlier" else [one for one in audit.verdicts if one != "outlier"]
    count, allowed = [SIDES[one] for one in verdicts].count("lower"), int(most or 0)
    if limit is None or count <= allowed:
        return 0
    click.echo(
        f"rpil: {count:,} of {len(audit.ids):,} demonstrations are {PLURALS.get(lower, lower)}, and --fail-on {limit} "
        f"allows {allowed:,}.",
        err=True,
    )
    return 1
