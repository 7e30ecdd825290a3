"""Where a result comes from: the digest changes with the data alone; settings are named by their dots."""

import hashlib
import json
import math
from dataclasses import replace

import pyarrow.parquet as pq
import pytest

from audits import make_audit
from rpil.estimators.pipeline import Settings
from rpil.inference.settings import JudgeSettings, OutlierSettings
from rpil.results import judged
from rpil.results.choice import write_kept, write_verdicts
from rpil.results.judged import changed_settings, digest, provenance_of


def test_a_file_has_the_digest_that_every_tool_computes(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"1,2\n")
    expected = hashlib.sha256(b"1,2\n").hexdigest()
    assert digest(tmp_path / "a.csv") == {"path": str(tmp_path / "a.csv"), "bytes": 4, "sha256": expected}


@pytest.mark.parametrize("is_large", [False, True])
def test_the_digest_of_a_folder_changes_with_names_and_contents(tmp_path, monkeypatch, is_large):
    monkeypatch.setattr(judged, "_MOST_DIGESTED", 0 if is_large else 1000)
    folder = tmp_path / "data"
    (folder / "b").mkdir(parents=True)
    (folder / "a.csv").write_bytes(b"abc")
    (folder / "b" / "c.csv").write_bytes(b"xyz")
    first = digest(folder)
    assert first["bytes"] == 6
    (folder / ".git").mkdir()
    (folder / ".git" / "index").write_bytes(b"1")  # no reader reads it
    assert digest(folder) == first
    digests = {first["sha256"]}
    for name, content in (("a.csv", b"abd"), ("a.csv", b"abcd"), ("d.csv", b"")):
        (folder / name).write_bytes(content)
        digests.add(digest(folder)["sha256"])
    (folder / "b" / "c.csv").rename(folder / "b" / "e.csv")
    digests.add(digest(folder)["sha256"])
    assert len(digests) == (4 if is_large else 5)  # of large folders sizes alone count


def test_settings_that_differ_are_named():
    assert changed_settings(Settings(), Settings()) == {}
    changed = replace(
        Settings(), judge=replace(JudgeSettings(), outliers=OutlierSettings(min_proba=0.75)), judge_features="raw"
    )
    assert changed_settings(changed, Settings()) == {"judge_features": "raw", "judge.outliers.min_proba": 0.75}
    assert changed_settings(math.inf, 1.0, "x") == {"x": "inf"}  # which JSON does not have


def test_outputs_carry_it_and_the_run_does_not_depend_on_it(tmp_path):
    bare = make_audit()
    (tmp_path / "a.csv").write_bytes(b"1,2\n")
    made = provenance_of("rpil audit x", 3, {"features": "raw"}, [tmp_path / "a.csv", None])
    assert made["files"] == [digest(tmp_path / "a.csv")]
    audit = replace(bare, provenance=made)
    assert audit.run_id == bare.run_id
    expected = json.loads(json.dumps(audit.provenance))
    write_verdicts(tmp_path / "v.parquet", audit, audit.table({}))
    assert json.loads(pq.read_schema(tmp_path / "v.parquet").metadata[b"rpil.provenance"]) == expected
    write_kept(tmp_path / "k.json", audit, audit.choice)
    assert json.loads((tmp_path / "k.json").read_text())["provenance"] == expected
    assert audit.to_dict()["provenance"] == made
    audit.to_dict()["provenance"]["files"].clear()
    assert audit.provenance == expected, "what a caller does with the dict changes no audit"
    assert "provenance" not in bare.to_dict()
