"""rpil audit: the finding, the ranking, JSON, reports, weights, and groups of which one must be labelled."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from command_line import ok
from rpil import formats
from rpil.formats.recording import Recording


def test_audit_prints_json(folder):
    result = ok("audit", folder / "good.parquet", "--format", "json")
    assert result.stderr == ""
    audit = json.loads(result.stdout, parse_constant=pytest.fail)
    assert audit["provenance"]["command"] == f"rpil audit {folder / 'good.parquet'} --format json"
    digest = hashlib.sha256((folder / "good.parquet").read_bytes()).hexdigest()
    assert [file["sha256"] for file in audit["provenance"]["files"]] == [digest]
    assert audit["faults"]["findings"] == []
    assert audit["n_demonstrations"] == 12
    assert audit["n_steps"] == formats.read(folder / "good.parquet").n_steps
    assert audit["finding"] == "outliers"
    assert 0 < audit["prior"]["low"] < audit["prior"]["mean"] < audit["prior"]["high"] < 1
    assert audit["identifiable"] is True
    assert len(audit["demonstrations"]) == 12
    for entry in audit["demonstrations"]:
        assert entry["verdict"] == ("open" if entry["id"] < 6 else "outlier")
        assert list(entry["evidence"]) == ["actions", "demonstrator", "label"]
        assert sum(entry["evidence"].values()) == pytest.approx(entry["log_odds"], abs=1e-9)
        assert all(0 <= step < entry["n_steps"] for step in entry["worst_steps"])


def test_audit_does_not_choose_features(folder, monkeypatch):
    monkeypatch.setattr("rpil.estimators.final_policy.choose_features", lambda *_: pytest.fail("features were chosen"))
    found = json.loads(ok("audit", folder / "good.parquet", "--format", "json", "--adversary", "marginal").stdout)
    assert (found["adversary"], found["finding"]) == ("marginal", "mixture")
    ok("audit", folder / "good.parquet", "--quiet")


def test_an_audit_reads_the_demonstrations_once(folder, monkeypatch):
    loads, load = [], Recording.load
    monkeypatch.setattr(Recording, "load", lambda *given: loads.append(1) or load(*given))
    ok("audit", folder / "good.parquet", "--quiet")
    assert len(loads) == 1


def test_audit_writes_a_report_and_weights(folder):
    Path("labels.csv").write_text("id,label\n" + "".join(f"{m},good\n{11 - m},bad\n" for m in range(3)))
    told = ["--labels", "labels.csv", "--format", "json", "--report", "r.html", "--weights", "w.parquet"]
    result = ok("audit", folder / "good.parquet", *told)
    json.loads(result.stdout)
    assert result.stderr.splitlines() == ["Weights: w.parquet", "Report: r.html"]
    assert "good.parquet" in Path("r.html").read_text()
    weights = pq.read_table("w.parquet").to_pydict()
    assert list(weights) == ["episode_index", "step_index", "weight", "expert_proba", "log_odds"]
    demonstrations = formats.read(folder / "good.parquet")
    assert weights["episode_index"] == np.repeat(demonstrations.ids, demonstrations.lengths).tolist()
    good = np.array(weights["episode_index"]) < 6
    weight = np.array(weights["weight"])
    assert weight[good].min() > 1 > weight[~good].max()
    assert np.mean(weight) == pytest.approx(1)


def test_answered_question_decides_between_two_groups(folder):
    file = folder / "shifted.parquet"
    result = ok("audit", file, "--seed", 2)
    printed = " ".join(result.stdout.split())
    assert "Two groups act differently: 6 and 6; without an answer nobody can say which is good." in printed
    groups = re.findall(r"Group [AB], 6: ([\d, ]+)", result.stdout)
    assert sorted(sorted(map(int, group.split(", "))) for group in groups) == [[*range(6)], [*range(6, 12)]]
    first, second = map(int, re.search(r"Which is better: (\d+).*? or (\d+).*?\?", printed).groups())
    assert (first < 6) != (second < 6)
    assert "steps): 12 open." in result.stdout
    assert "\nThe two groups: " in result.stdout
    assert result.stderr == ""
    again = result.stdout.partition("Then run: ")[2]
    assert shlex.split(again) == ["rpil", "audit", str(file), "--seed", "2", "--labels", "labels.csv"]
    better, worse = sorted((first, second))
    Path("labels.csv").write_text(f"id,label\n{better},good\n{worse},bad\n")
    result = ok(*shlex.split(again)[1:], "--format", "json")
    audit = json.loads(result.stdout)
    assert audit["identifiable"] is True
    assert (audit["finding"], audit["anchor"]) == ("answered", "answers")
    assert result.stderr == ""
    for entry in audit["demonstrations"]:
        assert entry["verdict"] in (("good" if entry["id"] < 6 else "bad"), "open")
    ranking = sorted(audit["demonstrations"], key=lambda entry: entry["rank"])
    assert sorted(entry["id"] for entry in ranking[:6]) == [*range(6)]
