"""An audit in a notebook: a bar of the words, the lowest ten, and everything escaped."""

from __future__ import annotations

import re

import numpy as np

from audits import make_audit
from rpil.results.html.notebook import overview_html
from rpil.results.plots import COLOURS


def rows(text: str) -> list[list[str]]:
    """The cells of the table as text."""
    body = text[text.index("<tbody>") :]
    cells = [re.findall(r"<td.*?>(.*?)</td>", row, re.DOTALL) for row in re.findall(r"<tr>(.*?)</tr>", body, re.DOTALL)]
    return [[" ".join(re.sub(r"<[^>]*>", "", cell).split()) for cell in row] for row in cells]


def test_the_lowest_ten_with_their_reasons():
    audit = make_audit(("typical",) * 8 + ("open",) * 2 + ("unlike",) * 5)
    found = rows(overview_html(audit))
    lowest = np.argsort(audit.log_odds)[:10].tolist()
    assert [row[0] for row in found] == [str(audit.ids[m]) for m in lowest]
    for row, m in zip(found, lowest, strict=True):
        assert row[1].endswith(audit.verdicts[m])
        assert row[2:5] == [audit.place(m), f"{audit.log_odds[m]:+.1f}", f"{audit.lengths[m]:,}"]
    assert "Judged by its actions" in found[0][5]


def test_the_bar_has_a_part_for_each_word():
    text = overview_html(make_audit())
    assert re.findall(r"flex:(\d+);background:(#\w+)", text) == [
        *(("5", COLOURS["upper"]), ("1", COLOURS["open"]), ("4", COLOURS["lower"]))
    ]
    assert COLOURS["lower"] not in overview_html(make_audit(("typical",) * 3))


def test_doubts_and_question_are_shown_and_names_escaped():
    ids = ["<script>alert(1)</script>", *"bcdefghij"]
    audit = make_audit(("unlike",) * 10, ids=ids, doubts=("A <b>doubt</b>.",), pair=("b", ids[0]))
    text = overview_html(audit)
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "A &lt;b&gt;doubt&lt;/b&gt;." in text
    assert "Which is better: b" in text


def test_nothing_is_loaded_from_elsewhere():
    text = overview_html(make_audit())
    assert "http" not in text
    assert "<style" not in text
    assert "src=" not in text
