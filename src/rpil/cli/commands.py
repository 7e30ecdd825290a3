"""Shared parts of the commands: errors, reading data, an audit by the options, and the files that it writes."""

from __future__ import annotations

import errno
import io
import os
import shlex
import sys
import warnings
from collections.abc import Iterable, Mapping, Set
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import click

from rpil.cli.options import RunOptions, command_words
from rpil.cli.terminal import LOADING, StageProgress, print_warnings, to_one_line
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.text import MAX_LISTED_NAMES, printable
from rpil.results.vocabulary import PLURALS, SIDES

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.formats.columns import ColumnOptions
    from rpil.formats.recording import Recording
    from rpil.results.choice import Choice
    from rpil.results.html.page import About
    from rpil.results.record import Audit
    from rpil.segments.ranges import Segments


_OF_STREAMS = errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF  # of stdout and stderr, without a name


class Commands(click.Group):
    """Commands that end an error of the user with a sentence on stderr and code 2, an interruption with code 130."""

    def main(self, *args: Any, standalone_mode: bool = True, **more: Any) -> NoReturn:
        run: Any = super().main
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # the terminal may have no code for a character of an id
                stream.reconfigure(errors="backslashreplace")
        try:
            with print_warnings():
                code = run(*args, standalone_mode=False, **more)
        except click.Abort:
            _exit_with_error("interrupted.", 130)  # as shells have it
        except SystemExit as error:  # of click, where nobody reads stdout any more, with the 1 of faults found
            sys.exit(2 if error.code == 1 else error.code)
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "rpil"
            message = error.format_message().rstrip(".?").replace(". Did", "; did").replace(". (Did", " (did")
            _exit_with_error(f"{message}; see {command} --help.")
        except DataError as error:
            _exit_with_error(error.in_shell)
        except (click.ClickException, MissingExtraError) as error:
            _exit_with_error(str(error))
        except OSError as error:
            if error.filename is None and error.errno not in _OF_STREAMS:
                raise
            _exit_with_error(f"{error.filename or 'stdout'}: {error.strerror}; check the path.")
        sys.exit(code)


def _exit_with_error(sentence: str, code: int = 2) -> NoReturn:
    with suppress(OSError):  # of stderr
        click.echo(f"rpil: {to_one_line(sentence)}", err=True)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # Python would flush it again at its end, and fail
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)


def open_recording(
    file: str, columns: ColumnOptions, progress: StageProgress, on_disk: bool | None = None
) -> Recording:
    """Open a file; the data stay on disk where they do not fit in memory, unless `on_disk` is False."""
    from rpil import formats

    progress(f"reading {file}")
    recording = formats.read_recording(file, columns, on_disk=on_disk)
    if columns.allow_missing:
        recording.demonstrations  # noqa: B018  # are read here
    return recording


def tell_of_set_aside(recording: Recording) -> None:
    """Name what --skip-bad left out, for commands that do not print what was read."""
    for line in recording.left_out:
        click.echo(line, err=True)


@dataclass(frozen=True, eq=False)
class AuditRun:
    """An audit, and the recording that it is of."""

    audit: Audit
    source: str
    """The path of the data."""
    recording: Recording
    demonstrators: Mapping[str, str]
    """By the ids of their demonstrations."""
    faults: FaultReport | None = None
    faulty: Set[str] = frozenset()
    spared: Set[str] = frozenset()
    """Demonstrations that are rejected for a fault, and those that are kept; see `rpil.results.choice.choose`."""
    idle: str = "keep"
    pattern: str = "{id}"
    """How to treat idle rows, and the pattern of keys; see ``--ranges``."""

    @cached_property
    def choice(self) -> Choice:
        """The kept demonstrations, and why the others are not kept."""
        from rpil.results.choice import choose

        return choose(self.audit.table(), faulty=self.faulty, spared=self.spared)

    @cached_property
    def ranges(self) -> dict[str, list[tuple[int, int]]]:
        """The rows to keep, by the keys of the pattern."""
        from rpil.segments.ranges import idle_rows, keys_of

        rule: Literal["rest", "openpi"] = "openpi" if self.idle == "openpi" else "rest"
        dropped = None if self.idle == "keep" else idle_rows(self.recording.demonstrations, rule)
        kept = self.audit.ranges(dropped, self.choice.kept)
        pattern = self.pattern.replace(f"{{{self.recording.description.id_column}}}", "{id}")
        return dict(zip(keys_of(pattern, kept, self.source, self.recording.options), kept.values(), strict=True))

    @cached_property
    def segments(self) -> Segments:
        """Where in the demonstrations something is."""
        return self.audit.segments(self.recording.demonstrations, self.recording.tasks)

    @cached_property
    def lost(self) -> tuple[str, ...]:
        """Sentences on what is lost with the rejected demonstrations."""
        from rpil.results.choice import lost_places

        return lost_places(self.recording.demonstrations, self.choice.kept)


