"""Lines of JSON: an object for each step, and folders of them."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rpil
from command_line import ok, refused
from rpil.data.errors import DataError
from rpil.formats.json_lines import find_defects

RNG = np.random.default_rng(0)
LENGTHS = (4, 6, 5)
STATES = [RNG.normal(size=(n, 2)).tolist() for n in LENGTHS]
MOVES = [RNG.normal(size=n).tolist() for n in LENGTHS]


def write(path, values):
    path.write_text("".join(f"{json.dumps(value)}\n" for value in values))
    return path


def test_each_file_of_a_folder_is_a_demonstration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "meta").mkdir(parents=True)
    for m in (0, 1, 10):
        rows = [{"x": x, "action": a} for (x, _), a in zip(STATES[m % 3], MOVES[m % 3], strict=True)]
        write(tmp_path / "runs" / f"run_{m}.jsonl", rows)
    write(tmp_path / "runs" / "meta" / "notes.jsonl", [{"of": "all"}])
    (tmp_path / "runs" / "README.txt").write_text("a,b\n1,2\n")
    (tmp_path / "runs" / "labels.csv").write_text("id,label\nrun_0,good\n")  # of rpil label
    assert rpil.open("runs").describe().format == "JSON lines, 3 files"
    assert rpil.read("runs").ids == ("run_0", "run_1", "run_10")
    (tmp_path / "runs" / "more").mkdir()
    write(tmp_path / "runs" / "more" / "run_0.jsonl", rows)
    assert rpil.read("runs").ids == ("more/run_0", "run_0", "run_1", "run_10")
    refused("keep writes no folder of JSON lines; write the list with -o ids.json, or a", "keep", "runs", "-o", "new")


@pytest.mark.parametrize(
    "text", ['{"x": 1, "action": 2}\n{"x": ', "[1, 2]\n", '{"x": 1}\n{"x": "a"}\n', "[" * 9999, '{"x": [{"y": []}]}\n']
)
def test_what_is_damaged_is_one_sentence(text, tmp_path):
    (tmp_path / "a.jsonl").write_text(text)
    with pytest.raises(DataError, match=r"^a\.jsonl[:,] .*\.$"):
        rpil.read(tmp_path / "a.jsonl")


STEP = '{"episode": 0, "x": 1, "action": 2}\n'


@pytest.mark.parametrize(
    "text",
    [
        f'\n{STEP}\n{STEP}{{"episode": 0, "x"',
        STEP + STEP + "\0" * 100,
        STEP + STEP[:-1] + STEP,
        json.dumps(json.loads(STEP), indent=1),
        STEP.replace("\n", "\r") * 3,
    ],
)
def test_a_line_that_holds_no_object_or_several_is_refused(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # in which no file changes
    (tmp_path / "a.jsonl").write_bytes(text.encode())
    sentence = (
        r"a\.jsonl: no lines of JSON, or damaged .*(line|row|object).*; write an object of the same kind on each line"
    )
    refused(sentence, "info", tmp_path / "a.jsonl")
    refused(sentence, "info", tmp_path / "a.jsonl", "--skip-bad")


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
@pytest.mark.parametrize("blank", [b"", b"\n"])  # with blank lines a file is read line by line
def test_a_return_within_an_object_ends_no_line(end, blank, tmp_path):
    lines = [b'{"episode_index": %d,\r "x": %d, "action": 0.%d}' % (m, k, k) for m in range(4) for k in range(1, 6)]
    (tmp_path / "a.jsonl").write_bytes(b"".join(line + end + blank for line in lines))
    (tmp_path / "labels.csv").write_text("id,label\n0,bad\n")
    ok("keep", tmp_path / "a.jsonl", "-o", tmp_path / "b.jsonl", "--verdicts", tmp_path / "labels.csv")
    assert (tmp_path / "b.jsonl").read_bytes() == b"".join(line + end for line in lines[5:])
    assert rpil.open(tmp_path / "b.jsonl").describe().format == "JSON lines"


@pytest.fixture
def pictures(tmp_path):
    (tmp_path / "images").mkdir()
    for k in range(10):
        (tmp_path / "images" / f"{k}.jpg").write_bytes(b"" if k in (3, 4, 5) else b"x")
    return tmp_path


def said(names, pictures):
    lines = [json.dumps({"x": k, "image": name}) for k, name in enumerate(names)]
    (pictures / "a.jsonl").write_text("\n".join(lines))
    return [defect.sentence for defect in find_defects(pictures / "a.jsonl")]


@pytest.mark.parametrize("form", ["{}.jpg", "images/{}.jpg", "C:\\data\\images\\{}.jpg", "/elsewhere/{}.jpg"])
def test_empty_and_missing_files_are_named_by_their_rows(pictures, form):
    names = [form.format(k) for k in range(12)]
    assert said(names, pictures) == [
        "3 of the 12 files that it names are empty: rows 3-5, 3.jpg to 5.jpg; leave these steps out",
        "2 of the 12 files that it names are not there: rows 10-11, 10.jpg to 11.jpg; leave these steps out",
    ]


def test_sound_files_other_texts_and_files_that_were_left_elsewhere_say_nothing(pictures):
    assert said([f"{k}.jpg" for k in (0, 1, 2)], pictures) == []
    assert said(["pour", "stack", "wipe"], pictures) == []
    assert said([f"{k}.png" for k in range(4)], pictures) == []


def test_no_path_and_no_link_out_of_the_pictures_is_followed(pictures):
    inside = pictures / "set"
    inside.mkdir()
    (inside / "images").symlink_to(pictures / "images")
    assert said(["../images/3.jpg", "../images/4.jpg"], inside) == []
    assert said(["images/3.jpg", "images/0.jpg"], inside) == []


def test_a_tub_whose_steps_cannot_be_read_is_told_of_its_pictures(pictures):
    lines = [{"cam/image_array": f"{k}.jpg", "user/angle": 0.1 * k, "user/mode": "user"} for k in range(10)]
    (pictures / "catalog_0.catalog").write_text("\n".join(map(json.dumps, lines)))
    report = rpil.check(pictures)
    assert [(fault.rule, fault.grade) for fault in report.findings] == [("named files", "broken")]
    assert "no column holds" in report.not_checked["spike"]
    (pictures / "images" / "3.jpg").write_bytes(b"x")
    (pictures / "images" / "4.jpg").write_bytes(b"x")
    (pictures / "images" / "5.jpg").write_bytes(b"x")
    with pytest.raises(rpil.DataError, match="no column holds"):
        rpil.check(pictures)
