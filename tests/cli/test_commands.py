"""The files of ``rpil audit``: a table of verdicts and the demonstrations to keep; nothing joins the data."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from audits import make_audit
from command_line import G, call, npz, ok, refused
from rpil.cli import commands


def test_audit_writes_verdicts_and_the_list_to_keep(folder):
    who = "".join(f"{m},{'abcd'[m // 3]}\n" for m in range(11))
    Path("who.csv").write_text(f"id,demonstrator\n{who}")
    files = ["--verdicts", "v.csv", "--keep", "k.json", "--weights", "w.csv", "--report", "r.html"]
    words = ["audit", folder / "good.parquet", "--format", "json", "--operator", "who.csv", *files]
    assert call(*words, "--fail-on", "outlier:5").exit_code == 1, "after all output"
    result = ok(*words, "--fail-on", "outlier:6")
    *lines, warning = result.stderr.splitlines()
    assert "w.csv: every step weighs the same, until you call one demonstration good" in warning
    assert lines == ["Weights: w.csv", "Verdicts: v.csv", "Keep: k.json", "Report: r.html"]
    assert {row["run"] for row in pa.csv.read_csv("v.csv").to_pylist()} == {json.loads(result.stdout)["run"]}
    printed = {entry["id"]: entry for entry in json.loads(result.stdout)["demonstrations"]}
    rows = pa.csv.read_csv("v.csv").to_pylist()
    assert [row["id"] for row in rows] == [*range(12)]
    assert [row["demonstrator"] for row in rows] == [*"aaabbbcccdd", ""]
    for row in rows:
        for name in ("verdict", "log_odds", "expert_proba", "reliability", "n_steps"):
            assert row[name] == printed[row["id"]][name]
        assert row["from_label"] == printed[row["id"]]["evidence"]["label"]
    assert json.loads(Path("k.json").read_text())["episodes"] == [*range(12)]
    assert json.loads(Path("k.json").read_text())["rejected"] == {}


def test_nothing_to_keep_is_said():
    audit = make_audit(("bad",) * 3, labels=dict.fromkeys(range(3), -1))
    given = commands.AuditRun(audit, "x", SimpleNamespace(step_columns=None), {})
    paths = dict.fromkeys(commands.OUTPUTS) | {"keep": "k.json"}
    with click.Context(click.Command("audit")), pytest.warns(UserWarning, match=r"k\.json: it lists no demonstration"):
        commands.write_outputs(paths, given, lambda _: None)
    assert json.loads(Path("k.json").read_text())["episodes"] == []


def test_no_home_folder_is_in_what_is_passed_on(folder, tmp_path, monkeypatch):
    data, work = tmp_path / "ann" / "sets" / "d.parquet", tmp_path / "ann" / "work"
    data.parent.mkdir(parents=True)
    work.mkdir()
    shutil.copy(folder / "good.parquet", data)
    monkeypatch.setenv("HOME", str(tmp_path / "ann"))
    monkeypatch.chdir(work)
    (work / "who.csv").write_text("id,demonstrator\n0,a\n1,a\n2,b\n")
    files = {"report": "r.html", "keep": "k.json", "verdicts": "v.parquet"}
    outputs = [word for name, path in files.items() for word in (f"--{name}", str(work / path))]
    ok("audit", data, "--operator", work / "who.csv", *outputs, "-q")
    for path in files.values():
        assert str(tmp_path).encode() not in Path(path).read_bytes(), path
    made = json.loads(Path("k.json").read_text())["provenance"]
    assert made["command"].startswith("rpil audit ~/sets/d.parquet --report ~/work/r.html --verdicts ~/work/v.parquet")
    assert [file["path"] for file in made["files"]] == ["~/sets/d.parquet", "~/work/who.csv"]


def test_outputs_do_not_join_the_data(folder):
    Path("data").mkdir()
    shutil.copy(folder / "good.parquet", "data/one.parquet")
    for output in ("data/one.parquet", "data/two.csv"):
        refused("it would join the data in .*; write it to another folder", "audit", "data", "--weights", output)
    assert pq.read_table("data/one.parquet").equals(pq.read_table(folder / "good.parquet"))


def test_ids_with_control_characters_are_escaped():
    npz("data.npz", episode_ids=np.array([f"é\x1b{g}" for g in G]))
    command = [Path(sys.executable).parent / "rpil", "audit", "data.npz"]
    result = subprocess.run(command, capture_output=True, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert result.returncode == 0, result.stderr
    assert b"\x1b" not in result.stdout
