"""Shared parts of the commands: error messages, reading the data, and a fit with the options of the command line."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from rpil.cli import INTERRUPTED, tell_of_interruption
from rpil.cli.options import FitOptions
from rpil.cli.progress import ProgressTiming, StageProgress
from rpil.cli.terminal import print_warnings, to_one_line
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.memory import budget

if TYPE_CHECKING:
    from rpil.audit.record import Audit
    from rpil.data.demonstrations import Demonstrations
    from rpil.data.formats.columns import ColumnOptions
    from rpil.data.formats.dataset import Dataset
    from rpil.data.formats.id_values import Label
    from rpil.data.formats.recording import Recording
    from rpil.estimators.rpil import RPIL
    from rpil.estimators.settings import Settings
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
    click.get_current_context().meta.setdefault(KEPT, []).append(kept)


def _exit_with_error(sentence: str) -> NoReturn:
    click.echo(f"rpil: {to_one_line(sentence)}", err=True)
    sys.exit(2)


def read_recording(
    file: str, columns: ColumnOptions, progress: StageProgress, stream: bool | None = False
) -> Recording:
    """What a file holds; on disk if `stream`, or if `stream` is None and it is large, or many Parquet files."""
    from rpil.data import formats
    from rpil.data.formats import lerobot_folder
    from rpil.data.formats.registry import find_layout
    from rpil.data.formats.store import find_files, may_be_many_files

    progress(f"reading {file}")
    if stream is None and find_layout(file) not in (None, lerobot_folder):
        stream = False  # only Parquet files can stay on disk
    elif stream is None:
        stream = bool(find_files(file)[1]) if may_be_many_files(file) else _exceeds_budget(file)
    return formats.read_recording(file, columns, on_disk=stream)


def resolve_stream(stream: bool | None, scheduler: str | None) -> bool | None:
    """`stream` for `read_recording`: with a cluster the data stay on disk, because its workers read them."""
    if scheduler and stream is False:
        raise click.UsageError("--scheduler and --no-stream exclude each other: leave one out")
    return True if scheduler else stream


def load_into_memory(demonstrations: Demonstrations | Dataset) -> Demonstrations:
    """All demonstrations in memory."""
    from rpil.data.formats.dataset import Dataset

    return demonstrations.select(slice(None)) if isinstance(demonstrations, Dataset) else demonstrations


def _exceeds_budget(file: str) -> bool:
    """Whether a Parquet file would take more memory than it may."""
    if Path(file).suffix.lower() != ".parquet" or not os.path.isfile(file) or not os.path.getsize(file):
        return False
    from pyarrow import fs

    from rpil.data.formats.parquet_pages import check_pages
    from rpil.data.formats.store import opened
    from rpil.data.formats.table import kind_of_type

    filesystem, path = fs.LocalFileSystem(), os.path.abspath(file)
    with opened(filesystem, path) as opened_file:
        columns = [field.name for field in opened_file.schema_arrow if kind_of_type(field.type) != "nested"]
        return check_pages(filesystem, path, opened_file, columns) > budget()


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
    warn_if_ambiguous: bool = True,
) -> tuple[RPIL, Mapping[str, str]]:
    """`RPIL`, fitted to the demonstrations in `file` with the options of the command line, and the demonstrators by the
    ids of their demonstrations as text."""
    n_tasks = len({*recording.tasks.values()})
    if n_tasks > 1:
        message = f"{file}: its {n_tasks} tasks are judged and learned as one; rpil audit judges each by itself."
        warnings.warn(message, stacklevel=1)
    given = _read_ids(recording, options)
    return _fit(file, recording.demonstrations, given, options, progress, engine, warn_if_ambiguous), given[1]


def audit_by_task(
    file: str,
    recording: Recording,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None = None,
    warn_if_ambiguous: bool = True,
) -> tuple[Audit, Mapping[str, str]]:
    """The audit of the demonstrations in `file`, each judged within its task, and the demonstrators as `fit_rpil`."""
    from rpil.audit.tasks import MIN_DEMONSTRATIONS, join_audits, split_by_task

    demonstrations = recording.demonstrations
    places = split_by_task(demonstrations.ids, recording.tasks)
    if len(places) == 1:
        model, demonstrators = fit_rpil(file, recording, options, progress, engine, warn_if_ambiguous)
        return model.audit_, demonstrators
    labels, demonstrators = _read_ids(recording, options)
    audits: dict[str, Audit] = {}
    for task, rows in places.items():
        if len(rows) < MIN_DEMONSTRATIONS:
            warnings.warn(
                f"{file}: the task {task!r} has {len(rows)} demonstrations, too few to judge them well; to judge all "
                f"tasks as one, add --exclude {recording.description.task_column}.",
                stacklevel=1,
            )
        if len(rows) > 1:
            part = demonstrations.select(rows)
            ids = {*map(str, part.ids)}
            own_labels = {m: label for m, label in labels.items() if m in ids}
            who = {m: name for m, name in demonstrators.items() if m in ids}
            audits[task] = _fit(file, part, (own_labels, who), options, progress, None, warn_if_ambiguous).audit_
    return join_audits(audits, places, demonstrations.ids, demonstrations.offsets), demonstrators


def _read_ids(recording: Recording, options: FitOptions) -> tuple[dict[str, Label], dict[str, str]]:
    """The labels and the demonstrators, by the ids of the demonstrations as text."""
    if options.adversary != "auto" and options.minority != "ask":
        raise click.UsageError("--minority has no effect with a named --adversary: leave one out")
    from rpil.data import formats
    from rpil.data.formats.table import check_ids

    demonstrations = recording.demonstrations
    labels = formats.read_labels(options.labels) if options.labels else {}
    # The estimator checks these ids too, but cannot name the file.
    check_ids(labels, demonstrations.ids, str(options.labels), "the labels")
    demonstrators = formats.read_demonstrators(options.operator, recording) if options.operator else {}
    check_ids(demonstrators, demonstrations.ids, str(options.operator), "the demonstrators")
    return labels, demonstrators


def _fit(
    file: str,
    demonstrations: Demonstrations | Dataset,
    given: tuple[Mapping[str, Label], Mapping[str, str]],  # labels and demonstrators
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None,
    warn_if_ambiguous: bool,
) -> RPIL:
    progress("starting")
    from rpil.data.errors import AmbiguousWarning
    from rpil.estimators.rpil import RPIL

    checkpoint = _checkpoint_path(file, options.resume)
    model = RPIL(
        features=options.features,
        adversary=options.adversary,
        minority=options.minority,
        labels=given[0] or None,
        random_state=options.seed,
        progress=progress,
        checkpoint=checkpoint,
        engine=engine,
        settings=CommandSettings.current().fit,
    )
    if not warn_if_ambiguous:
        warnings.simplefilter("ignore", AmbiguousWarning)
    try:
        return model.fit(demonstrations, demonstrators=given[1] or None)
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
