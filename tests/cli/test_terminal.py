"""Lines, tables, and warnings in a terminal."""

import sys

import click
import pytest

from rpil.cli import terminal
from rpil.cli.terminal import show_stages


def test_a_text_is_cut_after_so_many_lines():
    text = "one " * 40
    assert all(len(line) <= 30 for line in terminal.fit(text, 30))
    assert len(terminal.fit(text, 30)) > 2
    two = terminal.fit(text, 30, 2)
    assert len(two) == 2
    assert two[1].endswith(" ...")
    assert terminal.fit("", 30) == [""]
    assert terminal.fit("a\x1bb --session", 30) == ["a\\x1bb --session"]


def test_numbers_stand_at_the_right_and_the_last_column_is_cut():
    verdict = click.style("outlier", fg="red")
    columns = {"id": ["1", "10"], "verdict": [verdict, verdict], "score": ["-3.5", "+12.0"], "why": ["ab", "c" * 40]}
    head, first, second = terminal.table_lines(columns, 40)
    assert (head, first) == ("id  verdict  score  why", f"1   {verdict}   -3.5  ab")
    assert second == f"10  {verdict}  +12.0  {'c' * 17}..."
    assert [*terminal.table_lines(columns, None)][2].endswith("c" * 40)


def test_a_terminal_has_long_lines_in_several_but_for_code(monkeypatch, capsys):
    lines = ["  P17  " + "one two " * 20, "    code = " + "1 + " * 30 + "1", ""]
    terminal.print_lines(lines)
    assert capsys.readouterr().out.splitlines() == lines
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr(terminal, "line_width", lambda: 60)
    terminal.print_lines(lines)
    *first, code, last = capsys.readouterr().out.splitlines()
    assert (code, last) == (lines[1], "")
    assert len(first) == 3
    assert all(len(line) <= 60 for line in first)


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
