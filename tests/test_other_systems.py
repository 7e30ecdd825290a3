"""Windows and macOS, as far as Linux can stand for them: lines that end in CR LF, files that are open elsewhere, names
with backslashes, and a Python without fork, signals and what only Linux has. docs/stability.md says what is untested.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import rpil
from command_line import ok, refused

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "path_of_audit.py"))


@pytest.fixture
def drive():
    TOOL["write_demonstrations"](Path("drive.csv"))
    Path("labels.csv").write_text("id,label\n0,bad\n4,bad\n1,good\n")
    return Path("drive.csv")


def with_crlf(path: Path) -> Path:
    """A copy as an editor of Windows saves it."""
    copy = path.with_name(f"crlf_{path.name}")
    copy.write_bytes(path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    return copy


def test_lines_may_end_in_cr_lf(drive):
    """Those of the data and of labels, and of tables that rpil wrote."""
    windows = with_crlf(drive)
    assert rpil.audit(windows).verdicts == rpil.audit(drive).verdicts
    ok("keep", "drive.csv", "-o", "kept.csv", "--labels", "labels.csv")
    ok("keep", str(windows), "-o", "kept_crlf.csv", "--labels", str(with_crlf(Path("labels.csv"))))
    assert Path("kept_crlf.csv").read_bytes() == Path("kept.csv").read_bytes().replace(b"\n", b"\r\n")
    ok("audit", "drive.csv", "--labels", "labels.csv", "--verdicts", "v.csv", "--keep", "k.json")
    for name in ("v.csv", "k.json"):
        for number, table in enumerate((Path(name), with_crlf(Path(name)))):
            ok("keep", "drive.csv", "-o", f"{name}{number}.json", "--verdicts", str(table))
        kept = [json.loads(Path(f"{name}{number}.json").read_text())["episodes"] for number in (0, 1)]
        assert kept[0] == kept[1] != []


def test_a_file_that_another_process_holds_open_stays_and_the_error_names_it(drive, monkeypatch):
    def refuse(source, target):
        raise PermissionError(13, "The process cannot access the file because it is being used by another process")

    Path("kept.csv").write_text("old\n")
    monkeypatch.setattr(os, "replace", refuse)
    refused("kept.csv.*cannot be written", "keep", drive, "-o", "kept.csv")


ELSEWHERE = """
import click, os, signal, sys
for name in ("fork", "forkpty", "register_at_fork", "sched_getaffinity", "sysconf", "getuid", "geteuid", "mkfifo",
             "O_TMPFILE", "O_NOFOLLOW", "O_DIRECTORY", "killpg", "setsid", "fchmod", "chown", "link"):
    if hasattr(os, name):
        delattr(os, name)
for name in [name for name in dir(signal) if name.startswith("SIG") and name not in ("SIGINT", "SIGTERM", "SIG_DFL",
             "SIG_IGN", "SIGABRT", "SIGFPE", "SIGILL", "SIGSEGV")]:
    delattr(signal, name)
sys.modules.update(dict.fromkeys(("fcntl", "resource", "pwd", "grp", "termios")))
import rpil
from rpil.cli.main import main
def call(*words):
    print(words, click.Group.main(main, [*words], standalone_mode=False))
call("info", "drive.csv")
call("check", "drive.csv")
call("audit", "drive.csv", "--verdicts", "v.csv", "--report", "a.html", "--quiet", "--memory", "64KB")
call("keep", "drive.csv", "-o", "kept.csv", "--labels", "labels.csv", "--quiet")
call("fit", "drive.csv", "-o", "policy.rpil", "--quiet")
print(rpil.RPIL().fit(rpil.open("drive.csv", on_disk=True)).audit_.verdicts)
"""


@pytest.mark.slow
def test_the_same_without_fork_signals_and_what_only_linux_has(drive, tmp_path, monkeypatch):
    (tmp_path / "temporary").mkdir()
    environment = os.environ | {"TMPDIR": str(tmp_path / "temporary")}
    code = [sys.executable, "-W", "error", "-c", ELSEWHERE]
    there = subprocess.run(code, env=environment, capture_output=True, text=True, check=False)
    assert there.returncode == 0, there.stderr
    assert list((tmp_path / "temporary").iterdir()) == []  # copies of rows go with their process
    ok("audit", drive, "--verdicts", "here.csv", "--memory", "64KB", settings=None)
    tables = [[row.split(",")[:2] for row in Path(name).read_text().splitlines()] for name in ("v.csv", "here.csv")]
    assert tables[0] == tables[1]
