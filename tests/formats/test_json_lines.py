"""Lines of JSON: an object for each step, and folders of them."""

from __future__ import annotations

import json

import pytest

import rpil
from command_line import ok, refused
from rpil.data.errors import DataError
from rpil.formats.json_lines import find_defects


def write(path, values):
    path.write_text("".join(f"{json.dumps(value)}\n" for value in values))
    return path


def test_each_file_of_a_folder_is_a_demonstration(tmp_path):
    (tmp_path / "runs" / "meta").mkdir(parents=True)
    for m in (0, 1, 10):
        rows = [{"x": 0.3 * k, "action": (k + m) % 4 / 7} for k in range(4 + m)]
        write(tmp_path / "runs" / f"run_{m}.jsonl", rows)
    write(tmp_path / "runs" / "meta" / "notes.jsonl", [{"of": "all"}])
    (tmp_path / "runs" / "README.txt").write_text("a,b\n1,2\n")
    (tmp_path / "runs" / "labels.csv").write_text("id,label\nrun_0,good\n")  # of rpil label
    assert rpil.open("runs").description.format == "JSON lines, 3 files"
    assert rpil.read("runs").ids == ("run_0", "run_1", "run_10")
    (tmp_path / "runs" / "more").mkdir()
    write(tmp_path / "runs" / "more" / "run_0.jsonl", rows)
    assert rpil.read("runs").ids == ("more/run_0", "run_0", "run_1", "run_10")
    (tmp_path / "two").mkdir()
    for m in (0, 1):
        rows = [{"drive": 0, "step": k, "x": 0.3 * k, "action": k / 7} for k in range(5)]
        write(tmp_path / "two" / f"{m}.catalog", rows)
    refused("demonstration 0: it is both in 0.catalog and in 1.catalog; .*, --exclude drive", "info", "two")
    write(tmp_path / "nested.jsonl", [{"x": [{"y": []}]}])
    refused(r"nested\.jsonl: no column says which demonstration a row is from", "info", "nested.jsonl")
    refused("keep writes no folder of JSON lines; write the list with -o ids.json, or a", "keep", "runs", "-o", "new")


def test_records_that_donkeycar_marks_as_deleted_are_left_out(tmp_path):
    rows = [
        {"_index": k, "_session_id": f"s{k // 10}", "cam": f"{k}.jpg", "speed": k % 7, "user/angle": k / 9}
        for k in range(30)
    ]
    for m in (0, 1):
        write(tmp_path / f"catalog_{m}.catalog", rows[15 * m : 15 * m + 15])
    write(tmp_path / "manifest.json", manifest := [["user/angle"], ["float"], {}, {}, {"deleted_indexes": [3, 4, 29]}])
    assert (recording := rpil.open(tmp_path)).description.format == "JSON lines, 2 files, without 3 deleted records"
    assert recording.demonstrations.actions[:, 0].tolist() == [k / 9 for k in range(30) if k not in (3, 4, 29)]
    assert [recording.steps.place_of(k, 0).split()[-1] for k in (4, 26)] == ["7", "14"], "lines of the files"
    for k in {*range(29)} - {3, 7}:  # of records 3, 4 and 29, which are deleted, two have no image
        (tmp_path / f"{k}.jpg").write_bytes(b"x")
    assert [one.sentence[:54] for one in find_defects(tmp_path)] == [
        "1 of the 27 files that it names are not there: row 7, "
    ]
    rpil.open(tmp_path / "catalog_0.catalog").keep(["s0"], tmp_path / "kept.catalog")
    assert (tmp_path / "kept.catalog").read_text().count("\n") == 8
    write(tmp_path / "manifest.json", manifest[:4])
    refused(r"manifest\.json: its last line does not say which records are deleted .*; copy it again", "info", tmp_path)


STEP = '{"episode": 0, "x": 1, "action": 2}\n'


