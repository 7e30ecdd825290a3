"""What ``rpil keep`` rejects, and why: labels, faults, answers, and what is outlier only where answers allow it."""

import json
import re
from itertools import product
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
UNDECIDED = (
    "rpil: 4 of 12 demonstrations are outliers, more than 20% of all: they are kept, because without two "
    "answers nobody knows whether they are worse.\n"
)


def labels(**of):
    Path("labels.csv").write_text("id,label\n" + "".join(f"{name[1:]},{label}\n" for name, label in of.items()))
    return ["--labels", "labels.csv"]


def kept_in(path):
    return {*rpil.read(path).ids}


def test_a_fifth_that_is_unlike_is_rejected_and_more_is_kept_with_code_3():
    few, many = write("few.parquet", FEW), write("many.parquet", MANY)
    assert ok("keep", few, "-o", "k.parquet", *COLUMNS, "-q").stdout.splitlines() == [
        "Kept 20 of 24 demonstrations: k.parquet",
        "Rejected: 4 as outliers.",
        "  as outliers: 3, 5, 8 and 9",
    ]
    ok("audit", many, *COLUMNS, "--verdicts", "v.csv", "-q")
    for extra, yes in product(([], ["--verdicts", "v.csv"]), ([], ["--yes"])):
        Path("k.parquet").unlink()
        result = call("keep", many, "-o", "k.parquet", *COLUMNS, "-q", *extra, *yes)
        assert (result.exit_code, result.stderr) == (0 if yes else 3, UNDECIDED)
        assert result.stdout == "Kept 12 of 12 demonstrations: k.parquet\n"
        assert kept_in("k.parquet") == {*range(MANY)}


@pytest.mark.parametrize(("n", "code", "outlier"), [(FEW, 0, [*sorted(BAD)]), (MANY, 3, [])])
def test_an_audit_lists_what_keep_keeps(n, code, outlier):
    data = write("d.parquet", n)
    result = call("audit", data, *COLUMNS, "--keep", "k.json", "--json", "-q")
    assert result.exit_code == code
    assert (UNDECIDED in result.stderr) == (code == 3)
    listed = json.loads(Path("k.json").read_text())
    found = {name: listed[name] for name in ("episodes", "rejected", "undecided")}
    assert (
        json.loads(result.stdout)["keep"]
        == found
        == {
            "episodes": [m for m in range(n) if m not in outlier],
            "rejected": {"outlier": outlier} if outlier else {},
            "undecided": [] if outlier else sorted(BAD),
        }
    )
    assert call("keep", data, "-o", "k.parquet", *COLUMNS, "-q").exit_code == code
    assert kept_in("k.parquet") == {*listed["episodes"]}
    assert call("audit", data, *COLUMNS, "--keep", "k.json", "--yes", "-q").exit_code == 0
    assert call("audit", data, *COLUMNS, "--keep", "k.json", "-q", "--fail-on", "outlier").exit_code == 1
    assert call("audit", data, *COLUMNS, "--verdicts", "v.csv", "-q").exit_code == 0, "nothing is kept by it"


def test_what_would_decide_is_printed_and_holds():
    """The numbers of what is kept are those of the same command with these answers, and with the share."""
    many = write("many.parquet", MANY)
    for given in ({}, {"_0": "good"}):
        result = call("keep", many, "-o", "k.parquet", *COLUMNS, *(labels(**given) if given else []))
        assert result.exit_code == (3 if not given or "outlier" in result.stderr else 0)
        if result.exit_code == 0:
            continue
        cases = re.findall(r"If (.*), (\d+) of 12 are kept\.", result.stdout)
        assert len(cases) == 2
        for said, n in cases:
            answers = dict(re.findall(r"(\d+) is (good|bad)", said))
            assert set(answers.values()) == ({"good", "bad"} if not given else {said.rpartition(" ")[2]})
            extra = labels(**given, **{f"_{name}": label for name, label in answers.items()})
            again = ok("keep", many, "-o", "again.parquet", *COLUMNS, *extra, "-q").stdout
            assert again.startswith(f"Kept {n} of 12 demonstrations")
        [share] = re.findall(r"--share 0\.6 would keep (\d+)", result.stdout)
        assert f"Kept {share} of 12" in ok("keep", many, "-o", "s.parquet", *COLUMNS, "--share", ".6", "-q").stdout
        assert ("Is it good or bad: " if given else "Which is better: ") in result.stdout
    assert "Which" not in call("keep", many, "-o", "k.parquet", *COLUMNS, "-q").stdout


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
    inferred = ids.get("by inference from your answers", set()) | ids.get("as outliers", set())
    assert inferred
    assert inferred <= BAD - {3}
    assert kept_in("k.parquet") == {*range(MANY)} - set.union(*ids.values())


