"""A run: the view of an audit as a JSON file, from which its page can be made again.

It may come from anybody. So what is read is compared with the shape that `rpil.results.view` describes, and sizes are
bounded; a page shows it as text and never as code.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
from collections.abc import Callable, Mapping
from typing import NoReturn

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_readable, replacing
from rpil.results.drawings import MAX_BINS
from rpil.results.view import FORMAT_NAME, FORMAT_VERSION, MAX_DRAWN, MAX_FOUND, View

MAX_RUN_BYTES = 64 * 2**20
MAX_RUN_DEMONSTRATIONS = 100_000
MAX_RUN_TEXT = 20_000
"""Characters of a text."""
MAX_RUN_LIST = 10_000
"""Entries of a list that does not have one for each demonstration."""
MAX_RUN_NUMBER = 1e15

Check = Callable[[object, str], None]
"""Raises `_Other` with the place of a value that is not as it should be."""


class _Other(Exception):
    """A value is not as it should be; the text is a clause that says what."""


def write_run(path: StrPath, view: View) -> None:
    """Write a view to a .json file."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(view, allow_nan=False) + "\n", encoding="ascii")


def read_run(path: StrPath) -> View:
    """The view in a file that `write_run` wrote; a `DataError` where it is something else."""
    if check_readable(path).stat().st_size > MAX_RUN_BYTES:
        raise DataError(f"{path}: it is larger than {MAX_RUN_BYTES // 2**20} MB, as no run is; give one.")
    with open(path, "rb") as file:
        content = file.read()
    try:
        view = json.loads(content, parse_constant=_no_number)
        if not isinstance(view, dict) or view.get("format") != FORMAT_NAME:
            raise _Other("it does not say that it is one")
        if view.get("version") != FORMAT_VERSION:
            raise DataError(f"{path}: another version of rpil wrote it; run rpil audit --save with this one.")
        _record(_shape(view))(view, "")
    except (_Other, ValueError, RecursionError) as error:
        reason = str(error) if isinstance(error, _Other) else "it is not JSON"
        raise DataError(f"{path}: it is no run of rpil audit --save: {reason}; write it again.") from error
    return view


def _no_number(name: str) -> NoReturn:
    raise _Other(f"it holds {name}")


def _of(wanted: bool, where: str, what: str) -> None:
    if not wanted:
        raise _Other(f"{where.removeprefix('.')[:80] or 'it'} is not {what}")


def _text(value: object, where: str) -> None:
    _of(isinstance(value, str) and len(value) <= MAX_RUN_TEXT, where, f"a text of up to {MAX_RUN_TEXT:,} characters")


def _matching(pattern: str) -> Check:
    def check(value: object, where: str) -> None:
        _of(isinstance(value, str) and re.fullmatch(pattern, value, re.DOTALL) is not None, where, "as it should be")

    return check


def _among(values: Mapping[str, object] | tuple[object, ...]) -> Check:
    return lambda value, where: _of(isinstance(value, str) and value in values, where, "one of those that may be")


def _number(value: object, where: str) -> None:
    is_one = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_RUN_NUMBER
    _of(is_one, where, "a number")


def _share(value: object, where: str) -> None:
    _number(value, where)
    _of(isinstance(value, int | float) and 0 <= value <= 1, where, "a share")


def _whole(end: float) -> Check:
    """A whole number from 0 on, below `end`."""
    return lambda value, where: _of(type(value) is int and 0 <= value < end, where, "a whole number in its range")


def _equal(number: int) -> Check:
    return lambda value, where: _of(value == number and type(value) is int, where, f"{number}")


def _flag(value: object, where: str) -> None:
    _of(isinstance(value, bool), where, "true or false")


def _optional(check: Check) -> Check:
    return lambda value, where: None if value is None else check(value, where)


def _each(check: Check, size: int | None = None, most: int = MAX_RUN_LIST) -> Check:
    """A list of `size` values, or of any number up to `most`."""

    def check_all(value: object, where: str) -> None:
        is_list = isinstance(value, list) and (len(value) <= most if size is None else len(value) == size)
        _of(is_list, where, "a list of the right length")
        for k, one in enumerate(value if isinstance(value, list) else ()):
            check(one, f"{where}[{k}]")

    return check_all


def _record(fields: Mapping[str, Check]) -> Check:
    """A dict with these keys and no others."""

    def check_all(value: object, where: str) -> None:
        _of(isinstance(value, dict) and set(value) == set(fields), where, f"a record of {', '.join(fields)}")
        for name, check in fields.items():
            check(value[name] if isinstance(value, dict) else None, f"{where}.{name}")

    return check_all


def _mapping(key: Check, check: Check) -> Check:
    """A dict with any keys like `key`."""

    def check_all(value: object, where: str) -> None:
        _of(isinstance(value, dict) and len(value) <= MAX_RUN_LIST, where, "a mapping of a size that may be")
        for name, one in value.items() if isinstance(value, dict) else ():
            key(name, where)
            check(one, f"{where}.{name}")

    return check_all


