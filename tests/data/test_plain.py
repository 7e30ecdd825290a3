"""Records as JSON and back: the same bits, and nothing but the types that the record declares."""

from __future__ import annotations

import json
import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pytest

from rpil.data.plain import from_plain, to_plain
from rpil.numerics.types import Array, Float


@dataclass(frozen=True)
class Inner:
    word: Literal["a", "b"]
    number: float = 1.0


@dataclass(frozen=True, eq=False)
class Record:
    names: tuple[Hashable, ...]
    pair: tuple[int, float]
    values: Float[Array, "M 2"]
    maybe: Float[Array, " M"] | None
    inner: tuple[Inner, ...]
    more: Mapping[Hashable, Inner]
    flag: bool
    any: object = None
    texts: Mapping[str, str | int] = field(default_factory=dict)


def record(**changes):
    values = np.array([[0.1, -0.0], [math.nan, -math.inf]])
    given = {"names": ("x", 3), "pair": (1, 2.5), "values": values, "maybe": None, "inner": (Inner("a"),)}
    return Record(
        **given | {"more": {3: Inner("b", math.inf)}, "flag": True, "any": ["x"], "texts": {"a": "b", "c": 1}} | changes
    )


@pytest.mark.parametrize("maybe", [None, np.float32([0.1, 3e38]), np.array([1, 2**62])])
def test_a_record_comes_back_bit_for_bit(maybe):
    given = record(maybe=maybe)
    again = from_plain(json.loads(json.dumps(to_plain(given), allow_nan=False)), Record)
    assert again.values.tobytes() == given.values.tobytes()
    assert (maybe is None) == (again.maybe is None)
    if maybe is not None:
        assert (again.maybe.tobytes(), again.maybe.dtype) == (maybe.tobytes(), maybe.dtype)
    for name in ("names", "pair", "inner", "more", "flag", "any", "texts"):
        assert getattr(again, name) == getattr(given, name)


ARRAY = {"type": "float64", "shape": [1, 2], "values": [1.0, 2.0]}


@pytest.mark.parametrize(
    "change",
    [
        {"names": "xy"},
        {"names": [["a"]]},
        {"names": [None]},
        {"pair": [1]},
        {"pair": [1, 2, 3]},
        {"pair": ["1", 2]},
        {"pair": [1, "1"]},
        {"pair": [1, True]},
        {"values": None},
        {"values": [1.0]},
        {"values": ARRAY | {"shape": [3]}},
        {"values": ARRAY | {"shape": [-1, 2]}},
        {"values": ARRAY | {"values": ["x", 1.0]}},
        {"values": ARRAY | {"values": [[1.0], [2.0]]}},
        {"values": ARRAY | {"type": "object"}},
        {"values": ARRAY | {"type": "int64"}},
        {"values": ARRAY | {"more": 1}},
        {"inner": [{"word": "c", "number": 1.0}]},
        {"inner": [{"word": "a"}]},
        {"inner": [{"word": "a", "number": 1.0, "more": 1}]},
        {"more": {"a": 1}},
        {"more": 1},
        {"more": [[1]]},
        {"flag": "yes"},
        {"texts": {"a": 1.5}},
        {"texts": [[1, "a"]]},
        {"other": 1},
    ],
)
def test_what_is_of_another_type_is_refused(change):
    with pytest.raises((TypeError, ValueError, KeyError, AttributeError)):
        from_plain(to_plain(record()) | change, Record)


@pytest.mark.parametrize("value", [{1}, b"x", object(), np.array(["x"])])
def test_what_json_does_not_have_is_refused(value):
    with pytest.raises(TypeError):
        to_plain(value)
