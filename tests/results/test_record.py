"""The audit of users: a row for each demonstration in a frame, the report, and every field described."""

from __future__ import annotations

import re
from dataclasses import fields, replace

import numpy as np
import pyarrow as pa
import pytest

from audits import make_audit
from html_page import Page
from problems import make
from rpil.data.errors import DataError
from rpil.estimators.rpil import RPIL
from rpil.results.record import Audit, Demonstrator, Interval
from rpil.results.tasks import join_audits, select


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
def test_a_fitted_audit_becomes_a_frame_with_its_facts(backend):
    pytest.importorskip(backend)
    audit = RPIL().fit(make("random", 0).demonstrations).audit_
    frame = audit.to_frame(backend)
    assert {"fact_length", "fact_pauses"} & {*pa.table(frame).column_names}
    assert len(frame) == len(audit.ids)


def test_to_html_writes_the_report(tmp_path):
    audit = make_audit(ids=list("abcdefghij"))
    audit.to_html(tmp_path / "report.html", title="Drives of May")
    text = (tmp_path / "report.html").read_text()
    assert "<title>Drives of May</title>" in text
    assert audit.run_id in text
    assert Page(text)
    with pytest.raises(DataError):
        audit.to_html(tmp_path / "missing" / "report.html")


def test_parts_and_joined_audits_show_themselves_in_lines_too():
    audit = make_audit()
    joined = join_audits({"t": audit}, {"t": range(10)}, audit.ids, audit.offsets)
    for shown in (audit, select(audit, [1, 2, 3]), joined, replace(audit, doubts=("A reason.",))):
        assert repr(shown).startswith("Audit: ")
        assert len(repr(shown).splitlines()) <= 9
        assert "<table>" in shown._repr_html_()


def test_every_field_is_described():
    described = {
        name for line in re.findall(r"^    (\w[\w, ]*) :", Audit.__doc__ or "", re.M) for name in line.split(", ")
    }
    assert described == {field.name for field in fields(Audit)}
