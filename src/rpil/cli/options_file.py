"""``rpil.toml`` beside the data: options that every command takes from there, unless the command line gives them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import click

from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.folders import check_inside
from rpil.data.guard import guarded
from rpil.data.json_files import read_toml

NAME = "rpil.toml"

TEXTS = "id", "order", "operator", "task", "session", "outcome", "action-kind"
LISTS = "action", "observations", "exclude", "only", "without"
SWITCHES = "skip-bad", "fill-missing"
KEYS = *TEXTS, *LISTS, *SWITCHES
"""The long names of the options that may stand there: those that say how data are read, and name no file."""


def place_of(data: str) -> Path:
    """Where the file of options is for a file of data, or a folder."""
    path = Path(data)
    return (path if path.is_dir() else path.parent) / NAME


def use_options_file(ctx: click.Context, param: click.Parameter, data: str) -> str:
    """Let the options beside the `data` be the defaults of those that are not on the command line; say so once."""
    path = place_of(data)
    if not ctx.resilient_parsing and Path(data).exists() and path.is_file():
        options = read_options(path)
        names = {option.name for option in ctx.command.params}
        ctx.default_map = {key.replace("-", "_"): value for key, value in options.items()}
        used = [key for key in options if key.replace("-", "_") in names]
        click.echo(f"Options from {path}: {', '.join(used) or 'none'}.", err=True)
    return data


file_argument = click.argument("file", type=click.Path(), is_eager=True, callback=use_options_file)
"""The data of a command, which is looked at first, because options may lie beside them."""


def read_options(path: Path) -> dict[str, str | bool | list[str]]:
    """The options in a file; a `DataError` where one is unknown, or no text, list or switch as it should be.

    Links out of the folder are refused, and files of other things.
    """
    check_inside(str(path), str(path.parent))
    with guarded(str(path), "it is not valid TOML in UTF-8", "correct it, or move it away"):
        found = read_toml(path)
    return {_key(name, path): _value(_key(name, path), value, path) for name, value in found.items()}


def _key(name: str, path: Path) -> str:
    key = name.replace("_", "-")
    if key not in KEYS:
        raise DataError(f"{path}: there is no option {name[:40]!r}; write some of {', '.join(KEYS)}.")
    return key


def _value(key: str, value: object, path: Path) -> str | bool | list[str]:
    if key in SWITCHES:
        if not isinstance(value, bool):
            raise DataError(f"{path}: {key} needs true or false.")
        return value
    values = value if isinstance(value, list) and key in LISTS else [value]
    if not all(isinstance(one, str | int) and not isinstance(one, bool) for one in values):
        raise DataError(f"{path}: {key} needs a text{' or a list of texts' if key in LISTS else ''}.")
    from rpil.data.id_values import is_id_file

    if key == "operator" and is_id_file(str(value)):
        raise DataError(f"{path}: operator needs a column; name a file on the command line.")
    return [str(one) for one in values] if key in LISTS else str(value)


def write_options(data: str, params: Mapping[str, str | bool | Sequence[str] | None]) -> Path:
    """Write the options that a command was called with beside the `data`; the file, which must not be there yet."""
    path, lines = place_of(data), []
    if os.path.lexists(path):
        raise DataError(f"{path}: it is there already; change it with an editor, or move it away.")
    for key in KEYS:
        value = params.get(key.replace("-", "_"))
        if value and value != "auto":
            lines.append(f"{key} = {_toml(value)}\n")
    with replacing(path) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8")
    return path


def _toml(value: str | bool | Sequence[str]) -> str:
    """A value as TOML has it, of which JSON has the same texts, lists and switches but for one character."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