def _any(value: object, where: str) -> None:
    _of(len(json.dumps(value)) <= MAX_RUN_BYTES // 16, where, "short")


def _shape(view: View) -> dict[str, Check]:
    """The shape of a view, given how many demonstrations and which words it has."""
    columns, counts = view.get("demonstrations"), view.get("counts")
    ids = columns.get("id") if isinstance(columns, dict) else None
    n_steps = columns.get("n_steps") if isinstance(columns, dict) else None
    _each(_text, most=MAX_RUN_DEMONSTRATIONS)(ids, "demonstrations.id")
    size = len(ids) if isinstance(ids, list) else 0
    _each(_whole(MAX_RUN_NUMBER), size)(n_steps, "demonstrations.n_steps")
    _of(size > 0, "demonstrations.id", "the ids of any")
    steps = dict(enumerate(n_steps if isinstance(n_steps, list) else ()))
    words: dict[str, object] = counts if isinstance(counts, dict) else {}
    interval, texts, member = {"mean": _share, "low": _share, "high": _share}, _each(_text), _whole(size)
    counted = _record(dict.fromkeys(words, _whole(MAX_RUN_NUMBER)))
    return {
        **dict.fromkeys(("format", "run", "title", "source", "adversary", "question", "command"), _text),
        "version": _number,
        "seconds": _optional(_number),
        "finding": _record({"name": _text, "sentence": _text, "next": _text, "decided": _flag}),
        "words": _record(dict.fromkeys(("upper", "lower", "probability", "meaning"), _text) | {"threshold": _share}),
        "sides": _record(dict.fromkeys(words, _among(("upper", "open", "lower")))),
        "counts": counted,
        "share": _record(interval),
        "mean_weight": _share,
        "pair": _each(member, most=2),
        **dict.fromkeys(("doubts", "notes", "assumptions", "lost", "read", "differ"), texts),
        "contradicting": _each(member),
        "answers": _each(_answer(size), most=MAX_RUN_DEMONSTRATIONS),
        "demonstrations": _columns(size, words, bool(view.get("whole_ids"))),
        "whole_ids": _flag,
        "n_review": _whole(size + 1),
        "demonstrators": _each(_record({**interval, "name": _text, "n": _whole(size + 1), "counts": counted})),
        "faults": _faults(view.get("faults"), member),
        "fps": _optional(_positive),
        "lerobot": _flag,
        "hub": _matching(r"([\w.-]{1,100}/[\w.-]{1,100})?"),
        "provenance": _mapping(_text, _any),
        "drawings": _drawings(steps),
    }


def _positive(value: object, where: str) -> None:
    _number(value, where)
    _of(isinstance(value, int | float) and value > 0, where, "above 0")


def _answer(size: int) -> Check:
    def check(value: object, where: str) -> None:
        _of(isinstance(value, list) and len(value) == 2, where, "a demonstration and a word")
        if isinstance(value, list):
            _whole(size)(value[0], where)
            _text(value[1], where)

    return check


def _columns(size: int, words: Mapping[str, object], whole: bool) -> Check:
    """The columns of `size` demonstrations with these words."""
    texts, numbers, shares = _each(_text, size), _each(_number, size), _each(_share, size)
    steps = _whole(MAX_RUN_NUMBER)
    fields = _record(
        {
            "id": _each(_matching(r"-?\d{1,20}" if whole else ".{1,1000}"), size),
            "verdict": _each(_among(words), size),
            "log_odds": numbers,
            **dict.fromkeys(("p", "reliability", "low", "high"), shares),
            "n_steps": _each(_whole(MAX_RUN_NUMBER), size),
            **dict.fromkeys(("reason", "task", "demonstrator", "session"), texts),
            "evidence": _mapping(_text, numbers),
            "worst": _each(_each(steps, most=100), size),
            "stretch": _each(_optional(_each(steps, 2)), size),
            "look": _each(_whole(size), size),
            "group": _each(_among(("", "A", "B")), size),
            "order": _each(_whole(size + 1), most=size),
            "facts": _mapping(_text, shares),
        }
    )

    def check(value: object, where: str) -> None:
        fields(value, where)
        if isinstance(value, dict):
            _of(len(set(value["look"])) == size, f"{where}.look", "an order of all")
            _of(len(value["order"]) in (0, size), f"{where}.order", "of all")

    return check


def _faults(faults: object, member: Check) -> Check:
    found = faults.get("found") if isinstance(faults, dict) else None
    size = len(found["rule"]) if isinstance(found, dict) and isinstance(found.get("rule"), list) else 0
    step = _whole(MAX_RUN_NUMBER)
    own = {
        "rule": _each(_text, most=MAX_FOUND),
        "demonstration": _each(_optional(member), size),
        "first": _each(step, size),
        "last": _each(step, size),
        "sentence": _each(_text, size),
    }
    return _record(
        {
            "kinds": _each(_record({"rule": _text, "words": _text, "n": step})),
            "found": _record(own if found else {}),
            "not_checked": _each(_record({"reason": _text, "rules": _each(_text)})),
            "usual": _each(_text),
        }
    )


def _drawings(steps: Mapping[int, int]) -> Check:
    """Drawings of demonstrations with so many `steps`."""

    def check(value: object, where: str) -> None:
        _of(isinstance(value, dict) and len(value) <= MAX_DRAWN, where, f"up to {MAX_DRAWN} drawings")
        for name, drawn in value.items() if isinstance(value, dict) else ():
            _of(name.isascii() and name.isdigit() and len(name) < 9 and int(name) in steps, where, "of demonstrations")
            bins = min(steps[int(name)], MAX_BINS)
            part: dict[str, Check] = {"name": _text, "share": _share}
            fields: dict[str, Check] = {
                "bins": _equal(bins),
                "ratio": _curves(bins, ("min", "mean", "max")),
                "trust": _curves(bins, ("mean",)),
                "parts": _each(_curves(bins, ("value", "low", "high"), part), most=10),
            }
            _record(fields)(drawn, f"{where}.{name}")

    return check


def _curves(bins: int, names: tuple[str, ...], others: Mapping[str, Check] = {}) -> Check:
    def packed(value: object, where: str) -> None:
        try:
            size = len(base64.b64decode(value if isinstance(value, str) else "", validate=True))
        except (binascii.Error, ValueError):
            size = -1
        _of(size == bins, where, f"a curve of {bins} bins")

    return _record({"from": _number, "to": _number, **dict.fromkeys(names, packed), **others})
