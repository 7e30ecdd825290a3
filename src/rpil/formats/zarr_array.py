"""Zarr stores and their arrays, which the library zarr reads; chunks that are not there are never made up.

A header, of format 2 or 3, names the codecs that the library is to call with the contents of the file, and some of
these run code. Codecs and types that are not on the lists here are refused before the array is opened.
"""

from __future__ import annotations

import math
import re
import stat
import threading
import warnings
import zipfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rpil.data.errors import DataError, optional
from rpil.data.guard import guarded
from rpil.data.held import held
from rpil.data.json_files import Parsed, parse
from rpil.data.memory import check_free
from rpil.formats.description import commas
from rpil.numerics.types import Array

HEADERS = (".zarray", "zarr.json")
"""Files that describe an array, in the formats 2 and 3."""

_CODECS = {
    *("bytes", "transpose", "sharding_indexed", "zlib", "gzip", "bz2", "zstd", "blosc", "lz4", "shuffle", "delta"),
    *("fixedscaleoffset", "quantize", "crc32", "crc32c", "adler32", "fletcher32"),
}
_TEXT_CODECS = {"vlen-utf8", "vlen-bytes"}
_IMAGE_CODECS = "imagecodecs_"
_TYPE_2 = re.compile(r"[<>|]?(?:[biufcSU]\d{1,6}|[mM]8(?:\[\d{0,9}[a-zA-Z]{1,2}\])?)")
_TYPE_3 = re.compile(
    r"bool|u?int(?:8|16|32|64)|float(?:16|32|64)|complex(?:64|128)|numpy\.(?:datetime|timedelta)64|"
    r"fixed_length_utf32|null_terminated_bytes"
)
_TEXT_2 = re.compile(r"\|O|[<>|]?[SU]\d{1,6}")
_TEXT_3 = re.compile(r"string|bytes|variable_length_bytes")

ArrayHeader = Mapping[str, Parsed]
"""What a header says."""

ZIP = ".zip"
"""The extension of stores in a ZIP file; a file of another name is never taken for one."""

_DAMAGED_HEADER = "its header is damaged, or of an unknown format", "copy or write it again"
_DAMAGED_CHUNK = "a chunk of it is damaged, or does not hold what the header declares", "copy or write it again"


@dataclass(frozen=True)
class Store:
    """A store of Zarr: the folder at `path`, or what is in the ZIP file there; `root` is its top."""

    path: Path
    root: Path | zipfile.Path

    def header_file(self, name: str) -> Path | zipfile.Path | None:
        """The file that describes the array or group `name`; None where there is none."""
        files = (self.root / name / header for header in HEADERS)
        return next((file for file in files if file.is_file()), None)

    def headers(self, names: Collection[str]) -> dict[str, ArrayHeader]:
        """The headers of the arrays among `names`; a `DataError` where one is damaged, or `check_header` refuses it."""
        headers = {}
        for name in names:
            if (file := self.header_file(name)) is not None:
                where = f"{self.path.name}: {name}"
                with guarded(where, *_DAMAGED_HEADER):
                    header = parse(file.read_bytes(), where)
                    if header.get("node_type") != "group":
                        check_header(header, where)
                        headers[name] = header
        return headers

    def attributes_3(self, name: str) -> Parsed:
        """The attributes of a group in format 3."""
        file, where = self.root / name / HEADERS[1], f"{self.path.name}: {name}"
        with guarded(where, *_DAMAGED_HEADER):
            return parse(file.read_bytes(), where).get("attributes", {}) if file.is_file() else {}

    def folders(self, name: str) -> list[str]:
        """The names of the folders in a folder, in order."""
        folder = self.root / name
        entries = [entry.name for entry in folder.iterdir() if entry.is_dir()] if folder.is_dir() else []
        return sorted(entry for entry in entries if entry not in ("", ".", "..") and "\\" not in entry)

    def files(self, name: str) -> Iterator[tuple[str, int]]:
        """The files in a folder and in the folders in it: names without that of the folder, and bytes."""
        if isinstance(self.root, zipfile.Path):
            infos = (info for info in self.root.root.infolist() if info.filename.startswith(f"{name}/"))
            return ((info.filename.removeprefix(f"{name}/"), info.file_size) for info in infos)
        folder = self.root / name
        files = ((file, file.stat()) for file in folder.rglob("*"))
        return ((file.relative_to(folder).as_posix(), at.st_size) for file, at in files if stat.S_ISREG(at.st_mode))

    @cached_property
    def of_library(self) -> Any:
        """The store as the library has it; a `MissingExtraError` where that is not installed."""
        storage = optional("zarr.storage", "To read Zarr", "zarr")
        if not isinstance(self.root, zipfile.Path):
            return storage.LocalStore(self.path)
        store = storage.ZipStore(self.path)  # which would open the file a second time
        store._lock, store._zf, store._is_open = threading.RLock(), self.root.root, True
        return store

    def array(self, name: str, header: ArrayHeader) -> Any:
        """The array of the library that a header describes, whose chunks are in the folder `name`."""
        store = self.of_library
        from zarr import Array, AsyncArray
        from zarr.storage import StorePath

        return Array(AsyncArray(dict(header), StorePath(store, name), {"write_empty_chunks": True}))


