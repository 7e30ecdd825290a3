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

from command_line import call, npz, ok, refused
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
    slow = json.loads(ok("check", "clean.parquet", "--format", "json", "--fps", "60").stdout)
    assert slow["counts"]["dropped frames"] == len(recording())


def test_findings_are_printed_written_and_decide_the_exit_code():
    write("data.parquet", spike)
    assert "spike: observation 1" in ok("check", "data.parquet").stdout
    assert "      1  RPIL-108  spike\n" in ok("check", "data.parquet").stdout
    printed = json.loads(ok("check", "data.parquet", "--format", "json").stdout)
    assert printed["counts"] == {"spike": 1}
    (row,) = printed["findings"]
    assert (row["id"], row["rule"], row["first"], row["last"]) == (4, "spike", 60, 60)
    ok("check", "data.parquet", "-o", "faults.csv")
    assert '"spike","4",60,60' in Path("faults.csv").read_text()
    refused("faults.txt", "check", "data.parquet", "-o", "faults.txt")
    for fail_on, code in (("jump,spike", 1), ("any", 1), ("frozen-sensor", 0)):
        assert call("check", "data.parquet", "--fail-on", fail_on).exit_code == code
    refused("no rule 'nonsense'", "check", "data.parquet", "--fail-on", "nonsense")


def test_expected_findings_do_not_fail():
    write("data.parquet", spike)
    Path("faults.json").write_text('{"spike": [4, 5], "idle-head": "all"}')
    result = ok("check", "data.parquet", "--expected", "faults.json", "--fail-on", "any")
    assert "1 more is expected" in result.stdout


def test_expected_in_another_form_is_refused():
    write("data.parquet")
    for text, match in (
        ('{"spikes": [4]}', "no rule 'spikes'"),
        ('{"spike": 4.5}', "needs a list"),
        ('{"spike": [4', "JSON"),
    ):
        Path("faults.json").write_text(text)
        refused(match, "check", "data.parquet", "--expected", "faults.json")


@pytest.mark.parametrize("stream", ["--memory=120kB", "--memory=1GB"])
def test_missing_values_are_reported_with_their_place(stream):
    write("data.parquet", missing)
    result = ok("check", "data.parquet", stream)
    assert "observation 1 is nan at 2.0 s" in result.stdout
    assert "--skip-bad" in result.stdout
    skipped = ok("check", "data.parquet", stream, "--skip-bad")
    assert "Set aside, because values are missing: 4." in skipped.stdout
    assert "--skip-bad" not in skipped.stdout
    refused("nan", "audit", "data.parquet", stream)


def test_timestamps_that_declare_too_many_numbers_are_not_read():
    npz("all.npz", timestamps=np.arange(60.0))
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    with zipfile.ZipFile("all.npz") as old, zipfile.ZipFile("giant.npz", "w") as new:
        for member in old.namelist():
            if member != "timestamps.npy":
                new.writestr(member, old.read(member))
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(stream, header)
        new.writestr("timestamps.npy", stream.getvalue())
    assert "timestamps: not one value for each step" in ok("info", "giant.npz").stdout
    assert "dropped frames" in json.loads(ok("check", "giant.npz", "--format", "json").stdout)["not_checked"]


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


def test_missing_values_in_all_demonstrations_are_named():
    x = np.random.default_rng(0).normal(size=(8 * 40, 2))
    x[::40, 0] = np.nan
    columns = {"episode_index": np.repeat(np.arange(8), 40), "observation.x": x[:, 0], "observation.y": x[:, 1]}
    pq.write_table(pa.table({**columns, "action": x[:, 1] + 0.1}), "nan.parquet")
    for options in ([], ["--skip-bad"]):
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
    assert json.loads(ok("audit", "data.parquet", "--format", "json").stdout)["faults"]["counts"] == {"spike": 1}


def test_thousands_of_ids_may_be_expected():
    ids = [f"{m:08d}" for m in range(5000)]
    Path("faults.json").write_text(json.dumps({"spike": ids}))
    assert read_expected("faults.json") == {"spike": {*ids}}
