"""Reading and writing `Demonstrations`: Parquet, CSV and NPZ files; ``docs/formats.md`` says what each holds."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TypedDict, Unpack

from numpy.typing import ArrayLike

from rpil.data.arrays import ActionKind, Id, as_array
from rpil.data.demonstrations import SOURCE, Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_exists, check_extension, check_readable, check_writable
from rpil.data.guard import guard, guarded
from rpil.data.id_values import (
    Label,
    check_labels_file,
    is_id_file,
    match_demonstrators,
    match_labels,
    read_answers,
    read_id_pairs,
    read_labels,
)
from rpil.data.memory import Size, limited
from rpil.data.missing import fill_chunks
from rpil.data.names import is_data
from rpil.formats import csv, folder, hdf5, lerobot_folder, npz, parquet, robomimic, zarr
from rpil.formats.arrow import Frame, read_frame
from rpil.formats.columns import ColumnOptions, Names
from rpil.formats.dataset import open_dataset
from rpil.formats.description import Description
from rpil.formats.dialect import TEXT_SUFFIXES
from rpil.formats.embeddings import with_embeddings
from rpil.formats.on_disk import from_dataset
from rpil.formats.recording import Recording
from rpil.formats.registry import find_layout
from rpil.formats.selection import keep_file, keep_folder
from rpil.formats.store import may_be_many_files
from rpil.formats.weights import write_weights

__all__ = [
    "ColumnOptions",
    "Description",
    "Label",
    "Recording",
    "check_labels_file",
    "match_labels",
    "read_answers",
    "read_labels",
    "write_weights",
]

FORMATS: dict[str, ModuleType] = {".parquet": parquet, ".csv": csv, ".npz": npz}
"""Extension -> module with `read(path, options)`, for a `Recording`, and `write(path, demonstrations, truth)`."""

_OF_TABLES = {*FORMATS, ".tsv", ".txt", ".gz", ".json"}
_OF_ARCHIVES = {*hdf5.SUFFIXES, ".zip"}


def check_format(path: StrPath) -> Path:
    """`path`, or a `DataError` naming the known extensions where it has none of them."""
    return check_extension(path, FORMATS)


class ReadOptions(TypedDict, total=False):
    """Those of `ColumnOptions` that matter to `read`."""

    id: str | None
    action: Names
    observations: Names
    exclude: Names
    order: str | None
    action_kind: ActionKind
    embeddings: str | None


def read(
    path: StrPath | Frame | Iterable[object],
    *,
    memory: Size | None = None,
    fill_missing: bool = False,
    **columns: Unpack[ReadOptions],
) -> Demonstrations:
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
    action_kind : {"auto", "discrete", "continuous"}
        Whether one column of whole numbers holds classes; "auto" decides by how many there are.
    embeddings : path
        A Parquet or NPZ file with more observations of each step, joined on the column ``index``.
    memory : int or str, optional
        Bytes that the data may take, as a number or as text such as "4GB"; by default half of the free memory.
    fill_missing : bool
        Whether chunks of Zarr and HDF5 that are not there are read as the value that the file names; else they are
        an error.

    Raises
    ------
    DataError
        One sentence naming the file, the demonstration where there is one, and the remedy; before anything is read
        where the data would take more memory.
    """
    with limited(memory), fill_chunks(fill_missing):
        options = ColumnOptions(**columns)
        if not isinstance(path, str | os.PathLike | Frame):
            return _of_trajectories(path, options)
        recording = read_frame(path, options) if isinstance(path, Frame) else read_recording(path, options)
        demonstrations = recording.demonstrations
    assert isinstance(demonstrations, Demonstrations)
    return demonstrations


def _of_trajectories(trajectories: Iterable[object], options: ColumnOptions) -> Demonstrations:
    if options != ColumnOptions():
        raise DataError(f"{SOURCE}: trajectories have no columns to choose; leave the options out, or give a frame.")
    return Demonstrations.from_episodes(trajectories)


@guard
def read_recording(path: StrPath, options: ColumnOptions = ColumnOptions(), *, on_disk: bool = False) -> Recording:
    """The recording in a file or folder: a description, and the demonstrations when they are asked for.

    `on_disk` leaves the demonstrations, in Parquet files, where they are, see `open_dataset`. Errors are those of
    `read`; a value that is missing, or of the wrong kind, is an error only of ``read_recording(...).demonstrations``.
    """
    recording = _recording(path, options, on_disk)
    return with_embeddings(recording, options.embeddings) if options.embeddings else recording


def _recording(path: StrPath, options: ColumnOptions, on_disk: bool) -> Recording:
    if on_disk:
        return from_dataset(open_dataset(path, options=options))
    layout = find_layout(path)
    if layout is not None:
        return layout.read(Path(path), options)
    if may_be_many_files(path):
        return folder.read(path, options)
    path = _known(check_exists(path))
    module = csv if path.name.lower().endswith(TEXT_SUFFIXES) else FORMATS[path.suffix.lower()]
    recording: Recording = module.read(check_readable(path), options)
    return recording


def _known(path: Path) -> Path:
    """`path`, or a `DataError` where no table can have its extension, or a ZIP file of a layout cannot be opened."""
    if path.suffix.lower() == ".zip":
        with guarded(path.name, "it is no ZIP file, or a damaged one", "copy or write it again"), zipfile.ZipFile(path):
            pass
    is_text = path.name.lower().endswith(TEXT_SUFFIXES)
    return path if is_text else check_extension(path, {**FORMATS, **dict.fromkeys(TEXT_SUFFIXES)})


