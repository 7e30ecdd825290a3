"""Files of ids and values: labels, pairs and demonstrators."""

import csv

import numpy as np
import pandas as pd
import pytest

from asked import read_answers
from problems import refused, refused_file
from rpil import formats
from rpil.data.errors import DataError
from rpil.data.id_values import (
    AnswerRow,
    label_rows,
    label_signs,
    match_pairs,
    parse_answers,
    parse_marks,
    read_answer_rows,
    write_answers,
)


def as_rows(pairs):
    """Answers as rows of a file of labels, from ids and words."""
    return [AnswerRow(*pair) for pair in pairs]


@pytest.mark.parametrize("header", ["id,label", "episode_index, label", "note,label,id", "\ufeffid,label"])
def test_labels_csv(tmp_path, header):
    path = tmp_path / "labels.csv"
    row = "{note},{label},{id}" if header.startswith("note") else "{id},{label}"
    rows = [row.format(id=i, label=word, note="") for i, word in ((7, "EXPERT"), ("a", " Bad "), ("b", "good"))]
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    labels, _ = read_answers(path)
    assert labels == {"7": "good", "a": "bad", "b": "good"}
    assert label_signs(labels, ("b", "x", "a", 7)).tolist() == [1, 0, -1, 1]
    assert parse_answers(label_rows({"b": "ADVERSARY", 7: "Expert"}), "")[0] == {"b": "bad", "7": "good"}


def test_files_that_hold_no_labels(tmp_path):
    headless = "no column is called 'id', 'label'; rename one .found '7', 'good'.; ids are"
    cases = ("l.csv", "7,good\n", headless), ("l.csv", "", "the file is empty"), ("l.json", "", "use one of .csv")
    for name, text, match in cases:
        (tmp_path / name).write_text(text)
        refused_file(match, read_answers, tmp_path / name)
    refused_file("no such file", read_answers, tmp_path / "missing.csv")


def better(pairs):
    return dict.fromkeys(pairs, "better than")


def test_a_file_of_answers_holds_labels_and_pairs(tmp_path):
    path = tmp_path / "answers.csv"
    path.write_text('id,label\n7,good\n7,better than 3\n7,"BETTER  Than a,b"\n3, Better than a b \n7,better than 3\n')
    assert read_answers(path) == ({"7": "good"}, better([("7", "3"), ("7", "a,b"), ("3", "a b")]))
    path.write_text("id,label\n12,Same  AS 7\n12,same as a same as b\n7,same as 12\n7,same as 3\n")
    same = dict.fromkeys([("12", "7"), ("12", "a same as b"), ("3", "7")], "same as")  # neither is the first
    assert read_answers(path) == ({}, same)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("7,great\n", "'7': unknown label 'great'; write 'good', 'bad', 'better than ID'"),
        ("7\n", "demonstration '7': unknown label ''"),
        ("7,good\n7,bad\n", "demonstration '7': it is labelled twice"),
        ("", "labels no demonstration"),
        ('"7,good\n', "cannot be read as CSV"),
        ("7,better than 7\n", "demonstration '7': it is compared with itself; name two"),
        ("7,better than 3\n3,BETTER than 7\n", "'3' and '7': two answers contradict each other; keep one answer"),
        ("7,better than\n", "demonstration '7': unknown label 'better than'; write 'good', 'bad', 'better than ID'"),
        ("7,same as 7\n", "demonstration '7': it is compared with itself; name two"),
        ("7,same as 3\n7,better than 3\n", "'7' and '3': two answers contradict each other; keep one answer"),
        ("7,better than 3\n3,same as 7\n", "'3' and '7': two answers contradict each other; keep one answer"),
        ("7,same as\n", "unknown label 'same as'; write .* or 'same as ID'"),
        ("7,worse than 3\n", "unknown label 'worse than 3'"),
    ],
)
def test_bad_answers(tmp_path, text, match):
    path = tmp_path / "answers.csv"
    path.write_text(f"id,label\n{text}")
    refused_file(match, read_answers, path)


def test_pairs_are_numbers_of_demonstrations():
    given = [((7, "a"), "better than"), (("b", "a"), "same as"), (("b", 7), "better than"), (("7", "a"), "better than")]
    pairs, tied = match_pairs([*given, (("a", "b"), "same as")], ["a", 7, "b"])
    assert (pairs.tolist(), tied.tolist()) == ([[1, 0], [2, 1]], [[0, 2]])
    assert [found.shape for found in match_pairs([], ["a"])] == [(0, 2)] * 2
    for pairs, match in (
        ([("a", "c")], "no demonstration is called 'c'"),
        ([("a", "a")], "demonstration 'a': it is compared with itself"),
        ([("a", 7), (7, "a")], "'7' and 'a': two answers contradict each other"),
    ):
        with pytest.raises(DataError, match=match):
            match_pairs(better(pairs).items(), ["a", 7])


def demonstrators_of(where, path):
    return formats.read_demonstrators(where, formats.open(path, operator=where))


