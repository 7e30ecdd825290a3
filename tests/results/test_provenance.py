"""Where a result comes from: the digest changes with the data alone; settings are named by their dots."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from audits import make_audit
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.settings import Settings
from rpil.formats.recording import from_demonstrations
from rpil.inference.settings import ClaimSettings, JudgeSettings
from rpil.results import provenance
from rpil.results.provenance import Provenance, changed_settings, digest
from rpil.results.verdict_table import write_kept, write_verdicts


def test_a_file_has_the_digest_that_every_tool_computes(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"1,2\n")
    expected = hashlib.sha256(b"1,2\n").hexdigest()
    assert digest(tmp_path / "a.csv") == {
        "path": str(tmp_path / "a.csv"),
        "bytes": 4,
        "sha256": expected,
        "of": "the bytes",
    }


@pytest.mark.parametrize("is_large", [False, True])
def test_the_digest_of_a_folder_changes_with_names_sizes_and_ends(tmp_path, monkeypatch, is_large):
    if is_large:
        monkeypatch.setattr(provenance, "_MOST_DIGESTED", 3)
        monkeypatch.setattr(provenance, "_END", 2)
    folder = tmp_path / "data"
    (folder / "b").mkdir(parents=True)
    (folder / "a.csv").write_bytes(b"abc")
    (folder / "b" / "c.csv").write_bytes(b"xyz")
    first = digest(folder)
    assert first["bytes"] == 6
    assert first["of"].endswith("the last 64 KiB of each file" if is_large else "the bytes of each file")
    (folder / ".git").mkdir()
    (folder / ".git" / "index").write_bytes(b"1")  # no reader reads it
    assert digest(folder) == first
    found = {first["sha256"]}
    for name, content in (("a.csv", b"abd"), ("a.csv", b"abcd"), ("d.csv", b"")):
        before = (folder / name).read_bytes() if (folder / name).exists() else None
        (folder / name).write_bytes(content)
        found.add(digest(folder)["sha256"])
        (folder / name).write_bytes(before) if before is not None else (folder / name).unlink()
    (folder / "b" / "c.csv").rename(folder / "b" / "e.csv")
    assert len(found | {digest(folder)["sha256"]}) == 5
    assert (folder / "a.csv").write_bytes(b"Abc")
    assert (digest(folder)["sha256"] in found) is False
    (folder / "b" / "e.csv").rename(folder / "b" / "c.csv")
    assert (digest(folder)["sha256"] == first["sha256"]) is is_large  # of a large file only the end is read


def test_an_address_is_not_read_again_nor_are_its_secrets_kept():
    assert digest("s3://K:S@bucket/x")["path"] == "s3://***@bucket/x"
    assert digest("hf://datasets/somebody/some")["sha256"] == ""
    assert "address" in digest("hf://datasets/somebody/some")["of"]


def test_settings_that_differ_are_named():
    assert changed_settings(Settings(), Settings()) == {}
    changed = replace(
        Settings(),
        judge=replace(JudgeSettings(), claims=replace(ClaimSettings(), min_proba=0.75)),
        judge_features="raw",
    )
    assert changed_settings(changed, Settings()) == {"judge_features": "raw", "judge.claims.min_proba": 0.75}
    assert changed_settings(math.inf, 1.0, "x") == {"x": "inf"}  # which JSON does not have


def data(first=0.0):
    rng = np.random.default_rng(0)
    observations, actions = rng.normal(size=(60, 2)), rng.normal(size=(60, 2))
    observations[0, 0] = first
    return Demonstrations.from_groups(observations, actions, np.repeat(np.arange(6), 10))


def made(demonstrations):
    recording = from_demonstrations(demonstrations, "test")
    return Provenance.of(recording, None, "rpil audit x", 3, {"features": "raw"}, [None])


def test_it_names_what_was_read_and_when(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    found = made(data())
    assert (found.command, found.seed, found.time) == ("rpil audit x", 3, "2023-11-14T22:13:20+00:00")
    assert found.libraries["numpy"] == np.__version__
    assert found.columns["id"] == "episode"
    assert len(found.columns["observations"]) == len(found.columns["action"]) == 2
    assert found == made(data())
    assert found.files != made(data(first=1.0)).files
    assert json.loads(json.dumps(found.to_dict()))["settings"] == {"features": "raw"}


def test_outputs_carry_it_and_the_run_does_not_depend_on_it(tmp_path):
    bare = make_audit()
    audit = replace(bare, provenance=made(data()))
    assert audit.run_id == bare.run_id
    expected = json.loads(json.dumps(audit.provenance.to_dict()))
    write_verdicts(tmp_path / "v.parquet", audit, {})
    assert json.loads(pq.read_schema(tmp_path / "v.parquet").metadata[b"rpil.provenance"]) == expected
    write_kept(tmp_path / "k.json", audit, audit.choice)
    assert json.loads((tmp_path / "k.json").read_text())["provenance"] == expected
    assert audit.to_dict()["provenance"] == audit.provenance.to_dict()
    assert "provenance" not in bare.to_dict()
