"""Reading and writing `Demonstrations`: Parquet, CSV and NPZ files; ``docs/formats.md`` says what each holds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import TypedDict, Unpack

from numpy.typing import ArrayLike

from rpil.data.arrays import ActionKind, as_array
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_exists, check_extension, check_readable
from rpil.data.formats import csv, npz, parquet
from rpil.data.formats.columns import ColumnOptions, Names
from rpil.data.formats.dataset import open_dataset
from rpil.data.formats.description import Description
from rpil.data.formats.dialect import TEXT_SUFFIXES
from rpil.data.formats.id_values import Label, is_id_file, match_demonstrators, match_labels, read_id_pairs, read_labels
from rpil.data.formats.names import is_data
from rpil.data.formats.recording import Recording, from_dataset
from rpil.data.formats.store import find_files, may_be_many_files
from rpil.data.formats.weights import write_weights
from rpil.data.memory import Size, limited

__all__ = ["ColumnOptions", "Description", "Label", "Recording", "match_labels", "read_labels", "write_weights"]

FORMATS: dict[str, ModuleType] = {".parquet": parquet, ".csv": csv, ".npz": npz}
"""Extension -> module with `read(path, options)`, for a `Recording`, and `write(path, demonstrations, truth)`."""


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


def read(path: StrPath, *, memory: Size | None = None, **columns: Unpack[ReadOptions]) -> Demonstrations:
    """Read demonstrations into memory: from a .parquet, .csv or .npz file, or a folder of .parquet or .csv files.

    Parameters
    ----------
    id, order : str
        The column of the demonstration, and the one that orders its steps; by default they are found by name.
    action, observations, exclude : str or sequence of str
        Columns, or patterns such as ``joint_*``; those of `exclude` are not read.
    action_kind : {"auto", "discrete", "continuous"}
        Whether one column of whole numbers holds classes; "auto" decides by how many there are.
    memory : int or str, optional
        Bytes that the data may take, as a number or as text such as "4GB"; by default half of the free memory.

    Raises
    ------
    DataError
        One sentence naming the file, the demonstration where there is one, and the remedy; before anything is read
        where the data would take more memory.
    """
    with limited(memory):
        demonstrations = read_recording(path, ColumnOptions(**columns)).demonstrations
    assert isinstance(demonstrations, Demonstrations)
    return demonstrations


def read_recording(path: StrPath, options: ColumnOptions = ColumnOptions(), *, on_disk: bool = False) -> Recording:
    """The recording in a file or folder: a description, and the demonstrations when they are asked for.

    `on_disk` leaves the demonstrations, in Parquet files, where they are, see `open_dataset`. Errors are those of
    `read`; a value that is missing, or of the wrong kind, is an error only of ``read_recording(...).demonstrations``.
    """
    if on_disk:
        return from_dataset(open_dataset(path, options=options))
    if may_be_many_files(path):
        return _read_many(path, options)
    path = check_exists(path)
    is_text = path.name.lower().endswith(TEXT_SUFFIXES)
    module = (
        csv if is_text else FORMATS[check_extension(path, {**FORMATS, **dict.fromkeys(TEXT_SUFFIXES)}).suffix.lower()]
    )
    recording: Recording = module.read(check_readable(path), options)
    return recording


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


def _read_many(path: StrPath, options: ColumnOptions) -> Recording:
    """The recording in the Parquet files of a folder, or else in its text tables."""
    filesystem, parquet_files, text_files = find_files(path)
    source = Path(str(path)).name or str(path)
    if not parquet_files and not text_files:
        raise DataError(f"{path}: no .parquet or .csv file is there; check the path.")
    if not parquet_files:
        return csv.read_folder([Path(file) for file in text_files], options, source)
    recording = parquet.read_files(filesystem, parquet_files, options, source)
    return recording.with_ignored_files(text_files)


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
