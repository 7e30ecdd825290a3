"""The end of a review: one command that carries it out."""

from __future__ import annotations

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
def test_what_is_finished_is_carried_out_by_one_command(tmp_path):
    other = write(tmp_path / "d & <b>.parquet")
    with reviewing(other, "--observations", "x,v") as (_, client):
        given = {"demonstrations": [3, 5, 8, 9], "key": "b", "note": "=hit <b>the table</b>"}
        assert client.post("/api/answer", version=0, **given)[0] == 200
        assert client.answer(1, "g", 1, 2)[0] == 200
        seen = client.post("/api/finish", version=2)[1]
        assert seen["rejected"]["labels"] == [3, 5, 8, 9]
        spared = {"spared": ["8"], "rules": ["no rule"]}
        after = client.post("/api/finish", version=2, **spared)[1]
        assert (after["kept"], after["rejected"]["labels"]) == (seen["kept"] + 1, [3, 5, 9])
        found = client.post("/api/finish", version=2, write=True, **spared)[1]
        kept = json.loads(Path("labels-keep.json").read_text())
    assert kept["rejected"]["labels"] == [3, 5, 9]
    words = shlex.split(found["command"])
    new = "d & <b>-kept.parquet"
    assert words == ["rpil", "keep", other, "--observations", "x,v", "--verdicts", "labels-keep.json", "-o", new]
    out = ok(*words[1:], "-q").stdout
    assert f"Kept {len(kept['episodes'])} of 24 demonstrations" in out
    assert "Rejected: 3 by your labels" in out
    assert set(pq.read_table(new)["episode_index"].to_pylist()) == {*kept["episodes"]}


@pytest.mark.slow
def test_what_keep_does_not_write_is_finished_with_a_list(tmp_path):
    (tmp_path / "drives").mkdir()
    write(tmp_path / "drives" / "a.parquet")
    with reviewing(tmp_path / "drives", "--observations", "x,v") as (_, client):
        assert client.post("/api/answer", version=0, demonstrations=[3, 5], key="b")[0] == 200
        found = client.post("/api/finish", version=1, write=True)[1]
    words = shlex.split(found["command"])
    assert words[-2:] == ["-o", "drives-kept.json"]
    assert "These ids are kept; to write a table of them: rpil convert" in ok(*words[1:]).stdout