def is_zip(path: Path) -> bool:
    """Whether `path` is a file that is called a ZIP file."""
    return path.suffix.lower() == ZIP and path.is_file()


@contextmanager
def opened(path: Path) -> Iterator[Store]:
    """The store in a folder or ZIP file; a `DataError` where the ZIP file is damaged."""
    if not is_zip(path):
        yield Store(path, path)
        return
    fault = "no ZIP file, or a damaged one", "copy or write it again"
    with guarded(path.name, *fault), held(path, lambda: zipfile.ZipFile(path), "ZIP") as archive:
        yield Store(path, zipfile.Path(archive))


class ZarrArray:
    """An array in a store, whose rows are read when they are asked for.

    Attributes
    ----------
    name : str
        Its place in the store, such as ``data/action``.
    where : str
        The array in messages.
    header : mapping
        All that the header says, which `check_header` has passed.
    is_closed : bool
        Whether the values are images, which are not decoded.
    chunks : tuple of int
        The shape of what one file holds: a chunk, or a shard of several.
    grid : tuple of int
        Number of files along each axis.
    ends : (M,) array of int
        Where each demonstration ends, to name those that miss a chunk; of an array without demonstrations, nothing.
    fills : bool
        Whether chunks that are not there are read as the fill value.
    """

    def __init__(
        self, store: Store, name: str, header: ArrayHeader, ends: Array | None = None, fills: bool = False
    ) -> None:
        self.name, self.where, self.header, self.ends = name, f"{store.path.name}: {name}", header, ends
        self.fills, self.is_closed = fills, has_images(header)
        with guarded(self.where, *_DAMAGED_HEADER), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what in format 3 other libraries may not read
            self.stored = store.array(name, for_library(header))
            self.shape: tuple[int, ...] = self.stored.shape
            self.chunks: tuple[int, ...] = self.stored.shards or self.stored.chunks
            self.grid = tuple(-(-size // step) for size, step in zip(self.shape, self.chunks, strict=True))
        self.dtype = np.dtypes.StringDType() if self.stored.dtype.kind == "O" else self.stored.dtype
        self._files = store.files(name)

    def __getitem__(self, rows: slice) -> Array:
        first, stop, _ = rows.indices(self.shape[0])
        self._check(range(first // self.chunks[0], -(-stop // self.chunks[0])), stop - first)
        with guarded(self.where, *_DAMAGED_CHUNK):
            return np.asarray(self.stored[first:stop])

    def take(self, rows: Array) -> Array:
        """The values of `rows` (n,), which rise; a `DataError` where a chunk of theirs is missing or damaged."""
        self._check({*(rows // self.chunks[0]).tolist()}, len(rows))
        with guarded(self.where, *_DAMAGED_CHUNK):
            return np.asarray(self.stored.oindex[rows])

    def _check(self, numbers: Collection[int], n_rows: int) -> None:
        """A `DataError` where a chunk with one of these `numbers` along the first axis is missing, or `n_rows` rows do
        not fit in memory."""
        with guarded(self.where):
            check_free(self.dtype.itemsize * max(math.prod(self.chunks), n_rows * math.prod(self.shape[1:])))
        n_there = sum(n for number, n in self._n_stored.items() if number in numbers)
        if not self.fills and n_there < len(numbers) * math.prod(self.grid[1:]):
            raise self._missing()

    def chunk_file(self, place: tuple[int, ...]) -> str:
        """The name of the file at a place of the grid."""
        return f"{self.name}/{self.stored.metadata.encode_chunk_key(place)}"

    @cached_property
    def _n_stored(self) -> Counter[int]:
        """How many chunks there are, by their number along the first axis."""
        first = self.stored.metadata.encode_chunk_key((0,) * len(self.grid))
        pattern = re.compile(re.escape(first).replace("0", "([0-9]+)"))
        matches = [(match, n_bytes) for file, n_bytes in self._files if (match := pattern.fullmatch(file))]
        if self.dtype.kind != "T" and max((n_bytes for _, n_bytes in matches), default=0) > self._most_bytes:
            raise DataError(f"{self.where}: {'; '.join(_DAMAGED_CHUNK)}.")
        places = (tuple(map(int, match.groups())) for match, _ in matches)
        return Counter(place[0] for place in places if all(k < n for k, n in zip(place, self.grid, strict=True)))

    @property
    def _most_bytes(self) -> int:
        """The bytes of a file with a chunk, or with a shard of several, at most: filters make up to 8 bytes of one."""
        n_chunks = math.prod(self.chunks) // math.prod(self.stored.chunks)
        return int(8 * self.dtype.itemsize * math.prod(self.chunks) + 4096 * n_chunks)

    def _missing(self) -> DataError:
        """The error that names the demonstrations some of whose steps have no chunk."""
        n_files, in_row = math.prod(self.grid), math.prod(self.grid[1:])
        fault = f"{self.where}: {n_files - self._n_stored.total():,} of its {n_files:,} chunks are not there"
        if self.ends is None:
            return DataError(f"{fault}; copy it again.")
        whole = sorted(number for number, n in self._n_stored.items() if n == in_row)
        begins = np.concatenate([[0], self.ends[:-1]])
        first, last = begins // self.chunks[0], (self.ends - 1) // self.chunks[0]  # numbers of chunks
        n_whole = np.searchsorted(whole, last, side="right") - np.searchsorted(whole, first)
        ids = np.flatnonzero((n_whole <= last - first) & (begins < self.ends))
        return DataError(
            f"{fault}, which hold steps of the demonstrations {commas(list(map(str, ids.tolist())))}, as after a copy "
            "that broke off; copy it again, or write it with zarr.config.set({'array.write_empty_chunks': True})."
        )


def check_header(header: ArrayHeader, where: str) -> None:
    """A `DataError` where a codec or type in a header is not on the lists, or numbers are coded as text.

    Where the header is damaged, an error of another type may be raised.
    """
    is_2 = header["zarr_format"] == 2
    types, texts = (_TYPE_2, _TEXT_2) if is_2 else (_TYPE_3, _TEXT_3)
    for name, options in _codecs(header):
        if not {name, str(options.get("id", name))} <= _CODECS | _TEXT_CODECS and not name.startswith(_IMAGE_CODECS):
            raise _refusal(f"the codec {name[:60]!r}", where)
        for option in {"dtype", "astype"}.intersection(options):
            _check_type(_TYPE_2, options[option], where)
    _check_type(texts if _is_text(header) else types, header["dtype"] if is_2 else _name(header["data_type"]), where)


def has_images(header: ArrayHeader) -> bool:
    """Whether the values are images of the package imagecodecs, which are not decoded."""
    return any(name.startswith(_IMAGE_CODECS) for name, _ in _codecs(header))


def for_library(header: ArrayHeader) -> ArrayHeader:
    """The header with which the library opens an array: of images as if they were not coded.

    Before zarr 3.1 texts of one length were coded as those of any length, which it opens no more, and the fill value of
    texts was 0.
    """
    is_2 = header["zarr_format"] == 2
    if has_images(header):
        codecs = [{"name": "bytes", "configuration": {"endian": "little"}}]
        return {**header, **({"filters": None, "compressor": None} if is_2 else {"codecs": codecs})}
    return {**header, "dtype": "|O", "fill_value": None} if is_2 and _is_text(header) else header


def _is_text(header: ArrayHeader) -> bool:
    """Whether the values are coded as texts of any length."""
    return not _TEXT_CODECS.isdisjoint(name for name, _ in _codecs(header))


def _codecs(header: ArrayHeader) -> list[tuple[str, ArrayHeader]]:
    """The names of all codecs, with their options."""
    if header["zarr_format"] == 3:
        return [*_codecs_3(header["codecs"])]
    codecs = [*(header.get("filters") or ()), header.get("compressor")]
    return [(str(codec["id"]), codec) for codec in codecs if codec is not None]


def _codecs_3(codecs: Parsed) -> Iterator[tuple[str, ArrayHeader]]:
    """The names of codecs of format 3, and of those within shards, with their options."""
    for codec in codecs:
        options = {} if isinstance(codec, str) else codec.get("configuration") or {}
        yield _name(codec).removeprefix("numcodecs."), options
        yield from _codecs_3([*options.get("codecs", ()), *options.get("index_codecs", ())])


def _name(named: Parsed) -> str:
    """The name of a codec or type of format 3, which may stand alone or with a configuration."""
    return named if isinstance(named, str) else str(named["name"])


def _check_type(known: re.Pattern[str], data_type: Parsed, where: str) -> None:
    if not isinstance(data_type, str) or not known.fullmatch(data_type):
        raise _refusal(f"the type {str(data_type)[:60]!r}", where)


def _refusal(what: str, where: str) -> DataError:
    return DataError(
        f"{where} is stored with {what}, which is not read, because what a file names may run code; store numbers or "
        "text with a codec such as blosc, zstd or gzip, or take the array out."
    )
