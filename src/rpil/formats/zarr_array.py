"""Arrays of Zarr: their chunks are decoded here, each to no more than its declared size, and none is made up."""

from __future__ import annotations

import itertools
import math
import struct
from functools import cached_property

import numpy as np

from rpil.data.arrays import LONGEST_TEXT
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.json_files import Parsed
from rpil.data.memory import MIB, check_memory, check_padding
from rpil.data.missing import are_chunks_filled
from rpil.formats.description import commas
from rpil.formats.zarr_files import Files
from rpil.formats.zarr_header import STREAMS, ArrayHeader, Coding, Options
from rpil.numerics.types import Array

_NO_CHUNK = 2**64 - 1  # in the index of a shard
_OVERHEAD = 4096  # bytes that a codec may add to what it cannot compress
_MAX_TEXT = 64 * MIB  # bytes of a chunk of text


class ZarrArray:
    """An array in a store, whose rows are read when they are asked for.

    Attributes
    ----------
    name : str
        Its place in the store, such as ``data/action``.
    header : ArrayHeader
    ends : (M,) array of int
        Where each demonstration ends, to name those that miss a chunk; of an array without demonstrations, nothing.
    """

    def __init__(self, files: Files, name: str, header: ArrayHeader, ends: Array | None = None) -> None:
        self._files, self.name, self.header, self.ends = files, name, header, ends
        self.shape, self.dtype, self.chunks = header.shape, header.coding.dtype, header.file_shape

    def __getitem__(self, rows: slice) -> Array:
        first, stop, _ = rows.indices(self.shape[0])
        self.check(first, stop)
        return self.take(np.arange(first, stop))

    def check(self, first: int = 0, stop: int | None = None) -> None:
        """A `DataError` where a chunk of the rows from `first` to `stop` is missing, found without a list of rows."""
        check_padding(self.shape, self.chunks, self.dtype.itemsize, self.header.where)
        numbers = range(first // self.chunks[0], -(-(self.shape[0] if stop is None else stop) // self.chunks[0]))
        n_there = sum(len(files) for number, files in self.chunk_files.items() if number in numbers)
        if not are_chunks_filled() and n_there < len(numbers) * math.prod(self.header.grid[1:]):
            raise self._missing()

    def take(self, rows: Array) -> Array:
        """The values of `rows` (n,), which rise; a `DataError` where a chunk of theirs is missing or damaged."""
        check_padding(self.shape, self.chunks, self.dtype.itemsize, self.header.where)
        n_values = len(rows) * math.prod(self.shape[1:]) + 2 * math.prod(self.chunks)  # a chunk is decoded and unpacked
        check_memory(self.dtype.itemsize * n_values, self.header.where)
        size, numbers = self.chunks[0], np.unique(rows // self.chunks[0])
        there = np.intersect1d(numbers, np.fromiter(self.chunk_files, np.int64, len(self.chunk_files)))
        wanted = {number: self.chunk_files[number] for number in there.tolist()}
        n_wanted = len(numbers) * math.prod(self.header.grid[1:])
        if not are_chunks_filled() and sum(map(len, wanted.values())) < n_wanted:
            raise self._missing()
        out = np.full((len(rows), *self.shape[1:]), self._fill(), self.dtype)
        for number, files in wanted.items():
            first, last = np.searchsorted(rows, (number * size, (number + 1) * size))
            for place, file in files.items():
                block = self._read(file)[rows[first:last] - number * size]
                spans = [slice(k * step, (k + 1) * step) for k, step in zip(place[1:], self.chunks[1:], strict=True)]
                part = out[(slice(first, last), *spans)]
                part[...] = block[(slice(None), *map(slice, part.shape[1:]))]
        return out

    @cached_property
    def chunk_files(self) -> dict[int, dict[tuple[int, ...], str]]:
        """The files of the chunks by their first number, and by all of their numbers."""
        found: dict[int, dict[tuple[int, ...], str]] = {}
        grid, mark = self.header.grid, self.header.separator
        prefix = f"{self.header.prefix}{mark}" if self.header.prefix else ""
        for name in self._files.names(self.name):
            numbers = name.removeprefix(prefix).split(mark)
            if name.startswith(prefix) and len(numbers) == len(grid) and all(map(_is_number, numbers)):
                place = tuple(map(int, numbers))
                if all(k < n for k, n in zip(place, grid, strict=True)):
                    found.setdefault(place[0], {})[place] = name
        return found

    def stored(self, file: str) -> bytes:
        """The bytes of a chunk as they are."""
        limit = 2 * _n_bytes(self.header.coding, self.chunks) + _OVERHEAD
        return self._files.read(f"{self.name}/{file}", limit + 16 * self._chunks_in_file())

    def _chunks_in_file(self) -> int:
        return math.prod(self.chunks) // math.prod(self.header.chunks)

    def _missing(self) -> DataError:
        """The error that names the demonstrations some of whose steps have no chunk."""
        n_files, in_row = math.prod(self.header.grid), math.prod(self.header.grid[1:])
        n_there = sum(map(len, self.chunk_files.values()))
        fault = f"{self.header.where}: {n_files - n_there:,} of its {n_files:,} chunks are not there"
        if self.ends is None:
            return DataError(f"{fault}; copy it again.")
        whole = sorted(number for number, files in self.chunk_files.items() if len(files) == in_row)
        begins = np.concatenate([[0], self.ends[:-1]])
        first, last = begins // self.chunks[0], (self.ends - 1) // self.chunks[0]  # numbers of chunks
        n_whole = np.searchsorted(whole, last, side="right") - np.searchsorted(whole, first)
        ids = np.flatnonzero((n_whole <= last - first) & (begins < self.ends))
        return DataError(
            f"{fault}, which hold steps of the demonstrations {commas(list(map(str, ids.tolist())))}, as after a copy "
            "that broke off; copy it again, or, where the writer left out chunks of one value, have that value read "
            "with <option>.",
            "fill_missing",
        )

    def _fill(self) -> Parsed:
        """The value of what was left out."""
        value, kind = self.header.fill, self.dtype.kind
        if kind in "ST" or value is None:
            return "" if kind in "UT" else b"" if kind == "S" else np.zeros((), self.dtype)[()]
        if kind == "f" and isinstance(value, str) and value.startswith("0x"):
            return np.array(int(value, 16), f"u{self.dtype.itemsize}").view(f"f{self.dtype.itemsize}")[()]
        return float(value) if kind == "f" else value if kind in "biuU" else np.zeros((), self.dtype)[()]

    def _read(self, file: str) -> Array:
        """The values in a file, of its declared shape."""
        try:
            content = self.stored(file)
            return self._of_shard(content) if self.header.shards else decode(content, self.header.coding, self.chunks)
        except (DataError, MissingExtraError):
            raise
        except Exception as error:  # a damaged chunk makes codecs raise errors of many types
            raise DataError(
                f"{self.header.where}: its chunk {file} is damaged, or does not hold what the header declares; copy or "
                "write it again."
            ) from error

    def _of_shard(self, content: bytes) -> Array:
        """The values of all chunks in a shard; what its index says was left out has the fill value."""
        header, n_bytes = self.header, 16 * self._chunks_in_file()
        is_checked = header.index["codecs"] == ["bytes", "crc32c"]
        size = n_bytes + 4 * is_checked
        index = content[:size] if header.index["location"] == "start" else content[-size:]
        if is_checked:
            index = _without_crc32c(index)
        places = np.frombuffer(index, "<u8").reshape(-1, 2).tolist()
        values = np.full(self.chunks, self._fill(), self.dtype)
        steps = (range(0, whole, part) for whole, part in zip(self.chunks, header.chunks, strict=True))
        for (offset, length), corner in zip(places, itertools.product(*steps), strict=True):
            if (offset, length) != (_NO_CHUNK, _NO_CHUNK):
                spans = (slice(start, start + step) for start, step in zip(corner, header.chunks, strict=True))
                values[tuple(spans)] = decode(content[offset : offset + length], header.coding, header.chunks)
        return values


def decode(content: bytes, coding: Coding, shape: tuple[int, ...]) -> Array:
    """The values of a chunk of this shape; an error, of whatever type, where it holds more or less than these."""
    limit = _n_bytes(coding, shape)
    for codec in reversed(coding.codecs):
        content = _decompress(content, codec, limit)
    in_file = tuple(shape[axis] for axis in coding.axes)
    values = _texts(content, math.prod(shape)) if coding.is_text else np.frombuffer(content, coding.dtype)
    return values.reshape(in_file).transpose(np.argsort(coding.axes))


def _n_bytes(coding: Coding, shape: tuple[int, ...]) -> int:
    """Bytes of the values of a chunk at most, in whatever type a codec has them."""
    n_values = math.prod(shape)
    if coding.is_text:
        return min(4 + n_values * (4 + 4 * LONGEST_TEXT), _MAX_TEXT)
    return n_values * (max(coding.dtype.itemsize, 8) if len(coding.codecs) > 1 else coding.dtype.itemsize) + 16


def _decompress(content: bytes, codec: Options, limit: int) -> bytes:
    """What a codec, which is on the list, makes of the content: `limit` bytes at most."""
    name = codec["id"]
    if name in STREAMS:
        import pyarrow as pa

        with pa.CompressedInputStream(pa.py_buffer(content), STREAMS[name]) as stream:
            decoded: bytes = stream.read(limit + 1)
    elif name == "crc32c":
        return _without_crc32c(content)
    else:
        _check_declared(content, name, limit)
        try:
            from numcodecs import get_codec
        except ImportError as error:
            raise MissingExtraError(f"The codec {name!r} of Zarr", "zarr") from error
        # What decoding needs of these is in their frames, and format 3 has other options.
        options = {"id": name} if name in ("blosc", "lz4") else dict(codec)
        decoded = np.asarray(get_codec(options).decode(content)).tobytes()
    if len(decoded) > limit:
        raise ValueError(name)
    return decoded


def _check_declared(content: bytes, name: str, limit: int) -> None:
    """A `ValueError` where a frame says that it holds more bytes than `limit`: the library would allot them."""
    n_bytes = 0
    if name == "blosc":
        n_bytes, block, stored = struct.unpack_from("<3I", content, 4)
        if stored != len(content) or block > max(n_bytes, 1):
            raise ValueError(name)
    elif name == "lz4":
        (n_bytes,) = struct.unpack_from("<I", content)
    if n_bytes > limit:
        raise ValueError(name)


def _without_crc32c(content: bytes) -> bytes:
    """The content before its checksum; a `ValueError` where that differs."""
    try:
        import google_crc32c
    except ImportError as error:
        raise MissingExtraError("The codec 'crc32c' of Zarr", "zarr") from error
    if google_crc32c.value(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError("crc32c")
    return content[:-4]


def _texts(content: bytes, n: int) -> Array:
    """The texts (n,) that follow their number, each after its length."""
    (stored,), place, found = struct.unpack_from("<I", content), 4, []
    if stored != n:
        raise ValueError(stored)
    for _ in range(n):
        (length,) = struct.unpack_from("<I", content, place)
        found.append(content[place + 4 : place + 4 + length].decode())
        place += 4 + length
    return np.array(found, np.dtypes.StringDType())


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 19
