"""Answers about rows of demonstrations: id,start,end,label."""

from __future__ import annotations

import numpy as np
import pytest

import rpil
from rpil.data.errors import DataError
from rpil.data.id_values import AnswerRow, label_rows, parse_marks, read_answer_rows, read_answers, write_answers

IDS, LENGTHS = ("a, b", 'say "x"', "é\u2028z", "4"), np.array([20, 30, 40, 50])


def marks_of(rows):
    return parse_marks(rows, "labels.csv", IDS, LENGTHS)


def test_rows_and_demonstrations_stand_in_one_file(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text(
        'id,label,start,end\n"a, b",bad,5,9\n4,good,,\n"say ""x""",GOOD, 0 , 30.0\né\u2028z,bad,1,2\n9,bad,1,2\n'
    )
    rows = read_answer_rows(path)
    assert marks_of(rows).tolist() == [[0, 5, 9, -1], [1, 0, 30, 1], [2, 1, 2, -1]]
    assert read_answers(path) == ({"4": "good"}, {})


@pytest.mark.parametrize(
    ("start", "end"),
    [
        *(("5", "5"), ("9", "5"), ("-1", "5"), ("5", "21"), ("5", ""), ("", "5"), ("nan", "5"), ("1e3", "5")),
        *(("0x1", "5"), ("0", "9" * 400), ("1.5", "3"), ("٣", "9"), (None, 5), (float("nan"), 5), (True, 5)),
        (0, float("inf")),
    ],
)
def test_rows_that_are_none_are_refused_in_one_sentence(start, end):
    with pytest.raises(DataError, match=r"labels.csv, demonstration 'a, b', rows .* 0 <= start < end <= 20; correct"):
        marks_of([AnswerRow("a, b", "bad", "", start, end)])


def test_rows_are_good_or_bad_and_not_both():
    for word in ("better than 4", "cannot tell", "", 3):
        with pytest.raises(DataError, match=r"rows 1 to 5: unknown label .* write 'good' or 'bad'"):
            marks_of([AnswerRow("4", word, "", 1, 5)])
    good, bad = AnswerRow("4", "good", "", 1, 5), AnswerRow("4", "bad", "", 4, 9)
    with pytest.raises(DataError, match=r"rows 4 to 9: some of these rows have the other label too"):
        marks_of([good, bad])
    assert len(marks_of([good, bad._replace(start=5), good._replace(end=4)])) == 3


def test_a_written_mark_replaces_that_of_the_same_rows_alone(tmp_path):
    path = tmp_path / "labels.csv"
    before = b"id,label,mine\n4,bad,x\n"
    write_answers(path, before, [AnswerRow("4", "bad", "", 1, 5), AnswerRow(IDS[0], "good", "a note", 2, 3)])
    assert path.read_text().splitlines()[0] == "id,label,mine,note,start,end"
    write_answers(path, path.read_bytes(), [AnswerRow("4", "good", "", 1, 5)])
    rows = read_answer_rows(path)
    assert {(row.id, row.label, row.start, row.end) for row in rows} == {
        ("4", "bad", "", ""), (IDS[0], "good", "2", "3"), ("4", "good", "1", "5")
    }  # fmt: skip
    write_answers(path, path.read_bytes(), [AnswerRow("4", "good")])
    assert len(read_answer_rows(path)) == 3


def recording(n=10):
    rng = np.random.default_rng(0)
    pairs = ((x := rng.normal(size=(20, 3)), x[:, :2] + 0.1 * rng.normal(size=(20, 2))) for _ in range(n))
    return rpil.Demonstrations.from_episodes(list(pairs), ids=[f"r{k}" for k in range(n)])


def test_bad_rows_weigh_nothing_and_change_no_verdict():
    data = recording()
    plain, marked = rpil.audit(data), rpil.audit(data, labels={("r3", 5, 15): "bad", ("r4", 0, 3): "good"})
    rows = slice(3 * 20 + 5, 3 * 20 + 15)
    assert not marked.step_weight[rows].any()
    assert (marked.step_weight == 0).sum() == 10
    assert marked.step_weight.mean() == pytest.approx(1)
    assert marked.verdicts == plain.verdicts
    assert marked.finding == plain.finding
    np.testing.assert_array_equal(plain.log_odds, marked.log_odds)
    later = plain.answered({("r3", 5, 15): "bad"})
    np.testing.assert_allclose(later.step_weight, marked.step_weight)
    both = rpil.audit(data, labels={("r3", 5, 15): "bad", "r3": "good", "r1": "bad"})
    assert not both.step_weight[rows].any()
    np.testing.assert_allclose(
        plain.answered({"r3": "good", "r1": "bad", ("r3", 5, 15): "bad"}).step_weight, both.step_weight
    )
    assert not len(later.answered({"r3": "good"}, instead=True).answers.marks)
    with pytest.raises(DataError, match="no demonstration is called 'r99'"):
        plain.answered({("r99", 5, 15): "bad"})
    with pytest.raises(DataError, match="no demonstration is called 'r99'"):
        rpil.audit(data, labels={("r99", 5, 15): "bad"})


def test_labels_that_are_no_rows_are_still_read_as_before():
    assert label_rows({3: "good"}) == [AnswerRow("3", "good", "", "", "")]
    with pytest.raises(DataError):
        label_rows([("a", 1, 2, "bad")])
