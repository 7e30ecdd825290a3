"""Mutants of the structure of a file: arrays of other shapes and types, fields of other values, fewer columns."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator
HUGE = 2**40
"""Rows or numbers that a header declares and the file does not hold."""

VALUES: tuple[Any, ...] = (None, -1, 0, 1e300, HUGE, "", "x" * 2000, "../../x", [], {}, [[]], True, "NaN", float("nan"))


def mutate_structure(path: Path, rng: Rng) -> None:
    """Change the structure of a file, or of one of the files of a folder, in 1 to 3 places."""
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    known = [(file, change) for file in files if (change := _change_of(file)) is not None]
    if not known:
        return
    for _ in range(rng.integers(1, 4)):
        file, change = known[rng.integers(len(known))]
        with suppress(Exception):  # a second change of what the first one made unreadable
            change(file, rng)


def _change_of(file: Path) -> Callable[[Path, Rng], None] | None:
    """The function that changes a file of this kind."""
    head = file.read_bytes()[:8]
    if head.startswith(b"\x89HDF"):
        return _hdf5
    if head.startswith(b"PAR1"):
        return _parquet
    if head.startswith(b"PK"):
        return _zip
    if file.suffix in (".json", ".jsonl", ".zarray", ".zattrs", ".zgroup") or file.name in (".zarray", ".zattrs"):
        return _json
    return _text if file.suffix in (".csv", ".tsv", ".txt") else None


def _pick(rng: Rng, values: Any) -> Any:
    return values[rng.integers(len(values))]


def _array(array: np.ndarray[Any, Any], rng: Rng) -> np.ndarray[Any, Any]:
    """An array of another shape, type or value."""
    with np.errstate(all="ignore"):
        changes: list[Callable[[], np.ndarray[Any, Any]]] = [
            lambda: array[: len(array) // 2] if array.ndim else array.reshape(1),
            lambda: np.concatenate([array, array]) if array.ndim else np.array([]),
            lambda: array[:0] if array.ndim else np.array(np.nan),
            lambda: np.array(0.0),
            lambda: array[..., None],
            lambda: array.reshape(-1),
            lambda: array.astype("S3"),
            lambda: np.full(array.shape, np.nan),
            lambda: np.full(array.shape, 2**62),
            lambda: np.zeros(array.shape, dtype=_pick(rng, ["i1", "f2", "c16", "?", "u8", ">f4"])),
            lambda: np.zeros(len(array) if array.ndim else 1, dtype=[("a", "f4"), ("b", "i2")]),
        ]
        return np.asarray(_pick(rng, changes)())


def _hdf5(file: Path, rng: Rng) -> None:
    import h5py

    with h5py.File(file, "r+") as stored:
        names: list[str] = []
        stored.visit(names.append)
        if not names:
            return
        name, kind = _pick(rng, names), rng.integers(6)
        item = stored[name]
        if kind == 0:
            del stored[name]
        elif kind == 1:
            del stored[name]
            stored[name] = _pick(rng, [h5py.SoftLink("/"), h5py.SoftLink("/none"), h5py.ExternalLink("x.hdf5", "/a")])
        elif kind == 2:
            owner = _pick(rng, [stored, item])
            key = _pick(rng, [*owner.attrs, "num_samples", "total", "env_args"])
            value = _pick(rng, [v for v in VALUES if isinstance(v, int | float | str)])
            owner.attrs[key] = value
        elif isinstance(item, h5py.Dataset):
            if item.dtype.kind not in "biufS":
                return
            array = np.asarray(item[()])
            del stored[name]
            if kind == 3:
                kind_of = array.dtype if array.dtype.kind in "biuf" else "f4"
                chunks = (1000, *map(int, array.shape[1:]))
                stored.create_dataset(name, (HUGE, *array.shape[1:]), kind_of, chunks=chunks)
            else:
                stored[name] = _array(array, rng)


def _zip(file: Path, rng: Rng) -> None:
    """Change a member of a ZIP file: an array of NumPy, or JSON of Zarr."""
    with zipfile.ZipFile(file) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name, kind = _pick(rng, sorted(members)), rng.integers(5)
    if kind == 0:
        del members[name]
    elif name.endswith(".npy"):
        stream = io.BytesIO()
        array = np.load(io.BytesIO(members[name]), allow_pickle=False)
        if kind == 1:
            header = {"descr": np.lib.format.dtype_to_descr(array.dtype), "fortran_order": False, "shape": (HUGE, 7)}
            np.lib.format.write_array_header_1_0(stream, header)
        else:
            np.save(stream, _array(array, rng), allow_pickle=False)
        members[name] = stream.getvalue()
    else:
        members[name] = _changed_json(members[name], rng)
    with zipfile.ZipFile(file, "w") as archive:
        for member, content in members.items():
            archive.writestr(member, content)


def _json(file: Path, rng: Rng) -> None:
    file.write_bytes(_changed_json(file.read_bytes(), rng))


def _changed_json(content: bytes, rng: Rng) -> bytes:
    """JSON, or lines of it, with one value that is another or gone."""
    try:
        lines = [json.loads(line) for line in content.splitlines()] if b"\n{" in content else [json.loads(content)]
    except ValueError:
        return content[: len(content) // 2]
    place, holders = [lines], []
    while place:
        holder = place.pop()
        holders.append(holder)
        place += [
            one for one in (holder.values() if isinstance(holder, dict) else holder) if isinstance(one, dict | list)
        ]
    holder = _pick(rng, [one for one in holders if one])
    key = _pick(rng, sorted(holder)) if isinstance(holder, dict) else rng.integers(len(holder))
    if rng.integers(4):
        holder[key] = _pick(rng, VALUES)
    else:
        del holder[key]
    return "\n".join(map(json.dumps, lines)).encode()


def _parquet(file: Path, rng: Rng) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(file)
    if not table.num_columns:
        return
    k, n = int(rng.integers(table.num_columns)), len(table)
    name = table.column_names[k]
    changes: list[Callable[[], pa.Table]] = [
        lambda: table.drop_columns([name]),
        lambda: table.slice(0, n // 2),
        lambda: table.slice(0, 0),
        lambda: table.append_column(name, table[k]),
        lambda: table.set_column(k, name, pa.nulls(n)),
        lambda: table.set_column(k, name, pa.array(["x"] * n)),
        lambda: table.set_column(k, name, pa.array([[1.0] * int(rng.integers(4)) for _ in range(n)])),
        lambda: table.set_column(k, name, pa.array([{"a": 1}] * n)),
        lambda: table.set_column(k, name, pa.array(rng.permutation(n))),
        lambda: table.set_column(k, name, pa.array([np.nan, np.inf, *[0.0] * n][:n])),
        lambda: table.set_column(k, name, pa.array([None, *[1] * n][:n])),
        lambda: table.take(rng.permutation(n)),
    ]
    pq.write_table(_pick(rng, changes)(), file)


def _text(file: Path, rng: Rng) -> None:
    lines = file.read_bytes().split(b"\n")
    k = int(rng.integers(len(lines)))
    changes: list[Callable[[], list[bytes]]] = [
        lambda: [*lines[:k], *lines[k + 1 :]],
        lambda: [*lines[:k], lines[k].partition(b",")[2], *lines[k + 1 :]],
        lambda: [*lines[:k], lines[k] + b",1", *lines[k + 1 :]],
        lambda: [*lines[:k], b'"' + lines[k], *lines[k + 1 :]],
        lambda: [*lines[:k], lines[k].replace(b"0", b"\x00"), *lines[k + 1 :]],
        lambda: [*lines[:k], b"9" * 5000 + lines[k], *lines[k + 1 :]],
        lambda: lines[:k],
        lambda: [lines[0], *lines],
        lambda: [lines[0].replace(b"action", b"observation"), *lines[1:]],
    ]
    file.write_bytes(b"\n".join(_pick(rng, changes)()))
