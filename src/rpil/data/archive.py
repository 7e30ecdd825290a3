"""Archives of frozen records, without pickle: a ZIP file of plain ``.npy`` arrays and one ``header.json``.

The header is a tree: numbers and text stand for themselves; an array is named by its member of the archive; an object
is the name of a class that `stored` registered, and its fields. `Decoder` makes objects of those classes only, and only
where every array has the type and the shape that the class says.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.data.files import StrPath, replacing

VERSION = 5
"""Of the format: a file of another version is refused."""

_HEADER = "header.json"
_STEPS = (np.float64, np.float32)  # the latter where there are very many
_TYPES: dict[str, tuple[type, ...]] = {"offsets": (np.int64,), "step_log_ratio": _STEPS, "step_weight": _STEPS}

Class = TypeVar("Class", bound=type)

NOT_STORED = {"stored": False}
"""Metadata of a dataclass field that files do not hold; it has a default."""


@dataclass(frozen=True)
class Stored:
    """A class whose objects an archive may hold.

    Attributes
    ----------
    kind : type
        A dataclass.
    axes : dict of str to str
        The axes of each array field, see `stored`.
    renews : tuple of str
        Letters that stand for new sizes from here on.
    """

    kind: type
    axes: dict[str, str]
    renews: tuple[str, ...]


CLASSES: dict[str, Stored] = {}
"""Registered classes by their names in files."""


def stored(*, name: str | None = None, renews: tuple[str, ...] = (), **axes: str) -> Callable[[Class], Class]:
    """Register a dataclass whose objects an archive may hold.

    Parameters
    ----------
    name : str, optional
        Name of the class in files; by default its name in the code.
    renews : tuple of str
        Letters that stand for new sizes after an object of this class: those of the columns that a feature map makes.
    **axes : str
        The axes of each array field: a number, or a letter that means one size all through the file, perhaps plus one.
        D observations, F features, K actions or A parts of one, B bins, M demonstrations, N steps, Q quantiles.
    """

    def register(kind: Class) -> Class:
        CLASSES[name or kind.__name__] = Stored(kind, axes, renews)
        return kind

    return register


def rpil_version() -> str:
    """The installed version of rpil."""
    return version("rpil")


def write_archive(path: StrPath, header: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """A header and arrays to a file, all of it or nothing."""
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(_member(_HEADER), json.dumps(header, indent=1))
        for name, array in arrays.items():
            stream = io.BytesIO()
            npy.write_array(stream, array, allow_pickle=False)
            archive.writestr(_member(f"{name}.npy"), stream.getvalue())


def _member(name: str) -> zipfile.ZipInfo:
    """An entry of the archive without the time of day, so that the same model is the same file."""
    info = zipfile.ZipInfo(name)
    info.external_attr = 0o600 << 16  # readable when unpacked
    return info


def encode(value: Any, name: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """`value` as a node of the header; its arrays go to `arrays`, under names that begin with `name`."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufU":
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple | list):
        return [encode(item, f"{name}/{k}", arrays) for k, item in enumerate(value)]
    if isinstance(value, Mapping):
        return {"pairs": [[encode(part, name, arrays) for part in pair] for pair in value.items()]}
    class_name = stored_name(value)
    if class_name is None:
        raise TypeError(type(value).__name__)
    content = {f: encode(getattr(value, f), f"{name}/{f}", arrays) for f in _field_names(type(value))}
    return {"class": class_name, "fields": content}


def stored_name(value: object) -> str | None:
    """The name in files of the class of `value`; None where an archive may not hold it."""
    return next((name for name, known in CLASSES.items() if known.kind is type(value)), None)


def _field_names(known: type) -> list[str]:
    """What an object is made of; private fields are what a computation remembers for speed."""
    return [
        field.name for field in fields(known) if not field.name.startswith("_") and field.metadata.get("stored", True)
    ]


class Decoder:
    """Nodes of a header back to values, each array used once and checked against the sizes seen before."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self.arrays = dict(arrays)
        self.sizes: dict[str, int] = {}

    def array(self, node: Any, axes: str, *dtypes: type) -> NDArray[Any]:
        """The array that `node` names; axes as in `stored`."""
        array = self.arrays.pop(node["array"])
        letters = axes.split()
        if array.ndim != len(letters) or (dtypes and array.dtype not in dtypes):
            raise ValueError(node)
        for size, letter in zip(array.shape, letters, strict=True):
            letter, _, more = letter.partition("+")
            expected = int(letter) if letter.isdigit() else self.sizes.setdefault(letter, size - int(more or 0))
            if size != expected + int(more or 0):
                raise ValueError(node)
        if array.dtype.kind == "f" and np.isnan(array).any():
            raise ValueError(node)
        return array

    def value(self, node: Any) -> Any:
        """What `encode` was given; lists come back as tuples."""
        if isinstance(node, list):
            return tuple(self.value(item) for item in node)
        if not isinstance(node, dict):
            return node
        if node.keys() == {"pairs"}:
            return {self.value(key): self.value(value) for key, value in node["pairs"]}
        known, content = CLASSES[node["class"]], node["fields"]
        if node.keys() != {"class", "fields"} or content.keys() != set(_field_names(known.kind)):
            raise KeyError(node["class"])
        shapes = known.axes
        self.sizes = {letter: size for letter, size in self.sizes.items() if letter not in known.renews}
        return known.kind(
            **{
                name: self.array(part, shapes[name], *_TYPES.get(name, (np.float64,)))
                if name in shapes
                else self.value(part)
                for name, part in content.items()
            }
        )


def read_archive(path: Path, schema: str, otherwise: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header, of the right schema and version, and every array of the archive; what to say of another file."""
    foreign = f"{path}: {otherwise}."
    if not zipfile.is_zipfile(path):
        with path.open("rb") as file:
            started = file.read(2) == b"PK"
        raise DataError(f"{path}: it is damaged or truncated; fit and save it again." if started else foreign)
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            header = json.loads(archive.read(_HEADER)) if _HEADER in names else None
            if not isinstance(header, dict) or header.get("schema") != schema:
                raise DataError(foreign)
            _check_version(path, header)
            arrays = {name.removesuffix(".npy"): _array(archive.read(name)) for name in names if name != _HEADER}
    except DataError:
        raise
    except Exception as error:  # a damaged file makes zipfile, zlib, tokenize and numpy raise whatever they like
        if "allow_pickle" in str(error):
            raise DataError(
                f"{path}: it holds Python objects, which are never unpickled because that can run any code; "
                "fit and save it again."
            ) from error
        raise DataError(f"{path}: it is damaged or truncated; fit and save it again.") from error
    if len(set(names)) < len(names):
        raise DataError(f"{path}: it holds two arrays of one name; fit and save it again.")
    return header, arrays


def _check_version(path: Path, header: dict[str, Any]) -> None:
    version, made_by = header.get("version"), header.get("rpil")
    if version != VERSION:
        raise DataError(
            f"{path}: rpil {made_by} saved it in version {version!r} of the format, but rpil {rpil_version()} reads "
            f"version {VERSION}; use that rpil, or fit and save again."
        )


def _array(content: bytes) -> NDArray[Any]:
    stream = io.BytesIO(content)
    array: NDArray[Any] = npy.read_array(stream, allow_pickle=False)
    if stream.read(1):
        raise ValueError("bytes after the array")
    return array