def read_demonstrators(where: str, data: StrPath | Recording) -> dict[str, str]:
    """Demonstrator of each demonstration in the file `data`, by its id as text.

    `where` names a CSV file with the columns ``id`` and ``demonstrator``, a JSON object of id to demonstrator; or else
    a column, or NPZ array, of the data, which a `Recording` was read with. A `DataError` names the file: nothing of
    that name, a demonstration with two demonstrators, an empty name.
    """
    if is_id_file(where):
        return match_demonstrators(read_id_pairs(where, "demonstrator", "Ann"), Path(where).name)
    recording = data if isinstance(data, Recording) else read_recording(data, ColumnOptions(operator=where))
    return match_demonstrators(recording.operators, f"{recording.description.source}, {where!r}")


@guard
def keep(
    path: StrPath,
    output: StrPath,
    ids: Sequence[Id],
    options: ColumnOptions = ColumnOptions(),
    trims: Mapping[Id, tuple[int, int]] | None = None,
) -> None:
    """Write some demonstrations of a file or folder, with all that it says of them, to a new one of the same format.

    Parameters
    ----------
    ids : sequence
        Of the demonstrations to keep, as `read` gives them; they come in the order of the file.
    output : path
        A file is replaced whole; a folder must not be there yet. What is at `path` is never changed.
    options : ColumnOptions
        Those with which `path` was read.
    trims : mapping of id to pair of int, optional
        The first step to keep, and the first after those to keep, of some demonstrations; of LeRobot's folders only.

    Raises
    ------
    DataError
        Where an id is unknown, the output cannot be written or is in `path`, or the format cannot be given back.
    """
    path, output = check_keep(path, output, trim=bool(trims))
    if not ids:
        raise DataError(f"{path}: no demonstration is to be kept; choose others.")
    layout = find_layout(path)
    if layout is not None and options.id:
        raise DataError(f"{path}: it is given back by its own ids; leave id out, or write a table with rpil convert.")
    if layout is lerobot_folder:
        lerobot_folder.keep(path, output, ids, {str(name): (int(a), int(b)) for name, (a, b) in (trims or {}).items()})
    elif layout is not None:
        layout.keep(path, output, ids)
    elif path.is_dir():
        keep_folder(path, output, ids, options)
    else:
        keep_file(_known(path), output, ids, options)


@guard
def check_mask(path: StrPath) -> Path:
    """`path`, or a `DataError` where its format has no place for a list of demonstrations."""
    path = check_exists(path)
    if not robomimic.is_mine(path):
        raise DataError(f"{path}: only HDF5 of robomimic can list demonstrations to keep; write a new file with -o.")
    return path


@guard
def write_mask(path: StrPath, ids: Sequence[Id]) -> None:
    """List some demonstrations in the file itself, under ``mask/rpil_kept``; errors are those of `keep`."""
    path = check_mask(path)
    robomimic.write_mask(path, path, ids)


def commands_to_keep(path: StrPath, ids: Sequence[object], kept: Sequence[object], output: StrPath = "") -> list[str]:
    """Lines with what to give the tool that wrote the data, so that it takes those `kept` among `ids` only.

    `output` is the file or folder to which `keep` wrote these: a JSON file stands for lists too long to be read.
    """
    return lerobot_folder.commands(Path(path), ids, kept, output) if lerobot_folder.is_mine(Path(path)) else []


def notes_on_weights(path: StrPath) -> list[str]:
    """Sentences on how the tool that wrote the data takes weights."""
    return [lerobot_folder.WEIGHTS] if lerobot_folder.is_mine(Path(path)) else []


@guard
def check_keep(path: StrPath, output: StrPath, trim: bool = False) -> tuple[Path, Path]:
    """Both paths, or a `DataError`, before any work, where `keep` cannot write to `output`, or cannot `trim`."""
    if "://" in str(path):
        raise DataError(f"{path}: only files of this computer can be given back; download it first.")
    path, output = check_exists(path), Path(output)
    if path.resolve() in (output.resolve(), *output.resolve().parents):
        raise DataError(f"{output}: it is the data themselves, or in them; give another path.")
    if output.is_dir():
        raise DataError(f"{output}: it is there already; give the path of a new folder.")
    layout, suffix = find_layout(path), output.suffix.lower()
    is_list = layout is lerobot_folder and suffix == ".json"
    if path.is_dir() and suffix in {*_OF_TABLES, *_OF_ARCHIVES} and not is_list:
        raise DataError(f"{output}: the data are a folder, so name a folder, or write a table with rpil convert.")
    if layout is lerobot_folder:
        lerobot_folder.check_output(path, output, trim)
    elif trim:
        raise DataError(f"{path}: only folders of LeRobot can be trimmed; leave --trim out.")
    if path.is_file() and (layout in (None, zarr) or suffix in _OF_TABLES) and suffix != path.suffix.lower():
        raise DataError(f"{output}: give it the extension {path.suffix}, or write another format with rpil convert.")
    return path, check_writable(output)


def write(path: StrPath, demonstrations: Demonstrations, truth: Mapping[str, ArrayLike] | None = None) -> None:
    """Write demonstrations to a .parquet, .csv or .npz file, which is whole or not there.

    Parameters
    ----------
    truth : mapping of name to (M,) array, optional
        True values for each demonstration, such as whether it is good, for scoring; `read` ignores them.

    Raises
    ------
    DataError
        Where the path cannot be written, or a truth would be taken for data.
    """
    path = check_format(path)
    arrays = {}
    for name, values in (truth or {}).items():
        arrays[name] = as_array(values, f"truth {name!r}", str(path))
        if arrays[name].shape != (len(demonstrations),):
            raise DataError(f"{path}: truth {name!r} needs one value for each of {len(demonstrations)} demonstrations.")
        if is_data(name):
            raise DataError(f"{path}: truth {name!r} would be taken for data; give it another name.")
    FORMATS[path.suffix.lower()].write(path, demonstrations, arrays)
