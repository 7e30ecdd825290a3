"""Zarr replay buffers, as diffusion policy and UMI write them: ``data/*`` end to end, and ``meta/episode_ends``."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import beside, new_folder, replacing
from rpil.data.formats import umi
from rpil.data.formats.columns import ColumnOptions
from rpil.data.formats.description import listed
from rpil.data.formats.parts import NUMBERED, Part, from_parts, without_steps
from rpil.data.formats.recording import Recording
from rpil.data.formats.table import check_ids
from rpil.data.guard import guarded
from rpil.data.memory import BYTES_PER_NUMBER, check_memory
from rpil.numerics.types import Array

_ENDS = "meta/episode_ends"
_HEADERS = (".zarray", "zarr.json")  # of an array, in the formats 2 and 3
_COPIED_ROWS = 4096  # at a time


def is_mine(path: Path) -> bool:
    """Whether there is a ``meta/episode_ends`` in the folder or ZIP file."""
    return any((_root(path) / _ENDS / header).exists() for header in _HEADERS)


def read(path: Path, options: ColumnOptions) -> Recording:
    """The recording in the arrays of ``data``, whose demonstrations are numbered from 0; no image is opened.

    A `DataError` where there are none, or where they do not end where the demonstrations do.
    """
    with _opened(path) as store:
        ends = _ends(store, path.name)
        arrays, closed = _data(path, store)
        if not arrays:
            raise DataError(
                f"{path.name}: {_ENDS} tells of {len(ends):,} demonstrations and {ends[-1]:,} steps, but no array that "
                f"can be read is in data ({listed(closed) or 'nothing is there'}); copy the data as well."
            )
        for name, array in arrays.items():
            if array.shape[:1] != (ends[-1],):
                raise DataError(
                    f"{path.name}: data/{name} has the shape {array.shape}, but {_ENDS} ends at {ends[-1]:,} steps; "
                    "write it again."
                )
        whole = {name: "describes a demonstration as a whole" for name in arrays if umi.WHOLE.fullmatch(name)}
        steps = {name: array for name, array in arrays.items() if name not in whole}
        actions = umi.moves(steps, ends, path.name) if "action" not in steps and not options.action else {}
        lengths = np.diff(ends, prepend=0)
        empty = np.flatnonzero(lengths == 0).tolist()
        notes = (*([umi.NOTE] if actions else []), *without_steps(empty))
        parts = [Part(int(ends[-1]), {NUMBERED: np.repeat(np.arange(len(ends)), lengths), **steps, **actions})]
        recording = from_parts(parts, NUMBERED, path.name, "Zarr replay buffer", options, notes=notes)
    unread = dict.fromkeys(closed, "compressed by a codec that is not installed")
    return recording.with_ignored({**whole, **unread})


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write some demonstrations, in the chunks and codecs of the file, to a new folder, or to a ZIP file for one.

    Images that cannot be decoded here are copied as they are, which needs a chunk for each step.
    """
    with _opened(path) as store:
        ends = _ends(store, path.name)
        check_ids(ids, range(len(ends)), path.name, "the ids")
        chosen = sorted(int(i) for i in ids)
        rows = np.concatenate([np.arange(0), *(np.arange(0 if m == 0 else ends[m - 1], ends[m]) for m in chosen)])
        new_ends = np.cumsum(np.diff(ends, prepend=0)[chosen])
        with _new_store(path, output) as folder:
            _copy(path, store, folder, rows)
            old = _open(store, _ENDS)
            _create(folder, _ENDS, old, new_ends.shape)[:] = new_ends.astype(old.dtype)


