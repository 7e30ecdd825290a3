"""The files that ``rpil audit`` writes beside what it prints."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.cli.commands import tell_if_interrupted
from rpil.cli.label import WITHOUT
from rpil.cli.options import command_words
from rpil.cli.progress import StageProgress

if TYPE_CHECKING:
    from rpil.data.demonstrations import Demonstrations
    from rpil.faults.record import FaultReport
    from rpil.formats.dataset import Dataset
    from rpil.formats.recording import Recording
    from rpil.results.record import Audit
    from rpil.results.view import About

OUTPUTS = ("weights", "verdicts", "keep", "report", "save")
"""The options that name these files, in the order in which they are written."""


@dataclass(frozen=True, eq=False)
class Audited:
    """An audit and what it was given: the path of the data, their recording, its faults, and the demonstrators."""

    audit: Audit
    source: str
    recording: Recording
    faults: FaultReport
    demonstrators: Mapping[str, str]

    @cached_property
    def lost(self) -> tuple[str, ...]:
        """What is lost without those that `--keep` does not list; see `lost_without`."""
        from rpil.results.verdict_table import kept

        return lost_without(self.recording.demonstrations, kept(self.audit))


def lost_without(demonstrations: Demonstrations | Dataset, kept: Collection[object]) -> tuple[str, ...]:
    """What only demonstrations that are not kept visit, where their observations are in memory."""
    from rpil.data.demonstrations import Demonstrations
    from rpil.results.lost import lost_places

    return lost_places(demonstrations, kept) if isinstance(demonstrations, Demonstrations) else ()


def write_outputs(paths: Mapping[str, str | None], given: Audited, seconds: float, progress: StageProgress) -> None:
    """Write the files of `OUTPUTS` whose paths are given; the audit took so many `seconds`."""
    from rpil.formats.weights import write_weights
    from rpil.results.html.page import Article, write_page
    from rpil.results.run_file import write_run
    from rpil.results.step_weights import why_equal
    from rpil.results.verdict_table import kept, write_kept, write_verdicts
    from rpil.results.view import make_view

    audit = given.audit
    view = cache(lambda: make_view(audit, about(given, seconds)))

    def write_keep(path: str) -> None:
        write_kept(path, audit)
        if not kept(audit):
            warnings.warn(f"{path}: every demonstration is {audit.words.lower}, so that it lists none.", stacklevel=1)

    def write_step_weights(path: str) -> None:
        steps = audit.ids, audit.offsets, audit.step_weight, audit.expert_proba, audit.log_odds
        write_weights(path, *steps, given.recording.step_columns)
        if reason := why_equal(audit):
            warnings.warn(f"{path}: {reason}", stacklevel=1)

    writers: dict[str, Callable[[str], None]] = {
        "weights": write_step_weights,
        "verdicts": lambda path: write_verdicts(
            path, audit, given.demonstrators, given.faults.findings, given.recording.tasks
        ),
        "keep": write_keep,
        "report": lambda path: write_page(path, [Article(view())]),
        "save": lambda path: write_run(path, view()),
    }
    for title in OUTPUTS:
        path = paths[title]
        if path is not None:
            progress(f"writing {path}")
            writers[title](path)
            tell_if_interrupted(f"{path} is written")


def about(given: Audited, seconds: float | None = None) -> About:
    """What the report shows beside the audit, which the command made in so many `seconds`."""
    from rpil.data.privacy import for_others, without_secrets
    from rpil.results.run_file import NOT_IN_A_RUN
    from rpil.results.view import About

    words = command_words(click.get_current_context(), "audit", (*WITHOUT, *NOT_IN_A_RUN))
    read, lerobot = given.recording.description, given.recording.description.format.startswith("LeRobot")
    hub, source = re.match(r"hf://datasets/([\w.-]+/[\w.-]+)", given.source), for_others(given.source)
    return About(
        title=f"Audit of {Path(source).name}",
        source=source,
        read=list(map(for_others, read.short())),
        lost=given.lost,
        faults=given.faults,
        tasks=given.recording.tasks,
        demonstrators=given.demonstrators,
        fps=read.fps or given.recording.times().fps,
        lerobot=lerobot,
        hub=hub[1] if hub and lerobot else "",
        command=for_others(shlex.join(map(without_secrets, words))),
        seconds=seconds,
    )


def lines_after_output(title: str, path: str, given: Audited) -> list[str]:
    """What the file at `path`, an output, leaves out, and what to do with it where the tool that wrote the data takes
    it."""
    from rpil.formats.registry import find
    from rpil.results.verdict_table import kept

    if title == "weights":
        return [*find(given.source).format.notes_on_weights]
    every, ids = given.recording.ids or given.audit.ids, kept(given.audit) if title == "keep" else ()
    nothing_chosen = len(ids) in (0, len(every))
    return [] if nothing_chosen else [*given.lost, *find(given.source).commands_to_keep(every, ids, path)]


def tell_if_too_many(audit: Audit, limit: str | None) -> int:
    """The exit code under a `WordLimit`: 1, with a line on stderr, if more are unlike or bad than it allows, else 0."""
    from rpil.results.words import n_lower

    word, _, most = (limit or "").partition(":")
    # Those called unlike without an answer are not bad; those called bad are unlike the good ones.
    verdicts = audit.verdicts if word == "unlike" else [verdict for verdict in audit.verdicts if verdict != "unlike"]
    count, allowed = n_lower(verdicts), int(most or 0)
    if limit is None or count <= allowed:
        return 0
    click.echo(
        f"rpil: {count:,} of {len(audit.ids):,} demonstrations are {audit.words.lower}, and --fail-on {limit} allows "
        f"{allowed:,}.",
        err=True,
    )
    return 1


def judged_within(audit: Audit) -> tuple[str, ...]:
    """The sentence on the tasks within which demonstrations were judged; none where there is one task."""
    return audit.assumptions[:1] if audit.within else ()
