"""``rpil keep`` and ``rpil convert``: the trusted demonstrations, and tables of all, as new files."""

import csv
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import lerobot_folders as folders
import rpil
import samples
from command_line import call, ok, refused
from rpil import formats, load


def test_keep_by_its_own_audit_and_by_an_earlier_one(folder):
    data = folder / "good.parquet"
    Path("labels.csv").write_text("id,label\n0,good\n11,bad\n")
    labels = ["--labels", "labels.csv"]
    ok("audit", data, "--verdicts", "v.csv", *labels, "-q")
    rows = csv.DictReader(Path("v.csv").read_text().splitlines())
    bad = {int(row["id"]) for row in rows if row["verdict"] in ("bad", "outlier")}
    assert 11 in bad <= {*range(6, 12)}
    for extra in (labels, ["--verdicts", "v.csv"]):
        first, said, *_ = ok("keep", data, "-o", "kept.parquet", *extra, "-q").stdout.splitlines()
        assert first == f"Kept {12 - len(bad)} of 12 demonstrations: kept.parquet"
        assert said.startswith("Rejected: 1 by your labels, ")
        assert sum(map(int, re.findall(r"\d+", said))) == len(bad)
        assert {*rpil.read("kept.parquet").ids} == {*range(12)} - bad
        assert pq.read_schema("kept.parquet").equals(pq.read_schema(data), check_metadata=True)
    ok("keep", data, "-o", "most.parquet", "--verdicts", "v.csv", "--share", "0.75")
    assert len(rpil.read("most.parquet")) == 9
    ok("keep", data, "-o", "sure.parquet", "--verdicts", "v.csv", "--at-least", "0")
    assert len(rpil.read("sure.parquet")) == 11


def test_keep_names_what_leaving_out_loses():
    rng = np.random.default_rng(0)
    starts = [*rng.normal(size=12), 90.0]
    rows = [f"{m},{start + rng.normal():.3f},{n % 2}" for m, start in enumerate(starts) for n in range(10)]
    Path("drive.csv").write_text("\n".join(["episode,side,action", *rows]) + "\n")
    Path("labels.csv").write_text("id,label\n12,bad\n" + "".join(f"{m},good\n" for m in range(12)))
    call = ["keep", "drive.csv", "--verdicts", "labels.csv", "-o"]
    first, *rejected, lost = ok(*call, "kept.csv").stdout.splitlines()
    assert first == "Kept 12 of 13 demonstrations: kept.csv"
    assert rejected == ["Rejected: 1 by your labels.", "  by your labels: 12"]
    assert lost.startswith("No kept demonstration starts with side above ")
    assert ok(*call, "again.csv", "-q").stdout.splitlines()[1:] == rejected


def test_one_demonstration_alone_is_kept():
    rows = [f"7,{np.sin(n):.3f},{n % 2}" for n in range(20)]
    Path("drive.csv").write_text("\n".join(["episode,side,action", *rows]) + "\n")
    assert ok("keep", "drive.csv", "-o", "kept.csv").stdout.startswith("Kept 1 of 1 demonstrations: kept.csv\n")
    assert rpil.read("kept.csv").ids == (7,)
    assert "; 1 demonstration, 20 steps" in ok("info", "kept.csv").stdout
    assert ok("convert", "kept.csv", "-o", "one.npz").stdout == "1 demonstration, 20 steps: one.npz\n"
    refused("one demonstration alone", "audit", "drive.csv")
    for word, kept in (("bad", False), ("good", True)):
        Path("labels.csv").write_text(f"id,label\n7,{word}\n")
        call = ["keep", "drive.csv", "--labels", "labels.csv", "-o", f"{word}.csv"]
        ok(*call) if kept else refused("no demonstration is left by the audit; change labels", *call)
        assert Path(f"{word}.csv").exists() == kept
    Path("labels.csv").write_text("id,label\n8,bad\n")
    refused("no demonstration is called '8'", "keep", "drive.csv", "--labels", "labels.csv", "-o", "k.csv")


