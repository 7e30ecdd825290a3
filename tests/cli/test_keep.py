"""``rpil keep`` and ``rpil convert``: the trusted demonstrations, why others are rejected, and tables of all."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import rpil
from asked import BAD, MANY, with_jumps, write
from command_line import call, ok, refused


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


@pytest.mark.parametrize("name", ["out.parquet", "out.csv", "out.npz"])
@pytest.mark.parametrize(("last", "step"), [("", 0.1), (0.65, 0.1), (8.5, 1)])  # missing, back, and whole seconds
def test_convert_writes_times_and_operator_and_task_of_each_demonstration(name, last, step):
    seconds = [*(step * k + 2.0 * (k > 2) for k in range(8)), last]
    rows = [f"{m},{k},{t},{k / 7},{m % 2},{'AB'[m % 2]},lift it" for m in range(4) for k, t in enumerate(seconds)]
    Path("in.csv").write_text("\n".join(["run,frame,time,x,turn,operator,task", *rows]) + "\n")
    ok("convert", "in.csv", "-o", name, "--action", "turn")
    before, after = rpil.open("in.csv", action="turn"), rpil.open(name, operator="operator", task="task")
    assert dict(after.operators) == {"0": "A", "1": "B", "2": "A", "3": "B"}
    assert after.tasks == dict.fromkeys("0123", "lift it")
    np.testing.assert_allclose(after.times().timestamps, before.times().timestamps)
    assert after.times().fps == before.times().fps
    np.testing.assert_array_equal(after.demonstrations.observations, before.demonstrations.observations)
    refused("named twice|would join", "convert", "in.csv", "-o", "in.csv")
    Path("robot/data").mkdir(parents=True)
    ok("convert", "in.csv", "-o", "robot/data/a.parquet", "--action", "turn", "--exclude", "time")
    assert rpil.open("robot").times().timestamps is None
    Path("robot/meta").mkdir()
    Path("robot/meta/info.json").write_text('{"fps": 20}')  # with which no file needs times
    ok("convert", "robot", "-o", name)
    np.testing.assert_allclose(rpil.open(name).times().timestamps, np.tile(np.arange(9) / 20, 4))


FEW = 24
"""Demonstrations of which the four bad ones are less than a fifth; of `MANY` they are more."""

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
    labels(**{f"_{m}": "bad" for m in {*range(MANY)} - faulty})
    refused("name fewer faults, or change labels", *call_of, "n.parquet", "--without-faults", "jump")


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
