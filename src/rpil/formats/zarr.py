"""Zarr replay buffers, as diffusion policy and UMI write them: ``data/*`` end to end, and ``meta/episode_ends``."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpil.data.arrays import LONGEST_TEXT, Id
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import beside, check_extension, new_folder, replacing
from rpil.data.guard import guarded
from rpil.data.json_files import LARGEST_METADATA
from rpil.data.memory import BYTES_PER_NUMBER, MIB, check_memory
from rpil.data.missing import are_chunks_filled, fill_chunks
from rpil.data.names import is_outcome
from rpil.formats import umi, zarr_files
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, keep_by_own_ids, kept_of
from rpil.formats.step_arrays import NUMBERED, Part, StoredArray, from_parts, without_steps
from rpil.formats.step_tables import StepTables
from rpil.formats.zarr_array import ZarrArray
from rpil.formats.zarr_files import Files
from rpil.formats.zarr_header import HEADERS, parse_header
from rpil.numerics.types import Array

_ENDS = "meta/episode_ends"
_ATTRIBUTES = ".zattrs"
_COPIED_BYTES = 64 * MIB  # at a time


@dataclass(frozen=True)
class _Numbers:
    """The number of the demonstration of each step, made when it is asked for."""

    ends: Array
    dtype: np.dtype[np.int64] = np.dtype(np.int64)

    @property
    def shape(self) -> tuple[int]:
        return (int(self.ends[-1]),)

    def __getitem__(self, rows: slice) -> Array:
        return np.searchsorted(self.ends, np.arange(*rows.indices(self.shape[0])), side="right")


def claims(path: Path) -> bool:
    """Whether there is a ``meta/episode_ends`` in the folder, or in the file, whose name says that it is a ZIP file.

    A `DataError` where the ZIP file is damaged, or has none at its top.
    """
    if not path.is_dir() and not zarr_files.is_zip(path):
        return False
    with zarr_files.opened(path) as files:
        found = _header_name(files, _ENDS) is not None
    if not found and not path.is_dir():
        raise DataError(
            f"{path.name}: there is no {_ENDS} at the top of this ZIP file, as Zarr has; pack what is in the folder of "
            "Zarr, not the folder itself, or unpack the file where it holds no Zarr."
        )
    return found


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The recording in the arrays of ``data``, whose demonstrations are numbered from 0; no image is opened.

    A `DataError` where there are none, or where they do not end where the demonstrations do.
    """
    with _opened(path) as files:
        ends = _ends(files)[1]
        arrays, closed = _data(files, ends)
        if not arrays:
            raise DataError(
                f"{path.name}: {_ENDS} tells of {len(ends):,} demonstrations and {ends[-1]:,} steps, but no array that "
                f"can be read is in data ({commas(closed) or 'nothing is there'}); copy the data as well."
            )
        whole = {name: "describes a demonstration as a whole" for name in arrays if umi.WHOLE.fullmatch(name)}
        steps: dict[str, StoredArray] = {name: array for name, array in arrays.items() if name not in whole}
        actions = umi.moves(steps, ends, path.name) if "action" not in steps and not options.action else {}
        empty = np.flatnonzero(np.diff(ends, prepend=0) == 0).tolist()
        notes = (*([umi.NOTE] if actions else []), *without_steps(empty))
        parts = [Part(int(ends[-1]), {NUMBERED: _Numbers(ends), **steps, **actions})]
        recording = from_parts(parts, NUMBERED, path.name, "Zarr replay buffer", options, notes=notes)
    unread = dict.fromkeys(closed, "images of the package imagecodecs")
    return recording.with_ignored({**whole, **unread})


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write some demonstrations, in the chunks and codecs of the file, to a new folder, or to a ZIP file for one.

    An array with a chunk for each step is copied chunk by chunk; images that are not decoded must have that.
    """
    with _opened(path) as files:
        old, ends = _ends(files)
        chosen = kept_of(range(len(ends)), ids, path)
        rows = np.concatenate([np.arange(0), *(np.arange(0 if m == 0 else ends[m - 1], ends[m]) for m in chosen)])
        new_ends = np.cumsum(np.diff(ends, prepend=0)[chosen])
        arrays, closed = _data(files, ends)
        with _new_store(path, output) as folder:
            for array in (*arrays.values(), *closed.values()):
                one_each = array.header.shards is None and array.chunks[0] == 1
                (_copy_chunks if one_each else _copy)(files, array, folder, rows)
            _write(_create(files, old, folder, len(new_ends)), 0, new_ends.astype(old.dtype))


@contextmanager
def _opened(path: Path) -> Iterator[Files]:
    """The files of a folder or ZIP file; a `DataError` instead of errors of many types."""
    with guarded(path.name, "a damaged Zarr store", "copy or write it again"), zarr_files.opened(path) as files:
        yield files


def _header_name(files: Files, name: str) -> str | None:
    """The file that describes the array or group `name`; None where there is none."""
    return next((file for header in HEADERS if files.has(file := f"{name}/{header}")), None)


def _array(files: Files, name: str, ends: Array | None = None) -> ZarrArray | None:
    """The array `name`; None where there is none."""
    file = _header_name(files, name)
    header = parse_header(files.read(file, LARGEST_METADATA), f"{files.source}: {name}") if file else None
    return None if header is None else ZarrArray(files, name, header, ends)


def _ends(files: Files) -> tuple[ZarrArray, Array]:
    """The array of where each demonstration ends, and its values (M,), rising."""
    source, array = files.source, _array(files, _ENDS)
    wrong = DataError(f"{source}: {_ENDS} must hold rising numbers of steps, one for each demonstration; repair it.")
    if array is None or array.header.is_closed or len(array.shape) != 1 or array.dtype.kind not in "iu":
        raise wrong
    check_memory(BYTES_PER_NUMBER * max(math.prod(array.shape), math.prod(array.chunks)), source)
    with fill_chunks(False):
        ends = array[:]
    if not len(ends) or np.any(np.diff(ends, prepend=0) < 0):
        raise wrong
    check_memory(BYTES_PER_NUMBER * float(ends[-1]), source)
    return array, ends.astype(np.int64)


def _data(files: Files, ends: Array) -> tuple[dict[str, ZarrArray], dict[str, ZarrArray]]:
    """The arrays in ``data`` by name, and those of images, which are not decoded.

    A `DataError` where one has another number of rows than there are steps.
    """
    found = {name: _array(files, f"data/{name}", ends) for name in files.folders("data")}
    arrays = {name: array for name, array in found.items() if array is not None}
    for array in arrays.values():
        if array.shape[:1] != (ends[-1],):
            raise DataError(
                f"{array.header.where} has the shape {array.shape}, but {_ENDS} ends at {ends[-1]:,} steps; write it "
                "again."
            )
    closed = {name: array for name, array in arrays.items() if array.header.is_closed}
    return {name: array for name, array in arrays.items() if name not in closed}, closed


@contextmanager
def _new_store(path: Path, output: Path) -> Iterator[Path]:
    """A folder to fill, which becomes `output`: as it is, or a ZIP file where `path` is one."""
    if path.is_dir():
        with new_folder(output) as folder:
            yield folder
        return
    with replacing(check_extension(output, [zarr_files.ZIP])) as temporary, beside(output) as folder:
        folder.mkdir()
        yield folder
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:  # chunks are compressed already
            for file in sorted(file for file in folder.rglob("*") if file.is_file()):
                archive.write(file, file.relative_to(folder))


def _create(files: Files, old: ZarrArray, folder: Path, n_rows: int) -> Path:
    """The folder of a new array that is stored as an `old` one is, and the groups that hold it."""
    about = {**old.header.about, "shape": [n_rows, *old.shape[1:]]}
    is_2 = about["zarr_format"] == 2
    new = folder / old.name
    new.mkdir(parents=True)
    for group in (new.parent, folder):
        content = {"zarr_format": 2} if is_2 else {"zarr_format": 3, "node_type": "group", "attributes": {}}
        (group / (".zgroup" if is_2 else "zarr.json")).write_text(json.dumps(content))
    (new / HEADERS[not is_2]).write_text(json.dumps(about))
    if files.has(attributes := f"{old.name}/{_ATTRIBUTES}"):
        (new / _ATTRIBUTES).write_bytes(files.read(attributes, LARGEST_METADATA))
    return new


def _write(new: Path, first: int, values: Array) -> None:
    """Write the rows from `first` on to an array that `_create` made, also chunks that hold the fill value only."""
    try:
        import zarr
    except ImportError as error:
        raise MissingExtraError("To write Zarr", "zarr") from error
    with zarr.config.set({"array.write_empty_chunks": True}):
        array = zarr.open_array(str(new), mode="r+")
        array[first : first + len(values)] = values


def _copy(files: Files, old: ZarrArray, folder: Path, rows: Array) -> None:
    """Write the `rows` of an array to a new one, some at a time.

    Missing chunks of rewards and ends are filled, because zarr leaves chunks of zeros out; all others are refused.
    """
    if old.header.is_closed:
        raise DataError(
            f"{old.header.where} holds images of the package imagecodecs, several steps in a chunk, which cannot be "
            "parted here; write it again with a chunk for each step, or take the array out."
        )
    new = _create(files, old, folder, len(rows))
    n_bytes = 4 * LONGEST_TEXT if old.header.coding.is_text else old.dtype.itemsize
    row_bytes = max(n_bytes * math.prod(old.shape[1:]), 1)
    step = max(_COPIED_BYTES // (row_bytes * old.chunks[0]), 1) * old.chunks[0]
    with fill_chunks(are_chunks_filled() or is_outcome(old.name.rpartition("/")[2])):
        for first in range(0, len(rows), step):
            _write(new, first, old.take(rows[first : first + step]))


def _copy_chunks(files: Files, old: ZarrArray, folder: Path, rows: Array) -> None:
    """Copy the chunks of an array with one for each step, as they are: ``17.0.0`` holds step 17."""
    new = _create(files, old, folder, len(rows))
    for row, old_row in enumerate(rows.tolist()):
        for place, file in old.chunk_files.get(old_row, {}).items():  # a chunk that is left out stays so
            target = new / old.header.file_name((row, *place[1:]))
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(old.stored(file))


FORMAT = Format(name="Zarr", claims=claims, read=read, keep=keep_by_own_ids(keep), suffixes=(zarr_files.ZIP,))
