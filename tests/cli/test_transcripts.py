"""One transcript of each command, line by line: ``python tests/cli/test_transcripts.py`` writes them again."""

from __future__ import annotations

import os
import re
import shlex
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[1]))

from asked import BAD, N_STEPS, write
from recordings import write_recording
from rpil.cli.main import main
from small import FAST

FOLDER = Path(__file__).parent / "transcripts"
ANSWERS = "id,label\n0,good\n3,bad\n1,better than 8\n"
INPUT = {"label": "s\nb it stalls\nz\ng\nq\n"}
"""What is typed into a command that asks."""


def spike(observations: np.ndarray, ids: np.ndarray) -> None:
    observations[np.flatnonzero(ids == 4)[60], 1] += 30


def prepare() -> None:
    """Write demonstrations with a success and operators, answers about some, and a recording with a spike."""
    success = np.repeat([m not in BAD - {9} for m in range(24)], N_STEPS).astype(int)
    write("d.parquet", success=success, operator=np.repeat(["ann", "bob"], 12 * N_STEPS))
    Path("labels.csv").write_text(ANSWERS)
    write_recording("r.parquet", spike)
    Path("faults.json").write_text('{"spike": [4, 5], "idle-head": "all"}')


def run(command: str) -> str:
    """A command as it is typed, and what it prints; lines of stderr begin with "!"."""
    words = shlex.split(command)[1:]
    result = CliRunner().invoke(main, words, obj=FAST, input=INPUT.get(words[0]))
    said = [*result.stdout.splitlines(), *(f"! {line}" for line in result.stderr.splitlines())]
    code = [f"exit code {result.exit_code}"] * (result.exit_code != 0)
    return "\n".join([f"$ {command}", *said, *code, ""])


def without_last_digits(text: str) -> str:
    """The text with # for numbers that have decimals, and with single spaces: they depend on the processor."""
    return re.sub(r"[-+]?\d[\d,]*\.\d+", "#", re.sub(r" +", " ", text))


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.txt")), ids=lambda path: path.stem)
def test_a_command_prints_what_it_printed(path: Path) -> None:
    prepare()
    for block in re.split(r"^(?=\$ )", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        assert without_last_digits(run(block.partition("\n")[0][2:])) == without_last_digits(block)


if __name__ == "__main__":
    for path in sorted(FOLDER.glob("*.txt")):
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            prepare()
            commands = re.findall(r"^\$ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            path.write_text("".join(map(run, commands)), encoding="utf-8")
