"""An audit as text: about eight lines, each true."""

from __future__ import annotations

import re
from html import escape

import numpy as np

from audits import make_audit
from rpil.results.overview import headline, overview_html, overview_text, shortened


def test_the_text_names_finding_words_doubts_question_and_the_lowest_three():
    audit = make_audit(ids=list("abcdefghij"), doubts=("One reason.", "Another."), pair=("a", "j"))
    finding, words, doubt, question, head, *lowest, last = overview_text(audit).splitlines()
    assert finding == f"Audit: {headline(audit)}"
    assert words == f"10 demonstrations, {audit.offsets[-1]:,} steps: 5 similar, 1 open, 4 outliers."
    assert doubt == "Doubt: One reason. (1 more in doubts)"
    assert question == f"Question: {audit.question}"
    assert head == "The lowest 3 scores (log_odds), of 10:"
    names = [line.split()[0] for line in lowest]
    assert names == [audit.ids[m] for m in np.argsort(audit.log_odds)[:3]]
    m = audit.index(names[0])
    assert f"outlier, P(similar) {audit.expert_proba[m]:.2f}, score {audit.log_odds[m]:+.1f}" in lowest[0]
    assert "to_frame()" in last


def test_names_stay_in_one_short_line():
    assert shortened("a\nb\tc") == "a b c"
    assert shortened("x" * 41) == "x" * 37 + "..."
    assert shortened("x" * 40) == "x" * 40
    assert shortened(7) == "7"
    audit = make_audit(("open",) * 3, ids=["a\nb", "x" * 500, "\u202e"])
    assert len(overview_text(audit).splitlines()) == 7
    assert max(map(len, overview_text(audit).splitlines())) < 120


def test_a_notebook_shows_the_text_and_the_lowest_ten_with_their_reasons():
    ids = ["<script>alert(1)</script>", *map(str, range(14))]
    audit = make_audit(("similar",) * 8 + ("open",) * 2 + ("outlier",) * 5, ids=ids, doubts=("A <b>doubt</b>.",))
    text = overview_html(audit)
    assert "A &lt;b&gt;doubt&lt;/b&gt;." in text
    assert "<script" not in text
    lowest = np.argsort(audit.log_odds)[:10].tolist()
    rows = [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", text)]
    shown = [[audit.ids[m], audit.verdicts[m], audit.place(m), audit.reasons[m]] for m in lowest]
    assert rows == [[escape(cell) for cell in row] for row in shown]
