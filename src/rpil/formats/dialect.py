"""How a text table is written: its encoding, its separator, its decimal sign and the names of its columns."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.held import held_bytes
from rpil.data.memory import MIB, check_memory
from rpil.formats.columns import ColumnOptions, as_list

if TYPE_CHECKING:
    import pyarrow as pa

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
_SUFFIX = re.compile(r"\.(?:csv|tsv|txt)(?:\.gz)?$", re.IGNORECASE)
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_HEAD_LINES = 200
_MEMORY_PER_BYTE = 4  # of a file whose numbers have four characters
_CHUNK = 16 * MIB
_COMMENT = re.compile(r"\s*#|sep=.$", re.IGNORECASE)  # Excel writes the separator into a line of its own
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_WRITTEN_NUMBER = re.compile(r"\s*[+-]?(?:\d+|\d*([.,])\d+|\d+[.,])(?:[eE][+-]?\d+)?\s*")
"""A number, and the decimal sign that digits follow."""


@dataclass(frozen=True)
class TextTable:
    """A text table and how to read it."""

    path: Path
    names: tuple[str, ...]  # of the columns, without spaces around them
    skip_rows: int  # lines up to the first row of values
    separator: str
    encoding: str
    decimal: str
    on_disk: bool  # whether its rows are copied to disk

    @property
    def words(self) -> str:
        """What is unusual about it."""
        found = [f"separated by {_SEPARATORS[self.separator]}"] if self.separator != "," else []
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


def find_dialect(path: Path, options: ColumnOptions) -> TextTable:
    """The dialect of a file, which may be compressed; a `DataError` where it is no text or has no names of columns."""
    with guarded(path.name, "a damaged or truncated compressed file", "write it again"):
        head, encoding = _decoded(path, options)
    lines = head.removeprefix("\ufeff").splitlines()[:_HEAD_LINES]
    if "\0" in head or not any(line.strip() for line in lines):
        raise DataError(f"{path.name}: not a CSV file, or a damaged or truncated one; write it again.")
    start = next((k for k, line in enumerate(lines) if line.strip() and not _COMMENT.match(line)), len(lines) - 1)
    header = _QUOTED.sub("", lines[start])
    separator = max(_SEPARATORS, key=header.count)
    reader = csv.reader(lines[start:], delimiter=separator, skipinitialspace=True)
    names = [name.strip() for name in next(reader)]
    skip = start + reader.line_num
    if given := as_list(options.columns):
        names, skip, n_columns = given, start, len(names)
        if len(given) != n_columns:
            said = f"<option> names {len(given)} columns, and the first row has {n_columns}; correct it"
            raise DataError(f"{path.name}: {said}.", "columns")
    elif len(names) > 1 and 2 * sum(bool(_WRITTEN_NUMBER.fullmatch(name)) for name in names) > len(names):
        said = f"the first row holds numbers, not names; name its {len(names)} columns with <option>"
        raise DataError(f"{path.name}: {said}, as in a,b,c, or put their names above it.", "columns")
    names = [name or (f"Unnamed: {k}" if k else "") for k, name in enumerate(names)]
    return TextTable(path, tuple(names), skip, separator, encoding, _decimal(lines[skip:], separator), options.on_disk)


def without_suffix(name: str) -> str:
    """The name of a file without ``.csv``, ``.tsv.gz`` and the like."""
    return _SUFFIX.sub("", name)


def _decoded(path: Path, options: ColumnOptions) -> tuple[str, str]:
    """The beginning of a file, and its encoding: UTF-8 or, by its first bytes, UTF-16; else that of Western Windows.

    A `DataError` where its values would not fit in memory.
    """
    for encoding in ("utf-8", "cp1252", "latin-1"):
        n_bytes, head = 0, ""
        with suppress(UnicodeDecodeError), text_bytes(path) as stream:
            while chunk := stream.read(_CHUNK):
                if not n_bytes:
                    encoding = "utf-16" if chunk.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else encoding
                    decoder = codecs.getincrementaldecoder(encoding)()
                n_bytes += len(chunk)
                check_memory(0 if options.on_disk else _MEMORY_PER_BYTE * n_bytes, path.name, options.memory)
                text = decoder.decode(chunk)
                head = head or text
            return head, encoding
    return "", encoding


def _decimal(lines: list[str], separator: str) -> str:
    """A comma where values such as 1,5 occur between other separators, and none such as 1.5."""
    if separator == ",":
        return "."
    values = (value.strip('"') for line in lines for value in line.split(separator))
    signs = {found[1] for value in values if (found := _WRITTEN_NUMBER.fullmatch(value))}
    return "," if "," in signs and "." not in signs else "."
