"""The end of a review: one command that carries it out, and a page for the supplier of the data."""

from __future__ import annotations

import hashlib
import json
import shlex
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from asked import write
from command_line import ok
from served import need_server, reviewing

need_server()


@pytest.mark.slow
def test_what_is_finished_is_carried_out_by_one_command_and_told_to_the_supplier(tmp_path):
    other = write(tmp_path / "d & <b>.parquet")
    with reviewing(other, "--observations", "x,v", "--by", "anna") as (_, client):
        given = {"demonstrations": [3, 5, 8, 9], "key": "b", "note": "=hit <b>the table</b>", "tag": "drop"}
        assert client.post("/api/answer", version=0, **given)[0] == 200
        assert client.answer(1, "g", 1, 2)[0] == 200
        seen = client.post("/api/finish", version=2)[1]
        assert seen["rejected"]["labels"] == [3, 5, 8, 9]
        spared = {"spared": ["8"], "rules": ["no rule"]}
        after = client.post("/api/finish", version=2, **spared)[1]
        assert (after["kept"], after["rejected"]["labels"]) == (seen["kept"] + 1, [3, 5, 9])
        found = client.post("/api/finish", version=2, write=True, **spared)[1]
        named = client.post("/api/finish", version=2, write=True, names=True, **spared)[1]
        kept = json.loads(Path("labels-keep.json").read_text())
    assert kept["rejected"]["labels"] == [3, 5, 9]
    words = shlex.split(found["command"])
    new = "d & <b>-kept.parquet"
    assert words == ["rpil", "keep", other, "--observations", "x,v", "--verdicts", "labels-keep.json", "-o", new]
    out = ok(*words[1:], "-q").stdout
    assert f"Kept {len(kept['episodes'])} of 24 demonstrations" in out
    assert "Rejected: 3 by your labels" in out
    assert set(pq.read_table(new)["episode_index"].to_pylist()) == {*kept["episodes"]}
    page = Path(named["files"]["supplier"]).read_text()
    assert "anna: bad, drop: =hit &lt;b&gt;the table&lt;/b&gt;" in page
    assert hashlib.sha256(Path(other).read_bytes()).hexdigest() in page
    assert str(tmp_path) not in page


@pytest.mark.slow
def test_the_supplier_is_told_no_names_unless_asked(data):
    with reviewing(data, "--observations", "x,v") as (_, client):
        for version, (by, word) in enumerate((("anna", "g"), ("bilal", "b"), ("chen", "b"))):
            assert (
                client.post("/api/answer", version=version, demonstrations=[3], key=word, by=by, tag="drop")[0] == 200
            )
        assert client.post("/api/finish", version=3, write=True)[0] == 200
    page = Path("labels-supplier.html").read_text()
    assert "anna" not in page
    assert "bilal" not in page
    assert "1 called bad by a person" in page
    assert page.count("<li>bad, drop</li>") == 2
    assert "default-src 'none'" in page
    assert "<script" not in page
