"""``rpil check``: what it prints, writes and returns."""

from __future__ import annotations

import io
import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from command_line import call, ok, refused
from recordings import recording
from recordings import write_recording as write
from rpil.faults.report import read_expected


def spike(observations, ids):
    observations[np.flatnonzero(ids == 4)[60], 1] += 30


def missing(observations, ids):
    observations[np.flatnonzero(ids == 4)[60], 1] = np.nan


def test_clean_recording():
    write("clean.parquet")
    result = ok("check", "clean.parquet", "--fail-on", "any")
    assert "No recording faults" in result.stdout
    assert "every 33.33 ms" in result.stdout


def test_findings_are_printed_also_as_json():
    write("data.parquet", spike)
    assert "spike: observation 1" in ok("check", "data.parquet").stdout
    assert "      1  RPIL-108  spike\n" in ok("check", "data.parquet").stdout
    printed = json.loads(ok("check", "data.parquet", "--json").stdout)
    assert printed["counts"] == {"spike": 1}
    (row,) = printed["findings"]
    assert (row["id"], row["rule"], row["first"], row["last"]) == (4, "spike", 60, 60)


def test_findings_are_written_as_a_table():
    write("data.parquet", spike)
    ok("check", "data.parquet", "-o", "faults.csv")
    assert '"spike","4",60,60' in Path("faults.csv").read_text()
    refused("faults.txt", "check", "data.parquet", "-o", "faults.txt")


@pytest.mark.parametrize(("fail_on", "code"), [("spike", 1), ("jump,spike", 1), ("any", 1), ("frozen-sensor", 0)])
def test_exit_code(fail_on, code):
    write("data.parquet", spike)
    assert call("check", "data.parquet", "--fail-on", fail_on).exit_code == code


def test_expected_findings_do_not_fail():
    write("data.parquet", spike)
    Path("faults.json").write_text('{"spike": [4, 5], "idle-head": "all"}')
    result = ok("check", "data.parquet", "--expected", "faults.json", "--fail-on", "any")
    assert "1 more is expected" in result.stdout


@pytest.mark.parametrize(
    ("text", "match"),
    [('{"spikes": [4]}', "no rule 'spikes'"), ('{"spike": 4.5}', "needs a list"), ('{"spike": [4', "JSON")],
)
def test_expected_in_another_form_is_refused(text, match):
    write("data.parquet")
    Path("faults.json").write_text(text)
    refused(match, "check", "data.parquet", "--expected", "faults.json")


def test_unknown_rule_is_refused():
    write("data.parquet")
    refused("no rule 'nonsense'", "check", "data.parquet", "--fail-on", "nonsense")


@pytest.mark.parametrize("stream", ["--stream", "--no-stream"])
def test_missing_values_are_reported_with_their_place(stream):
    write("data.parquet", missing)
    result = ok("check", "data.parquet", stream)
    assert "observation 1 is nan at 2.0 s" in result.stdout
    assert "--skip-bad" in result.stdout
    skipped = ok("check", "data.parquet", stream, "--skip-bad")
    assert "Set aside, because values are missing: 4." in skipped.stdout
    assert "--skip-bad" not in skipped.stdout
    refused("nan", "audit", "data.parquet", stream)


def test_empty_cells_of_a_csv_file_are_missing_values():
    rows = [f"{m},{x:.3f},{x + 1:.3f}" for m in range(3) for x in np.linspace(0, 1, 30)]
    rows[40] = "1,,2.0"
    with open("data.csv", "w") as file:
        file.write("\n".join(["episode_index,observation.x,action.0", *rows]))
    assert "x is nan at step 10" in ok("check", "data.csv").stdout


def test_a_lerobot_folder_is_compared_with_what_it_says_of_itself(tmp_path):
    root = tmp_path / "set"
    (root / "data").mkdir(parents=True)
    (root / "meta" / "episodes").mkdir(parents=True)
    write(root / "data" / "file-000.parquet")
    lengths = [len(x) for x, _ in recording()]
    lengths[3] += 2
    table = pa.table({"episode_index": list(range(len(lengths))), "length": lengths})
    pq.write_table(table, root / "meta" / "episodes" / "file-000.parquet")
    (root / "meta" / "info.json").write_text(json.dumps({"fps": 30}))
    found = json.loads(ok("check", root, "--json").stdout)
    assert [(f["rule"], f["id"]) for f in found["findings"]] == [("frame count", 3), ("episode table", 3)]
    assert "33.33 ms" in found["usual"]["dropped frames"]
    slow = json.loads(ok("check", root, "--json", "--fps", "60").stdout)
    assert slow["counts"]["dropped frames"] == len(lengths)


def write_lossy(name):
    """Twelve demonstrations of 30 steps at 50 frames a second; the sixth has lost ten frames."""
    rng = np.random.default_rng(0)
    ids, position = np.repeat(np.arange(12), 30), rng.normal(size=(360, 2)).cumsum(axis=0)
    seconds = np.tile(np.arange(30) / 50, 12)
    seconds[ids == 5] += np.where(np.arange(30) < 12, 0.0, 10 / 50)
    columns = {"timestamp": seconds, "observation.x": position[:, 0], "observation.y": position[:, 1]}
    columns |= {"action": rng.normal(size=360)}
    if name.endswith(".hdf5"):
        h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
        with h5py.File(name, "w") as file:
            for m in range(12):
                for column, values in columns.items():
                    file[f"data/{m}/{column}"] = values[ids == m]
        return
    if name.endswith(".npz"):
        np.savez(name, observations=position, actions=columns["action"], episode_ids=ids, timestamps=seconds)
        return
    table = pa.table({"episode_index": ids, **columns})
    if "." in name:
        (pa.csv.write_csv if name.endswith(".csv") else pq.write_table)(table, name)
        return
    Path(name).mkdir()
    for k, part in enumerate((table.slice(0, 180), table.slice(180))):
        suffix = name.removeprefix("several-")
        (pa.csv.write_csv if suffix == "csv" else pq.write_table)(part, f"{name}/{k}.{suffix}")


