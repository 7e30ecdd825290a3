"""Headers of Zarr arrays, in the formats 2 and 3: the codecs and types in one are checked before the array is opened.

A header names the codecs that a library is to call with the contents of the file, and some of these run code. Codecs
and types that are not on the lists here are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from rpil.data.errors import DataError
from rpil.data.json_files import Parsed

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
