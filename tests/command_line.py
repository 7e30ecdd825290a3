"""Calls of the command ``rpil`` in this process."""

import re
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from rpil.cli.main import main
from small import FAST

ENV = "MountainCar-v0"
_RNG = np.random.default_rng(0)
X, Y, G = _RNG.normal(size=(60, 2)), _RNG.integers(0, 2, 60), np.repeat(np.arange(6), 10)


def call(*arguments, settings=FAST):
    """Invoke the command; `settings` are those of `RPIL`."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments], obj=settings)


def write_lines(name, lines):
    """A text file of these lines, and its name."""
    Path(name).write_text("\n".join(lines) + "\n")
    return name


def ok(*arguments, settings=FAST):
    """The result of a call that succeeds."""
    result = call(*arguments, settings=settings)
    assert result.exit_code == 0, result.output
    return result


def refused(match, *arguments, settings=FAST):
    """Exit code 2, nothing on stdout, one sentence on stderr, and no file more, less or other than before."""
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    result = call(*arguments, settings=settings)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert re.fullmatch(r"rpil: ([^.\n]|\.(?! ))*\.\n", result.stderr)
    assert re.search(match, result.stderr), result.stderr
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before
    return result.stderr


def npz(name, **changes):
    np.savez(name, allow_pickle=True, **({"observations": X, "actions": Y, "episode_ids": G} | changes))
