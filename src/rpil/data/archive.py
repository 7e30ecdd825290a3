"""Archives of arrays (NPZ) and of frozen dataclasses, without pickle: the latter have a ``header.json`` beside arrays.

The header is a tree of JSON values: numbers and text stand for themselves; an array is named by its member of the
archive; an object is the name of a class that `stored` registered, and its fields. `Decoder` makes objects of
registered classes only, and checks the fields, and the shape of every array, against the class. Settings check their
values where they are made.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.lib import format as npy

from rpil.data.arrays import as_array
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_readable, replacing
from rpil.data.memory import LARGEST_TABLE, check_memory, check_text
from rpil.numerics.regression import ErrorSettings
from rpil.numerics.types import Array

VERSION = 19
"""Version of the format; a file of another version is refused."""

MEMBER = ".npy"  # end of the names of members that hold an array
_HEADER, _SCHEMA, _REMEDY = "header.json", "rpil fitted estimator", "fit and save it again"

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]
Class = TypeVar("Class", bound=type)

NOT_STORED = {"stored": False}
"""Metadata of a dataclass field that files do not hold; it has a default."""

CLASSES: dict[str, tuple[type, Mapping[str, str], tuple[str, ...]]] = {}
"""Registered classes by their names in files, with the axes of their arrays and the `renews` of `stored`."""


def stored(*, renews: tuple[str, ...] = (), **axes: str) -> Callable[[Class], Class]:
    """Register a dataclass whose objects an archive may hold.

    Parameters
    ----------
    renews : tuple of str
        Letters that stand for new sizes after an object of this class: those of the columns that a feature map makes.
    **axes : str
        The axes of each array field, in double precision. Axes are numbers, or letters, each of which means one size in
        the whole file, perhaps plus one ("F+1 K"). D observations, F features, K actions or A parts of one, B bins,
        M demonstrations.
    """

    def register(kind: Class) -> Class:
        CLASSES[kind.__name__] = kind, axes, renews
        return kind

    return register


def write_archive(path: StrPath, header: Mapping[str, object], arrays: Mapping[str, Array]) -> None:
    """Write a header and arrays to a file, which is whole or not there."""
    header = {"schema": _SCHEMA, "version": VERSION, "rpil": version("rpil")} | dict(header)
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        with archive.open(_HEADER, "w") as member:
            member.write(json.dumps(header, indent=1).encode())
        write_arrays(archive, arrays)


def encode(value: object, name: str, arrays: dict[str, Array]) -> Json:
    """`value` as a node of the header; its arrays are added to `arrays` under names that begin with `name`.

    A `TypeError` names a class that is not registered, or that of the estimator that such an object is made of.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufU":
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple | list):
        return [encode(item, f"{name}/{k}", arrays) for k, item in enumerate(value)]
    kind = type(value)
    if kind not in (registered for registered, *_ in CLASSES.values()):
        raise TypeError(type(getattr(value, "estimator", value)).__name__)
    content = {f: encode(getattr(value, f), f"{name}/{f}", arrays) for f in _field_names(kind)}
    return {"class": kind.__name__, "fields": content}


def _field_names(kind: type) -> list[str]:
    """The stored fields of a class: private ones are caches, see also `NOT_STORED`."""
    return [f.name for f in fields(kind) if not f.name.startswith("_") and f.metadata.get("stored", True)]


class Decoder:
    """Converts nodes of a header to values. Each array is used once, and checked against the sizes of those before."""

    def __init__(self, arrays: Mapping[str, Array]) -> None:
        self.arrays = dict(arrays)
        self.sizes: dict[str, int] = {}

    def array(self, node: Any, axes: str) -> Array:
        """The array that `node` names; a `ValueError` or `KeyError` where it is missing, or has other axes."""
        array, letters = self.arrays.pop(node["array"]), axes.split()
        if array.dtype != np.float64 or array.ndim != len(letters) or np.isnan(array).any():
            raise ValueError(axes)
        for size, letter in zip(array.shape, letters, strict=True):
            letter, _, more = letter.partition("+")
            expected = int(letter) if letter.isdigit() else self.sizes.setdefault(letter, size - int(more or 0))
            if size != expected + int(more or 0):
                raise ValueError(axes)
        return array

    def value(self, node: object) -> Any:
        """The value that `encode` made the `node` from; lists come back as tuples.

        An error of some type where a part of it is not what its class declares.
        """
        if isinstance(node, list):
            return tuple(self.value(item) for item in node)
        if not isinstance(node, dict):
            return node
        (kind, axes, renews), content = CLASSES[node["class"]], node["fields"]
        if node.keys() != {"class", "fields"} or content.keys() != set(_field_names(kind)):
            raise KeyError(node["class"])
        self.sizes = {letter: size for letter, size in self.sizes.items() if letter not in renews}
        values = {}
        for name, part in content.items():
            is_array = name in axes and part is not None
            values[name] = self.array(part, axes[name]) if is_array else self.value(part)
        return kind(**values)


