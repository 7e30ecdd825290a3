"""Progress on stderr, in a terminal and in a pipe."""

from __future__ import annotations

import re
import sys
import time

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


def test_pipe_gets_ever_rarer_lines(capsys):
    timing = ProgressTiming(first=0.2, interval=0.1, elapsed_share=1.0)
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
    lines = ["rpil: 0 s: reading", *2 * ["rpil: _ s: learning"], "rpil: 0 s: playing, 1 of 2"]
    assert [re.sub(r"[01] s: learning", "_ s: learning", line) for line in err.splitlines()] == lines
