"""The questions of ``rpil label``: what is asked, written, undone and named."""

from __future__ import annotations

import io
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from asked import BAD, N_STEPS, write
from command_line import ok, refused
from rpil.cli.label import MAX_QUESTIONS, ask, last_lines
from rpil.cli.main import main
from rpil.cli.questions.session import Session
from rpil.data.id_values import read_answers
from rpil.estimators.pipeline import FitOptions
from small import FAST


def label(keys, *arguments):
    """A run that is given the lines `keys`."""
    lines = "".join(f"{key}\n" for key in keys)
    result = CliRunner().invoke(main, ["label", *arguments, "--observations", "x,v"], input=lines, obj=FAST)
    assert result.exit_code == 0, result.output
    return result.stdout


def rows():
    return Path("labels.csv").read_text().splitlines()


def test_a_run_asks_the_pair_first_and_writes_every_answer(data):
    out = label("x1gq", data)
    pair = re.search(r"Question 1 of 8 at most. Which is better: (\d+).* or (\d+).*\?", out)
    assert len(BAD & {int(name) for name in pair.groups()}) == 1
    assert "Give one of 1, 2, 3, 4, 5, u, s, z, q." in out
    single = re.search(r"Question 2 of 8 at most. Is it good or bad: (\d+)", out)[1]
    assert rows() == ["id,label", f"{pair[1]},better than {pair[2]}", f"{single},good"]
    assert "Now: 20 similar, 4 outliers.\nNo verdict changed.\n" in out
    assert "One answer alone does not" in out
    assert out.splitlines()[-2:] == [
        "2 answers of this run in labels.csv.",
        f"Then run: rpil audit {data} --observations x,v --labels labels.csv",
    ]
    found = json.loads(ok("audit", data, "--observations", "x,v", "--labels", "labels.csv", "--json").stdout)
    assert (found["finding"], found["question"]) == ("answered", None)


def test_a_run_goes_on_where_the_last_one_ended(data):
    Path("labels.csv").write_text("note,id,label\nseen,3,BAD\n,0,better than 3\n,1,good\n")
    out = label("gb", data)  # the end of the input ends it too
    assert out.startswith("By your answers: ")
    assert "Which is better" not in out
    asked = re.findall(r"Is it good or bad: (\d+)", out)
    assert rows() == ["note,id,label", "seen,3,BAD", ",0,better than 3", ",1,good",
                      f",{asked[0]},good", f",{asked[1]},bad"]  # fmt: skip
    assert not {"1", "3"} & set(asked)


def test_no_difference_is_an_answer_about_the_pair(data):
    out = label("5q", data)
    assert "4: Both bad, 5: No difference, u: Cannot tell" in out
    first, second = re.search(r"better: (\d+).* or (\d+)", out).groups()
    assert rows() == ["id,label", f"{first},same as {second}"]
    assert "Now: 20 similar, 4 outliers.\nNo verdict changed.\n" in out
    found = json.loads(ok("audit", data, "--observations", "x,v", "--labels", "labels.csv", "--json").stdout)
    assert (found["finding"], found["question"]) == ("answered", None)
    assert "P(good) is learned from 1 pair, each of which may be wrong." in found["assumptions"]
    assert "Question 1 of 8 at most. Is it good or bad" in label("q", data)  # the next run does not ask it again


def test_undo_takes_back_the_last_answer_and_asks_again(data):
    out = label("z1zq", data)
    assert "There is nothing to undo." in out
    assert out.count("Question 1 of 8") == 3
    assert out.count("Now: 20 similar, 4 outliers.\n") == 2
    assert out.endswith("No answer was given, and nothing was written.\n")
    assert not Path("labels.csv").exists()
    out = label("4gzbz", data)
    pair = re.search(r"better: (\d+).* or (\d+)", out).groups()
    assert rows() == ["id,label", *(f"{name},bad" for name in pair)]


