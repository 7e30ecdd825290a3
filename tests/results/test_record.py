"""The audit of users: a row for each demonstration in a frame, the report, and every field described."""

from __future__ import annotations

import re
from dataclasses import fields

import numpy as np
import pyarrow as pa
import pytest

from audits import make_audit
from html_page import Page
from rpil.data.errors import DataError
from rpil.results.record import Audit, Demonstrator, Interval


def test_a_frame_has_the_demonstrations_in_the_order_of_the_data():
    audit = make_audit(ids=list("abcdefghij"))
    table = audit.to_frame("pyarrow")
    assert table["id"].to_pylist() == list(audit.ids)
    assert table["verdict"].to_pylist() == list(audit.verdicts)
    assert table["reason"].to_pylist() == list(audit.reasons)
    np.testing.assert_array_equal(table["log_odds"].to_numpy(), audit.log_odds)
    np.testing.assert_array_equal(table["n_steps"].to_numpy(), audit.lengths)
    assert not {"faults", "task", "run", "demonstrator", "session"} & {*table.column_names}


def test_a_frame_has_demonstrators_and_sessions_where_they_are_known():
    who = (Demonstrator("ann", Interval(0.5, 0.1, 0.9), (0, 2)), Demonstrator("bob", Interval(0.5, 0.1, 0.9), (1,)))
    audit = make_audit(("similar",) * 3, demonstrators=who, sessions=("mon", "mon", "tue"))
    table = audit.to_frame("pyarrow")
    assert table["demonstrator"].to_pylist() == ["ann", "bob", "ann"]
    assert table["session"].to_pylist() == ["mon", "mon", "tue"]


@pytest.mark.parametrize("backend", ["pandas", "polars"])
def test_an_audit_becomes_a_frame_with_its_facts(backend):
    pytest.importorskip(backend)
    frame = make_audit(order=np.arange(10.0)).to_frame(backend)
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
        name for line in re.findall(r"^    (\w[\w, ]*) :", Audit.__doc__ or "", re.M) for name in line.split(", ")
    }
    assert described == {field.name for field in fields(Audit)}
