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

import rpil
from command_line import G, X, Y, call, npz, refused
from rpil import formats
from rpil.estimators.persistence import load


def spoilt(value):
    observations = X.copy()
    observations[33, 1] = value
    return observations


def table(name, **columns):
    columns = {"episode_index": G, "action": Y, "observation.x": X[:, 0]} | columns
    pq.write_table(pa.table(columns), name)


def text(name, *lines):
    Path(name).write_text("\n".join(lines) + "\n")


def truncated(name):
    npz("whole.npz")
    table("whole.parquet")
    whole = Path("whole.npz" if name.endswith("npz") else "whole.parquet").read_bytes()
    Path(name).write_bytes(whole[: len(whole) // 2])


def repeated(name):
    columns = [pa.array(G), pa.array(Y), pa.array(X[:, 0]), pa.array(X[:, 1])]
    names = ["episode_index", "action", "observation.x", "observation.x"]
    pq.write_table(pa.Table.from_arrays(columns, names=names), name)


HEAD = "episode_index,action,observation.x"
BAD_DATA = {
    "missing.parquet": (lambda name: None, "there is no such file or folder; check the path"),
    "folder.csv": (lambda name: Path(name).mkdir(), r"no .parquet or .csv file is there; check the path"),
    "empty.parquet": (lambda name: Path(name).touch(), "the file is empty; write it again"),
    "empty.csv": (lambda name: Path(name).touch(), "the file is empty; write it again"),
    "empty.npz": (lambda name: Path(name).touch(), "the file is empty; write it again"),
    "cut.parquet": (truncated, "damaged or truncated Parquet file, .* write it again"),
    "cut.npz": (truncated, "truncated one .*; write it again"),
    "cut.csv": (lambda name: text(name, HEAD, "0,1,2", "0,1"), "row 2: 2 values for 3 columns .* write it again"),
    "data.xls": (lambda name: text(name, HEAD, "0,1,2"), r"a workbook \(data.xls\) .*; export .* as CSV or Parquet"),
    "data.doc": (lambda name: text(name, HEAD, "0,1,2"), r"unknown extension '.doc'; use one of .parquet, .csv, .npz"),
    "nan.npz": (lambda name: npz(name, observations=spoilt(np.nan)), "demonstration 3, step 3: .* is nan; repair"),
    "infinite.npz": (lambda name: npz(name, observations=spoilt(-np.inf)), "demonstration 3, step 3: .* -inf; repair"),
    "nan.parquet": (
        lambda name: table(name, **{"observation.x": spoilt(np.nan)[:, 1]}),
        "demonstration 3, step 3: observation 'x' is nan; repair",
    ),
    "nan.csv": (lambda name: text(name, HEAD, "0,1,2", "a,1,nan"), "demonstration 'a', row 2: .* no value; fill it in"),
    "inf.csv": (lambda name: text(name, HEAD, "0,1,2", "7,1,inf"), "demonstration 7, step 0: .* is inf; repair"),
    "none.npz": (
        lambda name: npz(name, observations=X[:0], actions=Y[:0], episode_ids=G[:0]),
        "no demonstrations; give at least one with at least one step",
    ),
    "none.csv": (lambda name: text(name, HEAD), "none.csv: it has no rows; write one for each step"),
    "counts.npz": (lambda name: npz(name, actions=Y[:-1]), r"episode_ids has the shape \(60,\) for 59 actions; give"),
    "still.npz": (lambda name: npz(name, actions=Y * 0), "every action is 0, one class only; give"),
    "single.npz": (lambda name: npz(name, episode_ids=G * 0), "one demonstration alone .*; give at least two"),
    "pickled.npz": (lambda name: npz(name, observations=X.astype(object)), "never unpickled .*; save plain arrays"),
    "twice.csv": (lambda name: text(name, f"{HEAD},action", "0,1,2,3"), "column 'action' appears twice; rename"),
    "twice.parquet": (repeated, "column 'observation.x' appears twice; rename or drop"),
    "text.csv": (
        lambda name: text(name, HEAD, "0,1,2", "5,1,far"),
        r"demonstration 5, row 2: column 'observation.x' holds text \('far'\), not numbers; write numbers",
    ),
    "text.npz": (lambda name: npz(name, observations=X.astype(str)), "no column holds observations: .*'observation'"),
    "still-numbers.npz": (lambda name: npz(name, actions=X * 0), "every action is the same; give demonstrations"),
    "anonymous.csv": (lambda name: text(name, "episode_index,x", "0,1"), "no column holds the action: name it action"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_DATA)
def test_bad_demonstrations_are_refused(name):
    make, match = BAD_DATA[name]
    make(name)
    Path("old.html").write_text("old")
    for arguments in (["audit", "--report", "old.html", "--weights", "w.csv"], ["fit", "-o", "policy"]):
        assert refused(match, arguments[0], name, *arguments[1:]).startswith(f"rpil: {name}")


def test_episode_without_steps_is_refused():
    with pytest.raises(rpil.DataError, match="demonstration 'b': it has no steps; leave it out"):
        rpil.Demonstrations.from_episodes([(X, Y), (X[:0], Y[:0])], ids=["a", "b"])


def test_unknown_action_is_refused_when_scoring(folder):
    model = load(folder / "policy")
    demonstrations = formats.read(folder / "good.parquet")
    actions = demonstrations.actions.copy()
    actions[0] = 9
    other = rpil.Demonstrations(demonstrations.observations, actions, demonstrations.offsets, source="new.csv")
    with pytest.raises(
        rpil.DataError, match=r"new.csv, demonstration 0: action 9 is not among the fitted ones .*; fit again with it"
    ):
        model.score_demonstrations(other)


BAD_LABELS = {
    "missing.csv": (None, "missing.csv: there is no such file or folder; check the path"),
    "empty.csv": ("", "empty.csv: the file is empty; write it again"),
    "none.csv": ("id,label\n", "none.csv: it labels no demonstration; give"),
    "who.csv": ("id,label\n77,bad\n", "who.csv: no demonstration is called '77'; the ids are '0', .*; correct"),
    "word.csv": ("id,label\n1,perhaps\n", "word.csv, demonstration '1': unknown label 'perhaps'; write"),
    "twice.csv": ("id,label\n1,bad\n1,good\n", "twice.csv, demonstration '1': it is labelled twice; keep"),
    "columns.csv": ("name,what\n1,bad\n", "columns.csv: the columns must be id and label"),
    "cut.json": ('{"1": ', "cut.json: it cannot be read as JSON .*; write it again"),
    "labels.txt": ("id,label\n1,bad\n", r"labels.txt: unknown extension '.txt' for labels; use one of .csv, .json"),
}  # fmt: skip


BAD_DEMONSTRATORS = {
    "who.csv": ("id,demonstrator\n0,Ann\n77,Ann\n", "who.csv: no demonstration is called '77'; .*; correct the"),
    "none.csv": ("id,demonstrator\n", "none.csv: it names no demonstrator; give"),
    "twice.csv": ("id,demonstrator\n1,Ann\n1,Bob\n", "twice.csv, demonstration '1': both 'Ann' and 'Bob' gave it"),
    "columns.csv": ("id,label\n1,bad\n", "columns.csv: the columns must be id and demonstrator"),
    "missing.csv": (None, "missing.csv: there is no such file or folder; check the path"),
    "column": (None, "data.npz: no column is called 'column'; correct"),
}  # fmt: skip


BESIDE = [("--labels", name, *bad) for name, bad in BAD_LABELS.items()]
BESIDE += [("--demonstrators", name, *bad) for name, bad in BAD_DEMONSTRATORS.items()]


@pytest.mark.parametrize(("option", "name", "content", "match"), BESIDE)
def test_bad_labels_and_demonstrators_are_refused(option, name, content, match):
    npz("data.npz")
    if content is not None:
        Path(name).write_text(content)
    refused(match, "audit", "data.npz", option, name, "--report", "r.html")
    refused(match, "fit", "data.npz", option, name, "-o", "policy")


@pytest.mark.parametrize("label", ["x y" * 30_000, [[[]] * 50] * 900, {"a" * 9_000: 0}], ids=["text", "lists", "dict"])
def test_of_a_long_label_the_beginning_is_quoted(label):
    npz("data.npz")
    for content in ({"1": label}, {str(label): "good"}):
        Path("labels.json").write_text(json.dumps(content))
        assert len(refused("labels.json", "audit", "data.npz", "--labels", "labels.json")) < 500


def test_a_long_task_is_noted_by_its_beginning():
    tasks = ["pick " * 9_000] * 40 + ["place"] * 20
    table("data.parquet", task=tasks)
    said = call("audit", "data.parquet", "-q").stderr
    assert "too few to judge them well" in said
    assert max(map(len, said.splitlines())) < 500


def test_one_demonstration_is_refused():
    npz("data.npz", episode_ids=np.zeros(len(X), dtype=int))
    refused(r"data.npz: .* one demonstration alone \(1 sample\) cannot be compared", "audit", "data.npz")


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["audit", "data.npz", "--report", "no/r.html"], "no/r.html: there is no folder no; make it first"),
        (["audit", "data.npz", "--weights", "no/w.csv"], "no/w.csv: there is no folder no; make it first"),
        (["audit", "missing.npz", "--weights", "w.txt"], "w.txt: unknown extension '.txt' for --weights; use one of"),
        (["audit", "missing.npz", "--report", "r.pdf"], "r.pdf: unknown extension '.pdf' for --report; use .*.html"),
        (["audit", "missing.npz", "--verdicts", "v.html"], "v.html: unknown extension '.html' for --verdicts; use one"),
        (["audit", "missing.npz", "--keep", "k.csv"], "k.csv: unknown extension '.csv' for --keep; use one of .json"),
        (["demo", "--output", "r.pdf"], "r.pdf: unknown extension '.pdf' for --output; use .*.html"),
        (["fit", "data.npz", "-o", "."], r"\.: it is a folder or a device; give"),
        (["fit", "data.npz", "-o", "/dev/null"], "/dev/null: it is a folder or a device; give"),
        (["audit", "data.csv", "--weights", "./data.csv"], "data.csv: it is named twice in the command; give"),
        (["audit", "data.npz", "--verdicts", "r.csv", "--weights", "./r.csv"], "r.csv: it is named twice"),
        (["fit", "data.npz", "-o", "no/policy"], "no/policy: there is no folder no; make it first"),
        (["fit", "data.npz", "-o", "data.npz"], "data.npz: it is named twice"),
        (["audit"], "Missing argument 'FILE'; see rpil audit --help"),
        (["audit", "data.npz", "--sed", "1"], "No such option.*--sed.*--seed.* see rpil audit --help"),
        (["audit", "data.npz", "--seed", "-1"], "--seed.* see rpil audit --help"),
        (["audit", "data.npz", "--features", "odd"], "'odd' is not one of 'auto', 'raw', 'folded', 'nystroem'"),
        (["audit", "data.npz", "--adversary", "odd"], "'odd' is not one of 'auto'"),
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
    command = [Path(sys.executable).parent / "rpil", "audit", "nothing.csv", "--json", "--quiet"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == "rpil: nothing.csv: there is no such file or folder; check the path.\n"
