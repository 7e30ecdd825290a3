"""Reading and writing `Demonstrations`, a module for each format; ``docs/formats.md`` says what each holds."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, Unpack, cast

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike

from rpil.data.arrays import ActionKind, as_array
from rpil.data.copies import RUN_KEY, run_id
from rpil.data.demonstrations import SOURCE, Demonstrations
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_extension, replacing
from rpil.data.id_values import is_id_file, match_demonstrators, read_id_pairs
from rpil.data.memory import Size, finite
from rpil.data.text import is_data
from rpil.formats import csv, parquet, table
from rpil.formats.columns import ColumnOptions, Ids, Names, check_names, check_options
from rpil.formats.format import Frame, from_arrow
from rpil.formats.recording import Recording, from_demonstrations, from_tables
from rpil.formats.registry import find, writer_of
from rpil.numerics.types import Array

EXTENSIONS = (".csv", ".parquet", ".json")
_BLOCK_STEPS = 1_048_576
_WRITERS = {".parquet": parquet.write_tables, ".csv": csv.write_tables}


class ReadOptions(TypedDict, total=False):
    """All of `ColumnOptions` but the outcome."""

    id: str | None
    action: Names
    observations: Names
    exclude: Names
    order: str | None
    action_kind: ActionKind
    only: Ids
    without: Ids
    skip_bad: bool
    memory: Size | None
    operator: str | None
    task: str | None
    session: str | None
    split_gap: float | None
    segment: float | None


def read(path: StrPath | Frame | Iterable[object], **columns: Unpack[ReadOptions]) -> Demonstrations:
    """Read demonstrations into memory: from a file or folder of a known format, a data frame, or trajectories.

    Parameters
    ----------
    path : path, frame or iterable of trajectories
        A frame of pandas, polars or pyarrow has one row for each step; see `Demonstrations.from_episodes` for
        trajectories, which have no columns to choose.
    id, order : str
        The column of the demonstration, and the one that orders its steps; by default they are found by name.
    action, observations, exclude : str or sequence of str
        Columns, or patterns such as ``joint_*``; those of `exclude` are not read.
    split_gap : float
        Seconds: a demonstration ends where the times of two rows are further apart, or go back.
    segment : float
        Seconds: each demonstration is divided into stretches of this length.
    action_kind : {"auto", "discrete", "continuous"}
        Whether columns of whole numbers hold classes; "auto" decides by how many there are.
    only, without : str, int or sequence of these
        Ids of the only demonstrations to read, and of those to leave out: ``"0-16,22"`` has a range.
    skip_bad : bool
        Leave out demonstrations with a missing or infinite value, and damaged files or groups, with a warning.
    memory : int or str, optional
        Bytes that the data may take, as a number or as text such as "4GB"; by default half of the free memory.

    Raises
    ------
    DataError
        One sentence naming the file, the demonstration and the remedy; before reading if the data need more memory.
    """
    check_options(columns)
    if not isinstance(path, str | os.PathLike | Frame):
        if columns:
            raise DataError(f"{SOURCE}: trajectories have no columns to choose; leave them out, or give a frame.")
        return Demonstrations.from_episodes(path)
    recording = read_recording(path, ColumnOptions(**columns))
    demonstrations = recording.demonstrations
    for line in recording.left_out:
        warnings.warn(f"{recording.description.source}: {line}", stacklevel=2)
    assert isinstance(demonstrations, Demonstrations)
    return demonstrations


def open(
    path: StrPath | Frame, *, on_disk: bool | None = None, outcome: Names | StrPath = (), **columns: Unpack[ReadOptions]
) -> Recording:
    """Open a recording, to describe, check, audit or keep it.

    ``recording.description`` is ``rpil info``, ``rpil.check(recording)`` is ``rpil check``, ``recording.keep(ids,
    output)`` is ``rpil keep``, and ``RPIL().fit(recording).audit_`` is ``rpil audit``.

    Parameters
    ----------
    path : path or frame
        A file or folder of any known format, or a data frame.
    on_disk : bool, optional
        Leave the demonstrations on disk, as a `Dataset` (a copy in a temporary folder), or read them into memory; by
        default data stay on disk if they take more than `memory`, which is then at most 512 MB by default.
    outcome, **columns
        As for `rpil.read`, and ``operator``, ``task``, ``session``, ``outcome``: see `ColumnOptions`.

    Returns
    -------
    Recording
        With ``description``, ``demonstrations``, ``tasks``, ``operators`` and ``facts``.

    Raises
    ------
    DataError
        One sentence naming the file and the remedy; about values only once `demonstrations` is read.

    Examples
    --------
    >>> recording = rpil.open("drive.parquet")        # doctest: +SKIP
    >>> audit = rpil.RPIL().fit(recording).audit_     # doctest: +SKIP
    """
    check_options(columns)
    outcome = os.fspath(outcome) if isinstance(outcome, os.PathLike) else outcome
    return read_recording(path, ColumnOptions(outcome=outcome, **columns), on_disk=on_disk)


def opened(data: object, options: ColumnOptions) -> Recording:
    """The recording in any data; a `DataError` where they have no columns to choose."""
    if isinstance(data, str | os.PathLike | Frame):
        return read_recording(data, options, on_disk=None)
    operator = options.operator if options.operator in options.files else None
    if options.outcomes or replace(options, operator=operator, outcome=()) != ColumnOptions(operator=operator):
        way = ", or give outcome a number for each demonstration" * bool(options.outcomes)
        raise DataError(f"{type(data).__name__} has no columns to choose: name them where it is read{way}.")
    if isinstance(data, Recording):
        return data
    demonstrations = data if isinstance(data, Demonstrations) else read(cast("Iterable[object]", data))
    return from_tables(from_demonstrations(demonstrations, "demonstrations in memory"))


def read_recording(
    path: StrPath | Frame, options: ColumnOptions = ColumnOptions(), *, on_disk: bool | None = False
) -> Recording:
    """The recording in a file, folder or frame, as `open` gives it; by default its demonstrations are in memory."""
    if isinstance(path, Frame):
        names = getattr(path, "columns", ())
        check_names([*map(str, names)] if hasattr(names, "is_unique") else [], "the frame")  # pandas may repeat one
        with guarded("the frame", "a column holds values of mixed types", "convert them"):
            # A table is none to convert: before pyarrow 25 the copy of a column of text views ended the process.
            table = path if isinstance(path, pa.Table) else pa.table(path)
        return from_tables(from_arrow([table], options, "the frame", "data frame"), options)
    return find(path).read(options, on_disk=on_disk)


def read_demonstrators(where: str, recording: Recording) -> dict[str, str]:
    """Demonstrator of each demonstration by its id as text. `where` is a CSV file (id,demonstrator), or the column of
    operators of the recording. A `DataError` names the file: a demonstration with two demonstrators, an empty name."""
    if is_id_file(where):
        return match_demonstrators(read_id_pairs(where, "demonstrator"), Path(where).name)
    return match_demonstrators(recording.operators, f"{recording.description.source}, {where!r}")


def write(path: StrPath, demonstrations: Demonstrations, truth: Mapping[str, ArrayLike] | None = None) -> None:
    """Write demonstrations to a .parquet, .csv or .npz file, whole or not at all.

    Parameters
    ----------
    truth : mapping of name to (M,) or (N,) array, optional
        Values for each demonstration or step: whether it is good, for scoring (`read` ignores it), or ``timestamp_s``.

    Raises
    ------
    DataError
        If the path cannot be written, or `read` would take a truth for data.
    """
    writer, path = writer_of(path), Path(path)
    arrays = {}
    for name, values in (truth or {}).items():
        arrays[name] = as_array(values, f"truth {name!r}", str(path))
        if arrays[name].shape not in {(len(demonstrations),), (demonstrations.n_steps,)}:
            each = f"one value for each of {len(demonstrations)} demonstrations, or {demonstrations.n_steps} steps"
            raise DataError(f"{path}: truth {name!r} needs {each}.")
        if is_data(name):
            raise DataError(f"{path}: truth {name!r} would be taken for data; give it another name.")
    assert writer.write is not None
    writer.write(path, demonstrations, arrays)


def write_columns(
    path: StrPath, columns: Mapping[str, Sequence[object]], what: str, said: Mapping[str, str] = {}
) -> None:
    """Write columns, with what is `said` of them in the metadata of Parquet; JSON holds a list of objects, and null for
    what is no finite number. A `DataError` where the path has another extension, or cannot be written."""
    path = check_extension(path, EXTENSIONS, what)
    if path.suffix.lower() == ".json":
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(finite(rows), allow_nan=False, indent=1) + "\n", encoding="utf-8")
        return
    _WRITERS[path.suffix.lower()](path, iter([pa.table(columns).replace_schema_metadata(dict(said))]))


def write_weights(
    path: StrPath,
    ids: Sequence[object],
    offsets: Array,
    step_weight: Array,
    expert_proba: Array,
    log_odds: Array,
    step_columns: Callable[[slice], pa.Table | None] = lambda _: None,
) -> None:
    """Write one row per step, in the order of the steps: episode_index, step_index, weight, expert_proba, log_odds.

    `expert_proba` and `log_odds` (M,) are repeated for each step of their demonstration. Numbers of the rows that the
    file itself gives, such as ``index``, come with `Recording.step_columns`. A million steps are in memory at a time:
    `step_weight` (N,) may be in a file, and larger than memory. Metadata of Parquet hold the `rpil.data.copies.run_id`.

    Raises
    ------
    DataError
        Where the path ends in neither .parquet nor .csv, or cannot be written.
    """
    writer = _WRITERS[check_extension(path, _WRITERS, "weights").suffix.lower()]
    metadata = {RUN_KEY: run_id(ids, offsets, log_odds)}
    repeated = {"expert_proba": expert_proba, "log_odds": log_odds}

    def tables() -> Iterator[pa.Table]:
        cuts = np.unique(np.append(np.searchsorted(offsets, np.arange(0, offsets[-1], _BLOCK_STEPS)), len(ids)))
        for block in map(slice, cuts[:-1].tolist(), cuts[1:].tolist()):
            steps = slice(int(offsets[block.start]), int(offsets[block.stop]))
            lengths, own = np.diff(offsets[block.start : block.stop + 1]), step_columns(steps)
            columns = table.step_columns(ids[block], np.append(0, np.cumsum(lengths)))
            columns |= zip(own.column_names, own.columns, strict=True) if own else {}  # with the file's own step column
            columns |= {"weight": np.asarray(step_weight[steps])}
            columns |= {name: np.repeat(values[block], lengths) for name, values in repeated.items()}
            yield pa.table(columns, metadata=metadata)

    writer(Path(path), tables())
