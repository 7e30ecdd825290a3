"""Progress on stderr, in a terminal and in a pipe."""

from __future__ import annotations

import re
import subprocess
import sys
import time

import pytest

from command_line import npz
from rpil.cli import progress
from rpil.cli.progress import ProgressTiming, show_count, show_stages


def test_terminal_shows_the_stage_unless_quiet(monkeypatch, capsys):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    for quiet in (True, False):
        with show_stages(quiet, ProgressTiming()) as show:
            show(f"stage [{quiet}]")
        with show_count("playing", quiet, ProgressTiming()) as count:
            count(1, 2)
    err = capsys.readouterr().err
    assert "stage [True]" not in err
    assert "stage [False]" in err


@pytest.mark.parametrize("is_terminal", [True, False])
def test_secrets_of_an_address_are_not_shown(monkeypatch, capsys, is_terminal):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal, raising=False)
    with show_stages(False, ProgressTiming(first=0.01)) as show:
        show("reading s3://KEY:HIDDEN@bucket/a.csv")
        time.sleep(0.2)
    err = capsys.readouterr().err
    assert "s3://***@bucket/a.csv" in err
    assert "HIDDEN" not in err


def test_time_left_is_that_of_the_unfinished_items(monkeypatch):
    monkeypatch.setattr("time.monotonic", lambda: 130.0)
    assert progress._time_left(100.0, 3, 12) == ", about 90 s left"
    assert progress._time_left(100.0, 0, 12) == ""


@pytest.mark.slow
def test_pipe_gets_ever_rarer_lines(capsys):
    timing = ProgressTiming(first=0.2, interval=0.1, elapsed_share=1.0, unchanged=0.1)
    with show_stages(False, timing) as show:
        show("never seen")
        show("reading")
        time.sleep(0.3)
        show("learning")
        time.sleep(0.8)
    with show_count("playing", False, timing) as count:
        count(1, 2)
        time.sleep(0.3)
    with show_stages(True, timing) as show:
        show("not to be seen")
        time.sleep(0.3)
    with show_stages(False, timing) as show:
        show("over at once")
    out, err = capsys.readouterr()
    assert out == ""
    # At 0.2 s, 0.4 s and 0.8 s: each time that went by doubles the wait.
    lines = ["rpil: 0 s: reading", *2 * ["rpil: _ s: learning"], "rpil: 0 s: playing, 1 of 2, about 0 s left"]
    assert [re.sub(r"[01] s: learning", "_ s: learning", line) for line in err.splitlines()] == lines


@pytest.mark.slow
def test_a_stage_is_named_once_and_again_where_it_is_long(capsys):
    with show_stages(False, ProgressTiming(first=0.05, interval=0.05, unchanged=0.7)) as show:
        time.sleep(0.3)
        show("reading")
        time.sleep(1.1)
    said = [line.partition(" s: ")[2] for line in capsys.readouterr().err.splitlines()]
    assert said[:3] == ["loading the libraries", "reading", "reading"]
    assert len(said) <= 4, "of more than twenty"


@pytest.mark.slow
def test_slow_imports_are_reported_within_two_seconds():
    npz("data.npz")
    script = (
        "import sys, time\n"
        "class Slow:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name in ('numpy', 'sklearn', 'pyarrow', 'rpil.policies'):\n"
        "            time.sleep(60)\n"
        "from rpil.cli.main import main\n"
        "sys.meta_path.insert(0, Slow())\n"
        "main(sys.argv[1:])\n"
    )
    for options in ([], ["--features", "spline"], ["--report", "r.html"]):
        start = time.monotonic()
        command = [sys.executable, "-c", script, "audit", "data.npz", *options]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr.readline() == "rpil: 1 s: loading the libraries\n"
            assert time.monotonic() - start < 30  # long before the first import ends
            process.kill()


@pytest.mark.slow
def test_long_command_reports_its_stage_within_two_seconds():
    script = (
        "import sys, time, types\n"
        "def run(progress, **_):\n"
        "    progress('waiting')\n"
        "    time.sleep(2)\n"
        "    raise SystemExit(7)\n"
        "sys.modules['rpil.cli.demo'] = types.SimpleNamespace(run=run)\n"
        "from rpil.cli.main import main\n"
        "main(['demo', *sys.argv[1:]])\n"
    )
    for options, pattern in (([], r"rpil: 1 s: waiting\n"), (["--quiet"], "")):
        done = subprocess.run([sys.executable, "-c", script, *options], capture_output=True, text=True)
        assert done.returncode == 7
        assert re.fullmatch(pattern, done.stderr), done.stderr
