"""Lines of JSON: an object for each step, and folders of them."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rpil
from command_line import ok, refused
from rpil.data.errors import DataError

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
    assert rpil.open("runs").description.format == "JSON lines, 3 files"
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
    assert rpil.open(tmp_path / "b.jsonl").description.format == "JSON lines"