def _root(path: Path) -> Path | zipfile.Path:
    return zipfile.Path(path) if path.is_file() and zipfile.is_zipfile(path) else path


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The store of a folder or ZIP file; a `DataError` instead of the errors of zarr, which are of many types."""
    try:
        from zarr.storage import LocalStore, ZipStore
    except ImportError as error:
        raise MissingExtraError(f"{path.name}: to read Zarr", "zarr") from error
    with guarded(path.name, "a damaged Zarr store", "copy or write it again"):
        store = LocalStore(path, read_only=True) if path.is_dir() else ZipStore(path, mode="r")
        try:
            yield store
        finally:
            store.close()


def _open(store: object, name: str) -> Any:
    import zarr

    return zarr.open_array(store, path=name, mode="r")


def _ends(store: object, source: str) -> Array:
    """Where each demonstration ends, (M,), rising."""
    array = _open(store, _ENDS)
    check_memory(BYTES_PER_NUMBER * max(math.prod(array.shape), math.prod(array.chunks)), source)
    ends = np.asarray(array[:])
    if ends.ndim != 1 or ends.dtype.kind not in "iu" or not len(ends) or np.any(np.diff(ends, prepend=0) < 0):
        raise DataError(f"{source}: {_ENDS} must hold rising numbers of steps, one for each demonstration; repair it.")
    check_memory(BYTES_PER_NUMBER * float(ends[-1]), source)
    return ends.astype(np.int64)


def _data(path: Path, store: object) -> tuple[dict[str, Any], list[str]]:
    """The arrays in ``data`` by name, and the names of those whose codec is not installed."""
    arrays, closed = {}, []
    for name in _names(path):
        try:
            arrays[name] = _open(store, f"data/{name}")
        except Exception as error:
            if "codec" not in str(error).lower():
                raise
            closed.append(name)
    return arrays, closed


def _names(path: Path) -> list[str]:
    data = _root(path) / "data"
    folders = data.iterdir() if data.is_dir() else ()
    return sorted(f.name for f in folders if f.is_dir() and any((f / header).exists() for header in _HEADERS))


@contextmanager
def _new_store(path: Path, output: Path) -> Iterator[Path]:
    """A folder to fill, which becomes `output`: as it is, or a ZIP file where `path` is one."""
    if path.is_dir():
        with new_folder(output) as folder:
            yield folder
        return
    with replacing(output) as temporary, beside(output) as folder:
        folder.mkdir()
        yield folder
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:  # chunks are compressed already
            for file in sorted(file for file in folder.rglob("*") if file.is_file()):
                archive.write(file, file.relative_to(folder))


def _copy(path: Path, store: object, folder: Path, rows: Array) -> None:
    """Write the `rows` of all arrays in ``data`` to the folder, and groups that hold them."""
    import zarr

    zarr_format = _open(store, _ENDS).metadata.zarr_format
    for group in ("", "data", "meta"):
        zarr.create_group(folder, path=group, zarr_format=zarr_format)
    arrays, closed = _data(path, store)
    for name, old in arrays.items():
        new = _create(folder, f"data/{name}", old, (len(rows), *old.shape[1:]))
        step = old.chunks[0] * max(_COPIED_ROWS // old.chunks[0], 1)
        for first in range(0, len(rows), step):
            new[first : first + step] = old.oindex[rows[first : first + step]]
    for name in closed:
        _copy_chunks(_root(path) / "data" / name, folder / "data" / name, rows, f"{path.name}: data/{name}")


def _create(folder: Path, name: str, old: Any, shape: tuple[int, ...]) -> Any:
    """A new array that is stored as an `old` one is."""
    import zarr

    return zarr.create_array(
        str(folder),
        name=name,
        shape=shape,
        dtype=old.dtype,
        chunks=old.chunks,
        shards=old.shards,
        filters=old.filters or None,
        compressors=old.compressors or None,
        fill_value=old.fill_value,
        zarr_format=old.metadata.zarr_format,
        attributes=dict(old.attrs),
    )


def _copy_chunks(old: Path | zipfile.Path, new: Path, rows: Array, where: str) -> None:
    """Copy the chunks of an array with one for each step, as they are: ``17.0.0`` holds step 17."""
    header = old / ".zarray"
    about = json.loads(header.read_text()) if header.exists() else {}
    if about.get("chunks", [0])[0] != 1 or about.get("dimension_separator", ".") != ".":
        raise DataError(f"{where} is compressed by a codec that is not installed (imagecodecs has it); install it.")
    new.mkdir()
    (new / ".zarray").write_text(json.dumps({**about, "shape": [len(rows), *about["shape"][1:]]}))
    new_row = {str(row): k for k, row in enumerate(rows.tolist())}
    for file in old.iterdir():  # a chunk of zeros is not there
        row, _, place = file.name.partition(".")
        if row in new_row:
            (new / f"{new_row[row]}.{place}").write_bytes(file.read_bytes())
