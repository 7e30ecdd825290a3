"""The audit of users: a row for each demonstration in a frame, the report, and every field described."""

from __future__ import annotations

import inspect
import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from audits import make_audit
from html_page import Page
from rpil.data.errors import DataError
from rpil.results.answering import looking_order
from rpil.results.choice import write_verdicts
from rpil.results.record import Audit, Demonstrator, Interval


def test_a_frame_has_the_demonstrations_in_the_order_of_looking():
    audit = make_audit(ids=list("abcdefghij"))
    table, (order, _) = pa.table(audit.to_frame()), looking_order(audit)
    assert order != sorted(order)
    for name, column in (("id", audit.ids), ("verdict", audit.verdicts), ("reason", audit.reasons)):
        assert table[name].to_pylist() == [column[m] for m in order]
    assert table["look"].to_pylist() == [*range(1, 11)]
    np.testing.assert_array_equal(table["log_odds"].to_numpy(), audit.log_odds[order])
    np.testing.assert_array_equal(table["n_steps"].to_numpy(), audit.lengths[order])
    assert not {"faults", "task", "run", "demonstrator", "session"} & {*table.column_names}


def test_a_frame_has_demonstrators_and_sessions_where_they_are_known():
    who = (Demonstrator("ann", Interval(0.5, 0.1, 0.9), (0, 2)), Demonstrator("bob", Interval(0.5, 0.1, 0.9), (1,)))
    changes = {"demonstrators": who, "sessions": ("mon", "mon", "tue"), "log_odds": np.arange(3.0)}
    table = pa.table(make_audit(("open",) * 3, **changes).to_frame())
    assert table["demonstrator"].to_pylist() == ["ann", "bob", "ann"]
    assert table["fact_session"].to_pylist() == ["mon", "mon", "tue"]


def test_an_audit_becomes_a_frame_with_its_facts():
    pytest.importorskip("pandas")
    frame = make_audit(order=np.arange(10.0)).to_frame()
    assert "fact_order" in pa.table(frame).column_names
    assert len(frame) == 10


def test_to_html_writes_the_report(tmp_path):
    audit = make_audit(ids=list("abcdefghij"))
    audit.to_html(tmp_path / "report.html", title="Drives of May")
    text = (tmp_path / "report.html").read_text()
    assert "<title>Drives of May</title>" in text
    assert audit.run_id in text
    assert Page(text)
    with pytest.raises(DataError):
        audit.to_html(tmp_path / "missing" / "report.html")


def test_every_field_is_described():
    described = {
        name for line in re.findall(r"^(\w[\w, ]*) :", inspect.getdoc(Audit) or "", re.M) for name in line.split(", ")
    }
    assert described == {field.name for field in fields(Audit)}


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
