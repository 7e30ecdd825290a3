"""Progress on stderr, in a terminal alone."""

from __future__ import annotations

import sys

import pytest

from rpil.cli.terminal import show_stages


@pytest.mark.parametrize(("quiet", "is_terminal"), [(False, True), (True, True), (False, False)])
def test_a_terminal_shows_the_stage_and_a_pipe_nothing(capsys, monkeypatch, quiet, is_terminal):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": "80"}.items():
        monkeypatch.setenv(name, value)
    with show_stages(quiet) as show:
        show("reading [b]d.csv")
    shown = capsys.readouterr().err
    assert ("reading [b]d.csv" in shown) == (is_terminal and not quiet)
    assert bool(shown) == (is_terminal and not quiet)
