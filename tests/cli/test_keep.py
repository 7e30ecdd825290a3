"""``rpil keep`` and ``rpil convert``: the trusted demonstrations, and tables of all, as new files."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

import lerobot_folders as folders
import rpil
from command_line import ok, refused
from rpil import formats


def test_keep_by_its_own_audit_and_by_an_earlier_one(folder):
    data = folder / "good.parquet"
    Path("labels.csv").write_text("id,label\n0,good\n1,good\n10,bad\n11,bad\n")
    labels = ["--labels", "labels.csv"]
    ok("audit", data, "--verdicts", "v.csv", *labels, "-q")
    rows = csv.DictReader(Path("v.csv").read_text().splitlines())
    bad = {int(row["id"]) for row in rows if row["verdict"] in ("bad", "outlier")}
    assert {10, 11} < bad <= {*range(6, 12)}
    for extra in (labels, ["--verdicts", "v.csv"]):
        first, said, *_ = ok("keep", data, "-o", "kept.parquet", *extra, "-q").stdout.splitlines()
        assert first == f"Kept {12 - len(bad)} of 12 demonstrations: kept.parquet"
        assert said.startswith("Rejected: 2 by your labels, ")
        assert sum(map(int, re.findall(r"\d+", said))) == len(bad)
        assert {*rpil.read("kept.parquet").ids} == {*range(12)} - bad
        assert pq.read_schema("kept.parquet").equals(pq.read_schema(data), check_metadata=True)
    ok("keep", data, "-o", "most.parquet", "--verdicts", "v.csv", "--share", "0.75")
    assert len(rpil.read("most.parquet")) == 9


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
    audit = ["audit", "drive.csv", "--labels", "labels.csv", "--keep", "k.json"]
    said = ok(*audit, "--report", "r.html").stdout.splitlines()
    counts, _, again = said[(at := said.index("Keep: k.json")) + 1 : at + 4]
    assert (counts, again) == ("12 of 13 kept. Rejected: 1 by your labels.", lost)
    page = Path("r.html").read_text()
    assert page.index("What is lost without them") < page.index(lost)
    assert lost not in ok(*audit, "--quiet").stdout


def test_convert_writes_operator_and_task_of_each_demonstration():
    rows = [f"{m},{k},{k / 7},{m % 2},{'AB'[m % 2]},lift it" for m in range(4) for k in range(5)]
    Path("in.csv").write_text("\n".join(["run,t,x,turn,operator,task", *rows]) + "\n")
    ok("convert", "in.csv", "-o", "out.parquet", "--action", "turn", "--exclude", "t")
    assert dict(formats.read_demonstrators("operator", "out.parquet")) == {"0": "A", "1": "B", "2": "A", "3": "B"}
    assert formats.read_recording("out.parquet").tasks == dict.fromkeys("0123", "lift it")
    refused("named twice|would join", "convert", "in.csv", "-o", "in.csv")


def test_a_list_of_lerobot(tmp_path):
    robot = folders.write(tmp_path / "robot", [20] * 4, "v2.1", cameras=())
    Path("labels.csv").write_text("id,label\n2,expert\n1,bad\n")
    named = ["--verdicts", "labels.csv", "--only", "1,2"]
    printed = ok("keep", robot, "-o", "keep.json", *named).stdout
    assert printed.startswith("Kept 1 of 4 demonstrations")
    assert json.loads(Path("keep.json").read_text())["episodes"] == [2]
    quiet = ok("keep", robot, "-o", "keep.json", *named, "-q").stdout
    assert quiet.startswith("Kept 1 of 4 demonstrations: keep.json\nRejected: 1 by your labels.")
    refused(r"x\.csv: .* folder", "keep", robot, "-o", "x.csv", "--verdicts", "labels.csv")