@pytest.mark.parametrize("name", ["one.csv", "one.parquet", "one.hdf5", "one.npz", "several-csv", "several-parquet"])
def test_lost_frames_are_found_in_every_format(name):
    write_lossy(name)
    found = json.loads(ok("check", name, "--json").stdout)
    (finding,) = [finding for finding in found["findings"] if finding["rule"] == "dropped frames"]
    assert (str(finding["id"]), finding["last"]) == ("5", 12)
    assert finding["value"] == pytest.approx(220.0)  # ms
    assert "dropped frames" not in found["not_checked"]


@pytest.mark.parametrize("command", [["info"], ["check", "--json"]])
def test_timestamps_that_declare_too_many_numbers_are_not_read(command):
    write_lossy("all.npz")
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    with zipfile.ZipFile("all.npz") as old, zipfile.ZipFile("giant.npz", "w") as new:
        for member in old.namelist():
            if member != "timestamps.npy":
                new.writestr(member, old.read(member))
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(stream, header)
        new.writestr("timestamps.npy", stream.getvalue())
    stdout = ok(command[0], "giant.npz", *command[1:]).stdout
    assert ("timestamps: not one value for each step" in stdout) == (command[0] == "info")
    assert command[0] == "info" or "dropped frames" in json.loads(stdout)["not_checked"]


def test_a_damaged_description_of_a_lerobot_folder_is_refused_alike():
    for name in ("data", "meta"):
        (Path("set") / name).mkdir(parents=True)
    write(Path("set/data/file-000.parquet"))
    Path("set/meta/info.json").write_text("{")
    commands = ["info"], ["check"], ["audit"], ["keep", "-o", "new"]
    (message,) = {refused(r"set/meta/info\.json", command, "set", *options) for command, *options in commands}
    Path("set/meta/info.json").unlink()
    assert "move it away" in message
    ok("info", "set")


def test_demonstrations_that_are_not_there_are_counted_apart():
    (Path("set") / "data").mkdir(parents=True)
    (Path("set") / "meta" / "episodes").mkdir(parents=True)
    only = pa.table({"episode_index": [0] * 9, "x": np.arange(9.0), "action": np.arange(9.0)})
    pq.write_table(only, "set/data/f.parquet")
    lengths = pa.table({"episode_index": list(range(55)), "length": [9] * 55})
    pq.write_table(lengths, "set/meta/episodes/file-000.parquet")
    Path("set/meta/info.json").write_text(json.dumps({"fps": 30}))
    first, *rest = ok("check", "set").stdout.splitlines()
    assert re.search(r"2 recording faults of the whole set", first)
    assert re.search(r"No recording faults found in 1 demonstration\b", first)
    assert any("the recording names 54 more demonstrations of 486 steps, not in the data" in line for line in rest)


@pytest.mark.parametrize("options", [[], ["--skip-bad"]])
def test_missing_values_in_all_demonstrations_are_named(options):
    x = np.random.default_rng(0).normal(size=(8 * 40, 2))
    x[::40, 0] = np.nan
    columns = {"episode_index": np.repeat(np.arange(8), 40), "observation.x": x[:, 0], "observation.y": x[:, 1]}
    pq.write_table(pa.table({**columns, "action": x[:, 1] + 0.1}), "nan.parquet")
    result = call("check", "nan.parquet", *options)
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert "missing values" in result.output or "a value is missing" in result.output


def test_at_most_thirty_findings_are_printed():
    rng = np.random.default_rng(0)
    once = {"observation": rng.normal(size=(2400, 1)), "action": rng.normal(size=(2400, 1))}
    twice = {name: list(np.concatenate([values, values])) for name, values in once.items()}
    pq.write_table(pa.table({"episode_index": np.repeat(np.arange(80), 60), **twice}), "twice.parquet")
    lines = ok("check", "twice.parquet").stdout.splitlines()
    assert sum("duplicate: " in line for line in lines) == 30
    assert any("10 more" in line for line in lines)


def test_an_audit_names_the_faults_beside_the_trust():
    write("data.parquet", spike)
    outputs = ["--report", "report.html", "--verdicts", "verdicts.json"]
    printed = ok("audit", "data.parquet", *outputs).stdout
    assert "\n1 recording is odd: 4: " in printed
    assert "\n  All: rpil check.\n" in printed
    with open("verdicts.json") as file:
        assert {row["id"]: row["faults"] for row in json.load(file)}[4] == "spike"
    with open("report.html") as file:
        page = file.read()
    assert "Odd in the recording" in page
    assert "for one step at 2.0 s" in page
    assert json.loads(ok("audit", "data.parquet", "--json").stdout)["faults"]["counts"] == {"spike": 1}


def test_thousands_of_ids_may_be_expected():
    ids = [f"{m:08d}" for m in range(5000)]
    Path("faults.json").write_text(json.dumps({"spike": ids}))
    assert read_expected("faults.json") == {"spike": {*ids}}
