"""The audit of users: a row for each demonstration in a frame, the report, and every field described."""

import inspect
import re
from dataclasses import fields

import numpy as np
import pyarrow as pa
import pytest

from audits import make_audit
from html_page import Page
from rpil.data.errors import DataError
from rpil.results.answering import looking_order
from rpil.results.judged import Demonstrator, Interval
from rpil.results.record import Audit


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
