"""Zarr replay buffers, as diffusion policy writes them: ``data/*`` end to end, and ``meta/episode_ends``.

The library zarr reads them. A header names the codecs that it calls with the contents of the file, and some codecs run
code: of an array with one that is not on the list here no value is read. Chunks that are not there are never made up.
"""

from __future__ import annotations

import json
import math
import re
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError, optional
from rpil.data.guard import guarded
from rpil.data.held import held
from rpil.data.memory import check_free
from rpil.formats.array_layout import ROLES, Arrays
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, StepTables
from rpil.formats.step_arrays import Closed, without_steps

if TYPE_CHECKING:
    from zarr import Array
    from zarr.abc.store import Store

ZIP = ".zip"
"""The extension of stores in a ZIP file; a file of another name is never taken for one."""

(_ENDS,) = ROLES["offsets"]
_HEADER_FILE = re.compile(rf"(data(?:/(?!\.\.?/)[^/\\]+)+|{_ENDS})/(?:\.zarray|zarr\.json)")
_CODECS = {
    *("bytes", "transpose", "sharding_indexed", "zlib", "gzip", "bz2", "zstd", "blosc", "lz4", "shuffle", "delta"),
    *("fixedscaleoffset", "quantize", "crc32", "crc32c", "adler32", "fletcher32", "vlen-utf8"),
}
_IMAGES, _CLOSED = "imagecodecs_", "images of the package imagecodecs"
_DAMAGED_HEADER = "its header is damaged, or of an unknown format", "copy or write it again"
_DAMAGED_CHUNK = "a chunk of it is damaged, or does not hold what the header declares", "copy or write it again"


