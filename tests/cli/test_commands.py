"""Errors of the user end with one sentence, exit code 2 and no other effect."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from command_line import G, X, Y, npz, refused


def table(name, **columns):
    columns = {"episode_index": G, "action": Y, "observation.x": X[:, 0]} | columns
    pq.write_table(pa.table(columns), name)


def text(name, *lines):
    Path(name).write_text("\n".join(lines) + "\n")


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
