"""A run: the view of an audit as a JSON file, from which its page can be made again.

Another person may have written it. So what is read is compared with the shape that `rpil.results.view` describes, and
sizes are bounded; a page shows it as text and never as code.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
import shlex
from collections.abc import Callable, Container, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_readable, replacing
from rpil.data.json_files import Parsed, check_text, read_text
from rpil.inference.contrast import MAX_PARTS
from rpil.results.traces import MAX_POINTS
from rpil.results.view import FORMAT_NAME, FORMAT_VERSION, MAX_DRAWINGS, MAX_FOUND, View

MAX_RUN_BYTES = 64 * 2**20
MAX_RUN_DEMONSTRATIONS = 100_000
MAX_RUN_TEXT = 20_000
"""Characters of a text."""
MAX_RUN_LIST = 10_000
"""Entries of a list that does not have one for each demonstration, and of a dict."""
MAX_RUN_NUMBER = 1e15
MAX_RUN_DEPTH = 8
"""Of the values of the provenance."""
NOT_IN_A_RUN = ("report", "weights", "verdicts", "keep", "save", "scheduler")
"""Options of ``rpil audit`` that no command of a page has: files to write, and an address that may send code."""


@dataclass(frozen=True)
class _Each:
    """The shape of a list: of its values, and how many there are."""

    shape: Shape
    sizes: Container[int] = range(MAX_RUN_LIST + 1)


@dataclass(frozen=True)
class _Named:
    """The shape of a dict with any keys: of its values."""

    shape: Shape


Test = Callable[[object], bool]
Shape = Test | _Each | _Named | Mapping[str, "Shape"]
"""Of a value: what tells whether it is right, or the shape of its parts; a mapping has all keys of a dict."""


class _OtherShape(Exception):
    """A value has another shape; the text is where."""


def write_run(path: StrPath, view: View) -> None:
    """Write a view to a .json file."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(view, allow_nan=False) + "\n", encoding="ascii")


def read_run(path: StrPath) -> View:
    """The view in a file that `write_run` wrote; a `DataError` where it is something else."""
    try:
        text = read_text(check_readable(path), MAX_RUN_BYTES)
        check_text(text, str(path), MAX_RUN_BYTES)
        view = json.loads(text, parse_constant=_refuse_constant)
        if not isinstance(view, dict) or view.get("format") != FORMAT_NAME:
            raise _OtherShape("format")
        if view.get("version") != FORMAT_VERSION:
            raise DataError(f"{path}: another version of rpil wrote it; run rpil audit --save with this one.")
        _check(view, _shape(view), "")
    except DataError:
        raise
    except (_OtherShape, ValueError, RecursionError) as error:
        where = f"its part {error} is wrong" if isinstance(error, _OtherShape) else "it is not JSON"
        raise DataError(f"{path}: it is no run of rpil audit --save: {where}; write it again.") from error
    return view


def _refuse_constant(name: str) -> NoReturn:
    raise _OtherShape(name)


def _check(value: Parsed, shape: Shape, where: str) -> None:
    """Compare a value with a shape."""
    parts: Iterable[tuple[str, object, Shape]] = ()
    if callable(shape):
        right = shape(value)
    elif isinstance(shape, _Each):
        right = isinstance(value, list) and len(value) in shape.sizes
        parts = ((f"[{k}]", one, shape.shape) for k, one in enumerate(value)) if right else ()
    elif isinstance(shape, _Named):
        right = isinstance(value, dict) and len(value) <= MAX_RUN_LIST and all(map(_text, value))
        parts = ((f".{name}", one, shape.shape) for name, one in value.items()) if right else ()
    else:
        right = isinstance(value, dict) and value.keys() == shape.keys()
        parts = ((f".{name}", value[name], own) for name, own in shape.items()) if right else ()
    if not right:
        raise _OtherShape(where.removeprefix(".")[:80])
    for name, one, own in parts:
        _check(one, own, where + name)


def _text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MAX_RUN_TEXT


def _matching(pattern: str) -> Test:
    return lambda value: isinstance(value, str) and re.fullmatch(pattern, value, re.DOTALL) is not None


def _among(values: Container[object]) -> Test:
    return lambda value: isinstance(value, str) and value in values


def _command(value: object) -> bool:
    """One ``rpil audit`` without `NOT_IN_A_RUN`, or nothing: a reader of the page pastes it into a shell."""
    if not (isinstance(value, str) and _text(value) and value.isprintable()):
        return False
    plain = value.replace(" ~/", " ")  # the home folder of who pastes it
    with suppress(ValueError):  # of a quote that is not closed
        words = shlex.split(plain)
        is_audit = words[:2] in ([], ["rpil", "audit"]) and shlex.join(words) == plain
        return is_audit and {f"--{name}" for name in NOT_IN_A_RUN}.isdisjoint(w.partition("=")[0] for w in words)
    return False


def _flag(value: object) -> bool:
    return isinstance(value, bool)


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_RUN_NUMBER


def _share(value: object) -> bool:
    return isinstance(value, int | float) and _number(value) and 0 <= value <= 1


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and _number(value) and value > 0


def _below(end: int) -> Test:
    """A whole number from 0 on, below `end`."""
    return lambda value: type(value) is int and 0 <= value < end


def _equal(number: int) -> Test:
    return lambda value: type(value) is int and value == number


def _optional(test: Test) -> Test:
    return lambda value: value is None or test(value)


def _shallow(value: object, depth: int = MAX_RUN_DEPTH) -> bool:
    """Any value that is not too deep."""
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return depth > 0 and all(_shallow(one, depth - 1) for one in parts)


def _packed(*sizes: int) -> Test:
    """Base64 of one of these numbers of bytes."""

    def is_packed(value: object) -> bool:
        try:
            return isinstance(value, str) and len(base64.b64decode(value, validate=True)) in sizes
        except (binascii.Error, ValueError):
            return False

    return is_packed


