"""The public surface: names and signatures of `rpil`, commands and options, keys of JSON, columns of tables.

``python tools/public_surface.py`` prints it, and ``--write`` writes it to ``docs/surface.txt``. A test compares both:
what goes from that file, or changes in it, is a change of `docs/stability.md`, and needs a line in the change log.
"""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import json
import runpy
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType

import click
from click.testing import CliRunner

import rpil

ROOT = Path(__file__).parents[1]
SURFACE = ROOT / "docs" / "surface.txt"
OF_THE_DATA = {
    "counts", "evidence", "facts", "ignored", "missing", "not_checked", "outcomes", "ranges", "rejected", "set",
    "settings", "unknown", "usual",
}  # fmt: skip
"""Keys of JSON whose own keys are names of rules, columns and outcomes."""

RETURNED = {"Audit", "Confusion", "Dataset", "SoftmaxPolicy"}
"""Classes that functions return, and that no user makes."""


def names() -> Iterator[str]:
    """Every public name with its parameters, and what a user calls or reads of each class."""
    for name in sorted(set(rpil.__all__) - {"__version__"}):
        public = getattr(rpil, name)
        if dataclasses.is_dataclass(public) and name.endswith("Settings"):
            yield f"rpil.{name}: {', '.join(field.name for field in dataclasses.fields(public))}"  # no numbers
            continue
        yield f"rpil.{name}{'' if name in RETURNED else parameters(public)}"
        if inspect.isclass(public):
            fields = [field.name for field in dataclasses.fields(public)] if dataclasses.is_dataclass(public) else []
            yield from (f"rpil.{name}.{field}" for field in fields if not field.startswith("_"))
            yield from members(public, name)


def members(public: type, name: str) -> Iterator[str]:
    """The methods and properties of a class that are of rpil and have no underscore."""
    for attribute in sorted(attribute for attribute in dir(public) if not attribute.startswith("_")):
        value = inspect.getattr_static(public, attribute)
        function = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
        if isinstance(function, FunctionType) and function.__module__.startswith("rpil."):
            yield f"rpil.{name}.{attribute}{parameters(function)}"
        elif isinstance(value, property):
            yield f"rpil.{name}.{attribute}"


def parameters(function: object) -> str:
    """The names of the parameters, and which may be left out: without types and without the numbers of defaults."""
    found = []
    for parameter in inspect.signature(function).parameters.values():
        optional = parameter.default is not inspect.Parameter.empty
        bare = parameter.replace(annotation=inspect.Parameter.empty, default=inspect.Parameter.empty)
        found.append(bare if not optional else bare.replace(default=...))
    return str(inspect.Signature(found)).replace("Ellipsis", "...")


def commands() -> Iterator[str]:
    """Every command with its arguments, and every option with its spellings and choices."""
    from rpil.cli.main import main

    for name, command in sorted(main.commands.items()):
        arguments = [parameter.human_readable_name for parameter in command.params if parameter.opts[0][0] != "-"]
        yield " ".join(["rpil", name, *arguments])
        for option in sorted((each for each in command.params if each.opts[0][0] == "-"), key=lambda each: each.opts):
            choices = f" {'|'.join(option.type.choices)}" if isinstance(option.type, click.Choice) else ""
            yield f"rpil {name} {', '.join([*option.opts, *option.secondary_opts])}{choices}"


def outputs() -> Iterator[str]:
    """The keys of what commands print as JSON, and the columns of what they write, of a small CSV."""
    from rpil.cli.main import main

    write = runpy.run_path(str(ROOT / "tools" / "path_of_audit.py"))["write_demonstrations"]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        write(Path("drive.csv"))
        lines = Path("drive.csv").read_text(encoding="utf-8").splitlines()
        copy = [f"99,{line.partition(',')[2]}" for line in lines[1:] if line.startswith("0,")]
        Path("drive.csv").write_text("\n".join([*lines, *copy]) + "\n", encoding="utf-8")  # a fault: a duplicate
        files = ["--verdicts", "verdicts.csv", "--weights", "weights.csv", "--keep", "keep.json"]
        for words in (["info"], ["info", "--set"], ["check", "-o", "faults.csv"], ["audit", *files]):
            done = CliRunner().invoke(main, [words[0], "drive.csv", *words[1:], "--format", "json"])
            if done.exit_code:
                raise RuntimeError(done.output)
            shown = " ".join(word for word in words if word in ("info", "--set", "check", "audit"))
            yield from (f"rpil {shown} --format json: {key}" for key in keys(json.loads(done.stdout)))
        yield from (f"rpil audit --keep: {key}" for key in keys(json.loads(Path("keep.json").read_text())))
        for option, name in (("audit --verdicts", "verdicts"), ("audit --weights", "weights"), ("check -o", "faults")):
            header = Path(f"{name}.csv").read_text(encoding="utf-8").splitlines()[0].replace('"', "")
            yield f"rpil {option}: {header}"


def keys(value: object, path: str = "") -> Iterator[str]:
    """The paths of the keys of an object of JSON; of a list those of its first item."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        yield from keys(value[0], f"{path}[]")
    if isinstance(value, dict):
        for key, inner in value.items():
            here = f"{path}.{key}".lstrip(".")
            yield here
            if key not in OF_THE_DATA:
                yield from keys(inner, here)


def surface() -> str:
    return "\n".join([*names(), *commands(), *outputs()]) + "\n"


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        SURFACE.write_text(surface(), encoding="utf-8", newline="\n")
    else:
        print(surface(), end="")
