"""``rpil check``: what it prints, writes and returns."""

import json
from pathlib import Path

import numpy as np
import pytest

import lerobot_folders
import rpil
from command_line import call, ok, refused
from recordings import spike
from recordings import write_recording as write
from rpil.cli import commands
from rpil.cli.check import fault_lines
from rpil.faults.report import FaultReport


def missing(observations, ids):
    observations[np.flatnonzero(ids == 4)[60], 1] = np.nan


def test_findings_are_written_and_decide_the_exit_code():
    write("data.parquet", spike)
    printed = json.loads(ok("check", "data.parquet", "--format", "json").stdout)
    assert printed["counts"] == {"spike": 1}
    (row,) = printed["findings"]
    assert (row["id"], row["rule"], row["first"], row["last"]) == (4, "spike", 60, 60)
    ok("check", "data.parquet", "-o", "faults.csv")
    assert '"spike","4",60,60' in Path("faults.csv").read_text()
    for fail_on, code in (("jump,spike", 1), ("RPIL-108", 1), ("any", 1), ("frozen-sensor,rpil-109", 0)):
        assert call("check", "data.parquet", "--fail-on", fail_on).exit_code == code
    refused("no rule 'RPIL-999'", "check", "data.parquet", "--fail-on", "RPIL-999")


@pytest.mark.parametrize(("rules", "found"), [((), {}), (("spike",), {}), (("totals",), {"totals": 1})])
def test_an_audit_looks_into_files_for_rules_that_are_named(tmp_path, rules, found):
    folder = lerobot_folders.write(tmp_path / "set", [30] * 5)
    lerobot_folders.change_info(folder, total_frames=7)
    assert commands.look_for_faults(rpil.open(folder), lambda stage: None, rules=rules).counts == found


def test_expected_in_another_form_is_refused():
    write("data.parquet")
    wrong = {'{"spikes": [4]}': "no rule 'spikes'", '{"spike": 4.5}': "needs a list", '{"spike": [4': "JSON"}
    for text, match in wrong.items():
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


def test_an_audit_names_the_faults_beside_the_trust():
    write("data.parquet", spike)
    outputs = ["--report", "report.html", "--verdicts", "verdicts.json"]
    ok("audit", "data.parquet", *outputs)
    with open("verdicts.json") as file:
        assert {row["id"]: row["faults"] for row in json.load(file)}[4] == "spike"
    with open("report.html") as file:
        page = file.read()
    assert "Odd in the recording" in page
    assert "for one step at 2.0 s" in page
    assert json.loads(ok("audit", "data.parquet", "--format", "json").stdout)["faults"]["counts"] == {"spike": 1}


def test_idle_ends_are_said_by_the_first_and_the_last_step_to_keep():
    trims, reasons = {"a": (0, 7), "b": (2, 30)}, {"lag": "few", "sign": "few", "scale": "one"}
    lines = fault_lines(FaultReport((), reasons, {"spike": ("x", "y")}, {}, trims, 9, 1200, n_expected=2))
    assert lines[2] == "2 more are expected and left out."
    assert lines[4] == "Idle ends of 2 of 9 may be trimmed (1 idle heads); steps to keep: a: 0 to 6, b: 2 to 29."
    assert lines[6:9] == ["Not checked:", "  lag, sign: few", "  scale: one"]