_SENTENCES, _STEP = _Each(_text), _below(int(MAX_RUN_NUMBER))


def _shape(view: View) -> Shape:
    """The shape of a view, given how many demonstrations, which words and which faults it has."""
    columns, counts, faults, drawings = (view.get(key) for key in ("demonstrations", "counts", "faults", "drawings"))
    n_steps = columns.get("n_steps") if isinstance(columns, dict) else None
    _check(n_steps, _Each(_STEP, range(1, MAX_RUN_DEMONSTRATIONS + 1)), "demonstrations.n_steps")
    steps: list[int] = n_steps if isinstance(n_steps, list) else []
    words = list(counts) if isinstance(counts, dict) else []
    member, counted = _below(len(steps)), dict.fromkeys(words, _STEP)
    interval = dict.fromkeys(("mean", "low", "high"), _share)
    return {
        **dict.fromkeys(("format", "run", "title", "source", "adversary", "question"), _text),
        "command": _command,
        **dict.fromkeys(("doubts", "notes", "assumptions", "lost", "read", "differ"), _SENTENCES),
        "version": _number,
        "seconds": _optional(_number),
        "finding": {**dict.fromkeys(("name", "sentence", "next"), _text), "decided": _flag},
        "words": {**dict.fromkeys(("upper", "lower", "probability", "meaning"), _text), "threshold": _share},
        "sides": dict.fromkeys(words, _among(("upper", "open", "lower"))),
        "counts": counted,
        "share": interval,
        "mean_weight": _share,
        "pair": _Each(member, (2,) if view.get("question") else (0, 2)),
        "contradicting": _Each(member),
        "answers": _Each(
            lambda value: isinstance(value, list) and len(value) == 2 and member(value[0]) and _text(value[1]),
            range(MAX_RUN_DEMONSTRATIONS),
        ),
        "demonstrations": _columns(columns, len(steps), words, bool(view.get("whole_ids"))),
        "whole_ids": _flag,
        "n_review": _below(len(steps) + 1),
        "demonstrators": _Each(
            {**dict.fromkeys(interval, _optional(_share)), "name": _text, "n": _STEP, "counts": counted, "style": _text}
        ),
        "faults": _faults(faults, member),
        "fps": _optional(_positive),
        "lerobot": _flag,
        "hub": _matching(r"([\w.-]{1,100}/[\w.-]{1,100})?"),
        "provenance": _Named(_shallow),
        "drawings": _drawings(drawings, steps),
    }


def _columns(columns: object, size: int, words: list[str], whole: bool) -> Shape:
    """The shape of the columns of `size` demonstrations with these words."""
    look = columns.get("look") if isinstance(columns, dict) else None
    every, texts, numbers, shares = (size,), _Each(_text, (size,)), _Each(_number, (size,)), _Each(_share, (size,))
    ordered = isinstance(look, list) and all(map(_STEP, look)) and sorted(look) == list(range(size))
    return {
        "id": _Each(_matching(r"-?\d{1,20}" if whole else ".{1,1000}"), every),
        "verdict": _Each(_among(words), every),
        "log_odds": numbers,
        **dict.fromkeys(("reliability", "low", "high"), shares),
        "p": _Each(_optional(_share), every),
        "rank": _Each(_below(size + 1), every),
        "n_steps": _Each(_positive, every),
        **dict.fromkeys(("reason", "task", "demonstrator", "session"), texts),
        "evidence": _Named(numbers),
        "worst": _Each(_Each(_STEP, range(100)), every),
        "stretch": _Each(lambda value: value is None or _is_span(value), every),
        "look": lambda _: ordered,
        "group": _Each(_among(("", "A", "B")), every),
        "order": _Each(_below(size + 1), (0, size)),
        "facts": _Named(shares),
        "kept": _Each(_flag, every),
    }


def _is_span(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_STEP, value))


def _faults(faults: object, member: Test) -> Shape:
    found = faults.get("found") if isinstance(faults, dict) else None
    rules = found.get("rule") if isinstance(found, dict) else None
    every = (min(len(rules), MAX_FOUND),) if isinstance(rules, list) else ()
    own = dict.fromkeys(("rule", "sentence"), _Each(_text, every)) | dict.fromkeys(
        ("first", "last"), _Each(_STEP, every)
    )
    return {
        "kinds": _Each({"rule": _text, "words": _text, "n": _STEP}),
        "found": {**own, "demonstration": _Each(_optional(member), every)} if found else {},
        "not_checked": _Each({"reason": _text, "rules": _SENTENCES}),
        "usual": _SENTENCES,
    }


def _drawings(drawings: object, steps: list[int]) -> Shape:
    """The shapes of drawings of demonstrations with so many `steps`."""
    given = drawings if isinstance(drawings, dict) else {}
    if len(given) > MAX_DRAWINGS or not given.keys() <= {*map(str, range(len(steps)))}:
        raise _OtherShape("drawings")
    shapes: dict[str, Shape] = {}
    for name in given:
        points = min(steps[int(name)], MAX_POINTS)
        scale: dict[str, Shape] = {"from": _number, "to": _number}
        part = {"name": _text, "share": _share, "nats": _number, **scale}
        shapes[name] = {
            "ratio": scale | dict.fromkeys(("min", "mean", "max"), _packed(points)),
            "trust": {**scale, "mean": _packed(points)},
            "compared_with": _among(("typical", "trusted")),
            "taken": {"names": _Each(_text, range(257)), "codes": _packed(0, points)},
            "parts": _Each(part | dict.fromkeys(("value", "low", "high"), _packed(points)), range(MAX_PARTS + 1)),
        }
    return shapes
