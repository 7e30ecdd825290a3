"""What is given of demonstrations beside their steps: outcomes, sessions, and a reference of good ones."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import asked
import rpil
from asked import BAD, N_STEPS
from command_line import call, ok, refused
from rpil import formats
from rpil.estimators.pipeline import FitOptions


def write(name, n, bad, seed, **changes):
    """`n` demonstrations, of which the `bad` ones act at random, with outcomes and days."""
    owner, ends = np.repeat(np.arange(n), N_STEPS), np.tile(np.arange(N_STEPS) == N_STEPS - 1, n)
    columns = {"next.success": ends & ~np.isin(owner, list(bad)), "day": np.where(owner % 2, "mon", "tue")}
    columns |= {"half": np.arange(len(owner)) / 2}
    return asked.write(name, n, None, bad, seed, **columns | changes)


@pytest.fixture
def data():
    return write("d.parquet", 24, BAD, 1)


def audited(*arguments):
    return json.loads(ok("audit", *arguments, "--format", "json", "--observations", "x,v").stdout)


@pytest.fixture
def given(monkeypatch):
    """The tasks that are fitted, with the outcomes and orders."""
    tasks = []
    check = FitOptions.check
    monkeypatch.setattr(FitOptions, "check", lambda self, task: (tasks.append(task), check(self, task))[1])
    return tasks


@pytest.mark.parametrize("command", [["audit"], ["fit", "-o", "policy"]])
def test_a_fit_is_given_the_outcome_that_is_named_and_no_other(data, given, command):
    ok(command[0], data, *command[1:], "--observations", "x,v")
    ok(command[0], data, *command[1:], "--observations", "x,v", "--outcome", "-next.success")
    assert [task.answers.names for task in given] == [(), ("-next.success",)]
    np.testing.assert_array_equal(given[1].answers.outcomes[:, 0], [float(m in BAD) for m in range(24)])


def test_several_outcomes_are_witnesses_in_each_task_and_one_that_the_others_turn_is_named(given):
    """All grades of the second task are alike, and say nothing there."""
    bad, owner = {*range(0, 48, 3)}, np.repeat(np.arange(48), N_STEPS)
    retries = np.isin(owner, list(bad)) + (owner % 16 == 5)
    data = write("w.parquet", 48, bad, 1, retries=retries, task=np.where(owner < 24, "lift", "turn"))
    grades = {m: 5 - 2 * (m in bad) if m < 24 else 7 for m in range(48)}
    Path("grade.csv").write_text("id,value\n" + "".join(f"{m},{grade}\n" for m, grade in grades.items()))
    Path("l.csv").write_text("id,label\n0,bad\n1,good\n24,bad\n25,good\n")
    names = [word for name in ("next.success", "-retries", "grade.csv") for word in ("--outcome", name)]
    one, twice = audited(data, *names), audited(data, *names, *names)
    assert not any("Your answers" in sentence for sentence in one["assumptions"])
    assert {row["id"] for row in one["demonstrations"] if row["verdict"] == "bad"} == bad
    assert twice["demonstrations"] == one["demonstrations"]
    turned = rpil.audit(data, outcome=["next.success", "grade.csv", "retries"], labels="l.csv", observations="x,v")
    assert {m for m, verdict in enumerate(turned.verdicts) if verdict == "bad"} == bad
    assert turned.doubts == ("The outcome retries contradicts what else is known: less of it counts as better.",)
    known = turned.answers
    assert known.names == ("grade", "next.success", "retries")
    np.testing.assert_array_equal(known.outcomes[:, 0], [*grades.values()])
    np.testing.assert_array_equal(known.outcomes[:, 2], retries[::N_STEPS])


def test_a_reference_is_labelled_good_and_left_out_of_what_is_written(data, given):
    write("good.parquet", 10, {}, 2)
    Path("l.csv").write_text("id,label\n3,bad\n")
    outputs = ["--verdicts", "v.csv", "--weights", "w.csv", "--report", "r.html", "--keep", "k.json"]
    options = ["--reference", "good.parquet", "--labels", "l.csv", "--outcome", "next.success"]
    found = audited(data, *options, *outputs)
    labels, ids = given[0].answers.labels, given[0].source.ids
    assert {ids[m]: labels[m] for m in labels.nonzero()[0]} == {"3": -1} | {f"reference {m}": 1 for m in range(10)}
    assert len(given[0].answers.outcomes) == 34
    assert np.sum(given[0].answers.outcomes) == 30
    assert (found["n_demonstrations"], found["n_steps"]) == (24, 24 * N_STEPS)
    assert {row["id"] for row in found["demonstrations"]} == set(range(24))
    by_id = {row["id"]: row for row in found["demonstrations"]}
    assert all(by_id[m]["verdict"] == ("bad" if m in BAD else "good") for m in range(24))
    assert len(Path("v.csv").read_text().splitlines()) == 25
    assert len(Path("w.csv").read_text().splitlines()) == 24 * N_STEPS + 1
    assert set(json.loads(Path("k.json").read_text())["episodes"]) == set(range(24)) - BAD
    for name in ("v.csv", "w.csv", "r.html", "k.json"):
        assert "reference 0" not in Path(name).read_text()


def test_every_command_reads_the_demonstrations_that_are_asked_for(data):
    few = ["--only", "0-15", "--without", "3,7", "--observations", "x,v"]
    said = json.loads(ok("info", data, *few, "--format", "json").stdout)
    assert (said["demonstrations"], said["notes"]) == (14, ["14 of 24 demonstrations are read, as asked."])
    assert json.loads(ok("check", data, *few, "--format", "json").stdout)["demonstrations"] == 14
    ids = [m for m in range(16) if m not in (3, 7)]
    audit = json.loads(ok("audit", data, *few, "--format", "json", "--weights", "w.csv").stdout)
    assert sorted(one["id"] for one in audit["demonstrations"]) == ids
    rows = np.genfromtxt("w.csv", delimiter=",", names=True)
    assert [*dict.fromkeys(rows["episode_index"].astype(int).tolist())] == ids
    ok("convert", data, *few, "-o", "some.csv")
    assert list(formats.read("some.csv").ids) == ids
    kept = ok("keep", data, *few, "-o", "kept.parquet").stdout
    assert f"Kept {len(formats.read('kept.parquet'))} of 24 demonstrations" in kept
    assert {*formats.read("kept.parquet").ids} <= {*ids}
    refused("no demonstration is called '77'", "label", data, "--only", "77")


def test_what_is_not_there_is_named_with_the_option():
    """And not with the argument of Python."""
    data = write("b.parquet", 10, {3}, 1)
    columns = "id", "action", "observations", "exclude", "operator", "outcome", "order", "task", "session"
    wrong = dict.fromkeys(columns, "no column is called 'nowhere'")
    for option, said in (wrong | dict.fromkeys(("only", "without"), "no demonstration is called '99'")).items():
        error = refused(said, "audit", data, f"--{option}", said.split("'")[1])
        assert f"correct --{option}" in error
        assert re.search(r"\w=", error) is None, error


def test_a_missing_value_is_described_and_refused(folder):
    Path("b.csv").write_text("episode,x,action\n0,1,0\n0,,1\n1,2,0\n")
    result = call("info", "b.csv")
    assert result.exit_code == 2
    assert "Missing values:\n  x: 1" in result.stdout
    assert "0, row 2: column 'x' has no value; fill it in, or read with --exclude or --skip-bad." in result.stderr
