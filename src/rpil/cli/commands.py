"""What commands share: how errors are said, reading the data, and a fit with the options of the command line."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from rpil.cli.terminal import Stages, notes, one_line
from rpil.data.errors import DataError, MissingExtraError

if TYPE_CHECKING:
    from rpil.data.demonstrations import Demonstrations
    from rpil.data.formats.dataset import Dataset
    from rpil.estimators.rpil import RPIL
    from rpil.inference.settings import Minority
    from rpil.scale.protocol import Engine


_SHARE = 0.25
"""Of the memory that is free: what a file may take there before it is read block by block instead."""


class Commands(click.Group):
    """Ends whatever a user can cause with one sentence on stderr and exit code 2, and an interruption with 130."""

    def invoke(self, ctx: click.Context) -> Any:
        with notes():
            return super().invoke(ctx)

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
            if isinstance(stream, io.TextIOWrapper):  # an id that the terminal cannot show is no reason to crash
                stream.reconfigure(errors="backslashreplace")
        try:
            code = super().main(args, prog_name, complete_var, False, **extra)
        except click.Abort:
            sys.exit(130)
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "rpil"
            said = error.format_message().rstrip(".?").replace(". Did", "; did").replace(". (Did", " (did")
            _fail(f"{said}; see {command} --help.")
        except click.ClickException as error:
            _fail(error.format_message())
        except (DataError, MissingExtraError) as error:
            _fail(str(error))
        except OSError as error:
            if error.filename is None:
                raise
            _fail(f"{error.filename}: {error.strerror}; check the path.")
        sys.exit(code)


def _fail(sentence: str) -> NoReturn:
    click.echo(f"rpil: {one_line(sentence)}", err=True)
    sys.exit(2)


class Words(click.Choice[str]):
    """A choice of names that the library writes with spaces, and a shell with hyphens; both will do."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        return super().convert(value.replace(" ", "-"), param, ctx).replace("-", " ")


def read(file: str, progress: Stages, stream: bool | None = False) -> Demonstrations | Dataset:
    """The demonstrations in a file; left on disk where `stream` says so, or where, undecided, they are many."""
    from rpil.data import formats
    from rpil.data.formats.store import may_be_many_files

    progress(f"reading {file}")
    if stream or (stream is None and (may_be_many_files(file) or _is_big(file))):
        from rpil.data.formats.dataset import open_dataset

        return open_dataset(file)
    if stream is False and may_be_many_files(file):
        return in_memory(read(file, progress, True))
    return formats.read(file)


def is_streamed(stream: bool | None, scheduler: str | None) -> bool | None:
    """Whether data stay on disk, None where their size is to say so: the workers of a cluster read them themselves."""
    if scheduler and stream is False:
        raise click.UsageError("--scheduler and --no-stream exclude each other: leave one out")
    return True if scheduler else stream


def in_memory(demonstrations: Demonstrations | Dataset) -> Demonstrations:
    """All of them, whatever they take."""
    from rpil.data.formats.dataset import Dataset

    return demonstrations.select(slice(None)) if isinstance(demonstrations, Dataset) else demonstrations


def _is_big(file: str) -> bool:
    """Whether a Parquet file would take more than a share of the free memory."""
    if Path(file).suffix.lower() != ".parquet" or not os.path.isfile(file):
        return False
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        metadata = pq.read_metadata(file)
    except (pa.ArrowException, OSError):
        return False  # to read it will say what is wrong with it
    size = sum(metadata.row_group(k).total_byte_size for k in range(metadata.num_row_groups))
    return size > _SHARE * _free_memory()


def _free_memory() -> float:
    """Bytes that programs can still have; infinite where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return float("inf")
    found = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * int(found[0]) if found else float("inf")


@contextmanager
def cluster(address: str | None) -> Iterator[Engine | None]:
    """The cluster of the scheduler at `address`, if one is given."""
    if address is None:
        yield None
        return
    from rpil.scale.dask import DaskEngine, connect

    with connect(address) as client:
        yield DaskEngine(client)


def fit_rpil(
    file: str,
    demonstrations: Demonstrations | Dataset,
    progress: Stages,
    *,
    boxed: bool,
    engine: Engine | None = None,
    labels: str | None,
    demonstrators: str | None,
    features: str,
    adversary: str,
    minority: Minority,
    seed: int,
    resume: bool,
) -> RPIL:
    """RPIL with the options of the command; `boxed` where a box will say what cannot be known."""
    if adversary != "auto" and minority != "ask":
        raise click.UsageError("--minority means nothing beside a named --adversary: leave one out")
    from rpil.data import formats
    from rpil.data.formats.table import check_ids

    known = formats.read_labels(labels) if labels else {}
    # Also done by the estimator, which cannot name the file.
    formats.match_labels(known, demonstrations.ids, str(labels))
    who = formats.read_demonstrators(demonstrators, file) if demonstrators else None
    check_ids(who or (), demonstrations.ids, str(demonstrators), "the demonstrators")
    progress("starting")
    from rpil.data.errors import AmbiguousWarning
    from rpil.estimators.rpil import RPIL

    so_far = Path(f"{Path(file).name}.rpil-checkpoint")  # the data's folder may be read-only
    if so_far.exists() != resume:
        said = (
            "nothing was interrupted here; leave out" if resume else "a run was interrupted; delete it, or go on with"
        )
        raise DataError(f"{so_far}: {said} --resume.")
    model = RPIL(
        features=features,
        adversary=adversary,
        minority=minority,
        labels=known or None,
        random_state=seed,
        progress=progress,
        checkpoint=so_far,
        engine=engine,
        settings=click.get_current_context().obj,
    )
    if boxed:
        warnings.simplefilter("ignore", AmbiguousWarning)
    try:
        return model.fit(demonstrations, demonstrators=who)
    except KeyboardInterrupt:
        if so_far.exists():
            click.echo(f"rpil: what was done is kept in {so_far}; the same command with --resume goes on.", err=True)
        raise