@pytest.mark.parametrize("words", [["--share", ".5"], ["--at-least", ".5"], ["--ignore", "outlier"]])
def test_what_is_asked_for_leaves_nothing_undecided(words):
    result = ok("keep", write("many.parquet", MANY), "-o", "k.parquet", *COLUMNS, *words, "-q")
    assert result.stderr == ""
    assert kept_in("k.parquet") == ({*range(MANY)} if words[0] == "--ignore" else kept_in("k.parquet") - BAD)


def test_each_rule_can_be_ignored():
    few = write("few.parquet", FEW)
    ok("keep", few, "-o", "k.parquet", *COLUMNS, "--ignore", "outlier,labels", *labels(_1="bad"), "-q")
    assert kept_in("k.parquet") == {*range(FEW)}
    given = labels(_0="good", _1="good", _2="good", _3="bad", _5="bad")
    for words, left in ((["--ignore", "labels"], {3, 5}), (["--ignore", "answers,outlier"], BAD - {3, 5})):
        ok("keep", few, "-o", "k.parquet", *COLUMNS, *words, *given, "-q")
        assert left <= kept_in("k.parquet")
    ok("keep", few, "-o", "k.parquet", *COLUMNS, "--ignore", "labels", "--ignore", "answers, outlier", *given, "-q")
    assert kept_in("k.parquet") == {*range(FEW)}
    assert ("labels", *RULES_OF_VERDICTS.values()) == CHOICE_RULES
    refused("'x' is not one of 'labels', 'answers'", "keep", few, "-o", "k.parquet", "--ignore", "labels,x")
    for words in (["--ignore", "outlier"], ["--without-faults", "jump"], ["--yes"]):
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
    ok("audit", data, "--keep", "k.json", "--without-faults", "jump", "--yes", "-q")
    assert json.loads(Path("k.json").read_text())["rejected"]["faults"] == sorted(faulty)
    refused("there is no rule 'jumps'; perhaps it is 'jump'", *call_of, "n.npz", "--without-faults", "jumps")
    refused("the rules are", "audit", data, "--keep", "n.json", "--without-faults", "jump,all")
    said = ok(*call_of, "k.npz", "--without-faults", "dropped frames,jump").stderr
    assert re.fullmatch(r"note: --without-faults: dropped frames was not checked, because [^\n]+\.\n", said)


@pytest.mark.slow
def test_each_task_counts_its_own_answers():
    """Two answers about one task say nothing of the outliers of another task: 4 of 20 are a fifth, 4 of 19 more."""
    many, few = (pq.read_table(write(f"{n}.parquet", n)) for n in (MANY, FEW))
    for n, code in ((20, 0), (19, 3)):
        rows = few.filter(pc.and_(pc.greater_equal(few["episode_index"], 12), pc.less(few["episode_index"], n)))
        tasks = pa.array(["lift"] * len(many) + ["turn"] * len(rows))
        pq.write_table(pa.concat_tables([many, rows]).append_column("task", tasks), data := "two.parquet")
        result = call("keep", data, "-o", "k.parquet", *COLUMNS, *labels(_14="good", _15="good"))
        assert result.exit_code == code
        assert kept_in("k.parquet") == {*range(n)} - (set() if code else BAD)
    result = ok("keep", data, "-o", "k.parquet", *COLUMNS, *labels(_0="good", _3="bad"))
    assert "Rejected: 1 by your labels, 3 as outliers." in result.stdout
