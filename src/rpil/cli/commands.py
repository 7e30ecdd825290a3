"""Shared parts of the commands: error messages, reading the data, and a fit with the options of the command line."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from rpil.cli import INTERRUPTED, tell_of_interruption
from rpil.cli.given import Given
from rpil.cli.options import FitOptions
from rpil.cli.progress import ProgressTiming, StageProgress
from rpil.cli.terminal import print_warnings, to_one_line
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import StrPath

if TYPE_CHECKING:
    from rpil.audit.record import Audit
    from rpil.data.demonstrations import Demonstrations
    from rpil.estimators.rpil import RPIL
    from rpil.estimators.settings import Settings
    from rpil.formats.columns import ColumnOptions
    from rpil.formats.dataset import Dataset
    from rpil.formats.recording import Recording
    from rpil.scale.protocol import Engine


KEPT = "rpil.kept"
"""Key of what an interruption leaves, in the `meta` of a click context."""


@dataclass(frozen=True)
class CommandSettings:
    """Settings that are not options of the command line, as ``obj`` of the context."""

    timing: ProgressTiming = ProgressTiming()
    fit: Settings | None = None  # of `RPIL`

    @classmethod
    def current(cls) -> CommandSettings:
        return click.get_current_context().ensure_object(cls)


class Commands(click.Group):
    """Commands that end an error of the user with a sentence on stderr and code 2, an interruption with code 130."""

    def invoke(self, ctx: click.Context) -> object:
        ctx.ensure_object(CommandSettings)
        try:
            with print_warnings():
                return super().invoke(ctx)
        except KeyboardInterrupt:
            tell_of_interruption("; ".join(ctx.meta.get(KEPT, ())))
            raise click.Abort from None

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, False, **extra)
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # the terminal may have no code for a character of an id
                stream.reconfigure(errors="backslashreplace")
        try:
            code = super().main(args, prog_name, complete_var, False, **extra)
        except click.Abort as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # while options were read
                tell_of_interruption()
            sys.exit(INTERRUPTED)
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "rpil"
            message = error.format_message().rstrip(".?").replace(". Did", "; did").replace(". (Did", " (did")
            _exit_with_error(f"{message}; see {command} --help.")
        except (click.ClickException, DataError, MissingExtraError) as error:
            _exit_with_error(str(error))
        except OSError as error:
            if error.filename is None:
                raise
            _exit_with_error(f"{error.filename}: {error.strerror}; check the path.")
        sys.exit(code)


def tell_if_interrupted(kept: str) -> None:
    """Name what an interruption of the command leaves."""
    click.get_current_context().meta.setdefault(KEPT, {})[kept] = None


def _exit_with_error(sentence: str) -> NoReturn:
    click.echo(f"rpil: {to_one_line(sentence)}", err=True)
    sys.exit(2)


def check_outputs(inputs: Iterable[StrPath | None], *outputs: StrPath | None) -> None:
    """A `DataError`, before any work, where an output cannot be written, or is or joins an input."""
    from rpil.data import files
    from rpil.formats.registry import suffixes

    files.check_outputs(inputs, outputs, suffixes())


def read_recording(
    file: str, columns: ColumnOptions, progress: StageProgress, stream: bool | None = False
) -> Recording:
    """What a file holds; on disk if `stream`, or if `stream` is None and it is large, or many Parquet files."""
    from rpil import formats

    progress(f"reading {file}")
    return formats.read_recording(file, columns, on_disk=stream)


def read_reference(
    reference: str | None, file: str, columns: ColumnOptions, progress: StageProgress
) -> Recording | None:
    """The recording of good demonstrations at `reference`, if one is given beside `file`, with its options."""
    if reference is None:
        return None
    if os.path.realpath(reference) == os.path.realpath(file):
        raise DataError(f"{reference}: the reference is the data themselves; give other demonstrations.")
    return read_recording(reference, columns, progress)


def resolve_stream(stream: bool | None, scheduler: str | None, reference: str | None = None) -> bool | None:
    """`stream` for `read_recording`: with a cluster the data stay on disk, because its workers read them; with a
    reference they are read into memory."""
    if reference is not None and (stream or scheduler):
        option = "--scheduler" if scheduler else "--stream"
        raise click.UsageError(f"--reference needs all data in memory: leave out {option}")
    if reference is not None:
        return False
    if scheduler and stream is False:
        raise click.UsageError("--scheduler and --no-stream exclude each other: leave one out")
    return True if scheduler else stream


def load_into_memory(demonstrations: Demonstrations | Dataset) -> Demonstrations:
    """All demonstrations in memory."""
    from rpil.formats.dataset import Dataset

    return demonstrations.select(slice(None)) if isinstance(demonstrations, Dataset) else demonstrations


@contextmanager
def connect_engine(address: str | None, progress: StageProgress) -> Iterator[Engine | None]:
    """The engine of the Dask scheduler at an address, or None without an address."""
    if address is None:
        yield None
        return
    progress(f"connecting to {address}")
    from rpil.scale.dask import DaskEngine, connect

    with connect(address) as client:
        yield DaskEngine(client)


def fit_rpil(
    file: str,
    recording: Recording,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None = None,
) -> tuple[RPIL, Mapping[str, str]]:
    """`RPIL`, fitted to the demonstrations in `file` with the options of the command line, and the demonstrators by the
    ids of their demonstrations as text."""
    n_tasks = len({*recording.tasks.values()})
    if n_tasks > 1:
        message = f"{file}: its {n_tasks} tasks are judged and learned as one; rpil audit judges each by itself."
        warnings.warn(message, stacklevel=1)
    given = Given.read(recording, options)
    model = _fit(file, recording.demonstrations, given, options, progress, engine)
    return model, given.demonstrators


def audit_by_task(
    file: str,
    recording: Recording,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None = None,
    reference: Recording | None = None,
) -> tuple[Audit, Mapping[str, str]]:
    """The audit of the demonstrations in `file`, each judged within its task and session, beside those of a
    `reference`; and the demonstrators as `fit_rpil`."""
    from rpil.audit.tasks import join_audits, split_by_task

    demonstrations, given = recording.demonstrations, Given.read(recording, options, reference)
    if options.session:
        from rpil.data.facts import check_sessions

        check_sessions(given.facts.sessions, options.session, recording.description.source)
    places = split_by_task(demonstrations.ids, recording.tasks, given.facts.sessions)
    fit_options = options, progress, engine
    if len(places) == 1:
        audit = _audit(file, demonstrations, given, *fit_options)
        return _with_facts(audit, given), given.demonstrators
    what = "sessions" if options.session else "tasks"
    what = f"tasks and {what}" if options.session and len({*recording.tasks.values()}) > 1 else what
    audits: dict[str, Audit] = {}
    n_pairs = 0
    for group, rows in places.items():
        _warn_of_few(file, group, len(rows), recording, options)
        own = given.select(rows, {str(demonstrations.ids[m]) for m in rows})
        n_pairs += len(own.pairs)
        if len(rows) > 1 or reference is not None:
            audits[group] = _audit(file, demonstrations.select(rows), own, options, progress, None)
    _warn_of_pairs(options, len(given.pairs) - n_pairs, what)
    joined = join_audits(audits, places, demonstrations.ids, demonstrations.offsets, what)
    return _with_facts(joined, given), given.demonstrators


def _with_facts(audit: Audit, given: Given) -> Audit:
    """The audit with the sessions and the order of its demonstrations."""
    return replace(audit, sessions=given.facts.sessions, order=given.facts.order)


def _warn_of_pairs(options: FitOptions, n: int, what: str) -> None:
    """Warn where `n` pairs compare demonstrations that are not judged together."""
    if n:
        pairs = f"{n} pairs compare" if n > 1 else "1 pair compares"
        text = f"{options.labels}: {pairs} demonstrations of different {what}, and {'are' if n > 1 else 'is'} left out."
        warnings.warn(text, stacklevel=1)


def _warn_of_few(file: str, group: str, n: int, recording: Recording, options: FitOptions) -> None:
    """Warn where a task or session has too few demonstrations."""
    from rpil.audit.tasks import MIN_DEMONSTRATIONS

    if n < MIN_DEMONSTRATIONS:
        what = "session" if options.session else "task"
        remedy = "leave out --session" if options.session else f"add --exclude {recording.description.task_column}"
        warnings.warn(
            f"{file}: the {what} {group!r} has {n} demonstrations, too few to judge them well; to judge all {what}s as "
            f"one, {remedy}.",
            stacklevel=1,
        )


def _audit(
    file: str,
    demonstrations: Demonstrations | Dataset,
    given: Given,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None,
) -> Audit:
    """The audit of the demonstrations, which are judged together with those of the reference if there is one."""
    if given.reference is None:
        return _fit(file, demonstrations, given, options, progress, engine).audit_
    from rpil.audit.subset import select
    from rpil.data.reference import with_reference

    n, own = len(demonstrations), load_into_memory(demonstrations)
    both = with_reference(own, given.reference)
    given = given.with_good([str(name) for name in both.ids[n:]])
    return select(_fit(file, both, given, options, progress, engine).audit_, range(n), own.ids)


def _fit(
    file: str,
    demonstrations: Demonstrations | Dataset,
    given: Given,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None,
) -> RPIL:
    progress("starting")
    from rpil.data.facts import tells
    from rpil.estimators.rpil import RPIL

    checkpoint = _checkpoint_path(file, options.resume)
    model = RPIL(
        features=options.features,
        adversary=options.adversary,
        labels=given.answers or None,
        random_state=options.seed,
        progress=progress,
        checkpoint=checkpoint,
        engine=engine,
        settings=CommandSettings.current().fit,
    )
    outcome = given.facts.outcome if tells(given.facts.outcome) else None  # of a session it may be the same for all
    try:
        return model.fit(
            demonstrations,
            demonstrators=given.demonstrators or None,
            outcome=outcome,
            order=given.facts.order,
        )
    except KeyboardInterrupt:
        if checkpoint.exists():
            tell_if_interrupted(f"the work so far is in {checkpoint}; run the command again with --resume")
        raise


def _checkpoint_path(file: str, resume: bool) -> Path:
    """The checkpoint of a fit to the data in `file`: in the current folder, because that of the data may be read-only.

    A `DataError` if there is a checkpoint without --resume, or none with it.
    """
    path = Path(f"{Path(file).name}.rpil-checkpoint")
    if path.exists() and not resume:
        raise DataError(f"{path}: an earlier run was interrupted; delete this file, or add --resume to go on.")
    if resume and not path.exists():
        raise DataError(f"{path}: there is no such checkpoint to go on from; leave out --resume.")
    return path
