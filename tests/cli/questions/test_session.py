"""A run of questions: what is asked, written, replaced and undone."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from asked import read_answers
from rpil.cli.questions.session import Session, next_question, rows_of
from rpil.data.errors import DataError


@pytest.mark.parametrize(
    ("key", "answer"),
    [
        ("1", (("a", "better than 7"),)), ("2", (("7", "better than a"),)), ("3", (("a", "good"), ("7", "good"))),
        ("4", (("a", "bad"), ("7", "bad"))), ("5", (("a", "same as 7"),)), ("u", ()),
    ],
)  # fmt: skip
def test_keys_as_answers(key, answer):
    assert [row[:2] for row in rows_of(("a", 7), key)] == [*answer]
    assert [row[:2] for row in rows_of((7,), "g") + rows_of((7,), "b")] == [("7", "good"), ("7", "bad")]


def test_it_ends_after_four_questions_where_every_demonstration_is_good_or_bad(audit):
    def asked(now, n, most=8, pair=False):
        given = [(audit.pair, "u")] * pair + [((1,), "s")] + [((2,), "g")] * (n - pair)
        return next_question(audit, now, [(*one, ("", "", "")) for one in given], most)

    assert asked(audit, 3) == audit.pair
    assert asked(audit, 4) == audit.pair  # nothing was answered
    sure = replace(audit, verdicts=("good",) * 23 + ("bad",))
    assert (asked(sure, 3), asked(sure, 4)) == (audit.pair, ())
    doubtful = audit.answered({0: "good"})
    assert len(asked(doubtful, 4, pair=True)) == 1
    assert asked(doubtful, 8) == ()
    assert asked(doubtful, 800, None, pair=True)


def test_what_is_skipped_is_asked_no_more_and_of_a_pair_each_alone(audit):
    first, second = audit.suggest_labels(2)
    pair = ((first, second), "u", "")
    assert next_question(audit, audit, [pair], 8) == (first,)
    for key in "us":
        assert next_question(audit, audit, [pair, ((first,), key, "")], 8) == (second,)


def rows():
    return Path("labels.csv").read_text().splitlines()


@pytest.mark.parametrize("name", ["labels.csv", "excel.csv"])
def test_a_label_replaces_that_of_an_earlier_run(audit, name):
    before = {
        "labels.csv": b'note,id,label\n"two\nlines",1,GOOD\n,1,better than 3\n\n"a",2,good\n',
        "excel.csv": b"id;label;note\n1;better than 3;a,b\n1;good;\n2;good;\n",
    }[name]
    Path(name).write_bytes(before)
    start = audit.answered(*read_answers(name))
    session = Session(start, name, before, None)
    session.answer((1,), "b")
    assert read_answers(name) == ({"1": "bad", "2": "good"}, {("1", "3"): "better than"})
    assert session.audit.answers.labels[1] == -1
    session.undo()
    assert read_answers(name) == ({"1": "good", "2": "good"}, {("1", "3"): "better than"})
    assert session.audit.answers.labels[1] == 1


def test_what_cannot_be_written_changes_nothing(audit):
    Path("labels.csv").write_text("id,label\n1,better than 3\n")
    session = Session(audit.answered({}, [(1, 3)]), "labels.csv", Path("labels.csv").read_bytes(), None)
    with pytest.raises(DataError, match="two answers contradict each other"):
        session.answer((3, 1), "1")
    Path("labels.csv").write_text("id,label\n1,better than 3\n5,bad\n")
    with pytest.raises(DataError, match="another program has changed it"):
        session.answer((3,), "b")
    assert (session.version, session.rows, session.given) == (0, (), ())
    assert rows()[-1] == "5,bad"


@pytest.mark.parametrize("now", ["gone", "folder", "pipe", "link to nothing", "other"])
def test_a_file_that_another_program_replaced_is_left_alone(audit, now):
    session, path = Session(audit, "labels.csv", None, None), Path("labels.csv")
    session.answer((1,), "g")
    assert session.is_as_written
    path.unlink()
    {
        "gone": lambda: None,
        "folder": path.mkdir,
        "pipe": lambda: os.mkfifo(path),  # which would be waited for
        "link to nothing": lambda: path.symlink_to("nothing.csv"),
        "other": lambda: path.write_text("id,label\n1,bad\n"),
    }[now]()
    for change in (lambda: session.answer((3,), "b"), session.undo):
        with pytest.raises(DataError, match=r"labels\.csv: another program has changed it; end this run, and start"):
            change()
    assert not session.is_as_written
    assert [row[:2] for row in session.rows] == [("1", "good")]
    assert [file.name for file in Path().iterdir()] == ["labels.csv"] * (now != "gone")
