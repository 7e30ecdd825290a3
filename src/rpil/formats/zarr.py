"""Zarr replay buffers, as diffusion policy and UMI write them: ``data/*`` end to end, and ``meta/episode_ends``."""

from __future__ import annotations

import itertools
import json
import math
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import beside, check_extension, new_folder, replacing
from rpil.data.memory import MIB
from rpil.data.names import is_outcome
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, StepTables, kept_of
from rpil.formats.step_arrays import NUMBERED, Part, StoredArray, from_parts, without_steps
from rpil.formats.zarr_array import HEADERS, ZIP, ArrayHeader, Store, ZarrArray, is_zip, opened
from rpil.numerics.types import Array

_ENDS = "meta/episode_ends"
_ATTRIBUTES = ".zattrs"
_COPIED_BYTES = 64 * MIB  # at a time


_NOTE = "There is no array action: an action is the move of pose and gripper to the next step, none at the last step."
_WHOLE = re.compile(r"robot\d+_demo_(?:start|end)_pose")
"""Arrays that describe a demonstration as a whole."""

_POSE = re.compile(r"robot\d+_(?:eef_pos|eef_rot_axis_angle|gripper_width)")


def claims(path: Path) -> bool:
    """Whether there is a ``meta/episode_ends`` in the folder, or in the file, whose name says that it is a ZIP file.

    A `DataError` where the ZIP file is damaged, or has none at its top.
    """
    if not path.is_dir() and not is_zip(path):
        return False
    with opened(path) as store:
        found = store.header_file(_ENDS) is not None
        names = store.root.root.namelist() if isinstance(store.root, zipfile.Path) and not found else []
    if not found and not path.is_dir():
        inside = f"it holds {names[0]!r:.40} and no {_ENDS}" if names else f"it holds no {_ENDS}"
        remedy = "unpack it, or pack what is in the folder of Zarr, not the folder itself"
        raise DataError(f"{path.name}: {inside} at its top, as a ZIP file of Zarr does; {remedy}.")
    return found


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The recording in the arrays of ``data``, whose demonstrations are numbered from 0; no image is opened.

    A `DataError` where there are none, or where they do not end where the demonstrations do.
    """
    with opened(path) as store:
        headers = _headers(store, "data")
        ends = _ends(store, headers)[1]
        arrays = {array.name.removeprefix("data/"): array for array in _data(store, headers, ends, options)}
        closed = [name for name, array in arrays.items() if array.is_closed]
        if len(closed) == len(arrays):
            raise DataError(
                f"{path.name}: {_ENDS} tells of {len(ends):,} demonstrations and {ends[-1]:,} steps, but no array that "
                f"can be read is in data ({commas(closed) or 'nothing is there'}); copy the data as well."
            )
        whole = {name: "describes a demonstration as a whole" for name in arrays if _WHOLE.fullmatch(name)}
        steps: dict[str, StoredArray] = {name: arrays[name] for name in arrays if name not in (*whole, *closed)}
        actions = _moves(steps, ends) if "action" not in steps and not options.action else {}
        lengths = np.diff(ends, prepend=0)
        notes = (*([_NOTE] if actions else []), *without_steps(np.flatnonzero(lengths == 0).tolist()))
        numbers = np.repeat(np.arange(len(ends)), lengths)
        parts = [Part(len(numbers), {NUMBERED: numbers, **steps, **actions})]
        tables = from_parts(parts, NUMBERED, path.name, "Zarr replay buffer", options, notes=notes)
    return tables.with_ignored({**whole, **dict.fromkeys(closed, "images of the package imagecodecs")})


def _moves(arrays: Mapping[str, StoredArray], ends: Array) -> dict[str, Array]:
    """The action (N, K) by name, of each array (N, K) of poses, as those of UMI's gripper are.

    ``ends`` (M,) are where demonstrations end. A position and a width move by their difference, in the units of the
    file; an orientation, as a rotation vector, by the rotation from one to the next in radians, in the axes of the
    gripper. Where there are no poses there is nothing.
    """
    poses = {name: array for name, array in arrays.items() if _POSE.fullmatch(name) and len(array.shape) == 2}
    found = {}
    for name, array in poses.items():
        now = np.asarray(array[: int(ends[-1])])
        now = now if now.dtype.kind == "f" else now.astype(np.float64)  # differences of whole numbers may not be whole
        then = np.concatenate([now[1:], now[-1:]])
        then[ends[ends > 0] - 1] = now[ends[ends > 0] - 1]
        found[f"action.{name}"] = _turn(now, then) if name.endswith("axis_angle") else then - now
    return found


def _turn(now: Array, then: Array) -> Array:
    """The rotation from one orientation (N, 3) to another as a rotation vector."""
    from scipy.spatial.transform import Rotation

    turn: Array = (Rotation.from_rotvec(now).inv() * Rotation.from_rotvec(then)).as_rotvec()
    return turn.astype(now.dtype)


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions) -> None:
    """Write some demonstrations, in the chunks and codecs of the file, to a new folder, or to a ZIP file for one.

    An array with a chunk for each step is copied chunk by chunk; images that are not decoded must have that.
    """
    with opened(path) as store:
        headers = _headers(store, "data", "meta")
        old_ends, ends = _ends(store, headers)
        chosen = kept_of(range(len(ends)), ids, path)
        lengths = np.diff(ends, prepend=0)
        steps = np.flatnonzero(np.isin(np.repeat(np.arange(len(ends)), lengths), chosen))
        new_ends = np.cumsum(lengths[chosen])
        arrays = _data(store, headers, ends, options, is_outcome)  # zarr leaves out chunks of zeros, as rewards have
        others = [name for name in headers if name.startswith("meta/") and name != _ENDS]
        about = [array for name in others if (array := ZarrArray(store, name, headers[name], fills=True)).shape]
        with _new_store(path, output) as new:
            for old in (*arrays, *about):
                every = np.array(chosen) if old.shape[:1] == ends.shape else np.arange(old.shape[0])
                rows = every if old in about else steps
                created = _create(store, old, new, len(rows))
                if old.stored.shards is None and old.chunks[0] == 1:
                    _copy_chunks(store, old, new, rows)
                else:
                    _copy(old, created, rows)
            _create(store, old_ends, new, len(new_ends)).stored[:] = new_ends.astype(old_ends.dtype)


def _headers(store: Store, *groups: str) -> dict[str, ArrayHeader]:
    """The headers of the ends and of all arrays in `groups` by name, which are checked before any array is opened."""
    headers, waiting = store.headers([_ENDS]), [*groups]
    while waiting:
        names = [f"{group}/{name}" for group in waiting for name in store.folders(group)]
        found = store.headers([name for name in names if name != _ENDS])
        headers, waiting = {**headers, **found}, [name for name in names if name not in (*found, _ENDS)]
    return headers


def _ends(store: Store, headers: Mapping[str, ArrayHeader]) -> tuple[ZarrArray, Array]:
    """The array of where each demonstration ends, and its values (M,), rising."""
    array = ZarrArray(store, _ENDS, headers[_ENDS]) if _ENDS in headers else None
    if array is not None and not array.is_closed and len(array.shape) == 1 and array.dtype.kind in "iu":
        ends = array[:].astype(np.int64)
        if len(ends) and np.all(np.diff(ends, prepend=0) >= 0):
            return array, ends
    raise DataError(
        f"{store.path.name}: {_ENDS} must hold rising numbers of steps, one for each demonstration; repair it."
    )


def _data(
    store: Store,
    headers: Mapping[str, ArrayHeader],
    ends: Array,
    options: ColumnOptions,
    is_filled: Callable[[str], bool] = lambda _: False,
) -> list[ZarrArray]:
    """The arrays in ``data``; a `DataError` where one has another number of rows than there are steps."""
    arrays = [
        ZarrArray(store, name, header, ends, is_filled(name.rpartition("/")[2]))
        for name, header in headers.items()
        if name.startswith("data/")
    ]
    for array in arrays:
        if array.shape[:1] != (ends[-1],):
            raise DataError(
                f"{array.where} has the shape {array.shape}, but {_ENDS} ends at {ends[-1]:,} steps; write it again."
            )
    return arrays


@contextmanager
def _new_store(path: Path, output: Path) -> Iterator[Store]:
    """A folder to fill, which becomes `output`: as it is, or a ZIP file where `path` is one."""
    if path.is_dir():
        with new_folder(output) as folder:
            yield Store(folder, folder)
        return
    with replacing(check_extension(output, [ZIP])) as temporary, beside(output) as folder:
        folder.mkdir()
        yield Store(folder, folder)
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:  # chunks are compressed already
            for file in sorted(file for file in folder.rglob("*") if file.is_file()):
                archive.write(file, file.relative_to(folder))


def _create(store: Store, old: ZarrArray, new: Store, n_rows: int) -> ZarrArray:
    """A new array of a new store that is stored as an `old` one is, in the groups that hold it."""
    header = {**old.header, "shape": [n_rows, *old.shape[1:]]}
    is_2 = header["zarr_format"] == 2
    folder = new.path / old.name
    folder.mkdir(parents=True)
    (folder / HEADERS[not is_2]).write_text(json.dumps(header))
    for place in (folder, *folder.parents[: old.name.count("/") + 1]):
        name, file = place.relative_to(new.path).as_posix(), place / (".zgroup" if is_2 else HEADERS[1])
        if place != folder and file.exists():
            break  # with all groups above, of an array before
        if place != folder:
            about = {} if is_2 else {"node_type": "group", "attributes": store.attributes_3(name)}
            file.write_text(json.dumps({"zarr_format": header["zarr_format"], **about}))
        if (attributes := store.root / name / _ATTRIBUTES).is_file():
            (place / _ATTRIBUTES).write_bytes(attributes.read_bytes())
    return ZarrArray(new, old.name, header)


def _copy(old: ZarrArray, new: ZarrArray, rows: Array) -> None:
    """Write the `rows` of an array to a new one, some at a time, also chunks that hold the fill value only."""
    if old.is_closed:
        raise DataError(
            f"{old.where} holds images of the package imagecodecs, several steps in a chunk, which cannot be "
            "parted here; write it again with a chunk for each step, or take the array out."
        )
    row_bytes = max(old.dtype.itemsize * math.prod(old.shape[1:]), 1)
    step = max(_COPIED_BYTES // (row_bytes * old.chunks[0]), 1) * old.chunks[0]
    for first in range(0, len(rows), step):
        new.stored[first : first + step] = old.take(rows[first : first + step])


def _copy_chunks(store: Store, old: ZarrArray, new: Store, rows: Array) -> None:
    """Copy the chunks of an array with one for each step, as they are: ``17.0.0`` holds step 17."""
    for row, old_row in enumerate(rows.tolist()):
        for place in itertools.product(*map(range, old.grid[1:])):
            chunk = store.root / old.chunk_file((old_row, *place))
            if chunk.is_file():  # a chunk that is left out stays so
                target = new.path / old.chunk_file((row, *place))
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(chunk.read_bytes())


FORMAT = Format(name="Zarr", claims=claims, read=read, keep=keep, has_own_ids=True, suffixes=(ZIP,))