def judge(file: str, given: RunOptions, progress: StageProgress) -> AuditRun:
    """Judge the demonstrations in `file` within their tasks and sessions, beside those of the --reference, which is
    read by the same columns; then the data are read into memory."""
    columns, reference = given.columns, given.reference
    recording, beside = open_recording(file, columns, progress, None if reference is None else False), None
    if reference is not None:
        if os.path.realpath(reference) == os.path.realpath(file):
            raise DataError(f"{reference}: the reference is the data themselves; give other demonstrations.")
        beside = open_recording(reference, replace(columns, only=(), without=()), progress, False)
    progress(LOADING)
    from rpil.estimators.pipeline import FitOptions, Settings
    from rpil.estimators.within_tasks import JUDGE_FEATURES, Statements, audit_recording

    stated, ctx = Statements.of(recording, given.labels, None, reference=beside), click.get_current_context()
    command = shlex.join(command_words(ctx, str(ctx.info_name), without=("quiet",)))
    chosen = FitOptions(JUDGE_FEATURES, given.adversary, 0, ctx.obj or Settings(), progress)
    audit = audit_recording(recording, stated, chosen, file, command, (given.labels, reference, *columns.files))
    names = zip(map(str, audit.ids), stated.demonstrators, strict=False)
    return AuditRun(audit, file, recording, {m: str(who) for m, who in names if who is not None})


def look_for_faults(
    recording: Recording, progress: StageProgress, skip_bad: bool = False, rules: Iterable[str] = ()
) -> FaultReport:
    """Findings of ``rpil check`` in the steps, without those with missing values if `skip_bad`; in files and
    videos as far as `rules` asks for it, which takes longer."""
    from rpil.faults.checking import check
    from rpil.faults.recorded import BY_LOOKING, FOLDER_RULES

    progress("looking for recording faults")
    wanted = {*rules}
    looks, reads = (any(rule.name in wanted for rule in some) for some in (BY_LOOKING, FOLDER_RULES))
    if not reads:
        recording = copy(recording)  # with the demonstrations, which are read
        vars(recording)["find_defects"] = None
    return check(recording, video=looks, skip_bad=skip_bad)


OUTPUTS = ("ranges", "segments", "weights", "verdicts", "keep", "report", "annotate")
"""The options that name these files, in the order in which they are written."""


def write_outputs(paths: Mapping[str, str | None], run: AuditRun, progress: StageProgress) -> dict[str, list[str]]:
    """Write the files of `OUTPUTS` whose paths are given; sentences by option on what they leave out, and their use."""
    said = dict[str, list[str]]()
    for title, path in ((title, paths[title]) for title in OUTPUTS):
        if path is not None:
            progress(f"writing {path}")
            said[title] = _write(title, path, run)
    return said


