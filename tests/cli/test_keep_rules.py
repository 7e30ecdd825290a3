"""What ``rpil keep`` rejects, and why: labels, outcomes, faults, and what is inferred once answers contrast."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import rpil
from asked import BAD, write
from command_line import call, ok, refused
from rpil.cli.options import CHOICE_RULES
from rpil.results.choice import RULES_OF_VERDICTS

FEW, MANY = 24, 12
"""Numbers of demonstrations of which the four bad ones are less and more than a fifth."""

COLUMNS = ["--observations", "x,v"]


def labels(**of):
    Path("labels.csv").write_text("id,label\n" + "".join(f"{name[1:]},{label}\n" for name, label in of.items()))
    return ["--labels", "labels.csv"]


def kept_in(path):
    return {*rpil.read(path).ids}


def test_without_answers_all_are_kept_and_what_to_look_at_is_printed():
    for n in (FEW, MANY):
        data = write("d.parquet", n)
        printed = ok("keep", data, "-o", "k.parquet", *COLUMNS).stdout.splitlines()
        assert printed[0] == f"Kept {n} of {n} demonstrations: k.parquet"
        lowest = re.fullmatch(r"Look at (\d+), (\d+), (\d+), (\d+) and (\d+), the lowest of the ranking\.", printed[1])
        assert {*map(int, lowest.groups()[:4])} == BAD
        assert printed[2].startswith("Which is better: ")
        assert kept_in("k.parquet") == {*range(n)}
        assert len(ok("keep", data, "-o", "k.parquet", *COLUMNS, "-q").stdout.splitlines()) == 1
        ok("audit", data, *COLUMNS, "--verdicts", "v.csv", "-q")
        ok("keep", data, "-o", "k.parquet", *COLUMNS, "--verdicts", "v.csv")
        assert kept_in("k.parquet") == {*range(n)}


@pytest.mark.parametrize("word", ["good", "bad"])
def test_labels_of_one_side_reject_themselves_alone(word):
    few = write("few.parquet", FEW)
    said = [3, 5, 8] if word == "bad" else [0, 1, 2]
    ok("keep", few, "-o", "k.parquet", *COLUMNS, *labels(**{f"_{m}": word for m in said}), "-q")
    assert kept_in("k.parquet") == {*range(FEW)} - ({*said} if word == "bad" else set())


@pytest.mark.parametrize("given", [{}, {"_0": "good", "_3": "bad"}])
def test_an_audit_lists_what_keep_keeps(given):
    data, more = write("d.parquet", FEW), labels(**given) if given else []
    result = ok("audit", data, *COLUMNS, *more, "--keep", "k.json", "--json", "-q")
    listed = json.loads(Path("k.json").read_text())
    assert json.loads(result.stdout)["keep"] == {name: listed[name] for name in ("episodes", "rejected")}
    assert listed["rejected"] == ({"labels": [3], "answers": [5, 8, 9]} if given else {})
    ok("keep", data, "-o", "k.parquet", *COLUMNS, *more, "-q")
    assert kept_in("k.parquet") == {*listed["episodes"]}
    assert ("the lowest of the ranking" in ok("audit", data, *COLUMNS, *more, "--keep", "k.json").stdout) == (not given)
    assert call("audit", data, *COLUMNS, "--keep", "k.json", "-q", "--fail-on", "outlier").exit_code == 1


def test_the_worse_one_of_a_pair_is_named_and_then_rejected():
    few = write("few.parquet", FEW)
    Path("labels.csv").write_text("id,label\n0,better than 3\n")
    given = ["keep", few, "-o", "k.parquet", *COLUMNS, "--labels", "labels.csv", "-q"]
    assert ok(*given).stdout.splitlines() == [
        "Kept 24 of 24 demonstrations: k.parquet",
        "3 is kept though you called it worse than 0: one answer more decides.",
    ]
    Path("labels.csv").write_text("id,label\n0,better than 3\n1,good\n")
    assert 3 not in {*map(int, re.findall(r"\d+", ok(*given).stdout.partition("Rejected")[0])[3:])}
    assert 3 not in kept_in("k.parquet")


SUCCESS = {"success": np.repeat([m not in {2, 3} for m in range(FEW)], 40).astype(int)}


@pytest.mark.parametrize("more", [[], ["--operator", "who"]])
def test_an_outcome_of_zero_rejects_at_once(more):
    data = write("d.parquet", FEW, **SUCCESS, who=np.repeat(["ann", "bob"], 480))
    words = [data, *COLUMNS, "--outcome", "success", *more]
    printed = ok("keep", *words, "-o", "k.parquet", "--ignore", "answers", "-q").stdout.splitlines()
    assert printed[1:] == ["Rejected: 2 by success = 0.", "  by success = 0: 2 and 3"]
    assert kept_in("k.parquet") == {*range(FEW)} - {2, 3}
    ok("keep", *words, "-o", "k.parquet", "--ignore", "answers,outcome", "-q")
    assert kept_in("k.parquet") == {*range(FEW)}
    ok("keep", *words, "-o", "k.parquet", "--ignore", "answers", *labels(_2="good"), "-q")
    assert kept_in("k.parquet") == {*range(FEW)} - {3}, "a label of the same demonstration says more"
    shown = ok("audit", *words, "--verdicts", "v.csv", "--report", "r.html", "-q").stdout
    assert re.search(r"^2 +bad .*success 0$", shown, re.M)
    rows = {row["id"]: row for row in csv.DictReader(Path("v.csv").read_text().splitlines())}
    assert [(rows[m]["verdict"], rows[m]["reason"][:9]) for m in "23"] == [("bad", "success 0")] * 2
    assert '"success 0' in Path("r.html").read_text()
    printed = ok("keep", data, *COLUMNS, "--verdicts", "v.csv", "-o", "k.parquet", "-q").stdout
    assert "2 by success = 0" in printed


def test_an_outcome_may_be_a_file():
    data, other = write("d.parquet", FEW, **SUCCESS), write("o.parquet", FEW)
    Path("success.csv").write_text("id,value\n" + "".join(f"{m},{m not in (2, 3)}\n" for m in range(FEW)))
    Path("success.json").write_text(json.dumps({str(m): int(m not in (2, 3)) for m in range(FEW)}))
    expected = ok("keep", data, *COLUMNS, "--outcome", "success", "-o", "k.parquet", "-q").stdout
    for file in ("success.csv", "success.json"):
        assert ok("keep", other, *COLUMNS, "--outcome", file, "-o", "k.parquet", "-q").stdout == expected
        assert rpil.audit(other, outcome=file, observations=["x", "v"]).choice.rejected["outcome"] == (2, 3)
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


def test_a_failure_is_one_where_more_is_worse():
    data = write("d.parquet", FEW, failed=1 - SUCCESS["success"])
    printed = ok("keep", data, *COLUMNS, "--outcome=-failed", "-o", "k.parquet", "--ignore", "answers", "-q").stdout
    assert "2 by failed = 1" in printed


def test_the_page_shows_what_is_printed():
    """But for the numbers, which are those of this set with another judge."""
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```\n(Kept .*?)^```", page, re.M | re.S)
    many = write("drive.parquet", MANY)
    for block, given in zip(shown, ([], labels(_0="good", _3="bad")), strict=True):
        result = call("keep", many, "-o", "kept.parquet", *COLUMNS, *given)
        printed = result.stdout + result.stderr
        plain = [re.sub(r"\d+", "0", " ".join(text.split())) for text in (block, printed)]
        assert plain[0] == plain[1]


def test_two_answers_reject_what_they_say():
    many = write("many.parquet", MANY)
    printed = ok("keep", many, "-o", "k.parquet", *COLUMNS, *labels(_0="good", _3="bad")).stdout
    ids = {rule: {*map(int, re.findall(r"\d+", found))} for rule, found in re.findall(r"  ([a-z ]+): (.*)", printed)}
    assert ids["by your labels"] == {3}
    assert ids["by inference from your answers"] <= BAD - {3}
    assert kept_in("k.parquet") == {*range(MANY)} - set.union(*ids.values())


def test_each_rule_can_be_ignored():
    few = write("few.parquet", FEW)
    ok("keep", few, "-o", "k.parquet", *COLUMNS, "--ignore", "labels", *labels(_1="bad"), "-q")
    assert kept_in("k.parquet") == {*range(FEW)}
    given = labels(_0="good", _1="good", _2="good", _3="bad", _5="bad")
    for words, left in ((["--ignore", "labels"], {3, 5}), (["--ignore", "answers"], BAD - {3, 5})):
        ok("keep", few, "-o", "k.parquet", *COLUMNS, *words, *given, "-q")
        assert left <= kept_in("k.parquet")
    ok("keep", few, "-o", "k.parquet", *COLUMNS, "--ignore", "labels", "--ignore", "answers, outcome", *given, "-q")
    assert kept_in("k.parquet") == {*range(FEW)}
    assert ("labels", "outcome", *RULES_OF_VERDICTS.values()) == CHOICE_RULES
    refused("'x' is not one of 'labels', 'outcome'", "keep", few, "-o", "k.parquet", "--ignore", "labels,x")
    for words in (["--ignore", "outcome"], ["--without-faults", "jump"]):
        refused("give --keep OUT.json", "audit", few, *words)


def with_jumps(name, faulty, n=MANY):
    """Demonstrations that all follow one policy; a column of the `faulty` ones leaps once by far."""
    rng = np.random.default_rng(0)
    states = np.cumsum(rng.normal(0, 0.05, (n, 80, 2)), axis=1)
    actions = states @ [1.0, -0.5] + rng.normal(0, 0.02, (n, 80))
    states[sorted(faulty), 40:, 0] += 20
    np.savez(
        name, observations=states.reshape(-1, 2), actions=actions.reshape(-1, 1), episode_ids=np.repeat(range(n), 80)
    )
    return name


def test_faults_that_are_named_are_rejected():
    data, faulty = with_jumps("jumps.npz", {2, 7, 11}), {2, 7, 11}
    Path("labels.csv").write_text("id,label\n2,good\n3,bad\n4,good\n")
    found = json.loads(ok("check", data, "--json").stdout)["findings"]
    assert {one["id"] for one in found if one["rule"] == "jump"} == faulty
    call_of = ["keep", data, "--verdicts", "labels.csv", "-q", "-o"]
    for words in (
        ["--without-faults", "jump,frozen-sensor"],
        ["--without-faults", "Jump", "--without-faults", "spike"],
    ):
        printed = ok(*call_of, "k.npz", *words).stdout
        assert "1 by your labels, 3 with a fault that was named." in printed
        assert kept_in("k.npz") == {*range(MANY)} - faulty - {3}, "also those that the labels do not name"
    ok("audit", data, "--keep", "k.json", "--without-faults", "jump", "-q")
    assert json.loads(Path("k.json").read_text())["rejected"]["faults"] == sorted(faulty)
    refused("there is no rule 'jumps'; perhaps it is 'jump'", *call_of, "n.npz", "--without-faults", "jumps")
    refused("the rules are", "audit", data, "--keep", "n.json", "--without-faults", "jump,all")
    said = ok(*call_of, "k.npz", "--without-faults", "dropped frames,jump").stderr
    assert re.fullmatch(r"note: --without-faults: dropped frames was not checked, because [^\n]+\.\n", said)


@pytest.mark.slow
def test_each_task_counts_its_own_answers():
    """Answers that contrast about one task say nothing of the demonstrations of another task."""
    many, few = (pq.read_table(write(f"{n}.parquet", n)) for n in (MANY, FEW))
    rows = few.filter(pc.greater_equal(few["episode_index"], 12))
    tasks = pa.array(["lift"] * len(many) + ["turn"] * len(rows))
    pq.write_table(pa.concat_tables([many, rows]).append_column("task", tasks), data := "two.parquet")
    for given, left in (
        ({"_14": "good", "_15": "bad"}, {15}),
        ({"_0": "good", "_15": "bad"}, {15}),
        ({"_0": "good", "_3": "bad"}, BAD),
    ):
        ok("keep", data, "-o", "k.parquet", *COLUMNS, *labels(**given))
        assert kept_in("k.parquet") & BAD == BAD - left
        assert left <= {*range(FEW)} - kept_in("k.parquet")


@pytest.mark.parametrize("option", ["--task", "--session"])
def test_who_failed_is_rejected_where_all_of_a_task_or_session_did(option):
    """What tells none from another there is what the user said all the same."""
    success = [m < 8 or (m < 16 and m % 2 == 1) for m in range(FEW)]
    group = np.repeat(["all", "some", "none"], 8 * 40)
    data = write("d.parquet", FEW, success=np.repeat(success, 40).astype(int), group=group)
    words = [data, *COLUMNS, option, "group", "--outcome", "success", "--ignore", "answers", "-q"]
    ok("keep", *words, "-o", "k.parquet")
    assert kept_in("k.parquet") == {m for m in range(FEW) if success[m]}


def test_the_mean_weight_is_one_beside_a_reference():
    data, good = write("d.parquet", FEW), write("good.parquet", MANY, ids=[f"g{m}" for m in range(MANY)])
    ok("keep", good, "-o", "r.parquet", *COLUMNS, "--without", "g3,g5,g8,g9", "-q")
    words = ["audit", data, *COLUMNS, "--reference", "r.parquet", "--weights", "w.csv", "-q"]
    for given, least in (([], 1.0), (labels(_3="bad"), 0.0)):
        ok(*words, *given)
        weight = np.array([float(row["weight"]) for row in csv.DictReader(Path("w.csv").read_text().splitlines())])
        assert weight.mean() == pytest.approx(1)
        assert weight.min() == pytest.approx(least, abs=1e-4)
