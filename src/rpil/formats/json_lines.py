"""Lines of JSON: an object for each step."""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
import pyarrow as pa
import pyarrow.json

from rpil.data.errors import guarded
from rpil.data.memory import check_memory, object_in, read_text
from rpil.data.text import counted, natural_key
from rpil.formats import table as flat
from rpil.formats.columns import FILE, ColumnOptions
from rpil.formats.csv import MEMORY_PER_BYTE
from rpil.formats.format import Defect, Format, StepTables, called, from_arrow, plain_columns
from rpil.formats.scan import parts_in_words, without_damaged
from rpil.formats.table_folder import has_tables
from rpil.numerics.types import Array

JSON_SUFFIXES = (".jsonl", ".ndjson", ".catalog")
_LARGEST_BLOCK = (1 << 31) - 1


def claims(path: Path) -> bool:
    """Whether `path` is such a file, or a folder with such files and without tables."""
    return called(*JSON_SUFFIXES)(path) or (path.is_dir() and bool(_files(path)) and not has_tables(path))


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The columns of all lines; an object within an object has a column for each of its parts, as ``observation.x``.

    Where no column tells demonstrations apart, each file of a folder is one.
    """
    files = {file.relative_to(path).as_posix() if path.is_dir() else file.name: file for file in _files(path)}
    check_memory(MEMORY_PER_BYTE * sum(file.stat().st_size for file in files.values()), path.name, options.memory)
    found, damaged = without_damaged(files, lambda name: _parsed(files[name]), options.skip_bad)
    tables = [one.append_column(FILE, pa.repeat(m.rpartition(".")[0], len(one))) for m, one in found.items()]
    table, left = flat.end_to_end(tables, path.name), [_are_left(files[m], one) for m, one in found.items()]
    name, place = "JSON lines" if len(files) == 1 else f"JSON lines, {len(tables):,} files", None
    if n := len(table) - len(rows := np.flatnonzero(np.concatenate(left))):
        table, name, place = table.take(rows), f"{name}, without {counted(n, 'deleted record')}", rows
    steps = from_arrow([table], options, path.name, name, FILE if path.is_dir() else None)
    return replace(steps, sizes={m: len(one) for m, one in found.items()}, place=place, skipped=tuple(damaged))


def _files(path: Path) -> list[Path]:
    """The file at `path`, or those in the folder and in folders in it, but for hidden ones and for ``meta``."""
    if path.is_file():
        return [path]
    found = {m.relative_to(path): m for m in filter(called(*JSON_SUFFIXES), path.rglob("*")) if m.stat().st_size}
    shown = [one for one in found if "meta" not in one.parts and not any(part[0] in "._" for part in one.parts)]
    return [found[one] for one in sorted(shown, key=lambda one: natural_key(one.as_posix()))]


def _parsed(file: Path) -> pa.Table:
    """A row for each line that is not empty, however long; a `DataError` where one holds no object, or several."""
    fault, remedy = "no lines of JSON, or damaged or truncated ones", "write an object of the same kind on each line"
    with guarded(file.name, fault, remedy):
        size = min(file.stat().st_size + 1, _LARGEST_BLOCK)
        table = plain_columns(pa.json.read_json(file, pa.json.ReadOptions(use_threads=False, block_size=size)))
        with file.open("rb") as lines:
            ends = [line[:1] + line[-1:] for line in map(bytes.strip, lines) if line]
        if ends != [b"{}"] * len(table):
            line = next((k for k, end in enumerate(ends, 1) if end != b"{}"), 0)
            raise ValueError(f"line {line:,} holds no object" if line else "a line holds several objects")
        return table


def _are_left(file: Path, table: pa.Table) -> Array:
    """False for the rows of records that Donkeycar only marks as deleted, in the last line of its manifest."""
    manifest = file.with_name("manifest.json")
    if file.suffix != ".catalog" or not manifest.is_file():
        return np.ones(len(table), bool)
    with guarded(manifest, "its last line does not say which records are deleted", "copy it again"):
        deleted = object_in(read_text(manifest).splitlines()[-1])["deleted_indexes"]
        return ~np.isin(table["_index"].to_numpy(), np.array(deleted, np.int64))


def keep_lines(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Copy the lines of the demonstrations `ids`, byte for byte."""
    table, lines = _parsed(path), [line + b"\n" for line in path.read_bytes().split(b"\n") if line.strip()]
    episode = from_arrow([table], options, path.name, "").columns.episode
    names, owners = flat.id_codes(table, episode, lambda _: path.name)
    wanted = np.isin(owners, [k for k, name in enumerate(names) if str(name) in ids]) & _are_left(path, table)
    output.write_bytes(b"".join(line for line, is_wanted in zip(lines, wanted, strict=True) if is_wanted))


_NAMED = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".npy", ".npz", ".mp4", ".avi", ".wav", ".pcd")
_FOLDERS = ("", "images", "IMG", "img")  # where recorders put them beside their table


def find_defects(path: Path) -> Iterator[Defect]:
    """Rows, from 0, of files that are empty, or missing beside others; no link is followed, nor a path that leaves."""
    tables = without_damaged(map(str, _files(path)), lambda name: _parsed(Path(name)))[0]
    is_left = np.concatenate([_are_left(Path(name), one) for name, one in tables.items()])
    table, folder = flat.end_to_end([*tables.values()], path.name), path if path.is_dir() else path.parent
    for name in [one.name for one in table.schema if str(one.type).endswith("string")]:
        texts = [PurePosixPath(str(text or "").strip().replace("\\", "/")) for text in table[name].to_pylist()]
        if not all(text.suffix.lower() in _NAMED for text in texts[:: max(len(texts) // 20, 1)]):
            continue
        named = {str(text.parent) for text in texts if not text.is_absolute() and ".." not in text.parts}
        sizes = dict[str, int]()
        for place in (folder.resolve() / name for name in (*sorted(named)[:20], *_FOLDERS)):
            if place.is_dir() and place.resolve() == place:
                sizes |= {file.name: file.lstat().st_size for file in place.iterdir() if file.is_file()}
        rows = [sizes.get(text.name) for text in texts]
        for size, what in ((0, "empty"), (None, "not there")):
            if any(rows) and (wrong := [row for row in np.flatnonzero(is_left).tolist() if rows[row] == size]):
                where = f"{parts_in_words(wrong, 'row', [])}, {texts[wrong[0]].name} to {texts[wrong[-1]].name}"
                said = f"{len(wrong):,} of the {is_left.sum():,} files that it names are {what}: {where}"
                yield Defect("named files", name, f"{said}; leave these steps out")


FORMAT = Format(
    name="JSON lines",
    claims=claims,
    read=read,
    keep=keep_lines,
    suffixes=JSON_SUFFIXES,
    unkept=lambda path, _: "folder of JSON lines" if path.is_dir() else "",
    find_defects=lambda path, _: [*find_defects(path)],
)
