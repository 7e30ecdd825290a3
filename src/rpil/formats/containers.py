"""HDF5 and Zarr as containers of named arrays, whose values are read when they are asked for; and copies of HDF5 files.

No link is followed, because links lead to other files, or in circles. An array is read only if all its values are in
the file: the libraries read missing ones as the fill value. A header of Zarr names the codecs that the library calls
with the contents of the file, and some codecs run code: no value of an array is read with one that is not listed here.
"""

from __future__ import annotations

import json
import math
import re
import warnings
import zipfile
from collections.abc import Container, Mapping, Set
from contextlib import suppress
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpil.data.errors import DataError, guarded, optional
from rpil.data.files import check_readable
from rpil.data.memory import MIB, check_free
from rpil.data.text import natural_key
from rpil.formats.array_layout import ROLES, Arrays
from rpil.formats.columns import ColumnOptions
from rpil.formats.scan import commas
from rpil.formats.step_arrays import Closed, is_value
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import h5py
    import zarr

_SMALL, _ROOM = 65_536, 64 * MIB
"""Bytes of an array that is read when its shape is asked for, and of all of them in a file."""

ZIP = ".zip"
"""The extension of stores of Zarr in a ZIP file; a file of another name is never taken for one."""

(_ENDS,) = ROLES["offsets"]
_HEADER_FILE = re.compile(rf"(data(?:/(?!\.\.?/)[^/\\]+)+|{_ENDS})/(?:\.zarray|zarr\.json)")
_CODECS = {
    *("bytes", "transpose", "sharding_indexed", "zlib", "gzip", "bz2", "zstd", "blosc", "lz4", "shuffle", "delta"),
    *("fixedscaleoffset", "quantize", "crc32", "crc32c", "adler32", "fletcher32", "vlen-utf8"),
}
_IMAGES, _CLOSED = "imagecodecs_", "images of the package imagecodecs"
_DAMAGED_HEADER = "its header is damaged, or of an unknown format", "copy or write it again"
_DAMAGED_CHUNK = "a chunk of it is damaged, or does not hold what the header declares", "copy or write it again"


def open_hdf5(path: Path, options: ColumnOptions = ColumnOptions()) -> tuple[h5py.File, Arrays]:
    """The file, which is closed with its arrays, and these by path: each is opened when it is asked for.

    Each group is visited once, in whatever circles hard links lie. A `DataError` where this is no file of HDF5, or it
    is damaged, a `MissingExtraError` without h5py.
    """
    h5py, kinds = optional("h5py", f"{path.name} is HDF5, which", "hdf5"), dict[bytes, int]()
    with guarded(path.name, "no HDF5 file, or a damaged one", "copy or write it again"):
        file = h5py.File(check_readable(path), "r")
        file.id.links.visit(lambda place, link: kinds.update({place: link.type}), info=True)
        is_hard = {m.decode("utf-8", "surrogateescape"): kind == h5py.h5l.TYPE_HARD for m, kind in kinds.items()}
        groups = {place.rpartition("/")[0] for place in is_hard}
        leaves = [place for place in sorted(is_hard, key=natural_key) if place not in groups]
        room = [_ROOM]
        found = {place: _FileArray(file, place, room) for place in leaves if is_hard[place]}
        links = [place for place in leaves if place not in found]
        notes = (f"Not read, because they are links: {commas(links)}.",) if links else ()
        return file, Arrays(found, path.name, "HDF5", options, partial(_attributes, file), notes)


def _attributes(file: h5py.File, group: str) -> dict[str, Closed]:
    """The attributes of a group, which are read when they are asked for: None where one is no number and no text."""
    text = np.dtype(object, metadata={"vlen": str})  # what an array may be of which more is known when it is read

    def read(name: str, _: object) -> object:
        stored = (found := file[group].attrs).get_id(name)
        is_one = stored.shape in ((), (1,)) and stored.dtype.itemsize <= _SMALL and is_value(stored.dtype)
        return found[name] if is_one else None

    return {name: Closed((), text, partial(read, name)) for name in file[group].attrs if isinstance(name, str)}


