"""Notes in a file of labels stay what they are."""

from __future__ import annotations

import csv

import pytest

from rpil.data.id_values import AnswerRow, read_answer_rows, write_answers

HOSTILE = ["=1+1", "@SUM(1)", "'=2", 'say "no", he said', "<script>alert(1)</script>", "two\nlines", "＝1", "é\u202e"]


@pytest.mark.parametrize(
    "before", [None, b"id,label\n1,good", b"note;id;label\r\nold;1;good\r\n", b"by,label,id\nme,good,1\n"]
)
def test_notes_are_read_as_they_were_written(tmp_path, before):
    path = tmp_path / "labels.csv"
    rows = [AnswerRow(f"n{k}", "bad", note) for k, note in enumerate(HOSTILE)]
    write_answers(path, before, rows)
    old = [] if before is None else [row for row in read_answer_rows(path) if row.id == "1"]
    assert read_answer_rows(path) == [*old, *rows]
    assert len(old) == (before is not None)
    comma = ";" if before and b";" in before else ","
    with path.open(newline="") as file:
        cells = [cell for row in csv.reader(file, delimiter=comma) for cell in row if cell]
    assert not [cell for cell in cells if cell[0] in "=+-@\t\r\n＝"], "a spreadsheet computes none of them"
    if before:
        assert path.read_bytes().splitlines()[1].startswith(before.splitlines()[1]), "old rows keep their cells"


def test_a_label_replaces_the_one_before(tmp_path):
    path = tmp_path / "labels.csv"
    before = b"id,label,by\n1,good,anna\n2,good,\n1,better than 2,bilal\n"
    write_answers(path, before, [AnswerRow("1", "bad", "after all")])
    assert path.read_text().splitlines() == [
        "id,label,by,note", "2,good,,", "1,better than 2,bilal,", "1,bad,,after all",
    ]  # fmt: skip