def read_archive(path: StrPath) -> tuple[dict[str, Any], dict[str, Array]]:
    """The header and all arrays of an archive.

    A `DataError` where the file is none, damaged, of another version, compressed, or too large for the memory. Who
    decodes the header refuses arrays that it does not name.
    """
    path = check_readable(path)
    foreign = f"{path}: it is no policy that rpil saved; make one with rpil fit, or rpil.save."
    with path.open("rb") as file:
        if file.read(2) != b"PK":
            raise DataError(foreign)
    with guarded(path, "it is damaged or truncated", _REMEDY), zipfile.ZipFile(path) as archive:
        members, header = archive.namelist(), None
        if _HEADER in members:
            if sum(info.file_size for info in archive.infolist()) > path.stat().st_size:  # what rpil saves is as it is
                raise DataError(f"{path}: its parts hold more than the file, as rpil saves none; {_REMEDY}.")
            with archive.open(_HEADER) as file:
                check_text(content := file.read(LARGEST_TABLE + 1), f"{path}, {_HEADER}", LARGEST_TABLE)
            header = json.loads(content)
        if not isinstance(header, dict) or header.get("schema") != _SCHEMA:
            raise DataError(foreign)
        if header.get("version") != VERSION:
            who, saved = (str(header.get(name))[:20] for name in ("rpil", "version"))
            made = f"rpil {who} saved it in version {saved} of the format"
            here = f"rpil {version('rpil')} reads version {VERSION}"
            raise DataError(f"{path}: {made}, but {here}; use that rpil, or {_REMEDY}.")
        members.remove(_HEADER)
        names = [member.removesuffix(MEMBER) for member in members]
        arrays = dict(zip(names, read_arrays(archive, members, str(path)), strict=True))
        if len(arrays) < len(members):
            raise DataError(f"{path}: its parts do not belong together; {_REMEDY}.")
    return header, arrays


def read_arrays(archive: zipfile.ZipFile, members: Sequence[str], where: str) -> list[Array]:
    """The arrays in `members`.

    A `DataError` where they would not fit in memory, or one holds Python objects; where one is damaged, an error of
    another type, such as `ValueError`.
    """
    n_bytes, arrays = 0, []
    for member in members:
        shape, dtype, n_before = array_head(archive, member)
        if dtype.hasobject:
            raise DataError(
                f"{where}: {member!r} holds Python objects, which are never unpickled because that can run any code; "
                "save plain arrays of numbers or text, with numpy.asarray(values.tolist()) where they are objects."
            )
        if math.prod(shape) * dtype.itemsize != archive.getinfo(member).file_size - n_before:
            raise ValueError(member)
        n_bytes += math.prod(shape) * (dtype.itemsize + 8)  # and a copy as float64
    check_memory(n_bytes, where)
    for member in members:
        with archive.open(member) as stream:
            arrays.append(as_array(npy.read_array(stream, allow_pickle=False), f"the values of {member!r}", where))
    return arrays


def write_npz(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write an NPZ file. Arrays may have any names; to `numpy.savez_compressed` some are arguments of its own."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        write_arrays(archive, arrays)


def write_arrays(archive: zipfile.ZipFile, arrays: Mapping[str, Array]) -> None:
    """Add arrays as members ``NAME.npy``; a `ValueError` where one holds Python objects."""
    for name, array in arrays.items():
        with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:  # without the time of writing
            npy.write_array(stream, array, allow_pickle=False)


def array_head(archive: zipfile.ZipFile, member: str) -> tuple[tuple[int, ...], np.dtype[np.generic], int]:
    """The shape and the type that an array says it has, and the bytes before its values."""
    with archive.open(member) as stream:
        is_first = npy.read_magic(stream) == (1, 0)
        shape, _, dtype = (npy.read_array_header_1_0 if is_first else npy.read_array_header_2_0)(stream)
        return shape, dtype, stream.tell()


stored()(ErrorSettings)  # here, because numerics knows nothing of archives

Record = TypeVar("Record")


@dataclass_transform(frozen_default=True)
def settings_record(**intervals: str) -> Callable[[type[Record]], type[Record]]:
    """Make a class a frozen dataclass that an archive may hold, whose numbers lie in these intervals.

    See `check_settings`; a ``__post_init__`` of the class may check more.
    """

    def decorate(kind: type[Record]) -> type[Record]:
        check_more = getattr(kind, "__post_init__", None)

        def check(settings: Any) -> None:
            check_settings(settings, **intervals)
            if check_more:
                check_more(settings)

        kind.__post_init__ = check  # type: ignore[attr-defined]
        return stored()(dataclass(frozen=True)(kind))

    return decorate


def check_settings(settings: Any, **intervals: str) -> None:
    """Raise a `DataError` that names the first field of a dataclass with a number outside its interval.

    An interval is written as in mathematics, such as "[0, 1)"; by default it is "[1, inf)" for fields whose default is
    a whole number, and "(0, inf)" for others. Fields that default to something else than numbers are not checked, nor
    is a None that the type of the field allows.
    """
    for field in fields(settings):
        value, default = getattr(settings, field.name), field.default
        kind, numbers = (type(default[0]), value) if isinstance(default, tuple) else (type(default), (value,))
        if kind not in (int, float) or (value is None and "None" in str(field.type)):
            continue
        interval = intervals.get(field.name, "[1, inf)" if kind is int else "(0, inf)")
        if not isinstance(numbers, tuple) or not numbers or not all(_is_in(x, interval, kind) for x in numbers):
            noun = "whole number" if kind is int else "number"
            must = f"a tuple of {noun}s, each" if isinstance(default, tuple) else f"a {noun}"
            raise DataError(f"{type(settings).__name__}: {field.name}={value!r} must be {must} in {interval}.")


def _is_in(value: object, interval: str, kind: type) -> bool:
    low, high = map(float, interval[1:-1].split(","))
    if not isinstance(value, int | float | np.integer | np.floating) or (kind is int and not float(value).is_integer()):
        return False
    above = low <= value if interval[0] == "[" else low < value
    return bool(above and (value <= high if interval[-1] == "]" else value < high))
