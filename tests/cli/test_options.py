"""Options have one name, one default and the same choices in all commands and in Python."""

import inspect
import re
from pathlib import Path

import pytest

from rpil import RPIL
from rpil.cli.main import main

COMMANDS = main.commands.values()
PAGE = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")


def option(command, name):
    return next(param for param in main.commands[command].params if param.name == name)


def test_one_option_has_one_default_and_o_is_the_output_of_every_command():
    for name in {param.name for command in COMMANDS for param in command.params} - {"output", "file"}:
        defaults = [param.default for command in COMMANDS for param in command.params if param.name == name]
        assert len(set(map(repr, defaults))) == 1, name
    short = {name for name, command in main.commands.items() if any("-o" in param.opts for param in command.params)}
    assert short == {"check", "convert", "demo", "fit", "keep"}
    assert all(option(command, "output").opts == ["-o", "--output"] for command in short)


@pytest.mark.parametrize("command", ["audit", "fit"])
def test_defaults_are_those_of_python(command):
    assert option(command, "adversary").default == inspect.signature(RPIL).parameters["adversary"].default


def test_the_page_describes_the_files_of_an_audit():
    for name in ("report", "weights", "verdicts", "keep"):
        extensions = ", ".join(option("audit", name).type.extensions)
        assert re.search(rf"\| `--{name}` \| {re.escape(extensions)} \|", PAGE), name