def test_keep_by_labels_keeps_what_has_no_label(folder):
    Path("labels.csv").write_text("id,label\n2,expert\n11,good\n4,bad\n")
    call = ["keep", folder / "good.parquet", "--verdicts", "labels.csv", "-o"]
    printed = ok(*call, "kept.parquet").stdout.splitlines()
    assert printed[:4] == [
        "Kept 11 of 12 demonstrations: kept.parquet",
        "9 of these are not named in labels.csv: --only IDS keeps some alone.",
        "Rejected: 1 by your labels.",
        "  by your labels: 4",
    ]
    assert rpil.read("kept.parquet").ids == tuple(m for m in range(12) if m != 4)
    left = "no demonstration is left by the verdicts of labels.csv; change labels"
    refused(left, *call, "none.parquet", "--only", "4")


@pytest.mark.parametrize("rule", [[], ["--share", "1"], ["--share", "0.9"], ["--at-least", "0"]])
def test_what_is_labelled_bad_is_never_kept(folder, rule):
    """Demonstrations 0 to 5 are good, and two of them are labelled bad."""
    Path("labels.csv").write_text("id,label\n0,bad\n3,bad\n4,good\n5,good\n")
    ok("keep", folder / "good.parquet", "-o", "kept.parquet", "--labels", "labels.csv", *rule)
    ok("audit", folder / "good.parquet", "--labels", "labels.csv", "--verdicts", "v.csv", "--keep", "k.json", "-q")
    ok("keep", folder / "good.parquet", "-o", "again.parquet", "--verdicts", "v.csv", *rule)
    kept, listed = rpil.read("kept.parquet").ids, json.loads(Path("k.json").read_text())["episodes"]
    assert not {0, 3} & {*kept, *listed}
    assert {4, 5} <= {*kept} & {*listed}
    assert rpil.read("again.parquet").ids == kept
    labels = {
        row["id"]: (row["label"], row["verdict"]) for row in csv.DictReader(Path("v.csv").read_text().splitlines())
    }
    assert labels["0"] == labels["3"] == ("bad", "bad")
    assert labels["4"] == ("good", "good")
    assert labels["1"][0] == ""


