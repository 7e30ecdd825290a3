"""Zarr replay buffers, as diffusion policy writes them: ``data/*`` end to end, and ``meta/episode_ends``.

The library zarr decodes them. A header, of format 2 or 3, names the codecs that the library is to call with the
contents of the file, and some of these run code. Codecs and types that are not on the lists here are refused before the
library sees them. Chunks that are not there are never made up.
"""

from __future__ import annotations

import math
import re
import stat
import threading
import warnings
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rpil.data.errors import DataError, optional
from rpil.data.guard import guarded
from rpil.data.held import held
from rpil.data.json_files import Parsed, parse
from rpil.data.memory import check_free
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, StepTables
from rpil.formats.step_arrays import NUMBERED, Closed, Part, from_parts, without_steps
from rpil.numerics.types import Array

ZIP = ".zip"
"""The extension of stores in a ZIP file; a file of another name is never taken for one."""

ArrayHeader = Mapping[str, Parsed]
"""The header of an array."""

_ENDS = "meta/episode_ends"
_HEADERS = (".zarray", "zarr.json")
_IMAGE_CODECS = "imagecodecs_"
_CODECS = {
    *("bytes", "transpose", "sharding_indexed", "zlib", "gzip", "bz2", "zstd", "blosc", "lz4", "shuffle", "delta"),
    *("fixedscaleoffset", "quantize", "crc32", "crc32c", "adler32", "fletcher32"),
}
_TEXT_CODECS = {"vlen-utf8"}
_TYPE = re.compile(
    r"[<>|]?(?:[biufSU]\d{1,6}|[mM]8(?:\[\d{0,9}[a-zA-Z]{1,2}\])?)|bool|u?int(?:8|16|32|64)|float(?:16|32|64)|"
    r"numpy\.(?:datetime|timedelta)64|fixed_length_utf32|null_terminated_bytes"
)
_TEXT = re.compile(r"\|O|string")
_DAMAGED_HEADER = "its header is damaged, or of an unknown format", "copy or write it again"
_DAMAGED_CHUNK = "a chunk of it is damaged, or does not hold what the header declares", "copy or write it again"


def claims(path: Path) -> bool:
    """Whether there is a ``meta/episode_ends`` in the folder, or in the file, whose name says that it is a ZIP file."""
    if not path.is_dir() and not (path.suffix.lower() == ZIP and path.is_file()):
        return False
    with _opened(path) as top:
        found = _header_file(top, _ENDS) is not None
    if not found and not path.is_dir():
        raise DataError(
            f"{path.name}: there is no {_ENDS} at the top of this ZIP file, as Zarr has; pack what is in the folder of "
            "Zarr, not the folder itself, or unpack the file where it holds no Zarr."
        )
    return found


