"""Records as plain values of JSON, and back: a record says of which types its fields are, and no others are made."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from rpil.data.json_files import Parsed
from rpil.numerics.types import Array

Hint = Any
"""A type, as a record declares it."""

_NOT_FINITE = ("nan", "inf", "-inf")
"""Numbers that JSON does not have, as text."""


def to_plain(value: object) -> object:
    """`value`, a record or a part of one, as numbers, text, lists and dicts; a `TypeError` where it is something else.

    An array is its type, its shape and its values; a mapping whose keys are not all text is a list of pairs.
    """
    if isinstance(value, np.ndarray) and value.dtype.kind in "fi":
        return {"type": str(value.dtype), "shape": list(value.shape), "values": to_plain(value.ravel().tolist())}
    if is_dataclass(value):
        return {field.name: to_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: to_plain(part) for key, part in value.items()}
    if isinstance(value, Mapping):
        return [[to_plain(part) for part in pair] for pair in value.items()]
    if isinstance(value, tuple | list):
        return [to_plain(part) for part in value]
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(type(value).__name__)


def from_plain(node: Parsed, hint: Hint) -> Parsed:
    """The value of the type `hint` that `to_plain` made the `node` from; an error of some type where it is no such."""
    origin: Hint = get_origin(hint)
    args = get_args(hint)
    if np.ndarray in (hint, origin) or hasattr(hint, "array_type"):  # which shape-checked arrays of the tests have
        return _array(**node)
    if is_dataclass(hint):
        hints = get_type_hints(hint)
        if node.keys() != {field.name for field in fields(hint)}:
            raise KeyError(hint)
        return hint(**{name: from_plain(part, hints[name]) for name, part in node.items()})  # type: ignore[operator]
    if origin in (Union, UnionType):
        kinds = [arg for arg in args if (node is None) == (arg is type(None))]
        return from_plain(node, next((kind for kind in kinds if type(node) is kind), kinds[0]))
    if isinstance(node, list) and origin is tuple:
        args = (args[0],) * len(node) if args[-1] is ... else args
        return tuple(from_plain(part, kind) for part, kind in zip(node, args, strict=True))
    if isinstance(node, list | dict) and isinstance(origin, type) and issubclass(origin, Mapping):
        pairs = node.items() if isinstance(node, dict) else node
        return {from_plain(key, args[0]): from_plain(part, args[1]) for key, part in pairs}
    if hint is float and type(node) in (int, float, str):
        return _number(node)
    allowed: Hint = str | int | float | bool if hint is Hashable else hint
    if node not in args if origin is Literal else not isinstance(node, allowed):
        raise TypeError(hint)
    return node


def _array(type: str, shape: list[int], values: list[float | str]) -> Array:
    if type not in ("float64", "float32", "int64"):
        raise TypeError(type)
    if type == "int64" and not all(isinstance(value, int) for value in values):
        raise TypeError(values)
    array = np.array([_number(value) if type != "int64" else value for value in values], dtype=type).reshape(shape)
    if list(array.shape) != shape:
        raise ValueError(shape)
    return array


def _number(node: float | str) -> float:
    if isinstance(node, bool) or (isinstance(node, str) and node not in _NOT_FINITE):
        raise TypeError(node)
    return float(node)