@pytest.mark.parametrize(
    "text",
    [
        *('{"x": 1, "action": 2}\n{"x": ', "[1, 2]\n", '{"x": 1}\n{"x": "a"}\n', "[" * 9999),
        f'\n{STEP}\n{STEP}{{"episode": 0, "x"',
        STEP + STEP + "\0" * 100,
        STEP + STEP[:-1] + STEP,
        json.dumps(json.loads(STEP), indent=1),
        STEP.replace("\n", "\r") * 3,
    ],
)
def test_a_line_that_holds_no_object_or_several_is_refused(text, tmp_path):
    (tmp_path / "a.jsonl").write_bytes(text.encode())
    with pytest.raises(DataError, match=r"^a\.jsonl[:,] .*\.$"):
        rpil.read(tmp_path / "a.jsonl")
    for options in ([], ["--skip-bad"]):
        said = r"a\.jsonl: no lines of JSON, or damaged .*(line|row|object).*; write an object of the same kind on each"
        refused(f"{said} line", "info", tmp_path / "a.jsonl", *options)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
@pytest.mark.parametrize("blank", [b"", b"\n"])  # with blank lines a file is read line by line
def test_a_return_within_an_object_ends_no_line(end, blank, tmp_path):
    lines = [b'{"episode_index": %d,\r "x": %d, "action": 0.%d}' % (m, k, k) for m in range(4) for k in range(1, 6)]
    (tmp_path / "a.jsonl").write_bytes(b"".join(line + end + blank for line in lines))
    (tmp_path / "labels.csv").write_text("id,label\n0,bad\n")
    ok("keep", tmp_path / "a.jsonl", "-o", tmp_path / "b.jsonl", "--verdicts", tmp_path / "labels.csv")
    assert (tmp_path / "b.jsonl").read_bytes() == b"".join(line + end for line in lines[5:])
    assert rpil.open(tmp_path / "b.jsonl").description.format == "JSON lines"


def test_a_missing_flag_is_a_missing_value_and_no_observation_is_lost_in_silence(tmp_path):
    seen = [{"x": k % 4 / 7, "on": None if k == 7 else k % 3 > 0} for k in range(40)]
    rows = [{"episode": k // 5, "action": k % 3 / 7, "observation": one} for k, one in enumerate(seen)]
    recording = rpil.open(write(tmp_path / "a.jsonl", rows), skip_bad=True)
    assert recording.set_aside == (1,)
    assert "1: on is nan at step 2" in str(rpil.check(tmp_path / "a.jsonl")).replace("missing values: ", "")
    for k in range(2):  # blank in the first file alone
        values = "".join(f"{n},{n % 3},{n * k if k else ''}\n" for n in range(9))
        (tmp_path / f"r{k}.csv").write_text(f"observation.x,action,observation.y\n{values}")
    (tmp_path / "a.jsonl").unlink()
    with pytest.raises(DataError, match=r"r0\.csv.* 'observation.y' has no value"):
        rpil.read(tmp_path)


EMPTY = "3 of the 12 files that it names are empty: rows 3-5, 3.jpg to 5.jpg; leave these steps out"
LOST = "2 of the 12 files that it names are not there: rows 10-11, 10.jpg to 11.jpg; leave these steps out"
SAID = [*(f"{place}{{}}.jpg" for place in ("", "images/", "C:\\images\\", "../images/")), "pour", "{}.png"]


@pytest.mark.parametrize("form", SAID)
def test_empty_and_missing_files_are_named_by_their_rows(tmp_path, form):
    """Even where the steps cannot be read; no path out of the folder, and no link, is followed."""
    for name in ("images", "out"):
        (tmp_path / name).mkdir()
    for k in range(10):
        (tmp_path / "images" / f"{k}.jpg").write_bytes(b"x" * (k not in (3, 4, 5)))
    (tmp_path / "out" / "images").symlink_to(tmp_path / "images")
    for path in (tmp_path / "out" / "a.jsonl", tmp_path / "a.jsonl"):
        path.write_text("".join(f'{{"user/angle": 0.1, "image": {json.dumps(form.format(k))}}}\n' for k in range(12)))
        found = [defect.sentence for defect in find_defects(path)]
        assert found == ([EMPTY, LOST] if form in SAID[:4] and path.parent == tmp_path else [])
    if found:
        report = rpil.check(tmp_path / "a.jsonl")
        assert [(fault.rule, fault.grade) for fault in report.findings] == 2 * [("named files", "broken")]
        assert report.headline.startswith("The steps were not checked: a.jsonl: no column says which demonstration")
