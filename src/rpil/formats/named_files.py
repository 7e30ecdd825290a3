"""Whether the files that a table names, such as pictures, are there and hold something."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pyarrow as pa

from rpil.formats.format import Defect
from rpil.formats.scan import parts_in_words

_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".npy", ".npz", ".mp4", ".avi", ".wav", ".pcd")
_FOLDERS = ("", "images", "IMG", "img")  # where recorders put them beside their table


def in_table(table: pa.Table, folder: Path) -> Iterator[Defect]:
    """Rows, from 0, that name files that are empty, or not there though others are; no path out of the folder, and no
    link, is followed."""
    for name in [one.name for one in table.schema if str(one.type).endswith("string")]:
        texts = [PurePosixPath(str(text or "").strip().replace("\\", "/")) for text in table[name].to_pylist()]
        if not texts or not all(text.suffix.lower() in _SUFFIXES for text in texts[:: max(len(texts) // 20, 1)]):
            continue
        named = {str(text.parent) for text in texts if not text.is_absolute() and ".." not in text.parts}
        sizes = dict(entry for place in (*sorted(named)[:20], *_FOLDERS) for entry in _sizes(folder.resolve() / place))
        rows = [sizes.get(text.name) for text in texts]
        for size, what in ((0, "empty"), (None, "not there")):
            if any(rows) and (wrong := [row for row, own in enumerate(rows) if own == size]):
                where = f"{parts_in_words(wrong, 'row', [])}, {texts[wrong[0]].name} to {texts[wrong[-1]].name}"
                said = f"{len(wrong):,} of the {len(texts):,} files that it names are {what}: {where}"
                yield Defect("named files", name, f"{said}; leave these steps out")


def in_text(path: Path) -> Iterator[Defect]:
    """The same of a text table with a head, whose first row names files."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as lines:
        rows = csv.DictReader(lines)
        first = next(rows, {})
        if names := [name for name, text in first.items() if str(text).strip().lower().endswith(_SUFFIXES)]:
            every = [first, *rows]
            yield from in_table(pa.table({name: [str(row.get(name)) for row in every] for name in names}), path.parent)


def _sizes(place: Path) -> Iterator[tuple[str, int]]:
    if place.is_dir() and place.resolve() == place:
        with os.scandir(place) as entries:
            yield from ((e.name, e.stat(follow_symlinks=False).st_size) for e in entries if e.is_file())
