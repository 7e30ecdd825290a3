"""How a text table is written: its encoding, its separator, its decimal sign and the names of its columns."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.held import held_bytes
from rpil.data.memory import MIB, check_memory

if TYPE_CHECKING:
    import pyarrow as pa

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
_SUFFIX = re.compile(r"\.(?:csv|tsv|txt)(?:\.gz)?$", re.IGNORECASE)
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_HEAD_LINES = 200
_MEMORY_PER_BYTE = 4  # of a file whose numbers have four characters
_CHUNK = 16 * MIB
_COMMENT = re.compile(r"\s*#|sep=.$", re.IGNORECASE)  # Excel writes the separator into a line of its own
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
_NUMERIC_TEXT = re.compile(r"\s*[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class Dialect:
    """How to read a text table."""

    names: tuple[str, ...]  # without spaces around them
    skip_rows: int  # lines up to the first row of values
    separator: str
    encoding: str
    decimal: str
    on_disk: bool  # whether its rows are copied to disk

    @property
    def words(self) -> str:
        """What is unusual about it."""
        found = [f"separated by {SEPARATORS[self.separator]}"] if self.separator != "," else []
        found += ["decimal commas"] if self.decimal == "," else []
        found += [self.encoding] if self.encoding != "utf-8" else []
        return ", ".join(["CSV", *found])


@contextmanager
def text_bytes(path: Path) -> Iterator[pa.NativeFile]:
    """The bytes of a text table, decompressed."""
    import pyarrow as pa

    with held_bytes(path) as file:
        stream = pa.PythonFile(file)
        yield pa.CompressedInputStream(stream, "gzip") if path.suffix.lower() == ".gz" else stream


def find_dialect(path: Path, on_disk: bool = False) -> Dialect:
    """The dialect of a file, which may be compressed; a `DataError` where it is no text or has no names of columns."""
    with guarded(path.name, "a damaged or truncated compressed file", "write it again"), text_bytes(path) as stream:
        chunks = _checked(iter(lambda: stream.read(_CHUNK), b""), path.name, on_disk)
        head = next(chunks, b"")
        encoding = _encoding(chain([head], chunks))
    text = codecs.getincrementaldecoder(encoding)("strict").decode(head)
    lines = text.removeprefix("\ufeff").splitlines()[:_HEAD_LINES]
    if "\0" in text or not any(line.strip() for line in lines):
        raise DataError(f"{path.name}: not a CSV file, or a damaged or truncated one; write it again.")
    start = next((k for k, line in enumerate(lines) if line.strip() and not _COMMENT.match(line)), len(lines) - 1)
    separator = _separator(lines[start])
    reader = csv.reader(lines[start:], delimiter=separator, skipinitialspace=True)
    names = [name.strip() for name in next(reader)]
    if len(names) == 1:
        only = names[0][:40]
        raise DataError(f"{path.name}: it has one column, {only!r}; write commas, semicolons or tabs between columns.")
    names = [name or (f"Unnamed: {k}" if k else "") for k, name in enumerate(names)]
    if 2 * sum(bool(_NUMERIC_TEXT.fullmatch(name)) for name in names) > len(names):
        raise DataError(f"{path.name}: the first row holds numbers, not names; put the names of the columns above it.")
    body = [line for line in lines[start + reader.line_num :] if line.strip()]
    return Dialect(tuple(names), start + reader.line_num, separator, encoding, _decimal(body, separator), on_disk)


def without_suffix(name: str) -> str:
    """The name of a file without ``.csv``, ``.tsv.gz`` and the like."""
    return _SUFFIX.sub("", name)


def _checked(chunks: Iterator[bytes], source: str, on_disk: bool) -> Iterator[bytes]:
    """The chunks of a file, which may be compressed; a `DataError` where its values would not fit in memory."""
    n_bytes = 0
    for chunk in chunks:
        n_bytes += len(chunk)
        check_memory(0 if on_disk else _MEMORY_PER_BYTE * n_bytes, source)
        yield chunk


def _encoding(chunks: Iterator[bytes]) -> str:
    """UTF-8 or, by its first bytes, UTF-16; else what Western Windows writes."""
    first = next(chunks, b"")
    if first.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    candidates = {name: codecs.getincrementaldecoder(name)("strict") for name in ("utf-8", "cp1252")}
    for chunk in (first, *chunks):
        for name, decoder in list(candidates.items()):
            try:
                decoder.decode(chunk)
            except UnicodeDecodeError:
                del candidates[name]
    return next(iter(candidates), "latin-1")


def _separator(header: str) -> str:
    counts = {sign: _QUOTED.sub("", header).count(sign) for sign in SEPARATORS}
    return max(counts, key=lambda sign: counts[sign])


def _decimal(lines: list[str], separator: str) -> str:
    """A comma where values such as 1,5 occur between other separators, and none such as 1.5."""
    if separator == ",":
        return "."
    values = [value.strip('"') for line in lines for value in line.split(separator)]
    commas = any(_DECIMAL_COMMA.fullmatch(value) for value in values)
    points = any(re.fullmatch(r"\s*[+-]?\d*\.\d+(?:[eE][+-]?\d+)?\s*", value) for value in values)
    return "," if commas and not points else "."
