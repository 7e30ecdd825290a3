"""How a text table is written: its encoding, its separator, its decimal sign, the names of its columns, its rows."""

from __future__ import annotations

import codecs
import csv
import io
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from rpil.data.errors import DamagedError, DataError
from rpil.data.guard import guarded
from rpil.data.memory import MIB, check_memory
from rpil.formats.columns import ColumnOptions
from rpil.formats.scan import damaged_lines

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
_SUFFIX = re.compile(r"\.(?:csv|tsv|txt)(?:\.gz)?$", re.IGNORECASE)
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_HEAD_LINES = 200
MEMORY_PER_BYTE = 4  # of a file whose numbers have four characters
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
    n_lines: int  # or more, where parts that are read end within an end of line; 0 where nothing is quoted
    skipped: Sequence[int] = ()  # damaged lines, counted from 1, that are not read

    @property
    def words(self) -> str:
        """Words for what is unusual about it."""
        found = [f"separated by {_SEPARATORS[self.separator]}"] if self.separator != "," else []
        found += ["decimal commas"] if self.decimal == "," else []
        found += [self.encoding] if self.encoding != "utf-8" else []
        return ", ".join(["CSV", *found])

    @contextmanager
    def without_skipped(self) -> Iterator[pa.NativeFile]:
        """The bytes of the lines that are not skipped, as UTF-8."""
        skipped = {*self.skipped}
        with tempfile.TemporaryFile() as copy, self.lines() as lines:
            copy.writelines(line.encode() for number, line in enumerate(lines, 1) if number not in skipped)
            copy.seek(0)
            yield pa.PythonFile(copy)

    @contextmanager
    def lines(self) -> Iterator[Iterator[str]]:
        """All lines, with their ends."""
        with text_bytes(self.path) as stream, io.TextIOWrapper(stream, self.encoding, newline="") as lines:
            yield lines

    def check(self) -> None:
        """A `DataError` that names the first damaged line, where there is one that is not skipped."""
        rows = () if self.skipped else text_rows(self)
        damaged = [f"line {number:,}: {fault}" for number, _, _, fault in rows if fault]
        if damaged:
            raise damaged_lines(self.path.name, damaged)


TextRow = tuple[int, str, list[str], str]
"""A line of a text table: its number, from 1; the line with its end; its values, of which a comment, an empty line and
the header have none; and what is wrong with it."""


def text_rows(file: TextTable) -> Iterator[TextRow]:
    """All lines of a text table: each is one row, so that a quotation ends in its line."""
    with file.lines() as source:
        for number, line in enumerate(source, 1):
            if number <= file.skip_rows or not line.strip():
                yield number, line, [], ""
                continue
            values, fault = list[str](), ""
            try:
                values = next(csv.reader([line], delimiter=file.separator, strict=True))
            except csv.Error:
                fault = f"a quotation begins and does not end in {line.strip()[-40:]!r}; a line is a row"
            if not fault and len(values) != len(file.names) and line.lstrip().startswith("#"):
                values = []
            elif not fault and len(values) != len(file.names):
                fault = f"{len(values)} values for {len(file.names)} columns in {line.strip()[:40]!r}"
            elif not fault and tuple(map(str.strip, values)) == file.names:
                fault = "it repeats the names of the columns, as where files were joined"
            yield number, line, values, fault


@contextmanager
def text_bytes(path: Path) -> Iterator[pa.NativeFile]:
    """The bytes of a text table, decompressed."""
    with path.open("rb") as file:
        stream = pa.PythonFile(file)
        yield pa.CompressedInputStream(stream, "gzip") if path.suffix.lower() == ".gz" else stream


def find_dialect(path: Path, options: ColumnOptions) -> TextTable:
    """The dialect of a file, which may be compressed; a `DataError` where it is no text or has no names of columns."""
    with guarded(path.name, "a damaged or truncated compressed file", "write it again"):
        head, encoding, n_lines = _decoded(path, options)
    lines = head.removeprefix("\ufeff").splitlines()[:_HEAD_LINES]
    if "\0" in "".join(lines[:1]) or not any(line.strip() for line in lines):
        raise DamagedError(
            f"{path.name}: not a CSV file, or a damaged or truncated one, or UTF-16; write it again, as UTF-8."
        )
    start = next((k for k, line in enumerate(lines) if line.strip() and not _COMMENT.match(line)), len(lines) - 1)
    header = _QUOTED.sub("", lines[start])
    separator = max(_SEPARATORS, key=header.count)
    reader = csv.reader(lines[start : start + 1], delimiter=separator, skipinitialspace=True)
    names = [name.strip() for name in next(reader)]
    if header.count('"') % 2:
        said = f"a quotation begins and does not end in {lines[start].strip()[-40:]!r}, its names of columns"
        raise DamagedError(f"{path.name}, line {start + 1}: {said}; correct it.")
    skip = start + 1
    if len(names) > 1 and 2 * sum(bool(_WRITTEN_NUMBER.fullmatch(name)) for name in names) > len(names):
        said = f"the first row holds numbers, not names; put the names of its {len(names)} columns above it"
        raise DataError(f"{path.name}: {said}, or give a frame in Python, as pandas.read_csv(FILE, names=[...]).")
    names = [name or (f"Unnamed: {k}" if k else "") for k, name in enumerate(names)]
    cells = (cell.strip('"') for line in lines[skip:] if separator != "," for cell in line.split(separator))
    signs = {found[1] for cell in cells if (found := _WRITTEN_NUMBER.fullmatch(cell))}
    decimal = "," if "," in signs and "." not in signs else "."
    file = TextTable(path, tuple(names), skip, separator, encoding, decimal, options.on_disk, n_lines)
    if not options.skip_bad:
        return file
    return replace(file, skipped=[number for number, _, _, fault in text_rows(file) if fault])


def without_suffix(name: str) -> str:
    """The name of a file without ``.csv``, ``.tsv.gz`` and the like."""
    return _SUFFIX.sub("", name)


def _decoded(path: Path, options: ColumnOptions) -> tuple[str, str, int]:
    """The beginning of a file; its encoding, UTF-8 or that of Western Windows; and the number of its lines if there
    is a quotation mark.

    A `DataError` where its values would not fit in memory.
    """
    for encoding in ("utf-8", "cp1252"):
        decoder, n_bytes, n_lines, head, text, is_quoted = codecs.getincrementaldecoder(encoding)(), 0, 0, "", "", False
        with suppress(UnicodeDecodeError), text_bytes(path) as stream:
            while chunk := stream.read(_CHUNK):
                n_bytes += len(chunk)
                check_memory(0 if options.on_disk else MEMORY_PER_BYTE * n_bytes, path.name, options.memory)
                text = decoder.decode(chunk)
                head, is_quoted = head or text, is_quoted or '"' in text
                n_lines += text.count("\n") + text.count("\r") - text.count("\r\n")
            return head, encoding, is_quoted * (n_lines + (not text.endswith(("\n", "\r"))))
    return "", "", 0