def test_labels_choose_episodes_of_lerobot_too(tmp_path):
    robot, observed = tmp_path / "robot", "observation.state"
    (robot / "meta").mkdir(parents=True)
    (robot / "data").mkdir()
    features = {observed: {"dtype": "float32"}, "action": {"dtype": "float32"}}
    (robot / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v2.1", "features": features}))
    columns = {"episode_index": [0, 0, 1, 1, 2, 2, 3, 3], "action": [k / 3 for k in range(8)]}
    pq.write_table(pa.table({**columns, observed: [None, *map(float, range(7))]}), robot / "data" / "a.parquet")
    Path("labels.csv").write_text("id,label\n2,expert\n1,bad\n")
    assert ok("keep", robot, "-o", "k.json", "--verdicts", "labels.csv").stdout.startswith("Kept 3 of 4 demonstrations")
    assert json.loads(Path("k.json").read_text())["episodes"] == [0, 2, 3]
    named = ["--verdicts", "labels.csv", "--only", "1,2"]
    printed = ok("keep", robot, "-o", "keep.json", *named).stdout
    assert printed.startswith("Kept 1 of 4 demonstrations")
    assert "--dataset.episodes='[2]'" in printed
    assert "lerobot-edit-dataset" not in printed  # which cannot read version 2.1
    quiet = ok("keep", robot, "-o", "keep.json", *named, "-q").stdout
    assert quiet.startswith("Kept 1 of 4 demonstrations: keep.json\nRejected: 1 by your labels.")
    for output in ("x.csv", "x.parquet", "x.hdf5", "x.zarr.zip"):
        refused(f"{output}: .* folder", "keep", robot, "-o", output, "--verdicts", "labels.csv")
    Path("labels.csv").write_text("id,label\n2,expert\n7,good\n")
    refused("labels.csv: no demonstration is called '7'", "keep", robot, "-o", "k.json", "--verdicts", "labels.csv")


@pytest.mark.parametrize("sample", ["folder of CSV", "NPZ, stacked"])
def test_a_list_of_ids_is_kept_of_what_is_not_written_and_a_table_by_the_next_command(tmp_path, sample):
    data = samples.SAMPLES[sample](tmp_path)
    Path("labels.csv").write_text("id,label\n1,bad\n")
    call_of = ["keep", data, "--verdicts", "labels.csv", "--action-kind", "continuous", "-o"]
    refused(
        f"{data}: keep writes no .*; write the list with -o ids.json, or a table with rpil convert", *call_of, "new"
    )
    for output in ("ids.json", "ids.txt"):
        printed = ok(*call_of, output).stdout.splitlines()
        assert printed[0] == f"Kept 2 of 3 demonstrations: {output}"
        said, command = printed[-1].split(": ", 1)
        assert said == "These ids are kept; to write a table of them"
        words = shlex.split(command)
        assert words[-5:] == ["continuous", "--only", "0,2", "-o", "kept.parquet"]
        ok(*words[1:])
        assert [*map(str, rpil.read("kept.parquet").ids)] == ["0", "2"]
    assert json.loads(Path("ids.json").read_text()) == {"episodes": [*rpil.read(data).ids[::2]]}
    assert Path("ids.txt").read_text() == "0\n2\n"
    assert ok(*call_of, "ids.json", "-q").stdout.splitlines()[0] == "Kept 2 of 3 demonstrations: ids.json"


@pytest.mark.parametrize("output", ["ids.json", "ids.txt"])
def test_the_shell_reads_many_ids_from_the_list(tmp_path, output):
    values = {"observation.x": np.arange(360.0) % 11, "action": np.arange(360.0) % 7}
    steps = pa.table({"episode": np.repeat(np.arange(120), 3), **values})
    pq.write_table(steps, "many.parquet")
    Path("labels.csv").write_text("id,label\n7,bad\n")
    last = ok("keep", "many.parquet", "-o", output, "--verdicts", "labels.csv").stdout.splitlines()[-1]
    ids = re.search(r"--only (.*) -o kept\.parquet$", last)[1]
    printed = subprocess.check_output(["sh", "-c", f"printf %s {ids.replace('python', sys.executable)}"], text=True)
    assert printed.split(",") == [str(m) for m in range(120) if m != 7]


def test_keep_refuses_before_it_judges(folder, monkeypatch):
    monkeypatch.setattr("rpil.cli.keep.audit_data", lambda *_: pytest.fail("judged"))
    data = folder / "good.parquet"
    Path("there").mkdir()
    Path("all_bad.csv").write_text("id,label\n" + "".join(f"{m},bad\n" for m in range(12)))
    Path("other.csv").write_text("id,label\n99,good\n")
    refused("it is there already", "keep", data, "-o", "there")
    refused("it is the data themselves", "keep", data, "-o", data)
    refused("there is no folder", "keep", data, "-o", "no/kept.parquet")
    refused("exclude each other", "keep", data, "-o", "k.parquet", "--share", 0.5, "--at-least", 0.5)
    refused(
        "no demonstration is left by the verdicts of all_bad.csv",
        "keep",
        data,
        "-o",
        "k.parquet",
        "--verdicts",
        "all_bad.csv",
    )
    refused("no demonstration is called '99'", "keep", data, "-o", "k.parquet", "--verdicts", "other.csv")
    refused("give it the extension .parquet", "keep", data, "-o", "k.csv")


def test_what_is_open_is_kept(folder):
    printed = ok("keep", folder / "shifted.parquet", "-o", "k.parquet", "-q").stdout
    assert printed == "Kept 12 of 12 demonstrations: k.parquet\n"


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_convert_writes_operator_and_task_of_each_demonstration(suffix):
    rows = [f"{m},{k},{k / 7},{m % 2},{'AB'[m % 2]},lift it" for m in range(4) for k in range(5)]
    Path("in.csv").write_text("\n".join(["run,t,x,turn,operator,task", *rows]) + "\n")
    ok("convert", "in.csv", "-o", f"out{suffix}", "--action", "turn", "--exclude", "t")
    before = rpil.read("in.csv", action="turn", exclude="t")
    after = rpil.read(f"out{suffix}")
    assert after.ids == before.ids
    np.testing.assert_array_equal(after.observations, before.observations)
    np.testing.assert_array_equal(after.actions, before.actions)
    assert dict(formats.read_demonstrators("operator", f"out{suffix}")) == {"0": "A", "1": "B", "2": "A", "3": "B"}
    if suffix != ".npz":
        assert formats.read_recording(f"out{suffix}").tasks == dict.fromkeys("0123", "lift it")
    refused("named twice|would join", "convert", "in.csv", "-o", "in.csv")


@pytest.mark.slow
def test_each_task_is_judged_by_itself(folder):
    """Demonstrations of two tasks whose experts act in opposite ways: as one task, they would contradict each other."""
    table = pq.read_table(folder / "good.parquet")
    episode, action = table["episode_index"].to_numpy(), table["action"].to_numpy()
    where = table.column_names.index("episode_index"), table.column_names.index("action")
    mirrored = table.set_column(where[1], "action", pa.array(2 - action))
    mirrored = mirrored.set_column(where[0], "episode_index", pa.array(episode + 100))
    tasks = ["left"] * len(table) + ["right"] * len(table)
    both = pa.concat_tables([table, mirrored]).append_column("task", [tasks])
    pq.write_table(both.take(np.argsort(np.r_[episode, episode + 0.5], kind="stable")), "both.parquet")
    files = ["--verdicts", "v.csv", "--weights", "w.csv", "--report", "r.html"]
    printed = ok("audit", "both.parquet", *files, "-q").stdout
    judged = "left (12: outliers), right (12: outliers)"
    assert f"Demonstrations are judged within their tasks: {judged}." in " ".join(printed.split())
    rows = {row["id"]: row for row in pa.csv.read_csv("v.csv").to_pylist()}
    ok("audit", folder / "good.parquet", "--verdicts", "one.csv", "-q")
    for row in pa.csv.read_csv("one.csv").to_pylist():
        assert row["verdict"] == rows[row["id"]]["verdict"] == rows[row["id"] + 100]["verdict"]
        assert row["log_odds"] == rows[row["id"]]["log_odds"]
        assert (rows[row["id"]]["task"], rows[row["id"] + 100]["task"]) == ("left", "right")
    assert [row["id"] for row in rows.values()] == [m + k for m in range(12) for k in (0, 100)]
    few = both.filter(pa.array((both["episode_index"].to_numpy() != 100) & (both["episode_index"].to_numpy() < 103)))
    pq.write_table(few, "few.parquet")
    note = ok("audit", "few.parquet", "-q").stderr
    assert "the task 'right' has 2 demonstrations, too few to judge them well; to judge all tasks as one" in note
    pq.write_table(few.filter(pa.array(few["episode_index"].to_numpy() % 100 < 3)), "fewer.parquet")
    assert ok("audit", "fewer.parquet", "-q").stderr.count("too few to judge them well") == 1
    assert "judged within" not in ok("audit", "few.parquet", "-q", "--exclude", "task").stdout
    ok("fit", "both.parquet", "-o", "policy", "-q")
    assert [*load("policy").audit_.log_odds] == [row["log_odds"] for row in rows.values()]


def test_ids_that_look_like_formulas(folder):
    data = rpil.read(folder / "good.parquet")
    ids = ["=cmd|'/C calc'!A0", "+1+1", "@SUM(A1)", "-1+2", *"abcdefgh"]
    named = rpil.Demonstrations(data.observations, data.actions, data.offsets, ids)
    formats.write("named.parquet", named)
    ok("audit", "named.parquet", "--verdicts", "v.csv", "--weights", "w.csv", "-q")
    ok("convert", "named.parquet", "-o", "t.csv", "-q")
    for name in ("v.csv", "w.csv", "t.csv"):
        with open(name, newline="") as file:
            texts = [cell for row in csv.DictReader(file) for cell in row.values() if cell[:1] in ("=", "+", "@")]
        assert not texts
    assert rpil.read("t.csv").ids == tuple(ids)
    Path("labels.csv").write_text("id,verdict\n'=cmd|'/C calc'!A0,bad\n+1+1,bad\n")
    for verdicts, kept in (("v.csv", ids), ("labels.csv", ids[2:])):
        for table in ("named.parquet", "t.csv"):
            ok("keep", table, "-o", f"k{Path(table).suffix}", "--verdicts", verdicts)
            assert list(rpil.read(f"k{Path(table).suffix}").ids) == kept


def test_a_folder_is_checked(tmp_path):
    root = folders.write(tmp_path / "drive", [20] * 4, cameras=())
    assert "totals" not in ok("check", root).stdout
    place = root / "meta" / "info.json"
    place.write_text(place.read_text().replace('"total_frames": 80', '"total_frames": 7'))
    assert "total_frames is 7, and the data hold 80" in ok("check", root).stdout
    found = json.loads(ok("check", root, "--json").stdout)
    assert [(one["rule"], one["id"]) for one in found["findings"]] == [("totals", "")]
    assert call("check", root, "--fail-on", "totals").exit_code == 1
    assert call("check", root, "--fail-on", "any").exit_code == 1
    refused("for folders of LeRobot", "check", root / "data" / "chunk-000" / "file-000.parquet", "--video")
