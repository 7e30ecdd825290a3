"""Progress on stderr, in a terminal and in a pipe."""

from __future__ import annotations

import time
from types import SimpleNamespace

from rpil.cli.terminal import show_stages


def lines_come(monkeypatch, first, interval=3.0, elapsed_share=0.1):
    """Set after how many seconds lines are printed."""
    for name, value in (("FIRST", first), ("INTERVAL", interval), ("ELAPSED_SHARE", elapsed_share)):
        monkeypatch.setattr(f"rpil.cli.terminal.{name}", value)


def printed_at_last(capsys, text):
    """What has been printed on stderr when it holds a `text`, which a busy machine prints some time later."""
    err, end = "", time.monotonic() + 60
    while text not in err and time.monotonic() < end:
        time.sleep(0.05)
        err += capsys.readouterr().err
    return err


def test_pipe_gets_ever_rarer_lines(capsys, monkeypatch):
    times = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: times[0])

    class Finished:
        """An event that is set after ten seconds; to wait takes no time."""

        set = staticmethod(lambda: None)

        def wait(self, seconds):
            times[0] += seconds
            return times[0] > 10

    monkeypatch.setattr("threading.Event", Finished)
    monkeypatch.setattr("threading.Thread", lambda target, daemon: SimpleNamespace(start=target, join=lambda: None))
    lines_come(monkeypatch, 2, 1, 1.0)
    with show_stages(False):
        pass
    lines = [f"rpil: {seconds} s: loading the libraries" for seconds in (2, 4, 8)]
    assert capsys.readouterr().err.splitlines() == lines  # each time that went by doubles the wait


def test_nothing_is_printed_of_what_is_over_at_once_or_quiet(capsys, monkeypatch):
    lines_come(monkeypatch, 0.01, 0.01)
    with show_stages(True) as show:
        show("not to be seen")
        time.sleep(0.1)
    lines_come(monkeypatch, 3600)
    with show_stages(False) as show:
        show("over at once")
    assert capsys.readouterr() == ("", "")
