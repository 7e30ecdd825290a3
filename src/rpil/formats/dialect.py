"""How a text table is written: its encoding, its separator, its decimal sign, the names of its columns, its rows."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence, Set
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from rpil.data.errors import DamagedError, DataError
from rpil.data.guard import guarded
from rpil.data.held import held_bytes
from rpil.data.memory import MIB, check_memory
from rpil.formats.columns import ColumnOptions
from rpil.formats.scan import damaged_lines

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
_SUFFIX = re.compile(r"\.(?:csv|tsv|txt)(?:\.gz)?$", re.IGNORECASE)
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_HEAD_LINES = 200
MEMORY_PER_BYTE = 4  # of a file whose numbers have four characters
_CHUNK = 16 * MIB
_MOST_JOINED = MIB  # lines that are looked at again, because quotations join them
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
        damaged = [f"row {n}: {fault}, at line {line}" for n, line, _, _, fault in rows if fault]
        if damaged:
            raise damaged_lines(self.path.name, damaged)


TextRow = tuple[int, int, list[str], list[str], str]
"""A row of a text table: its number among the rows of values and that of its first line, both from 1; its lines with
their ends; its values, of which a comment, an empty line and the header have none; and what is wrong with it."""


def text_rows(file: TextTable) -> Iterator[TextRow]:
    """The header of a text table and all of its rows, so that each line is in one of them.

    Where a quotation joins rows, its first line is damaged, and those after it are rows again.
    """
    waiting, n_columns, n_joined = deque[str](), len(file.names), 0
    numbers: Set[int] | None = None  # columns that hold numbers in the first row
    with file.lines() as source:

        def ahead(taken: list[str]) -> Iterator[str]:
            while one := waiting.popleft() if waiting else next(source, ""):
                taken.append(one)
                yield one

        number, line, lines = 0, 1, [*itertools.islice(source, file.skip_rows)]
        yield number, line, lines, [], ""
        while True:
            line, lines, values, fault = line + len(lines), list[str](), list[str](), ""
            try:
                values = next(csv.reader(ahead(lines), delimiter=file.separator), [])
            except csv.Error:
                fault = f"a value has more than {csv.field_size_limit():,} characters"
            if not lines:
                return
            is_wrong = len(values) != n_columns
            if len(lines) > 1 and (is_wrong or _are_several_rows(lines, values, file.separator, numbers)):
                fault = f"a quotation begins and does not end in {lines[0].strip()[-40:]!r}"
                waiting.extendleft(reversed(lines[1:]))
                n_joined += len(lines)
                del lines[1:]
            elif values and is_wrong and not lines[0].lstrip().startswith("#"):
                fault = f"{len(values)} values for {n_columns} columns in {lines[0].strip()[:40]!r}"
            elif number and not is_wrong and tuple(map(str.strip, values)) == file.names:
                fault = "it repeats the names of the columns, as where files were joined"
            elif numbers is None and values and not is_wrong:
                numbers = _numbers_in(values)
            if n_joined > _MOST_JOINED:
                raise DamagedError(f"{file.path.name}: very many quotations begin and do not end; write it again.")
            values = [] if fault or is_wrong else values
            number += bool(values or fault)
            yield number, line, lines, values, fault


def _are_several_rows(lines: Sequence[str], values: Sequence[str], separator: str, numbers: Set[int] | None) -> bool:
    """Whether lines that a quotation joins to a row of `values` are rows of their own.

    So it is where the quotation has no end, or one of the lines has as many values, and `numbers` in these columns: on
    the first line those after the quotation count, on the last one those before it.
    """
    try:
        next(csv.reader(lines, delimiter=separator, strict=True))
    except csv.Error:
        return True
    quoted, last = next((k for k, value in enumerate(values) if "\n" in value or "\r" in value), 0), len(lines) - 1
    for place, line in enumerate(lines):
        own = next(csv.reader([line.replace('"', "")], delimiter=separator), [])
        found, more = _numbers_in(own), len(own) - len(values)  # as a text may hold the separator
        due = [k for k in numbers or () if (place > 0 or k > quoted) and (place < last or k <= quoted)]
        is_row = place and found if numbers is None else due
        if more >= 0 and is_row and all(k + more * (k > quoted) in found for k in due):
            return True
    return False


def _numbers_in(values: Sequence[str]) -> set[int]:
    return {k for k, value in enumerate(values) if _WRITTEN_NUMBER.fullmatch(value)}


@contextmanager
def text_bytes(path: Path) -> Iterator[pa.NativeFile]:
    """The bytes of a text table, decompressed."""
    with held_bytes(path) as file:
        stream = pa.PythonFile(file)
        yield pa.CompressedInputStream(stream, "gzip") if path.suffix.lower() == ".gz" else stream


def find_dialect(path: Path, options: ColumnOptions) -> TextTable:
    """The dialect of a file, which may be compressed; a `DataError` where it is no text or has no names of columns."""
    with guarded(path.name, "a damaged or truncated compressed file", "write it again"):
        head, encoding, n_lines = _decoded(path, options)
    lines = head.removeprefix("\ufeff").splitlines()[:_HEAD_LINES]
    if "\0" in "".join(lines[:1]) or not any(line.strip() for line in lines):
        raise DamagedError(f"{path.name}: not a CSV file, or a damaged or truncated one; write it again.")
    start = next((k for k, line in enumerate(lines) if line.strip() and not _COMMENT.match(line)), len(lines) - 1)
    header = _QUOTED.sub("", lines[start])
    separator = max(_SEPARATORS, key=header.count)
    reader = csv.reader(lines[start:], delimiter=separator, skipinitialspace=True)
    names = [name.strip() for name in next(reader)]
    skip = start + reader.line_num
    if reader.line_num > 1 and _are_several_rows(lines[start:skip], names, separator, None):
        said = f"a quotation begins and does not end in {lines[start].strip()[-40:]!r}, its names of columns"
        raise DamagedError(f"{path.name}, line {start + 1}: {said}; correct it.")
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
    damaged = (range(line, line + len(lines)) for _, line, lines, _, fault in text_rows(file) if fault)
    return replace(file, skipped=[*itertools.chain(*damaged)])


def without_suffix(name: str) -> str:
    """The name of a file without ``.csv``, ``.tsv.gz`` and the like."""
    return _SUFFIX.sub("", name)


def _decoded(path: Path, options: ColumnOptions) -> tuple[str, str, int]:
    """The beginning of a file; its encoding, UTF-8 or, by its first bytes, UTF-16, else that of Western Windows; and
    the number of its lines if there is a quotation mark.

    A `DataError` where its values would not fit in memory.
    """
    for encoding in ("utf-8", "cp1252", "latin-1"):
        n_bytes, n_lines, head, text, is_quoted = 0, 0, "", "", False
        with suppress(UnicodeDecodeError), text_bytes(path) as stream:
            while chunk := stream.read(_CHUNK):
                if not n_bytes:
                    encoding = "utf-16" if chunk.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else encoding
                    decoder = codecs.getincrementaldecoder(encoding)()
                n_bytes += len(chunk)
                check_memory(0 if options.on_disk else MEMORY_PER_BYTE * n_bytes, path.name, options.memory)
                text = decoder.decode(chunk)
                head, is_quoted = head or text, is_quoted or '"' in text
                n_lines += text.count("\n") + text.count("\r") - text.count("\r\n")
            return head, encoding, is_quoted * (n_lines + (not text.endswith(("\n", "\r"))))
    return "", encoding, 0
