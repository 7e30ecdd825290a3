"""An audit as text: about eight lines, each true."""

from __future__ import annotations

import re

import numpy as np

from audits import make_audit
from rpil.inference.findings import FINDINGS
from rpil.results.overview import counts, overview_html, overview_text, shortened
from rpil.results.words import COLOURS


def test_the_text_names_finding_words_doubts_question_and_the_lowest_three():
    audit = make_audit(ids=list("abcdefghij"), doubts=("One reason.", "Another."), pair=("a", "j"))
    finding, words, doubt, question, head, *lowest, last = overview_text(audit).splitlines()
    assert finding == f"Audit: some are unlike. {FINDINGS['some are unlike']}"
    assert words == f"10 demonstrations, {audit.offsets[-1]:,} steps: 5 typical, 1 open, 4 unlike."
    assert doubt == "Doubt: One reason. (1 more in doubts)"
    assert question == f"Question: {audit.question}"
    assert head == "The lowest 3 by log-odds, of 10:"
    names = [line.split()[0] for line in lowest]
    assert names == [audit.ids[m] for m in np.argsort(audit.log_odds)[:3]]
    m = audit.index(names[0])
    assert f"unlike, P(typical) {audit.expert_proba[m]:.2f}, log-odds {audit.log_odds[m]:+.1f}" in lowest[0]
    assert "to_frame()" in last


def test_without_doubts_and_question_there_are_fewer_lines():
    text = overview_text(make_audit())
    assert len(text.splitlines()) == 7
    assert "Doubt" not in text
    assert "Question" not in text


def test_the_words_are_those_of_the_anchor():
    audit = make_audit(("good",) * 2 + ("bad",), anchor="answers", finding="answered", lengths=[700, 700, 1])
    assert counts(audit) == "3 demonstrations, 1,401 steps: 2 good, 0 open, 1 bad."
    assert "bad, P(good)" in overview_text(audit)


def test_one_demonstration_has_no_plural():
    assert counts(make_audit(("open",), lengths=[5])).startswith("1 demonstration, 5 steps")


def test_names_stay_in_one_short_line():
    assert shortened("a\nb\tc") == "a b c"
    assert shortened("x" * 41) == "x" * 37 + "..."
    assert shortened("x" * 40) == "x" * 40
    assert shortened(7) == "7"
    audit = make_audit(("open",) * 3, ids=["a\nb", "x" * 500, "\u202e"])
    assert len(overview_text(audit).splitlines()) == 7
    assert max(map(len, overview_text(audit).splitlines())) < 120


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
