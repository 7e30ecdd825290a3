"""What ``rpil keep`` rejects, and why: labels, outcomes, faults, and what is inferred once answers contrast."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

import rpil
from asked import BAD, write
from command_line import call, ok, refused

FEW, MANY = 24, 12
"""Numbers of demonstrations of which the four bad ones are less and more than a fifth."""

COLUMNS = ["--observations", "x,v"]


def labels(**of):
    Path("labels.csv").write_text("id,label\n" + "".join(f"{name[1:]},{label}\n" for name, label in of.items()))
    return ["--labels", "labels.csv"]


def kept_in(path):
    return {*rpil.read(path).ids}


def test_an_audit_lists_what_keep_keeps():
    data, more = write("d.parquet", FEW), labels(_0="good", _1="good", _3="bad", _8="bad")
    result = ok("audit", data, *COLUMNS, *more, "--keep", "k.json", "--format", "json", "-q")
    listed = json.loads(Path("k.json").read_text())
    assert json.loads(result.stdout)["keep"] == {name: listed[name] for name in ("episodes", "rejected")}
    assert listed["rejected"] == {"labels": [3, 8], "answers": [5, 9]}
    ok("keep", data, "-o", "k.parquet", *COLUMNS, *more, "-q")
    assert kept_in("k.parquet") == {*listed["episodes"]}


SUCCESS = {"success": np.repeat([m not in {2, 3} for m in range(FEW)], 40).astype(int)}


def test_an_outcome_of_zero_rejects_at_once():
    data = write("d.parquet", FEW, **SUCCESS, who=np.repeat(["ann", "bob"], 480))
    words = [data, *COLUMNS, "--outcome", "success", "--operator", "who"]
    printed = ok("keep", *words, "-o", "k.parquet", "-q").stdout.splitlines()
    assert printed[1:] == ["Rejected: 2 by success = 0.", "  by success = 0: 2 and 3"]
    assert kept_in("k.parquet") == {*range(FEW)} - {2, 3}
    shown = ok("audit", *words, "--verdicts", "v.csv", "--report", "r.html", "-q").stdout
    assert re.search(r"By the outcomes: .*2 bad \((2, 3|3, 2)\)", shown)
    rows = {row["id"]: row for row in csv.DictReader(Path("v.csv").read_text().splitlines())}
    assert [(rows[m]["verdict"], rows[m]["reason"][:9]) for m in "23"] == [("bad", "success 0")] * 2
    assert '"success 0' in Path("r.html").read_text()
    printed = ok("keep", data, *COLUMNS, "--verdicts", "v.csv", "-o", "k.parquet", "-q").stdout
    assert "2 by success = 0" in printed


def test_an_outcome_may_be_a_file():
    data, other = write("d.parquet", FEW, **SUCCESS), write("o.parquet", FEW)
    Path("success.csv").write_text("id,value\n" + "".join(f"{m},{m not in (2, 3)}\n" for m in range(FEW)))
    expected = ok("keep", data, *COLUMNS, "--outcome", "success", "-o", "k.parquet", "-q").stdout
    assert ok("keep", other, *COLUMNS, "--outcome", "success.csv", "-o", "k.parquet", "-q").stdout == expected
    assert rpil.audit(other, outcome="success.csv", observations=["x", "v"]).choice.rejected["outcome"] == (2, 3)
    read = rpil.read(other, observations=["x", "v"])
    Path("who.csv").write_text("id,demonstrator\n" + "".join(f"{m},{'ab'[m % 2]}\n" for m in range(FEW)))
    audit = rpil.audit(read, outcome="success.csv", operator="who.csv")
    assert (audit.choice.rejected["outcome"], len(audit.demonstrators)) == ((2, 3), 2)
    few = ok("keep", other, *COLUMNS, "--outcome", "success.csv", "--without", "2", "-o", "k.parquet", "-q").stdout
    assert "1 by success = 0" in few
    Path("failure.csv").write_text("id,value\n0,no\n")
    refused(r"failure\.csv: outcome holds what is no number", "audit", other, "--outcome", "failure.csv")
    Path("failure.csv").write_text("id,value\n0,1\n0,1\n")
    refused(r"failure\.csv, demonstration '0': it has two outcomes", "audit", other, "--outcome", "failure.csv")
    Path("failure.csv").write_text("id,value\n99,1\n")
    refused(r"failure\.csv: no demonstration is called '99'", "audit", other, "--outcome", "failure.csv")
    Path("failure.csv").write_text("id,value\n0,0\n1,0\n")
    refused(r"failure\.csv: the outcome is 0 for every demonstration", "audit", other, "--outcome", "failure.csv")
    refused("it is named twice in the command", "audit", other, "--outcome", "success.csv", "--verdicts", "success.csv")


def test_the_page_shows_what_is_printed():
    """But for the numbers, which are those of this set with another judge."""
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```\n(Kept .*?)^```", page, re.M | re.S)
    many = write("drive.parquet", MANY)
    for block, given in zip(shown, ([], labels(_0="good", _3="bad", _8="bad")), strict=True):
        result = call("keep", many, "-o", "kept.parquet", *COLUMNS, *given)
        printed = result.stdout + result.stderr
        plain = [re.sub(r"\d+", "0", " ".join(text.split())) for text in (block, printed)]
        assert plain[0] == plain[1]
        assert kept_in("kept.parquet") == {*range(MANY)} - (BAD if given else set())


def with_jumps(name, faulty, n=MANY):
    """Demonstrations that all follow one policy; a column of the `faulty` ones leaps once by far."""
    rng = np.random.default_rng(0)
    states = np.cumsum(rng.normal(0, 0.05, (n, 80, 2)), axis=1)
    actions = states @ [1.0, -0.5] + rng.normal(0, 0.02, (n, 80))
    states[sorted(faulty), 40:, 0] += 20
    steps = states.reshape(-1, 2), actions.reshape(-1, 1), np.repeat(range(n), 80)
    rpil.write(name, rpil.Demonstrations.from_groups(*steps))
    return name


def test_faults_that_are_named_are_rejected():
    data, faulty = with_jumps("jumps.parquet", {2, 7, 11}), {2, 7, 11}
    Path("labels.csv").write_text("id,label\n2,good\n3,bad\n4,good\n")
    found = json.loads(ok("check", data, "--format", "json").stdout)["findings"]
    assert {one["id"] for one in found if one["rule"] == "jump"} == faulty
    call_of = ["keep", data, "--verdicts", "labels.csv", "-q", "-o"]
    printed = ok(*call_of, "k.parquet", "--without-faults", "Jump", "--without-faults", "spike,frozen-sensor").stdout
    assert "1 by your labels, 3 with a fault that was named." in printed
    assert kept_in("k.parquet") == {*range(MANY)} - faulty - {3}, "also those that the labels do not name"
    ok("audit", data, "--keep", "k.json", "--without-faults", "jump", "-q")
    assert json.loads(Path("k.json").read_text())["rejected"]["faults"] == sorted(faulty)
    refused("there is no rule 'jumps'; perhaps it is 'jump'", *call_of, "n.parquet", "--without-faults", "jumps")
    refused("the rules are", "audit", data, "--keep", "n.json", "--without-faults", "jump,all")
    said = ok(*call_of, "k.parquet", "--without-faults", "dropped frames,jump").stderr
    assert re.fullmatch(r"note: --without-faults: dropped frames was not checked, because [^\n]+\.\n", said)


def test_a_share_is_of_demonstrations_that_have_a_number():
    """Those that a table does not name would rank above all that it names."""
    data, few = write("d.parquet", FEW), ["--only", "0-11", "-q"]
    ok("audit", data, *COLUMNS, *few, "--verdicts", "v.csv")
    by = ["keep", data, *COLUMNS, "-o", "k.parquet", "--verdicts", "v.csv"]
    lacks = "no number in log_odds for 12, 13, 14, 15, 16 and 7 more; audit these too, or leave them"
    assert "out with --without" in refused(lacks, *by, "--share", 0.5)
    ok(*by, *few, "--share", 0.5)
    assert len(kept_in("k.parquet")) == 6
    assert "12 of these are not named in v.csv" in ok(*by).stdout


def test_the_command_to_run_next_does_not_repeat_the_memory_of_this_one():
    data = write("d.parquet", FEW)
    printed = ok("audit", data, *COLUMNS, "--memory", "70kB", "--verdicts", "v.parquet").stdout
    for text, last in ((ok("info", data, *COLUMNS, "--memory", "70kB").stdout, "Next: "), (printed, "Then run: ")):
        [line] = [line for line in text.splitlines() if line.startswith(last)]
        assert "--memory" not in line
    said = json.loads(pq.read_schema("v.parquet").metadata[b"rpil.provenance"])
    assert "--memory 70kB" in said["command"]