def test_what_cannot_be_told_or_is_skipped_is_not_written_and_not_asked_again(data):
    out = label(["s", *"us" * 4, "g", "q"], data)
    asked = re.findall(r"Is it good or bad: (\d+)", out)
    assert len(set(asked)) == len(asked) == 10
    assert rows() == ["id,label", f"{asked[8]},good"]
    assert re.findall(r"Question (\d) of", out) == ["1", "1", "2", "2", "3", "3", "4", "4", "5", "5", "6"]
    out = label("u" * 9, data, "--labels", "other.json")
    assert out.count("Question") == MAX_QUESTIONS
    assert "Nothing more is asked in this run." in out
    assert not Path("other.json").exists()


def test_json_is_written_where_it_is_named(data):
    out = label("3", data, "--labels", "l.json")
    pair = re.search(r"better: (\d+).* or (\d+)", out).groups()
    assert json.loads(Path("l.json").read_text()) == dict.fromkeys(pair, "good")
    assert out.endswith("--labels l.json\n")


def test_an_interruption_leaves_the_answers(data, monkeypatch):
    class Lines(io.StringIO):
        def readline(self, *_):
            return super().readline() or self.stop()

        def stop(self):
            raise KeyboardInterrupt

    invoked = CliRunner()
    lines = Lines("1\ng\n")
    monkeypatch.setattr("rpil.cli.label.sys", type("Sys", (), {"stdin": lines, "stdout": sys.stdout}))
    result = invoked.invoke(main, ["label", data, "--observations", "x,v"], obj=FAST)
    assert result.exit_code == 130
    assert result.stderr.endswith("rpil: interrupted.\n")
    assert len(rows()) == 3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("3,great\n", "labels.csv, demonstration '3': unknown label 'great'"),
        ("3,better than 77\n", "no demonstration is called '77'"),
        ("77,good\n", "no demonstration is called '77'"),
        ("3,better than 3\n", "labels.csv, demonstration '3': it is compared with itself"),
        ("3,better than 4\n4,better than 3\n", "labels.csv, '4' and '3': two answers contradict"),
        ("3,same as 4\n4,better than 3\n", "labels.csv, '4' and '3': two answers contradict"),
        ("3,same as 3\n", "labels.csv, demonstration '3': it is compared with itself"),
        ("3,same as 77\n", "no demonstration is called '77'"),
    ],
)
@pytest.mark.parametrize("command", ["label", "audit"])
def test_bad_answers_are_refused(data, command, text, words):
    Path("labels.csv").write_text(f"id,label\n{text}")
    refused(words, command, data, "--labels", "labels.csv", "-q", "--observations", "x,v")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--labels", "l.txt"], "use one of .csv, .json"),
        (["--labels", "nowhere/l.csv"], "there is no folder nowhere"),
        (["--adversary", "marginal"], "keeps nothing to learn from answers; leave out --adversary"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_a_question(data, options, words):
    refused(words, "label", data, "-q", "--observations", "x,v", *options)


def test_pairs_reach_the_fit(data, monkeypatch):
    tasks = []
    check = FitOptions.check
    monkeypatch.setattr(FitOptions, "check", lambda self, task: (tasks.append(task), check(self, task))[1])
    Path("l.csv").write_text("id,label\n0,better than 3\n3,bad\n1,better than 5\n")
    out = ok("audit", data, "--labels", "l.csv", "-q", "--observations", "x,v", "--json").stdout
    assert tasks[0].answers.pairs.tolist() == [[0, 3], [1, 5]]
    assert tasks[0].answers.labels.tolist() == [0, 0, 0, -1] + [0] * (len(tasks[0].source.ids) - 4)
    assert "1 label, 2 pairs" in " ".join(json.loads(out)["assumptions"])


def test_tasks_are_asked_about_together_and_pairs_between_them_are_left_out():
    name = write("t.parquet", task=np.repeat(np.where(np.arange(24) < 12, "lift", "turn"), N_STEPS))
    Path("labels.csv").write_text("id,label\n0,better than 3\n3,better than 20\n")
    result = CliRunner().invoke(main, ["label", name, "--observations", "x,v"], input="g\nb\n", obj=FAST)
    assert result.exit_code == 0, result.output
    assert "labels.csv: 1 pair compares demonstrations of different tasks, and is left out." in result.stderr
    assert len(rows()) == 5


def test_the_question_of_an_audit(audit):
    found = audit.to_dict()["question"]
    assert found["pair"] == list(audit.pair)
    assert found["text"] == audit.question
    for name, stretch in zip(audit.pair, found["look_at"], strict=True):
        assert stretch is not None or f"{name} (look" not in audit.question
        assert str(name) in audit.question
    answered = audit.answered({0: "good", 3: "bad"})
    assert answered.question is None
    assert answered.to_dict()["question"] is None


def test_facts_are_in_every_output_and_change_no_word(data):
    table = pq.read_table(data).append_column("day", pa.array(np.repeat(np.where(np.arange(24) % 2, "a", "b"), 40)))
    pq.write_table(table, "s.parquet")
    plain = json.loads(ok("audit", data, "--observations", "x,v", "--json").stdout)["demonstrations"]
    options = ["--session", "day", "--observations", "x,v", "--verdicts", "v.csv", "--json"]
    rows = json.loads(ok("audit", "s.parquet", *options).stdout)["demonstrations"]
    assert {row["facts"]["session"] for row in rows if row["id"] % 2} == {"a"}
    assert set(plain[0]["facts"]) >= {"length", "pauses", "smoothness", "path"}
    header = Path("v.csv").read_text().splitlines()[0].replace('"', "").split(",")
    assert [name for name in header if name.startswith("fact_")] == [
        *("fact_length", "fact_pauses", "fact_smoothness", "fact_path"),
        "fact_session",
    ]


def test_whatever_the_ids_are_the_answers_are_read_again():
    odd = " lead|trail |\u00a0space|\x85next|\u2028line|lead|,|=1+1|+5|007|7|a\nb|\t|' a"
    ids = odd.split("|")
    name = write("odd.parquet", len(ids), ids)
    out = label("3gbgbgbq", name)
    label("gbgbgb", name)  # goes on
    labels, pairs = read_answers("labels.csv", ids)
    assert (len(labels), pairs) == (14, {})
    assert set(labels) == set(ids)
    assert out.count("Question") == 8
    options = ["--observations", "x,v", "-q"]
    found = json.loads(ok("audit", name, "--labels", "labels.csv", "--json", "--verdicts", "v.csv", *options).stdout)
    assert found["finding"] == "answered"
    assert {row["id"] for row in found["demonstrations"]} == {*ids}
    for verdicts in ("labels.csv", "v.csv"):
        ok("keep", name, "-o", f"kept-by-{verdicts}.parquet", "--verdicts", verdicts, *options)
    good = {m for m, word in labels.items() if word == "good"}
    assert {*pq.read_table("kept-by-labels.csv.parquet")["episode_index"].to_pylist()} == good


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
    refused(
        r"labels\.csv: it is a link that leads to nothing; remove it, or give another file",
        command,
        "no-data.parquet",
        "-q",
    )
    assert not Path("elsewhere.csv").exists()
    assert Path("labels.csv").is_symlink()


def test_a_note_is_written_beside_the_answer(data):
    label(["4 slips at 3 s", "U  =too dark", "g", "q"], data)
    lines = rows()
    assert lines[0] == "id,label,note"
    first, second, third, fourth = (line.partition(",")[0] for line in lines[1:5])
    assert lines[1:] == [
        f"{first},bad,slips at 3 s",
        f"{second},bad,slips at 3 s",
        f"{third},cannot tell,'=too dark",
        f"{fourth},good,",
    ]
    found = json.loads(ok("audit", data, "--observations", "x,v", "--labels", "labels.csv", "--json").stdout)
    said = {str(one["id"]): one["label"] for one in found["demonstrations"]}
    assert (said[first], said[second], said[third], said[fourth]) == ("bad", "bad", "", "good")
