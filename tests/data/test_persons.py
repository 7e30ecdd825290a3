"""Several persons in one file of labels: what is learned, how far they agree, and that notes stay what they are."""

from __future__ import annotations

import csv
import json

import pytest

from problems import refused
from rpil.data.errors import DataError, DataWarning
from rpil.data.id_values import answers_of_persons, parse_answers, read_answer_rows, read_answers, write_answers
from rpil.data.persons import AnswerRow, agreement_lines

BOTH = """id,label,by,note
1,good,anna,
1,good,bilal,
1,bad,chen,slipped
2,good,anna,
2,bad,bilal,
3,bad,anna,
3,better than 4,anna,
4,better than 3,bilal,
5,same as 6,anna,
6,same as 5,bilal,
7,cannot tell,bilal,camera dark
"""


def test_most_persons_are_learned_from_and_a_tie_teaches_nothing(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text(BOTH)
    with pytest.warns(DataWarning, match=r"labels\.csv: Nothing is learned from .* persons disagree: 2 and 3 or 4\."):
        assert read_answers(path) == ({"1": "good", "3": "bad"}, {("5", "6"): "same as"})
    assert read_answer_rows(path)[2] == AnswerRow("1", "bad", "slipped", "", "chen")
    given = answers_of_persons(read_answer_rows(path), "labels.csv", ())
    assert list(agreement_lines(given)) == [
        "anna and bilal answered the same 4 questions, and agree on 2 (50%, Cohen's kappa 0.20).",
        "anna and chen answered the same 1 question, and agree on 0 (0%, Cohen's kappa 0.00).",
        "bilal and chen answered the same 1 question, and agree on 0 (0%, Cohen's kappa 0.00).",
        "Nothing is learned from answers in which persons disagree: 2 and 3 or 4.",
    ]


def test_kappa_is_that_of_cohen():
    # 50 answers, 20 and 15 alike; by chance 0.5 would be: 0.5 * 0.6 + 0.5 * 0.4.
    words = [("good", "good")] * 20 + [("good", "bad")] * 5 + [("bad", "good")] * 10 + [("bad", "bad")] * 15
    rows = [AnswerRow(str(m), word, by=by) for m, both in enumerate(words) for by, word in zip("ab", both, strict=True)]
    line, tied = agreement_lines(answers_of_persons(rows, "", ()))
    assert tied.startswith("Nothing is learned from answers in which persons disagree: 20, 21, ")
    assert line == "a and b answered the same 50 questions, and agree on 35 (70%, Cohen's kappa 0.40)."


def test_one_person_alone_says_the_same_once(tmp_path):
    rows = [AnswerRow("1", "good", by="anna"), AnswerRow("1", "bad", by="anna")]
    with refused("the answers, demonstration '1': it is labelled twice"):
        parse_answers(rows, "the answers", ())
    given = answers_of_persons(rows[:1], "", ())
    assert list(agreement_lines(given)) == []
    path = tmp_path / "labels.csv"
    path.write_text("id,label,note\n3,cannot tell,dark\n")
    assert read_answers(path) == ({}, {}), "what was only noted is no error"


HOSTILE = ["=1+1", "@SUM(1)", "'=2", 'say "no", he said', "<script>alert(1)</script>", "two\nlines", "＝1", "é\u202e"]


@pytest.mark.parametrize(
    "before", [None, b"id,label\n1,good\n", b"note;id;label\r\nold;1;good\r\n", b"by,label,id\nme,good,1\n"]
)
def test_notes_tags_and_names_are_read_as_they_were_written(tmp_path, before):
    path = tmp_path / "labels.csv"
    rows = [AnswerRow(f"n{k}", "bad", note, note[::-1].strip(), f"p {note}".strip()) for k, note in enumerate(HOSTILE)]
    write_answers(path, before, rows)
    old = [] if before is None else [row for row in read_answer_rows(path) if row.id == "1"]
    assert read_answer_rows(path) == [*old, *rows]
    assert len(old) == (before is not None)
    if before and b"by" in before:
        assert old == [AnswerRow("1", "good", by="me")]
    comma = ";" if before and b";" in before else ","
    with path.open(newline="") as file:
        cells = [cell for row in csv.reader(file, delimiter=comma) for cell in row if cell]
    assert not [cell for cell in cells if cell[0] in "=+-@\t\r\n＝"], "a spreadsheet computes none of them"
    if before:
        assert path.read_bytes().splitlines()[1] == before.splitlines()[1], "rows that were there stay as they were"


def test_a_label_replaces_that_of_the_same_person_alone(tmp_path):
    path = tmp_path / "labels.csv"
    before = b"id,label,by\n1,good,anna\n1,bad,bilal\n1,good,\n1,better than 2,bilal\n"
    write_answers(path, before, [AnswerRow("1", "good", "after all", "", "bilal")])
    assert path.read_text().splitlines() == [
        "id,label,by,note", "1,good,anna", "1,good,", "1,better than 2,bilal", "1,good,bilal,after all",
    ]  # fmt: skip
    write_answers(path, before, [AnswerRow("1", "bad")])
    assert path.read_text().splitlines()[1:] == ["1,good,anna", "1,bad,bilal", "1,better than 2,bilal", "1,bad,"]


def test_json_holds_them_as_well(tmp_path):
    path, before = tmp_path / "labels.json", b'{"1": ["good", "better than 2"], "3": {"label": "bad", "by": "anna"}}'
    write_answers(path, before, [AnswerRow("1", "bad", "slips, =late", "drop", "bilal"), AnswerRow("3", "good")])
    written = {"label": "bad", "note": "slips, =late", "tag": "drop", "by": "bilal"}
    three = [{"label": "bad", "by": "anna"}, "good"]
    assert json.loads(path.read_text()) == {"1": ["good", "better than 2", written], "3": three}
    rows = read_answer_rows(path)
    assert rows[2:] == [AnswerRow("1", *written.values()), AnswerRow("3", "bad", by="anna"), AnswerRow("3", "good")]
    write_answers(path, path.read_bytes(), [AnswerRow("3", "bad", "", "", "anna")])
    assert sorted(read_answer_rows(path)) == sorted(rows)
    path.write_text('{"1": {"label": "good", "label": "bad"}}')
    with pytest.raises(DataError, match="demonstration '1': unknown label"):
        read_answers(path)
    path.write_text(r'{"1": {"label": "good", "note": "\ud800"}}')
    with pytest.raises(DataError, match=r"labels\.json, demonstration '1': a note, a tag or a name"):
        read_answer_rows(path)
    for wrong in ('{"label": "bad", "why": "x"}', '["good", {"label": "bad", "note": 1}]'):
        path.write_text(f'{{"1": {wrong}}}')
        with pytest.raises(DataError, match=r"labels.json, demonstration '1': an answer has .*; give it label, note"):
            read_answer_rows(path)