@contextmanager
def _opened(path: Path) -> Iterator[Path | zipfile.Path]:
    """The top of a store: the folder, or what is in the ZIP file; a `DataError` where this is damaged."""
    if path.is_dir():
        yield path
        return
    fault = "no ZIP file, or a damaged one", "copy or write it again"
    with guarded(path.name, *fault), held(path, lambda: zipfile.ZipFile(path), "ZIP") as archive:
        yield zipfile.Path(archive)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The recording in the arrays of ``data``, whose demonstrations are numbered from 0; no image is opened.

    A `DataError` where there are none, or where they do not end where the demonstrations do.
    """
    with _opened(path) as top:
        headers = dict(_headers(top, "data", path.name))
        ends = _ends(top, path)
        closed = [name for name, header in headers.items() if has_images(header)]
        arrays = {name: _array(top, path, f"data/{name}", headers[name]) for name in headers if name not in closed}
    if not arrays:
        raise DataError(
            f"{path.name}: {_ENDS} tells of {len(ends):,} demonstrations and {ends[-1]:,} steps, but no array that "
            f"can be read is in data ({commas(closed) or 'nothing is there'}); copy the data as well."
        )
    for name, array in arrays.items():
        if array.shape[:1] != (ends[-1],):
            fault = f"has the shape {array.shape}, but {_ENDS} ends at {ends[-1]:,} steps"
            raise DataError(f"{path.name}: data/{name} {fault}; write it again.")
    lengths = np.diff(ends, prepend=0)
    notes = without_steps(np.flatnonzero(lengths == 0).tolist())
    numbers = np.repeat(np.arange(len(ends)), lengths)
    parts = [Part(len(numbers), {NUMBERED: numbers, **arrays})]
    tables = from_parts(parts, NUMBERED, path.name, "Zarr replay buffer", options, notes=notes)
    return tables.with_ignored(dict.fromkeys(closed, "images of the package imagecodecs"))


def _header_file(top: Path | zipfile.Path, name: str) -> Path | zipfile.Path | None:
    """The file that describes the array or group `name`; None where there is none."""
    return next((file for header in _HEADERS if (file := top / name / header).is_file()), None)


def _headers(top: Path | zipfile.Path, group: str, source: str, within: str = "") -> Iterator[tuple[str, ArrayHeader]]:
    """The checked headers of the arrays in a group, and in the groups in it, by their names there."""
    folder = top / group
    entries = [entry.name for entry in folder.iterdir() if entry.is_dir()] if folder.is_dir() else []
    for name in sorted(entry for entry in entries if entry not in ("", ".", "..") and "\\" not in entry):
        header = _header(top, f"{group}/{name}", source)
        if header is None:
            yield from _headers(top, f"{group}/{name}", source, f"{within}{name}/")
        else:
            yield f"{within}{name}", header


def _header(top: Path | zipfile.Path, name: str, source: str) -> ArrayHeader | None:
    """The checked header of an array; None of a group, and where there is none."""
    if (file := _header_file(top, name)) is None:
        return None
    where = f"{source}: {name}"
    with guarded(where, *_DAMAGED_HEADER):
        header = parse(file.read_bytes(), where)
        if header.get("node_type") == "group":
            return None
        check_header(header, where)
        return header  # type: ignore[no-any-return]


def _array(top: Path | zipfile.Path, path: Path, name: str, header: ArrayHeader) -> Closed:
    """An array of a store, whose rows are read when they are asked for."""
    storage, where = optional("zarr.storage", "To read Zarr", "zarr"), f"{path.name}: {name}"
    from zarr import Array, AsyncArray

    with guarded(where, *_DAMAGED_HEADER), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what in format 3 other libraries may not read
        if isinstance(top, zipfile.Path):
            store = storage.ZipStore(path)  # which would open the file a second time
            store._lock, store._zf, store._is_open = threading.RLock(), top.root, True
        else:
            store = storage.LocalStore(path)
        if header["zarr_format"] == 2 and header["dtype"] == "|O":  # the fill value of texts was 0 before zarr 3.1
            header = {**header, "fill_value": None}
        array = Array(AsyncArray(dict(header), storage.StorePath(store, name)))  # by the header that was checked
        shape, dtype, chunks = array.shape, array.dtype, array.shards or array.chunks
        grid = tuple(-(-size // step) for size, step in zip(shape, chunks, strict=True))
    check = cache(lambda: _check_chunks(array, grid, _files(top, name), where))

    def rows_of(rows: slice) -> object:
        first, stop, _ = rows.indices(shape[0])
        with guarded(where):
            check_free(dtype.itemsize * max(math.prod(chunks), (stop - first) * math.prod(shape[1:])))
        check()
        with guarded(where, *_DAMAGED_CHUNK):
            return np.asarray(array[first:stop])

    return Closed(shape, np.dtypes.StringDType() if dtype.kind == "O" else dtype, rows_of)


def _files(top: Path | zipfile.Path, name: str) -> list[tuple[str, int]]:
    """The files in a folder and in the folders in it: names without that of the folder, and bytes."""
    if isinstance(top, zipfile.Path):
        infos = (info for info in top.root.infolist() if info.filename.startswith(f"{name}/"))
        return [(info.filename.removeprefix(f"{name}/"), info.file_size) for info in infos]
    files = ((file, file.stat()) for file in (top / name).rglob("*"))
    return [(file.relative_to(top / name).as_posix(), at.st_size) for file, at in files if stat.S_ISREG(at.st_mode)]


def _check_chunks(array: Any, grid: tuple[int, ...], files: Iterable[tuple[str, int]], where: str) -> None:
    """A `DataError` where chunks are missing, or a file holds more than filters make of a chunk: 8 bytes of one."""
    pattern = re.escape(array.metadata.encode_chunk_key((0,) * len(grid))).replace("0", "([0-9]+)")
    found = [(match, n_bytes) for file, n_bytes in files if (match := re.fullmatch(pattern, file))]
    chunks = math.prod(array.shards or array.chunks)
    most = 8 * array.dtype.itemsize * chunks + 4096 * (chunks // math.prod(array.chunks))
    if array.dtype.kind not in "OT" and max((n_bytes for _, n_bytes in found), default=0) > most:
        raise DataError(f"{where}: {'; '.join(_DAMAGED_CHUNK)}.")
    n_there = sum(all(int(k) < n for k, n in zip(match.groups(), grid, strict=True)) for match, _ in found)
    if (n_files := math.prod(grid)) > n_there:
        raise DataError(
            f"{where}: {n_files - n_there:,} of its {n_files:,} chunks are not there; copy it again, or write it with "
            "zarr.config.set({'array.write_empty_chunks': True})."
        )


def _ends(top: Path | zipfile.Path, path: Path) -> Array:
    """Where each demonstration ends (M,), rising."""
    header = _header(top, _ENDS, path.name)
    if header is not None and not has_images(header):
        array = _array(top, path, _ENDS, header)
        if len(array.shape) == 1 and array.dtype.kind in "iu":
            ends: Array = np.asarray(array[:]).astype(np.int64)
            if len(ends) and np.all(np.diff(ends, prepend=0) >= 0):
                return ends
    raise DataError(f"{path.name}: {_ENDS} must hold rising numbers of steps, one for each demonstration; repair it.")


def check_header(header: ArrayHeader, where: str) -> None:
    """A `DataError` where a codec or type in a header is not on the lists.

    Where the header is damaged, an error of another type may be raised.
    """
    is_2, codecs = header["zarr_format"] == 2, [*_codecs(header)]
    names = {name for name, _ in codecs}
    for name in names:
        if name not in _CODECS | _TEXT_CODECS and not name.startswith(_IMAGE_CODECS):
            raise _refusal(f"the codec {name[:60]!r}", where)
    stored = header["dtype"] if is_2 else _name(header["data_type"])
    known = _TEXT if names & _TEXT_CODECS else _TYPE
    types = [(known, stored), *((_TYPE, given[m]) for _, given in codecs for m in ("dtype", "astype") if m in given)]
    for pattern, one in types:
        if not isinstance(one, str) or not pattern.fullmatch(one):
            raise _refusal(f"the type {str(one)[:60]!r}", where)


def has_images(header: ArrayHeader) -> bool:
    """Whether the values are images of the package imagecodecs, which are not decoded."""
    return any(name.startswith(_IMAGE_CODECS) for name, _ in _codecs(header))


def _codecs(header: ArrayHeader) -> Iterator[tuple[str, ArrayHeader]]:
    """The names of all codecs, with their options."""
    if header["zarr_format"] == 3:
        yield from _codecs_3(header["codecs"])
        return
    for codec in (*(header.get("filters") or ()), header.get("compressor")):
        if codec is not None:
            yield str(codec["id"]), codec


def _codecs_3(codecs: Iterable[Parsed]) -> Iterator[tuple[str, ArrayHeader]]:
    """The names of codecs of format 3, and of those within shards, with their options."""
    for codec in codecs:
        options = {} if isinstance(codec, str) else codec.get("configuration") or {}
        yield _name(codec).removeprefix("numcodecs."), options
        if "id" in options:
            yield str(options["id"]), options
        yield from _codecs_3([*options.get("codecs", ()), *options.get("index_codecs", ())])


def _name(named: Parsed) -> str:
    """The name of a codec or type of format 3, which may stand alone or with a configuration."""
    return named if isinstance(named, str) else str(named["name"])


def _refusal(what: str, where: str) -> DataError:
    return DataError(
        f"{where} is stored with {what}, which is not read, because what a file names may run code; store numbers or "
        "text with a codec such as blosc, zstd or gzip, or take the array out."
    )


FORMAT = Format(name="Zarr", claims=claims, read=read, suffixes=(ZIP,))
