"""Headers of Zarr arrays, in the formats 2 and 3: what is in them is checked before anything is decoded.

A header names the codecs that a library is to call with the contents of the file, and some of these run code. Codecs
and types that are not on the lists here are refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpil.data.errors import DataError
from rpil.data.json_files import Parsed, parse

HEADERS = (".zarray", "zarr.json")
"""Files that describe an array, in the formats 2 and 3."""

STREAMS = {"zlib": "gzip", "gzip": "gzip", "bz2": "bz2", "zstd": "zstd"}
"""Codecs that pyarrow decodes, and its names of them."""

_NUMERIC = ("delta", "fixedscaleoffset", "quantize")
_CODECS = (*STREAMS, "blosc", "lz4", "shuffle", *_NUMERIC, "crc32", "crc32c", "adler32", "fletcher32")
_IMAGE_CODECS = "imagecodecs_"
_TEXT_CODECS = ("vlen-utf8", "vlen-bytes")
_TEXT_TYPES = ("string", "bytes", "variable_length_bytes")  # of format 3
_DTYPE = re.compile(r"[<>|]?(?:[biufcSU]\d{1,6}|[mM]8(?:\[\d{0,9}[a-zA-Z]{1,2}\])?)")
_TYPE_NAME = re.compile(r"bool|u?int(?:8|16|32|64)|float(?:16|32|64)|complex(?:64|128)")

DType = np.dtype[Any]
Options = Mapping[str, Parsed]


@dataclass(frozen=True)
class Coding:
    """How the values of a chunk are stored.

    Attributes
    ----------
    dtype : dtype
        With the order of bytes of the file; NumPy's type of strings for text of any length.
    axes : tuple of int
        The axes of the array in the order in which the file has them, the last one running fastest.
    codecs : tuple of mapping
        With an ``id`` each, in the order of writing.
    """

    dtype: DType
    axes: tuple[int, ...]
    codecs: tuple[Options, ...]

    @property
    def is_text(self) -> bool:
        """Whether values are text of any length."""
        return self.dtype.kind == "T"


@dataclass(frozen=True)
class ArrayHeader:
    """What the header of an array says, all of which is on the lists of this file.

    Attributes
    ----------
    about : mapping
        The header itself.
    where : str
        The array in messages.
    chunks : tuple of int
        The shape of what is decoded at a time.
    shards : tuple of int
        The shape of what one file holds, where that is several chunks.
    fill : number or str
        The value of chunks that were left out, as the header has it.
    separator : str
        Between the numbers in the name of a file, which begins with `prefix`.
    index : mapping
        How the chunks in a shard are found.
    is_closed : bool
        Whether the values are images, which are not decoded.
    """

    about: Options
    where: str
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    shards: tuple[int, ...] | None
    coding: Coding
    fill: Parsed
    separator: str
    prefix: str = ""
    index: Options = field(default_factory=dict)
    is_closed: bool = False

    @property
    def file_shape(self) -> tuple[int, ...]:
        """The shape of what one file holds."""
        return self.shards or self.chunks

    @property
    def grid(self) -> tuple[int, ...]:
        """Number of files along each axis."""
        return tuple(-(-size // step) for size, step in zip(self.shape, self.file_shape, strict=True))

    def file_name(self, place: tuple[int, ...]) -> str:
        """The name of the file at a place of the grid."""
        return self.separator.join([*([self.prefix] if self.prefix else []), *map(str, place)])


def parse_header(content: bytes, where: str) -> ArrayHeader | None:
    """The header of an array, None for a group; a `DataError` where it is damaged or names what is not on the lists."""
    try:
        about = parse(content, where)
        if about.get("node_type") == "group":
            return None
        return (_parse_2 if about["zarr_format"] == 2 else _parse_3)(about, where)
    except DataError:
        raise
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise DataError(f"{where}: its header is damaged, or of an unknown format; copy or write it again.") from error


def _parse_2(about: Options, where: str) -> ArrayHeader:
    shape, chunks = _shape(about["shape"], 0), _shape(about["chunks"], 1)
    codecs = [*(about.get("filters") or ()), *([about["compressor"]] if about.get("compressor") else ())]
    names = [_checked(codec, where) for codec in codecs]
    # Until zarr 3.1 texts of one length were stored like others.
    is_text = bool(names) and names[0] in _TEXT_CODECS and _is_text(about["dtype"])
    dtype = _text_type() if is_text else _dtype(about["dtype"], where)
    coding = Coding(dtype, _axes(about.get("order", "C"), len(shape)), tuple(codecs[is_text:]))
    _check_text(names[is_text:], where)
    separator = {".": ".", "/": "/"}[about.get("dimension_separator", ".")]
    is_closed = any(name.startswith(_IMAGE_CODECS) for name in names)
    return _same_rank(
        ArrayHeader(about, where, shape, chunks, None, coding, about.get("fill_value"), separator, is_closed=is_closed)
    )


def _parse_3(about: Options, where: str) -> ArrayHeader:
    if about["zarr_format"] != 3 or about["node_type"] != "array" or about.get("storage_transformers"):
        raise ValueError(where)
    if about["chunk_grid"]["name"] != "regular":
        raise ValueError(where)
    shape, files = _shape(about["shape"], 0), _shape(about["chunk_grid"]["configuration"]["chunk_shape"], 1)
    key = about["chunk_key_encoding"]
    kind = {"default": ("c", "/"), "v2": ("", ".")}[key["name"]]
    separator = {".": ".", "/": "/"}[(key.get("configuration") or {}).get("separator", kind[1])]
    codecs, chunks, shards, index = about["codecs"], files, None, {}
    if _name(codecs[0]) == "sharding_indexed":
        if len(codecs) > 1:
            raise _refusal(f"codecs around {_name(codecs[0])!r}", where)
        index = codecs[0]["configuration"]
        shards, chunks, codecs = files, _shape(index["chunk_shape"], 1), index["codecs"]
        if any(whole % part for whole, part in zip(shards, chunks, strict=True)):
            raise ValueError(where)
        index = {"location": index.get("index_location", "end"), "codecs": [_name(c) for c in index["index_codecs"]]}
        if index["location"] not in ("start", "end") or index["codecs"] not in (["bytes"], ["bytes", "crc32c"]):
            raise _refusal("the index of its shards", where)
    coding = _coding_3(about["data_type"], codecs, len(shape), where)
    is_closed = any(codec["id"].startswith(_IMAGE_CODECS) for codec in coding.codecs)
    header = ArrayHeader(about, where, shape, chunks, shards, coding, about["fill_value"], separator, kind[0], index)
    return _same_rank(ArrayHeader(**{**vars(header), "is_closed": is_closed}))


def _coding_3(data_type: object, codecs: Sequence[Parsed], n_axes: int, where: str) -> Coding:
    """The coding by the codecs of format 3, of which one makes bytes, and those before it reorder axes."""
    axes, endian, found = _axes("C", n_axes), "<", []
    is_text = data_type in _TEXT_TYPES and any(_name(codec) in _TEXT_CODECS for codec in codecs)
    for codec in codecs:
        name, options = _name(codec), codec.get("configuration") or {} if isinstance(codec, dict) else {}
        if name == "transpose":
            axes = _axes(options["order"], n_axes)
        elif name == "bytes":
            endian = {"little": "<", "big": ">"}[options.get("endian") or "little"]
        elif not (name in _TEXT_CODECS and is_text):
            found.append({**options, "id": name})
            _check_text([_checked(found[-1], where)], where)
    dtype = _text_type() if is_text else _type_3(data_type, where).newbyteorder(endian)  # type: ignore[arg-type]
    return Coding(dtype, axes, tuple(found))


def _type_3(data_type: Parsed, where: str) -> DType:
    """The type of a name of format 3, or of a name with a configuration."""
    if isinstance(data_type, str) and _TYPE_NAME.fullmatch(data_type):
        return np.dtype(data_type)
    options = data_type.get("configuration") if isinstance(data_type, dict) else None
    if isinstance(options, dict):
        if data_type["name"] == "fixed_length_utf32":
            return _dtype(f"<U{int(options['length_bytes']) // 4}", where)
        if data_type["name"] == "null_terminated_bytes":
            return _dtype(f"|S{int(options['length_bytes'])}", where)
        if data_type["name"] in ("numpy.datetime64", "numpy.timedelta64"):
            kind = "M" if data_type["name"] == "numpy.datetime64" else "m"
            return _dtype(f"<{kind}8[{options.get('scale_factor', 1)}{options['unit']}]", where)
    raise _refusal(f"the type {str(data_type)[:60]!r}", where)


def _name(codec: Parsed) -> str:
    """The name of a codec of format 3."""
    name = codec if isinstance(codec, str) else codec["name"]
    return str(name).removeprefix("numcodecs.")


def _checked(codec: Options, where: str) -> str:
    """The id of a codec; a `DataError` where it is not on the list, or is to make objects."""
    name = str(codec["id"])
    for option in ("dtype", "astype"):
        if option in codec:
            _dtype(codec[option], where)
    if name not in (*_CODECS, *_TEXT_CODECS) and not name.startswith(_IMAGE_CODECS):
        raise _refusal(f"the codec {name[:60]!r}", where)
    return name


def _check_text(names: Sequence[str], where: str) -> None:
    """A `DataError` where text is to be coded again."""
    if not {*_TEXT_CODECS}.isdisjoint(names):
        raise _refusal("a codec of text for what is none", where)


def _refusal(what: str, where: str) -> DataError:
    return DataError(
        f"{where} is stored with {what}, which is not read, because what a file names may run code; store numbers or "
        "text with a codec such as blosc, zstd or gzip, or take the array out."
    )


def _dtype(text: Parsed, where: str) -> DType:
    """A type of numbers, of texts of one length or of times."""
    if not isinstance(text, str) or not _DTYPE.fullmatch(text):
        raise _refusal(f"the type {str(text)[:60]!r}", where)
    return np.dtype(text)


def _is_text(dtype: Parsed) -> bool:
    """Whether a type of format 2 is one that texts of any length have."""
    return isinstance(dtype, str) and (dtype == "|O" or (_DTYPE.fullmatch(dtype) is not None and dtype[1] in "SU"))


def _text_type() -> DType:
    return np.dtypes.StringDType()


def _shape(sizes: Parsed, least: int) -> tuple[int, ...]:
    if any(type(size) is not int or size < least for size in sizes):
        raise ValueError(sizes)
    return tuple(sizes)


def _axes(order: Parsed, n_axes: int) -> tuple[int, ...]:
    """The axes in the order of the file."""
    if order in ("C", "F"):
        return tuple(range(n_axes)[:: 1 if order == "C" else -1])
    if sorted(order) != list(range(n_axes)):
        raise ValueError(order)
    return tuple(order)


def _same_rank(header: ArrayHeader) -> ArrayHeader:
    if not len(header.shape) == len(header.file_shape) == len(header.chunks):
        raise ValueError(header.where)
    return header