def test_reading_demonstrators(tmp_path):
    (tmp_path / "who.csv").write_text("id,demonstrator\n0,Ann\n1, Bob\n")
    steps = {"episode_ids": np.repeat([5, 2], 3), "observations": np.ones((6, 1)), "actions": np.zeros(6)}
    np.savez(tmp_path / "each.npz", **steps, who=np.array(["x", "y"]), n=np.zeros((2, 2)))
    (tmp_path / "data.csv").write_text("episode_index,who,action,x\n0,Ann,1,1\n0,Ann,0,1\n1,Bob,0,1\n")
    (tmp_path / "two.csv").write_text("episode_index,who,action,x\n0,Ann,1,1\n0,Bob,0,1\n1,,0,1\n")
    assert demonstrators_of(str(tmp_path / "who.csv"), tmp_path / "data.csv") == {"0": "Ann", "1": "Bob"}
    assert demonstrators_of("who", tmp_path / "data.csv") == {"0": "Ann", "1": "Bob"}
    assert demonstrators_of("who", tmp_path / "each.npz") == {"5": "x", "2": "y"}
    formats.write(tmp_path / "data.parquet", formats.read(_npz(tmp_path)), {"demonstrator_ids": np.array([3.0, 4.0])})
    assert demonstrators_of("demonstrator_ids", tmp_path / "data.parquet") == {"0": "3", "1": "4"}
    for where, file, match in (
        ("who", "two.csv", "'0': both 'Ann' and 'Bob' gave it"),
        ("nothing", "data.csv", "no column is called 'nothing'"),
        ("n", "each.npz", r"shape \(2, 2\)"),
        (str(tmp_path / "missing.csv"), "data.csv", "no such file"),
        (str(tmp_path / "data.csv"), "data.csv", "no column is called 'demonstrator'"),
    ):
        with pytest.raises(DataError, match=match):
            demonstrators_of(where, tmp_path / file)


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("nobody.csv", "id,demonstrator\n", "it names no demonstrator; give at least one"),
        ("column.csv", "id,who\n0,Ann\n", "no column is called 'demonstrator'; rename one .found 'id', 'who'"),
        ("two.csv", "id,demonstrator\n0,Ann\n0,Bob\n", "demonstration '0': both 'Ann' and 'Bob' gave it; name one"),
        ("short.csv", "id,demonstrator\n0\n", "demonstration '0': it has no demonstrator; name one, or leave it out"),
        ("long.csv", "id,demonstrator\n0,Ann,Bob\n", "line 2: it has more values than there are columns; give"),
        ("no-id.csv", "id,demonstrator\n,Ann\n", "line 2: it names no demonstration; give"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, name, content, match):
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with refused(f"{name}.*{match}"):
        demonstrators_of(str(tmp_path / name), _npz(tmp_path))


def _npz(folder):
    path = folder / "small.npz"
    np.savez(path, observations=np.eye(4), actions=np.array([0, 1, 0, 1]), episode_ids=np.repeat([0, 1], 2))
    return path


@pytest.mark.parametrize("labels", [["bad"], "labels.csv", 3, [("a", "bad", 1)], {"a"}, pd.DataFrame({"id": ["a"]})])
def test_labels_are_a_mapping_or_pairs(labels):
    with pytest.raises(DataError, match="the labels must be a mapping or series of ids to words, or pairs"):
        label_rows(labels)
    assert label_rows([("a", "bad"), (3, "better than a")]) == [AnswerRow("a", "bad"), AnswerRow("3", "better than a")]
    assert parse_answers(label_rows({"a": "same as 3", 4: "Good "}), "") == ({"4": "good"}, {("3", "a"): "same as"})
    assert label_rows(pd.Series({"a": "bad"})) == label_rows([("a", "bad")])
    assert label_rows(None) == label_rows({}) == []


ODD = (" ", "  ", "\t", "\n", "\r", "\r\n", "\x0b", "\x1c", "\x85", "\u00a0", "\u2028", "\u3000", "\ufeff", "\u200b")
SIGNS = [
    *"=+-@,;\"'{\\",
    *("''", '""', "\uff1d", "0", "00", "7", "-7", "1e5", "a", "better than ", "same as ", "good", "\u00e9"),
]


def odd_ids(seed, n=40):
    """Different ids of a few parts, of which any may be white space or mean something to a reader of CSV."""
    rng = np.random.default_rng(seed)
    parts = (*ODD, *SIGNS)
    made = ("".join(parts[k] for k in rng.integers(0, len(parts), rng.integers(1, 5))) for _ in range(n))
    return list(dict.fromkeys(made))


@pytest.mark.parametrize("name", ["labels.csv", "excel.csv", "windows.csv"])
@pytest.mark.parametrize("seed", range(2))
def test_whatever_an_id_is_its_answers_are_read_as_they_were_written(tmp_path, name, seed):
    path, ids = tmp_path / name, odd_ids(seed)
    before = {"excel.csv": b"id;note;label\n", "windows.csv": b"\xef\xbb\xbfid,label\r\n"}.get(name)
    half = len(ids) // 2
    words = [(m, "bad") for m in ids[:half]]
    pairs = better([(ids[0], ids[-1]), *zip(ids[half:], ids[half + 1 :], strict=False)])
    pairs |= {(min(a, b), max(a, b)): "same as" for a, b in zip(ids[:half], ids[half:], strict=False) if a != ids[0]}
    compared = [(m, f"{word} {other}") for (m, other), word in pairs.items()]
    write_answers(path, before, as_rows([*words, *compared]))
    assert read_answers(path) == (dict(words), pairs)
    write_answers(path, path.read_bytes(), as_rows([(m, "good") for m in ids]))  # a label replaces another one
    assert read_answers(path) == (dict.fromkeys(ids, "good"), pairs)
    assert parse_answers(as_rows([*words, *compared]), "") == (dict(words), pairs)


def test_a_file_with_a_mark_of_its_encoding_keeps_it(tmp_path):
    for before in (b"id,label\r\n", b"\xef\xbb\xbfid,label\r\n"):
        write_answers(tmp_path / "labels.csv", before, [AnswerRow("\u00e9", "good")])
        assert (tmp_path / "labels.csv").read_bytes().startswith(before.strip())


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
