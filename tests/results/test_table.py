"""Verdicts as files: all formats hold the same rows, and the list to keep holds the trusted ids."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from audits import make_audit
from rpil.data.errors import DataError
from rpil.results.answering import looking_order
from rpil.results.choice import write_kept, write_verdicts

COLUMNS = [
    "id", "verdict", "label", "said", "rejected_by", "rank", "look", "expert_proba", "log_odds", "n_steps",
    "from_actions", "from_demonstrator", "from_label", "reliability", "demonstrator", "task", "faults", "reason", "run",
]  # fmt: skip


def read_rows(path: Path) -> list[dict[str, object]]:
    if path.suffix == ".json":
        return list(json.loads(path.read_text(encoding="utf-8")))
    if path.suffix == ".parquet":
        return list(pq.read_table(path).to_pylist())
    return list(pa.csv.read_csv(path).to_pylist())


@pytest.mark.parametrize("extension", [".csv", ".parquet", ".json"])
def test_every_format_holds_one_row_for_each_demonstration(tmp_path, extension):
    audit = make_audit(ids=["a,b", 'say "x"', "é", "01", "=1", "5", "6", "7", "8", "9"])
    path = tmp_path / f"verdicts{extension}"
    columns = audit.table({str(audit.ids[2]): "Ann"}, tasks={str(audit.ids[3]): "lift"})
    write_verdicts(path, audit, columns)
    rows = read_rows(path)
    assert list(rows[0]) == COLUMNS
    quote = "'" if extension == ".csv" else ""  # a spreadsheet would compute =1
    assert [row["id"] for row in rows] == [f"{quote}=1" if name == "=1" else name for name in audit.ids]
    assert [row["verdict"] for row in rows] == list(audit.verdicts)
    assert {row["label"] or "" for row in rows} == {""}
    assert [row["rank"] for row in rows] == audit.ranks.tolist()
    assert [row["look"] for row in rows] == (np.argsort(looking_order(audit)[0]) + 1).tolist()
    assert [row["expert_proba"] for row in rows] == audit.expert_proba.tolist()
    assert [row["log_odds"] for row in rows] == audit.log_odds.tolist()
    assert [row["reliability"] for row in rows] == audit.reliability.tolist()
    assert [row["n_steps"] for row in rows] == audit.lengths.tolist()
    assert [row["demonstrator"] for row in rows] == ["", "", "Ann", *[""] * 7]
    assert [row["task"] for row in rows] == ["", "", "", "lift", *[""] * 6]
    for row in rows:
        assert row["run"] == audit.run_id
        assert row["from_actions"] + row["from_demonstrator"] + row["from_label"] == pytest.approx(row["log_odds"])


@pytest.mark.parametrize(
    "write",
    [
        lambda path, audit: write_kept(path, audit, audit.choice),
        lambda path, audit: write_verdicts(path, audit, audit.table({})),
    ],
)
def test_other_extensions_are_refused(tmp_path, write):
    with pytest.raises(DataError, match=r"v\.txt: unknown extension '\.txt' for .*; use one of .*\.json"):
        write(tmp_path / "v.txt", make_audit())
    assert not list(tmp_path.iterdir())
