"""Errors of the user end with one sentence, exit code 2 and no other effect."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from command_line import G, X, Y, call, npz, refused


def table(name, **columns):
    columns = {"episode_index": G, "action": Y, "observation.x": X[:, 0]} | columns
    pq.write_table(pa.table(columns), name)


def text(name, *lines):
    Path(name).write_text("\n".join(lines) + "\n")


HEAD = "episode_index,action,observation.x"
BAD_DATA = {
    "missing.parquet": (lambda name: None, "there is no such file or folder; check the path"),
    "folder.csv": (lambda name: Path(name).mkdir(), r"no .parquet or .csv file is there; check the path"),
    "empty.npz": (lambda name: Path(name).touch(), "the file is empty; write it again"),
    "cut.csv": (lambda name: text(name, HEAD, "0,1,2", "0,1"), "row 2: 2 values for 3 columns .* write it again"),
    "nan.parquet": (
        lambda name: table(name, **{"observation.x": np.where(np.arange(60) == 33, -np.inf, X[:, 1])}),
        "demonstration 3, step 3: observation 'x' is -inf; repair",
    ),
    "none.csv": (lambda name: text(name, HEAD), "none.csv: it has no rows; write one for each step"),
    "still.npz": (lambda name: npz(name, actions=Y * 0), "every action is 0, one class only; give"),
    "single.npz": (lambda name: npz(name, episode_ids=G * 0), r"one demonstration alone \(1 .*; give at least two"),
    "pickled.npz": (lambda name: npz(name, observations=X.astype(object)), "never unpickled .*; save plain arrays"),
    "text.csv": (
        lambda name: text(name, HEAD, "0,1,2", "5,1,far"),
        r"demonstration 5, row 2: column 'observation.x' holds text \('far'\), not numbers; write numbers",
    ),
    "anonymous.csv": (lambda name: text(name, "episode_index,x", "0,1"), "no column holds the action: name it action"),
}


@pytest.mark.parametrize("name", BAD_DATA)
def test_bad_demonstrations_are_refused(name):
    make, match = BAD_DATA[name]
    make(name)
    Path("old.html").write_text("old")
    for arguments in (["audit", "--report", "old.html", "--weights", "w.csv"], ["fit", "-o", "policy"]):
        assert refused(match, arguments[0], name, *arguments[1:]).startswith(f"rpil: {name}")


def test_bad_labels_and_demonstrators_are_refused():
    npz("data.npz")
    Path("labels.csv").write_text("id,label\n77,bad\n")
    Path("who.csv").write_text("id,demonstrator\n0,Ann\n77,Ann\n")
    Path("columns.csv").write_text("id,what\n1,bad\n")
    for option, name, match in (
        ("--labels", "labels.csv", "labels.csv: no demonstration is called '77'; the ids are '0', .*; correct"),
        ("--labels", "columns.csv", "columns.csv: the columns must be id and label"),
        ("--labels", "missing.csv", "missing.csv: there is no such file or folder; check the path"),
        ("--demonstrators", "who.csv", "who.csv: no demonstration is called '77'; .*; correct the"),
        ("--demonstrators", "column", "data.npz: no column is called 'column'; correct"),
    ):
        refused(match, "audit", "data.npz", option, name, "--report", "r.html")
        refused(match, "fit", "data.npz", option, name, "-o", "policy")


def test_of_a_long_label_the_beginning_is_quoted():
    npz("data.npz")
    for label in ("x y" * 30_000, [[[]] * 50] * 900, {"a" * 9_000: 0}):
        for content in ({"1": label}, {str(label): "good"}):
            Path("labels.json").write_text(json.dumps(content))
            assert len(refused("labels.json", "audit", "data.npz", "--labels", "labels.json")) < 500


def test_a_long_task_is_noted_by_its_beginning():
    tasks = ["pick " * 9_000] * 40 + ["place"] * 20
    table("data.parquet", task=tasks)
    said = call("audit", "data.parquet", "-q").stderr
    assert "too few to judge them well" in said
    assert max(map(len, said.splitlines())) < 500


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["audit", "data.npz", "--report", "no/r.html"], "no/r.html: there is no folder no; make it first"),
        (["audit", "data.npz", "--weights", "no/w.csv"], "no/w.csv: there is no folder no; make it first"),
        (["audit", "missing.npz", "--weights", "w.txt"], "w.txt: unknown extension '.txt' for --weights; use one of"),
        (["demo", "--output", "r.pdf"], "r.pdf: unknown extension '.pdf' for --output; use .*.html"),
        (["fit", "data.npz", "-o", "/dev/null"], "/dev/null: it is a folder or a device; give"),
        (["audit", "data.csv", "--weights", "./data.csv"], "data.csv: it is named twice in the command; give"),
        (["fit", "data.npz", "-o", "no/policy"], "no/policy: there is no folder no; make it first"),
        (["fit", "data.npz", "-o", "data.npz"], "data.npz: it is named twice"),
        (["audit"], "Missing argument 'FILE'; see rpil audit --help"),
        (["audit", "data.npz", "--sed", "1"], "No such option.*--sed.*--seed.* see rpil audit --help"),
        (["audit", "data.npz", "--features", "odd"], "'odd' is not one of 'auto', 'raw', 'folded', 'nystroem'"),
        (["order"], "No such command 'order'; see rpil --help"),
    ],
)  # fmt: skip
def test_bad_options_are_refused_before_any_work(arguments, match, monkeypatch):
    npz("data.npz")
    monkeypatch.setattr("rpil.estimators.pipeline.FitOptions.check", lambda *_, **__: pytest.fail("too late"))
    refused(match, *arguments)


def test_failed_write_keeps_old_files(monkeypatch):
    npz("data.npz")
    for name in ("r.html", "w.csv", "policy"):
        Path(name).write_text("old")

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    data = "data.npz"
    refused("r.html: it cannot be written .No space left", "audit", data, "--report", "r.html")
    refused("w.csv: it cannot be written .No space left", "audit", data, "--weights", "w.csv")
    refused("policy: it cannot be written .No space left", "fit", data, "-o", "policy")


def test_ids_with_control_characters_are_escaped():
    npz("data.npz", episode_ids=np.array([f"é\x1b{g}" for g in G]))
    command = [Path(sys.executable).parent / "rpil", "audit", "data.npz"]
    result = subprocess.run(command, capture_output=True, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert result.returncode == 0, result.stderr
    assert b"\x1b" not in result.stdout


def test_process_prints_one_sentence_and_no_traceback():
    command = [Path(sys.executable).parent / "rpil", "audit", "nothing.csv", "--format", "json", "--quiet"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == "rpil: nothing.csv: there is no such file or folder; check the path.\n"
