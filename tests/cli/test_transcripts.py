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
from recordings import spike, write_recording
from rpil.cli.main import main
from rpil.estimators.pipeline import FitOptions
from small import FAST

FOLDER = Path(__file__).parent / "transcripts"
FILES = {
    "labels.csv": "id,label\n0,good\n3,bad\n1,better than 8\n",
    "faults.json": '{"spike": [4, 5], "idle-head": "all"}',
    "unknown.csv": "id,label\n77,bad\n",
    "unknown.json": '{"spike": ["4", "77"]}',
    "columns.csv": "id,what\n1,bad\n",
    "opposed.csv": "id,label\n3,same as 4\n4,better than 3\n",
    "all-bad.csv": "id,label\n" + "".join(f"{m},bad\n" for m in range(24)),
    "twice.csv": "id,verdict,rejected_by,label\n0,bad,labels,bad\n1,good,,\n0,good,,\n",
    "who.csv": "id,demonstrator\n0,Ann\n77,Ann\n",
}
"""What a user has written, by name."""


def prepare() -> None:
    """Write demonstrations with a success and operators, a recording with a spike, and the `FILES`."""
    success = np.repeat([m not in BAD - {9} for m in range(24)], N_STEPS).astype(int)
    write("d.parquet", success=success, operator=np.repeat(["ann", "bob"], 12 * N_STEPS))
    write_recording("r.parquet", spike)
    Path("there").mkdir()
    for name, text in FILES.items():
        Path(name).write_text(text)


def run(command: str) -> str:
    """A command as it is typed, and what it prints; lines of stderr begin with "!"."""
    words = shlex.split(command)[1:]
    result = CliRunner().invoke(main, words, obj=FAST, input={"label": "s\nb it stalls\nz\ng\nq\n"}.get(words[0]))
    said = [*result.stdout.splitlines(), *(f"! {line}" for line in result.stderr.splitlines())]
    code = [f"exit code {result.exit_code}"] * (result.exit_code != 0)
    return "\n".join([f"$ {command}", *said, *code, ""])


def without_last_digits(text: str) -> str:
    """The text with # for numbers that have decimals, and with single spaces: they depend on the processor."""
    return re.sub(r"[-+]?\d[\d,]*\.\d+", "#", re.sub(r" +", " ", text))


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.txt")), ids=lambda path: path.stem)
def test_a_command_prints_what_it_printed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is refused is refused before any work, and leaves all files as they were."""
    prepare()
    if path.stem == "refused":
        monkeypatch.setattr(FitOptions, "check", lambda *_: pytest.fail("too late"))
    for block in re.split(r"^(?=\$ )", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        before = {file: file.read_bytes() for file in Path().rglob("*") if file.is_file()}
        assert without_last_digits(run(block.partition("\n")[0][2:])) == without_last_digits(block)
        if path.stem == "refused":
            assert re.search(r"^! rpil: [^\n]+\.\nexit code 2$", block, re.MULTILINE), block
            assert {file: file.read_bytes() for file in Path().rglob("*") if file.is_file()} == before


if __name__ == "__main__":
    for path in sorted(FOLDER.glob("*.txt")):
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            prepare()
            commands = re.findall(r"^\$ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            path.write_text("".join(map(run, commands)), encoding="utf-8")