def claims(path: Path) -> bool:
    """Whether ``meta/episode_ends`` is in the folder, or a file has a name that says that it is a ZIP file."""
    is_zip = path.suffix.lower() == ZIP and path.is_file()
    return is_zip or any((path / _ENDS / header).is_file() for header in (".zarray", "zarr.json"))


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Store, Mapping[str, int]]]:
    """The store of the library, and the bytes of all files in it by name."""
    storage = optional("zarr.storage", "To read Zarr", "zarr")
    if path.is_dir():
        files = (file for file in path.rglob("*") if file.is_file())
        yield storage.LocalStore(path), {file.relative_to(path).as_posix(): file.stat().st_size for file in files}
        return
    fault = "no ZIP file, or a damaged one", "copy or write it again"
    with guarded(path.name, *fault), held(path, lambda: zipfile.ZipFile(path), "ZIP") as archive:
        store = storage.ZipStore(path)  # which would open the file a second time
        store._lock, store._zf, store._is_open = RLock(), archive, True
        yield store, {info.filename: info.file_size for info in archive.infolist()}


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The recording in the arrays of ``data``, whose demonstrations are numbered from 0; no image is opened.

    A `DataError` where there are none, or where they do not end where the demonstrations do.
    """
    with _opened(path) as (store, files):
        headers = {match[1]: file for file in files if (match := _HEADER_FILE.fullmatch(file))}
        ordered = sorted(headers, key=lambda name: name.split("/"))
        found = {name: _array(store, files, path.name, headers[name]) for name in ordered}
    if _ENDS not in headers:
        remedy = "pack what is in the folder of Zarr, not the folder itself, or unpack the file where it holds no Zarr"
        raise DataError(f"{path.name}: there is no {_ENDS} at the top of this ZIP file; {remedy}.")
    ignored = {name.removeprefix("data/"): why for name, why in found.items() if isinstance(why, str) and why}
    arrays = {name: array for name, array in found.items() if isinstance(array, Closed)}
    ends, offsets = arrays.pop(_ENDS, None), np.zeros(0, np.int64)
    if ends is not None and len(ends.shape) == 1 and ends.dtype.kind in "iu":
        offsets = np.asarray(ends[:]).astype(np.int64)
    if not len(offsets) or (lengths := np.diff(offsets, prepend=0)).min() < 0:
        raise DataError(f"{path.name}: {_ENDS} must hold rising numbers of steps, one a demonstration; repair it.")
    if not arrays:
        there = f"{_ENDS} tells of {len(offsets):,} demonstrations and {offsets[-1]:,} steps"
        none = f"no array that can be read is in data ({commas(ignored) or 'nothing is there'})"
        raise DataError(f"{path.name}: {there}, but {none}; copy the data as well.")
    for name, array in arrays.items():
        if array.shape[:1] != (offsets[-1],):
            fault = f"has the shape {array.shape}, but {_ENDS} ends at {offsets[-1]:,} steps"
            raise DataError(f"{path.name}: {name} {fault}; write it again.")
    steps = {name.removeprefix("data/"): array for name, array in arrays.items()}
    notes = without_steps(np.flatnonzero(lengths == 0).tolist())
    found = Arrays({**steps, _ENDS: offsets}, path.name, options).read("Zarr replay buffer", notes)
    return replace(found, ignored={**found.ignored, **ignored})


def _array(store: Store, files: Mapping[str, int], where: str, header: str) -> Closed | str:
    """An array of a store, whose rows are read when they are asked for; why it is not read; no text of a group."""
    from zarr import Group, open

    name = header.rpartition("/")[0]
    with guarded(where := f"{where}: {name}", *_DAMAGED_HEADER), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what in format 3 other libraries may not read
        check_free(100 * files[header])  # bytes that JSON may take for each of its own
        try:
            array = open(store=store, path=name, mode="r", use_consolidated=False)
        except Exception as error:  # of several types, where the codec is unknown
            if _IMAGES in str(error):
                return _CLOSED
            raise
        if isinstance(array, Group):
            return ""
        about, shape, dtype, chunks = array.metadata.to_dict(), array.shape, array.dtype, array.shards or array.chunks
        assert math.prod(array.chunks), "chunks hold something"
    codecs = json.dumps([about.get(part) for part in ("filters", "compressor", "codecs")], default=str)
    names = {name.removeprefix("numcodecs.") for name in re.findall(r'"(?:id|name)": "([^"]*)"', codecs)}
    if any(name.startswith(_IMAGES) for name in names):
        return _CLOSED
    unknown = [f"the codec {name[:60]!r}" for name in names - _CODECS]
    if unknown or dtype.kind not in "biufSUTmM":
        fault = f"is stored with {unknown[0] if unknown else dtype}, which is not read, because it may run code"
        remedy = "store numbers or text with a codec such as blosc, zstd or gzip, or take the array out"
        raise DataError(f"{where} {fault}; {remedy}.")
    own = {file.removeprefix(f"{name}/"): n_bytes for file, n_bytes in files.items() if file.startswith(f"{name}/")}
    check = cache(lambda: _check_chunks(array, chunks, own, where))

    def rows_of(rows: slice) -> object:
        first, stop, _ = rows.indices(shape[0])
        with guarded(where):
            check_free(dtype.itemsize * max(math.prod(chunks), (stop - first) * math.prod(shape[1:])))
        check()
        with guarded(where, *_DAMAGED_CHUNK):
            return np.asarray(array[first:stop])

    return Closed(shape, dtype, rows_of)


def _check_chunks(array: Array, chunks: tuple[int, ...], files: Mapping[str, int], where: str) -> None:
    """A `DataError` where chunks are missing, or a file holds more than filters make of a chunk: 8 bytes of one."""
    grid = [-(-size // step) for size, step in zip(array.shape, chunks, strict=True)]
    places = np.ndindex(*grid) if (n_chunks := math.prod(grid)) <= len(files) else ()
    found = [files[key] for at in places if (key := array.metadata.encode_chunk_key(at)) in files]
    if n_chunks > len(found):
        fault = f"{n_chunks - len(found):,} of its {n_chunks:,} chunks are not there"
        remedy = "copy it again, or write it with zarr.config.set({'array.write_empty_chunks': True})"
        raise DataError(f"{where}: {fault}; {remedy}.")
    most = 8 * array.dtype.itemsize * math.prod(chunks) + 4096 * (math.prod(chunks) // math.prod(array.chunks))
    if array.dtype.kind != "T" and max(found, default=0) > most:
        raise DataError(f"{where}: {'; '.join(_DAMAGED_CHUNK)}.")


FORMAT = Format(name="Zarr", claims=claims, read=read, suffixes=(ZIP,))
