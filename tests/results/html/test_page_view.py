"""The view holds what the audit says, in the order of the data, and what is worth a look comes first."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from audits import make_audit
from html_page import Page
from rpil.faults.report import FaultReport
from rpil.faults.rule import Fault
from rpil.results.answering import looking_order
from rpil.results.html.page import About, make_view, render_page
from rpil.results.judged import Demonstrator, Interval
from rpil.results.reasons import TWO_GROUPS, worst_stretch
from rpil.results.record import Audit


def view(audit: Audit, **about):
    return make_view(audit, About("Audit of x", "x.csv", **about))


def test_columns_are_those_of_the_audit_in_the_order_of_the_data():
    audit = make_audit()
    found = json.loads(json.dumps(view(audit), allow_nan=False))
    columns = found["demonstrations"]
    assert columns["id"] == list(map(str, audit.ids))
    assert found["whole_ids"]
    assert (columns["verdict"], columns["reason"]) == (list(audit.verdicts), list(audit.reasons))
    assert columns["n_steps"] == audit.lengths.tolist()
    np.testing.assert_allclose(columns["log_odds"], audit.log_odds, rtol=1e-5)
    assert columns["p"][:6] == [None] * 6  # they have no word
    np.testing.assert_allclose(columns["p"][6:], audit.expert_proba[6:], atol=1e-9)
    named = make_audit(("expert", "open"), anchor="named adversary", expert_proba=np.array([0.9, 0.5]))
    assert view(named)["demonstrations"]["p"] == [0.9, 0.5]
    assert columns["rank"] == audit.ranks.tolist() == (np.argsort(np.argsort(-audit.log_odds)) + 1).tolist()
    assert columns["worst"] == [*map(audit.worst_steps, audit.ids)]
    stretches = [worst_stretch(audit.log_ratio(m)) for m in range(len(audit.ids))]
    assert columns["stretch"] == [one and [*one] for one in stretches]
    assert columns["stretch"][9][0] < 168 / 2 < columns["stretch"][9][1]  # it goes wrong in its middle
    assert (found["counts"], found["run"]) == (audit.verdict_counts(), audit.run_id)


def test_numbers_stand_for_ids():
    words, changes = ("open",) * 8 + ("outlier",) * 2, {"pair": ("d1", "d7"), "contradicting": ("d4", "d6")}
    audit = make_audit(words, ids=[f"d{k}" for k in range(10)], **changes)
    found, (order, n_review) = view(audit), looking_order(audit)
    assert [found["demonstrations"]["look"].index(k) for k in range(10)] == order
    assert (found["n_review"], found["pair"], found["contradicting"]) == (n_review, [1, 7], [4, 6])
    assert "Which is better: d1" in found["question"]


def test_facts_beside_the_audit_are_those_of_each_demonstration():
    audit = make_audit(("open", "outlier"), ids=("a", "b"), sessions=("mon", "tue"), order=np.array([9.0, 4.0]))
    found = view(audit, tasks={"b": "pour"}, demonstrators={"a": "ann"})
    columns = found["demonstrations"]
    assert (columns["task"], columns["demonstrator"]) == (["", "pour"], ["ann", ""])
    assert (columns["session"], columns["order"]) == (["mon", "tue"], [2, 1])
    assert not found["whole_ids"]


def test_faults_are_folded_by_kind_and_point_to_their_demonstrations():
    def fault(rule, name, severity):
        return Fault(rule, name, 3, 5, "x", 1.0, 0.5, severity, "x leaps")

    findings = (fault("jump", "b", 2.0), fault("jump", "a", 9.0), fault("lag", "b", 5.0), fault("jump", "gone", 1.0))
    reasons = {"sign": "too few", "scale": "too few", "spike": "no columns"}
    report = FaultReport(findings, reasons, {}, {"lag": "a lag of 2 steps"}, {}, 2, 10)
    audit = make_audit(("open", "outlier"), ids=("a", "b"))
    found = view(audit, faults=report)["faults"]
    assert [(kind["rule"], kind["n"]) for kind in found["kinds"]] == [("jump", 3), ("lag", 1)]
    assert found["found"]["demonstration"] == [0, 1, 1, None]
    assert (found["found"]["sentence"][3], found["first"]) == ("gone: x leaps", [0, 1])
    page = Page(render_page(audit, About("Audit of x", "x.csv", faults=report))).text
    assert "2 demonstrations to look at first" not in page, "one of the three is not there any more"
    for said in ("Usual: a lag of 2 steps.", "Not checked: sign, scale (too few).", "Not checked: spike (no columns)."):
        assert said in page


def test_groups_and_demonstrators():
    ids = [f"d{k}" for k in range(10)]
    note = f"{TWO_GROUPS}A has 4 demonstrations and B 6."
    changes = {"finding": "two groups", "competing": (tuple(ids[:4]), tuple(ids[4:])), "notes": ("A note.", note)}
    who = Demonstrator("ann", Interval(0.8, 0.5, 0.9), tuple(ids[:6]))
    audit = make_audit(("open",) * 10, ids=ids, lengths=[9] * 10, demonstrators=(who,), **changes)
    found = view(audit)
    assert found["demonstrations"]["group"] == ["A"] * 4 + ["B"] * 6
    page = Page(render_page(audit, About("Audit of x", "x.csv"))).text
    assert page.count("A note.") == page.count(note) == 1
    assert "ann 80 % (50–90) 6 6 0" in page
    assert page.index("Nobody can say yet whether a group is worse") < page.index(note) < page.index("Operators")
    without = Page(render_page(replace(audit, demonstrators=(replace(who, trust=None),)), About("Audit of x", "x.csv")))
    assert "ann 6 6 0" in without.text
