"""What the scripts share on their command lines: numbers that make sense, and files that are never half written."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_writable, replacing


def at_least(least: int, most: float = float("inf")) -> Callable[[str], int]:
    """A type for argparse: a whole number from `least` to `most`."""

    def number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"{value} is less than {least}" if value < least else f"{value} is more than {most:.0f}"
            )
        return value

    return number


def output(text: str) -> Path:
    """A type for argparse: a file that can be written, found out before any work."""
    try:
        return check_writable(text)
    except DataError as error:
        raise argparse.ArgumentTypeError(str(error).rstrip(".")) from None


def asked(parser: argparse.ArgumentParser, options: argparse.Namespace) -> dict[str, Any]:
    """The options that are not the defaults and change figures: empty for a whole run."""
    given = {name: value for name, value in vars(options).items() if value != parser.get_default(name)}
    return {name: value for name, value in given.items() if name not in ("data", "json", "output", "processes")}


def write_json(path: Path, found: Any) -> None:
    """Figures as JSON; whatever was there stays until all is written."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def make_folder(path: StrPath) -> Path:
    """`path` as a folder that can be written to, made where it is missing; a `DataError` where that fails."""
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise DataError(f"{path}: it is a file; give the path of a folder.")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{path}: the folder cannot be made ({error.strerror}).") from error
    if not os.access(path, os.W_OK):
        raise DataError(f"{path}: it may not be written; choose another place or change the permissions.")
    return path