def _write(title: str, path: str, run: AuditRun) -> list[str]:
    from rpil.formats import write_columns, write_weights
    from rpil.formats.registry import find
    from rpil.results.choice import file_ids, write_kept, write_verdicts
    from rpil.results.html.page import write_page
    from rpil.segments.ranges import segment_columns, subtask_columns, write_ranges

    audit, n = run.audit, len(run.audit.ids)
    if title == "ranges":
        write_ranges(path, run.ranges)
        n_rows = sum(last - first for own in run.ranges.values() for first, last in own)
        return [f"{n_rows:,} of {audit.offsets[-1]:,} rows kept, of {len(run.ranges):,} demonstrations."]
    if title == "segments":
        write_columns(path, segment_columns(run.segments, file_ids(audit.ids), audit.fps), "segments")
        columns = run.segments.score, run.segments.demonstration, run.segments.start, run.segments.reason
        found = sorted(row for row in zip(*columns, strict=True) if row[-1])
        told = [f"  {printable(f'{audit.ids[m]}, from row {row}: {why}')}." for _, m, row, why in found]
        return [f"{len(found):,} to look at.", *told[:MAX_LISTED_NAMES]]
    if title == "weights":
        steps = audit.ids, audit.offsets, audit.step_weight, audit.expert_proba, audit.log_odds
        write_weights(path, *steps, run.recording.step_columns)
        if audit.step_weight.min() == audit.step_weight.max():
            why = "every step weighs the same, until you call one demonstration good and another bad"
            warnings.warn(f"{path}: {why}.", stacklevel=1)
    elif title == "verdicts":
        findings = run.faults.findings if run.faults else ()
        write_verdicts(path, audit, audit.table(run.demonstrators, run.recording.tasks, findings))
    elif title == "keep":
        write_kept(path, audit, run.choice)
        if not run.choice.kept:
            warnings.warn(f"{path}: it lists no demonstration, because all are rejected.", stacklevel=1)
        lost = run.lost if 0 < len(run.choice.kept) < len(run.recording.ids or audit.ids) else ()
        first, *more = [*run.choice.lines(), ""]
        return [f"{len(run.choice.kept):,} of {n:,} kept. {first}".rstrip(), *filter(None, more), *lost]
    elif title == "report":
        write_page(path, audit, about(run))
    else:
        table, names = audit.table(), {"verdict": "verdict", "score": "log_odds", "rejected_by": "rejected_by"}
        ids = [*map(str, audit.ids)]
        rows = {f"rpil/{name}": dict(zip(ids, table[own], strict=True)) for name, own in names.items()}
        find(run.source).annotate(path, rows | subtask_columns(run.segments, ids))
        keeps = 'episode_filter=lambda episode: not episode["rpil/rejected_by"]'
        return [f"For LeRobot: LeRobotDataset({Path(path).name!r}, root={path!r}, {keeps})"]
    return []


def about(run: AuditRun) -> About:
    """Context that the report shows beside the audit."""
    from rpil.data.demonstrations import Demonstrations
    from rpil.data.memory import FREE_SHARE, free_memory
    from rpil.data.text import for_others
    from rpil.faults.set_table import set_table
    from rpil.results.html.page import About, no_faults

    read, lerobot = run.recording.description, run.recording.description.format.startswith("LeRobot")
    source, data = for_others(run.source), run.recording.demonstrations
    fits = isinstance(data, Demonstrations) or data.nbytes < FREE_SHARE * free_memory()
    return About(
        title=f"Audit of {Path(source).name}",
        source=source,
        read=tuple(map(for_others, read.short())),
        lost=run.lost,
        faults=run.faults or no_faults(),
        table=set_table(run.recording, run.faults, Path(source).name) if run.faults else None,
        tasks=run.recording.tasks,
        demonstrators=run.demonstrators,
        segments=run.segments if fits else None,
        lerobot=lerobot,
    )


def faulty_ids(options: RunOptions, report: FaultReport) -> set[str]:
    """The demonstrations with faults that were named; a line on stderr where a named rule could not be applied."""
    for rule in filter(report.not_checked.__contains__, options.without_faults):
        click.echo(f"note: --without-faults: {rule} was not checked, because {report.not_checked[rule]}.", err=True)
    return {str(fault.id) for fault in report.findings if fault.rule in options.without_faults}


def tell_if_too_many(audit: Audit, limit: str) -> int:
    """The exit code under a `verdict_limit`: 1, with a line on stderr, if more are outliers or bad than allowed."""
    (verdict, _, most), lower = limit.partition(":"), audit.vocabulary.lower
    # Those called outliers without an answer are not bad; those called bad differ from the good ones.
    count = sum(SIDES[one] == "lower" and (verdict == "outlier" or one != "outlier") for one in audit.verdicts)
    if count <= int(most or 0):
        return 0
    who = f"{count:,} of {len(audit.ids):,} demonstrations are {PLURALS.get(lower, lower)}"
    click.echo(f"rpil: {who}, and --fail-on {limit} allows {int(most or 0):,}.", err=True)
    return 1
