"""The questions of ``rpil label``: what is asked, written, undone and named."""

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from command_line import refused
from rpil.cli.label import MAX_QUESTIONS, ask, last_lines
from rpil.cli.main import main
from rpil.cli.questions.session import Session
from small import FAST


def label(keys, *arguments):
    """A run that is given the lines `keys`."""
    lines = "".join(f"{key}\n" for key in keys)
    result = CliRunner().invoke(main, ["label", *arguments, "--observations", "x,v"], input=lines, obj=FAST)
    assert result.exit_code == 0, result.output
    return result.stdout


def asked_alone(out):
    return re.findall(r"Is it good or bad: (\d+)", out)


def rows():
    return Path("labels.csv").read_text().splitlines()


def test_what_cannot_be_told_is_asked_last_in_the_next_run_and_what_is_skipped_is_not_written(data):
    out = label(["s", *"us" * 4, "g", "q"], data)
    asked, untold = asked_alone(out), [f"{name},cannot tell" for name in asked_alone(out)[:8:2]]
    assert len(set(asked)) == len(asked) == 10
    assert rows() == ["id,label", *untold, f"{asked[8]},good"]
    assert re.findall(r"Question (\d) of", out) == ["1", "1", "2", "2", "3", "3", "4", "4", "5", "5", "6"]
    again = asked_alone(label("s" * 40, data))
    assert (len(again), {*again[-4:]}) == (len({*again}), {*asked[:8:2]})
    out = label("5" + "u" * 7, data, "--labels", "other.csv")
    pair = sorted(re.search(r"better: (\d+).* or (\d+)", out).groups())
    untold = [f"{name},cannot tell" for name in asked_alone(out)]
    assert Path("other.csv").read_text().splitlines()[1:] == [f"{pair[0]},same as {pair[1]}", *untold]
    assert out.count("Question") == MAX_QUESTIONS
    assert "Nothing more is asked in this run." in out
    assert out.endswith("--labels other.csv\n")


def test_an_interruption_leaves_the_answers(data, monkeypatch):
    class Lines(io.StringIO):
        def readline(self, *_):
            return super().readline() or self.stop()

        def stop(self):
            raise KeyboardInterrupt

    lines = Lines("1\ng\n")
    monkeypatch.setattr("rpil.cli.label.sys", type("Sys", (), {"stdin": lines, "stdout": sys.stdout}))
    result = CliRunner().invoke(main, ["label", data, "--observations", "x,v"], obj=FAST)
    assert result.exit_code == 130
    assert result.stderr.endswith("rpil: interrupted.\n")
    assert len(rows()) == 3


def test_an_answer_that_contradicts_another_is_asked_again(audit, monkeypatch, capsys):
    copies = replace(audit, copy_of=np.array([1 if m == 7 else m for m in range(24)]))
    session = Session(copies, "labels.csv", None, 8)
    session.answer((1,), "g")
    session.question = (7,)
    monkeypatch.setattr("sys.stdin", io.StringIO("b\ng\nq\n"))
    with click.Context(click.Command("label")):
        ask(session)
    said = capsys.readouterr().out
    assert "1 is labelled good and 7, a copy of it, bad; change one of the labels.\n" in said
    assert said.count("Question 2 of 8 at most. Is it good or bad: 7") == 2
    assert rows() == ["id,label", "1,good", "7,good"]


def test_the_last_lines_say_that_another_program_removed_the_answers(audit):
    session = Session(audit, "labels.csv", None, None)
    assert "nothing was written" in "\n".join(last_lines(session, ["rpil", "audit"]))
    session.answer((1,), "g")
    then = "Then run: rpil audit --labels labels.csv"
    assert [*last_lines(session, ["rpil", "audit"])] == ["", "1 answer of this run in labels.csv.", then]
    Path("labels.csv").unlink()
    said = "Another program has changed or removed labels.csv; look whether your answers are in it."
    assert [*last_lines(session, ["rpil", "audit"])] == ["", said]


@pytest.mark.parametrize("command", ["label", "review"])
def test_a_link_to_nothing_is_refused_before_anything_is_judged(command):
    Path("labels.csv").symlink_to("elsewhere.csv")
    said = r"labels\.csv: it is a link that leads to nothing; remove it, or give another file"
    refused(said, command, "no-data.parquet", "-q")
    assert not Path("elsewhere.csv").exists()
    assert Path("labels.csv").is_symlink()


def test_a_named_adversary_learns_from_no_answer(data):
    words = "keeps nothing to learn from answers; leave out --adversary"
    refused(words, "label", data, "-q", "--observations", "x,v", "--adversary", "marginal")
