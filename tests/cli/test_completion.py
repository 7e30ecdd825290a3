"""``rpil --install-completion``: the files it writes, and what the shell then offers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from command_line import ok, refused
from rpil.cli.completion import SCRIPTS

RPIL = Path(sys.executable).parent / "rpil"


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    return tmp_path


@pytest.mark.parametrize("shell", SCRIPTS)
def test_a_script_is_installed_and_read_once(home, shell):
    start = home / f".{shell}rc"
    if shell != "fish":
        start.write_text("alias ll='ls -l'")
    for _ in range(2):
        assert SCRIPTS[shell] in ok("--install-completion", shell).stdout
    assert "_RPIL_COMPLETE" in (home / SCRIPTS[shell]).read_text()
    if shell != "fish":
        assert start.read_text() == f"alias ll='ls -l'\n. {home / SCRIPTS[shell]}\n"
        check = f"{shell} -n {home / SCRIPTS[shell]}"
        assert shell != "bash" or subprocess.run(check.split()).returncode == 0


def test_the_shell_in_use_is_the_default(home, monkeypatch):
    monkeypatch.setenv("SHELL", "/usr/bin/zsh")
    assert ok("--install-completion").stdout.startswith("Completion for zsh: ")
    refused("no completion for the shell 'tcsh': name one of bash, zsh, fish", "--install-completion", "tcsh")


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("rpil au", ["plain,audit"]),
        ("rpil audit --verd", ["plain,--verdicts"]),
        ("rpil fit --adversary no", ["plain,normalised-complement"]),
        ("rpil simulate --kind n", ["plain,noisy"]),
        ("rpil audit dat", ["file,dat"]),
        ("rpil audit data.csv --keep ", ["file,"]),
        ("rpil audit data.csv --report r.pdf --verd", ["plain,--verdicts"]),
    ],
)
def test_commands_options_choices_and_files_are_offered(line, offered):
    words = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1), "_RPIL_COMPLETE": "bash_complete"}
    found = subprocess.run([RPIL], env=os.environ | words, capture_output=True, text=True, check=True)
    assert found.stdout.splitlines() == offered
    assert found.stderr == ""