class _FileArray:
    """An array that is read only if all its values are in the file, and fit in memory; of others nothing is known.

    It is open while it is read: HDF5 takes twice the time where thousands are open at once. So a small array is read
    when its shape is asked for, while there is `room` for it.
    """

    def __init__(self, file: h5py.File, path: str, room: list[int]) -> None:
        self._file, self._path, self._room = file, path, room

    def _opened(self) -> h5py.h5d.DatasetID | None:
        import h5py

        where = self._file.id, self._path.encode("utf-8", "surrogateescape")
        try:
            one = h5py.h5d.open(*where)  # faster than by its class
        except KeyError:  # maybe a type, or a group of nothing
            if not isinstance(one := h5py.h5o.open(*where), h5py.h5d.DatasetID):
                return None
        is_away = one.get_offset() is None and (h5py.Dataset(one).is_virtual or h5py.Dataset(one).external)
        return None if is_away else one

    @cached_property
    def _seen(self) -> tuple[tuple[int, ...], np.dtype[Any], Array | None]:
        """Shape and type, as the file says; and the values of a small array."""
        import h5py

        if (stored := self._opened()) is None:
            return (), np.dtype(object), None
        shape, dtype = tuple(stored.shape or ()), stored.dtype
        n_bytes, values = math.prod(shape) * dtype.itemsize, None
        if 0 < n_bytes <= min(_SMALL, self._room[0]) and stored.get_offset() is not None and not dtype.hasobject:
            with suppress(OSError):  # which is said where it is read
                stored.read(h5py.h5s.ALL, h5py.h5s.ALL, found := np.empty(shape, dtype))
                values, self._room[0] = found, self._room[0] - n_bytes
        return shape, dtype, values

    @property
    def shape(self) -> tuple[int, ...]:
        """As the file says."""
        return self._seen[0]

    @property
    def dtype(self) -> np.dtype[Any]:
        """As the file says."""
        return self._seen[1]

    def __getitem__(self, rows: slice) -> object:
        import h5py

        if (values := self._seen[2]) is not None:
            return values[rows]
        n_rows = len(range(*rows.indices(*self.shape[:1]))) if isinstance(rows, slice) else 0
        check_free(n_rows * math.prod(self.shape[1:]) * self.dtype.itemsize)
        if (stored := self._opened()) is not None and stored.get_offset() is None:  # values do not lie together
            self._check_chunks(h5py.Dataset(stored))
        return h5py.Dataset(stored)[rows]

    def _check_chunks(self, stored: h5py.Dataset) -> None:
        """An error where chunks are missing, or their bytes in the file are more than their values take."""
        where = f"{Path(self._file.filename).name}: {self._path}"
        grid = [-(-size // step) for size, step in zip(self.shape, stored.chunks or self.shape, strict=True) if step]
        n_chunks, n_bytes = math.prod(grid) if stored.size else 0, stored.id.get_storage_size()
        n_there = stored.id.get_num_chunks() if stored.chunks and n_chunks else int(n_bytes > 0)
        if n_there < n_chunks:
            fault = f"declares the shape {self.shape}, but {n_there:,} of its {n_chunks:,} chunks are in the file"
            raise DataError(f"{where} {fault}; copy or write it again.")
        chunk_bytes = math.prod(stored.chunks or ()) * self.dtype.itemsize
        check_free(chunk_bytes)
        if stored.chunks and n_bytes > n_there * (2 * chunk_bytes + 4096):
            raise DataError(f"{where}: its chunks hold more than they declare; copy or write it again.")


def keep_groups(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write the demonstrations called `ids`, and all else of the file, to a new one; filter keys name no others."""
    import h5py

    source, arrays = open_hdf5(path, options)
    within, found = arrays.groups()
    try:
        with h5py.File(output, "w") as new:
            dropped = found.keys() - ids
            _copy(source, new, {"mask", within.strip("/")} if within else {"mask", *dropped})
            if within:
                _copy(source[within], new.create_group(within), dropped)
            if "total" in (about := new[within or "/"].attrs):
                about["total"] = sum(part.n_steps for name, part in found.items() if name in ids)
            for key, one in arrays.arrays.items():
                if key.startswith("mask/") and one.shape:
                    listed = [name for name in np.asarray(one[:]).tolist() if name.decode() in ids]
                    new[key] = np.array(listed, dtype="S")
    except (OSError, RuntimeError) as error:  # of h5py, for a write that failed
        if failed := re.search(r"errno = (\d+)", str(error)):
            raise OSError(int(failed[1]), "write failed") from error
        raise


def _copy(group: h5py.Group, new: h5py.Group, without: Container[str]) -> None:
    """Copy the attributes of a group and its members, but for links and those that are to be left out."""
    import h5py

    for name, value in group.attrs.items():
        new.attrs[name] = value
    for name in group:
        if name not in without and isinstance(group.get(name, getlink=True), h5py.HardLink):
            group.copy(name, new)


def is_zarr(path: Path) -> bool:
    """Whether ``meta/episode_ends`` is in the folder, or a file has a name that says that it is a ZIP file."""
    is_zip = path.suffix.lower() == ZIP and path.is_file()
    return is_zip or any((path / _ENDS / header).is_file() for header in (".zarray", "zarr.json"))


def open_zarr(path: Path, options: ColumnOptions) -> Arrays:
    """The arrays of a replay buffer of diffusion policy: ``data/*`` end to end, and ``meta/episode_ends``.

    Of images none is opened. A `DataError` where this is no such store, or it is damaged.
    """
    storage = optional("zarr.storage", "To read Zarr", "zarr")
    with guarded(path.name, "no ZIP file, or a damaged one", "copy or write it again"):
        if path.is_dir():
            store, inside = storage.LocalStore(path), (file for file in path.rglob("*") if file.is_file())
            files = {file.relative_to(path).as_posix(): file.stat().st_size for file in inside}
        else:
            with zipfile.ZipFile(path) as archive:
                files = {info.filename: info.file_size for info in archive.infolist()}
            store = storage.ZipStore(path)
        headers = sorted(filter(_HEADER_FILE.fullmatch, files), key=lambda name: name.split("/"))
        found = {name.rpartition("/")[0]: _array(store, files, path.name, name) for name in headers}
    images = {name.removeprefix("data/"): why for name, why in found.items() if isinstance(why, str) and why}
    arrays = {name.removeprefix("data/"): array for name, array in found.items() if isinstance(array, Closed)}
    if _ENDS not in arrays:
        remedy = "pack what is in the folder of Zarr, not the folder itself, or unpack the file where it holds none"
        raise DataError(f"{path.name}: there is no {_ENDS} of numbers at the top of it; {remedy}.")
    if not arrays.keys() - {_ENDS}:
        there = ", ".join(images) or "nothing is there"
        raise DataError(f"{path.name}: no array that can be read is in data ({there}); copy the data as well.")
    return Arrays(arrays, path.name, "Zarr replay buffer", options, unread=images)


def _array(store: zarr.abc.store.Store, files: Mapping[str, int], where: str, header: str) -> Closed | str:
    """An array of a store, whose rows are read when they are asked for; why it is not read; no text of a group."""
    from zarr import Group, open

    name = header.rpartition("/")[0]
    with guarded(where := f"{where}: {name}", *_DAMAGED_HEADER), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what in format 3 other libraries may not read
        warnings.filterwarnings("error", ".*The stored chunk shape .* is invalid")  # zarr 3.4 reads another one
        check_free(100 * files[header])  # bytes that JSON may take for each of its own
        try:
            array = open(store=store, path=name, mode="r", use_consolidated=False)
        except Exception as error:  # of several types, where the codec is unknown
            if _IMAGES in str(error):
                return _CLOSED
            if isinstance(error, Warning):
                raise ValueError(error) from error
            raise
        if isinstance(array, Group):
            return ""
        about, shape, dtype, chunks = array.metadata.to_dict(), array.shape, array.dtype, array.shards or array.chunks
        assert math.prod(array.chunks), "chunks hold something"
    codecs = json.dumps([about.get(part) for part in ("filters", "compressor", "codecs")], default=str)
    names = {name.removeprefix("numcodecs.") for name in re.findall(r'"(?:id|name)": "([^"]*)"', codecs)}
    if any(name.startswith(_IMAGES) for name in names):
        return _CLOSED
    unknown = [f"the codec {name[:60]!r}" for name in names - _CODECS]
    if unknown or dtype.kind not in "biufSUTmM":
        fault = f"is stored with {unknown[0] if unknown else dtype}, which is not read, because it may run code"
        remedy = "store numbers or text with a codec such as blosc, zstd or gzip, or take the array out"
        raise DataError(f"{where} {fault}; {remedy}.")
    own = {file.removeprefix(f"{name}/"): n_bytes for file, n_bytes in files.items() if file.startswith(f"{name}/")}
    check = cache(lambda: _check_chunks(array, chunks, own, where))

    def rows_of(rows: slice) -> object:
        first, stop, _ = rows.indices(shape[0])
        with guarded(where):
            check_free(dtype.itemsize * max(math.prod(chunks), (stop - first) * math.prod(shape[1:])))
        check()
        with guarded(where, *_DAMAGED_CHUNK):
            return np.asarray(array[first:stop])

    return Closed(shape, dtype, rows_of)


def _check_chunks(array: zarr.Array, chunks: tuple[int, ...], files: Mapping[str, int], where: str) -> None:
    """A `DataError` where chunks are missing, or a file holds more than filters make of a chunk: 8 bytes of one."""
    grid = [-(-size // step) for size, step in zip(array.shape, chunks, strict=True)]
    places = np.ndindex(*grid) if (n_chunks := math.prod(grid)) <= len(files) else ()
    found = [files[key] for at in places if (key := array.metadata.encode_chunk_key(at)) in files]
    if n_chunks > len(found):
        remedy = "copy it again, or write it with zarr.config.set({'array.write_empty_chunks': True})"
        raise DataError(f"{where}: {n_chunks - len(found):,} of its {n_chunks:,} chunks are not there; {remedy}.")
    most = 8 * array.dtype.itemsize * math.prod(chunks) + 4096 * (math.prod(chunks) // math.prod(array.chunks))
    if array.dtype.kind != "T" and max(found, default=0) > most:
        raise DataError(f"{where}: {'; '.join(_DAMAGED_CHUNK)}.")
