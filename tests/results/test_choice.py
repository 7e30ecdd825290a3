"""Which demonstrations are kept, by which rule the others are rejected, and tables of verdicts read back as written."""

import copy
import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from audits import make_audit
from problems import refused
from rpil.inference.answers import Answers
from rpil.results.answering import rejecting_rules
from rpil.results.choice import KEEP_RULES, choose, read_verdicts, write_verdicts
from rpil.results.vocabulary import SIDES

TABLE = {
    "id": ["a", "b", "c", "d", "e"],
    "rejected_by": ["", "answers", "", "", ""],
    "expert_proba": [0.99, 0.02, 0.6, 0.95, 0.6],
    "log_odds": ["5", "-4", "0.4", "3", "0.4"],  # as in a file of text
}


def table_of(words, labels=None, rules=None):
    ids = [f"d{m}" for m in range(len(words))]
    columns = {"id": ids, "verdict": list(words), "label": list([""] * len(words) if labels is None else labels)}
    by_verdict = {"bad": "answers", "adversary": "adversary"}
    return {**columns, "rejected_by": [by_verdict.get(word, "") for word in words] if rules is None else list(rules)}


def rule_by_brute_force(table, faulty):
    """The rule of each demonstration, or nothing, in the words of docs/command-line.md, one demonstration at a time."""
    rows = zip(table["id"], table["label"], table["rejected_by"], strict=True)
    rules = []
    for name, label, rule in rows:
        rule = "" if label and not (rule == "outcome" and label == "bad") else rule
        if name in faulty and rule != "outcome":
            rule = "faults"
        if label == "bad":
            rule = "labels"
        rules.append(rule)
    return rules


def test_every_rule_by_brute_force():
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 30))
        share = rng.dirichlet(np.ones(len(SIDES)) * 0.3)
        words = rng.choice([*SIDES], n, p=share / share.sum())
        labels = rng.choice(["", "good", "bad"], n, p=[0.8, 0.1, 0.1])
        rules = rng.choice(["", "outcome", "answers"], n, p=[0.5, 0.3, 0.2]) if seed % 2 else None
        table = table_of(words, labels, rules)
        faulty = {f"d{m}" for m in range(n) if rng.random() < 0.1}
        rules = rule_by_brute_force(table, faulty)
        choice = choose(table, faulty=faulty)
        assert choice.kept == tuple(name for name, rule in zip(table["id"], rules, strict=True) if not rule), seed
        for rule in KEEP_RULES:
            ids = tuple(name for name, own in zip(table["id"], rules, strict=True) if own == rule)
            assert choice.rejected.get(rule, ()) == ids, seed


def test_the_table_of_the_page_is_what_is_done():
    """Each row, for one demonstration among ten, in either column."""
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    lines = page.partition("| a demonstration | before two answers contrast | after |")[2].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in itertools.takewhile(bool, lines)]
    flags = np.array([0.0] + [1.0] * 9)
    audits = {
        "labelled bad": (("bad",), {"labels": {0: -1}}),
        "labelled good": (("good",), {"labels": {0: 1}}),
        "failed, by an outcome of 0 where all are 0 or 1": (
            ("bad",),
            {"answers": replace(Answers.none(10), outcomes=flags[:, None])},
        ),
        "bad by inference from answers": (("bad",), {}),
        "outlier": (("outlier",), {}),
        "the worse one of an answered pair": (
            ("open",),
            {"answers": replace(Answers.none(10), pairs=np.array([[8, 0]])), "log_odds": -np.ones(10)},
        ),
        "adversary (`--adversary` names one)": (("adversary",), {"anchor": "named adversary"}),
    }
    audits |= {word: ((word,), {}) for word in ("good", "expert", "open")}
    named = set()
    for what, *columns in rows:
        for name in [what] if what in audits else what.split(", "):
            if name in audits:
                named.add(name)
                words, changes = audits[name]
                for said, more in zip(columns, ({}, {8: 1, 9: -1}), strict=True):
                    changes = copy.deepcopy(changes)
                    changes["labels"] = changes.get("labels", {}) | more
                    kept = make_audit((*words, *["open"] * 9), **{"anchor": "answers"} | changes).choice.kept
                    assert said == "there are none" or (0 in kept) == said.startswith("kept"), (name, said)
    assert named == {*audits}
    claimed = -(np.arange(10) < 1).astype(int)
    before = make_audit(("outlier", *["open"] * 9), columns=np.arange(20.0).reshape(10, 2), claimed=claimed)
    assert before.answered({8: "good"}).verdicts[0] == "outlier"
    assert before.answered({8: "good", 9: "bad"}).verdicts[0] == "open"


def pair_of(log_odds, labels=(), **changes):
    """An audit of four: 0 is better than 1."""
    known = replace(Answers.none(4), pairs=np.array([[0, 1]]))
    audit = make_audit(
        ("open",) * 4, log_odds=np.array(log_odds), answers=known, labels=dict(labels), anchor="answers", **changes
    )
    return replace(audit, rejected_by=rejecting_rules(audit))


def test_the_worse_one_of_a_pair_is_named_and_rejected_after_a_second_answer_that_agrees():
    one = pair_of([1.0, -1.0, 0.0, 0.0])
    said = "1 is kept though you called it worse than 0: one answer more decides."
    assert (one.choice.kept, one.choice.lines()) == ((0, 1, 2, 3), [said])
    assert one.reasons[1].startswith("You called it worse than 0")
    two = pair_of([1.0, 0.0, 0.0, 0.0], {3: 1})
    assert (two.choice.kept, two.choice.notes) == ((0, 2, 3), ())
    assert two.choice.rejected == {"answers": (1,)}
    against = pair_of([1.0, 1.0, 0.0, 0.0], {3: 1})
    assert (against.choice.kept, against.choice.lines()) == ((0, 1, 2, 3), [said])
    assert pair_of([1.0, 1.0, 0.0, 0.0], {1: 1}).choice.lines() == [], "it is labelled good"
    copied = pair_of([1.0, -1.0, -1.0, 0.0], {3: 1}, copy_of=np.array([0, 1, 1, 3]))
    assert copied.choice.rejected == {"answers": (1, 2)}


def with_flags(outcome, **changes):
    known = replace(Answers.none(4), outcomes=np.array(outcome)[:, None], names=("success",))
    return make_audit(("open",) * 4, answers=known, **changes)


def test_an_outcome_of_zero_rejects_and_is_named():
    audit = with_flags([0.0, 1.0, 0.0, np.nan], labels={2: 1})
    assert audit.choice.rejected == {"outcome": (0,)}, "a label says more of its demonstration"
    assert audit.choice.lines() == ["Rejected: 1 by success = 0.", "  by success = 0: 0"]
    assert audit.said == ("success = 0", "", "", "")
    assert choose(audit.table(), spared={"0"}).kept == (0, 1, 2, 3)
    assert choose(audit.table(), share=1.0).kept == (1, 2, 3)
    both = with_flags([0.0, 1.0, 0.0, np.nan], labels={0: -1})
    assert both.choice.rejected == {"labels": (0,), "outcome": (2,)}
    numbers = with_flags([0.0, 1.0, 0.0, 2.0])
    assert numbers.choice.rejected == {}, "no flag"
    copies = with_flags([0.0, 1.0, np.nan, np.nan], copy_of=np.array([0, 1, 0, 1]))
    assert copies.choice.rejected == {"outcome": (0, 2)}


def test_the_file_of_an_audit_says_the_same_as_the_audit(tmp_path):
    ids = ["a\nb", 'say "x"', "é", "01", "=1", " a", "a ", "\x85", "+5", "\u2028,"]
    path = tmp_path / "verdicts.csv"
    flags = np.array([1.0, *[np.nan] * 7, 0.0, np.nan])[:, None]
    known = Answers(np.zeros(10, dtype=np.int64), np.array([[0, 9]]), flags)
    for labels in ({}, {"é": 1, "01": -1}):
        words = ("good",) * 4 + ("open",) * 3 + ("bad",) * 3
        changes = {"anchor": "answers", "labels": labels, "answers": known if labels else Answers.none(10)}
        audit = make_audit(words, ids=ids, **changes)
        write_verdicts(path, audit, audit.table({}))
        for share in (None, 0.4):
            expected = choose(audit.table(), share)
            assert expected.kept
            assert choose(audit.table({}), share) == expected
            assert choose(read_verdicts(path), share) == expected
    assert {*audit.choice.rejected} == {"labels", "outcome", "answers"}


def test_unknown_rules_are_refused():
    with refused("Demonstration 'c': the rejected by 'me' is unknown; write one of labels, outc"):
        choose({"id": ["a", "b", "c"], "rejected_by": ["", "answers", "me"]})


def test_labels_are_verdicts(tmp_path):
    (tmp_path / "labels.csv").write_text("id,label\n3,good\n4,bad\n5,expert\n")
    choice = choose(table := read_verdicts(tmp_path / "labels.csv"))
    assert (choice.kept, choice.rejected) == (("3", "5"), {"labels": ("4",)})
    with refused("no numbers in log_odds"):
        choose(table, share=0.5)


def test_a_choice_as_lists_and_lines():
    words = ["bad"] * 25 + ["good"] * 3
    choice = choose({"id": range(28), "rejected_by": ["answers" if word == "bad" else "" for word in words]})
    rejected = ", ".join(map(str, range(20)))
    assert choice.lines()[1] == f"  by inference from your answers: {rejected} and 5 more"
    assert choice.to_dict() == {"episodes": [25, 26, 27], "rejected": {"answers": [*range(25)]}}
    named = choose({"id": [1, "b", 3], "rejected_by": ["", "answers", ""]})
    assert named.to_dict() == {"episodes": ["1", "3"], "rejected": {"answers": ["b"]}}


def test_files_that_are_no_verdicts_are_refused(tmp_path):
    other = "it is not the list of rpil audit --keep; give that, the CSV of --verdicts, or labels"
    for text, said in {"": "the file is empty", "[]": other, '[{"id": 1, "verdict": "good"}]': other}.items():
        (tmp_path / "v.json").write_text(text)
        with refused(rf"v\.json: .*{said}"):
            read_verdicts(tmp_path / "v.json")
    (tmp_path / "old.csv").write_text("id,verdict,label\n1,good,\n")
    with refused(r"old\.csv: it has no column rejected_by; write it again with rpil audit"):
        read_verdicts(tmp_path / "old.csv")
    (tmp_path / "pairs.csv").write_text("id,label\n1,better than 2\n")
    with refused(r"pairs\.csv: it labels no demonstration"):
        read_verdicts(tmp_path / "pairs.csv")


def test_what_was_written_to_keep_is_carried_out_by_its_rules(tmp_path):
    table = table_of(["bad", "good", "bad", "open"], ["bad", "", "", ""]) | {"id": [1, 2, 3, 4]}
    for spared, faulty in (({"1"}, {"4"}), (set(), {"2"}), ({"1", "3", "9"}, set())):
        choice = choose(table, None, faulty, spared)
        path = tmp_path / "keep.json"
        path.write_text(json.dumps(choice.to_dict()))
        again = choose(read_verdicts(path))
        assert ({*again.kept}, again.rejected) == ({*choice.kept}, choice.rejected)
        assert {*choice.kept}.isdisjoint([4] if faulty == {"4"} else [])
    assert 1 in choice.kept, "spared, though it is labelled bad"


@pytest.mark.parametrize(
    ("asked", "ids"),
    [
        ({}, "acde"),
        ({"share": 0.8}, "acde"),
        ({"share": 0.6}, "acd"),
        ({"share": 0.01}, "a"),
        ({"share": 1}, "abcde"),
        ({"faulty": {"a", "b"}}, "cde"),
        ({"share": 0.6, "faulty": {"a"}}, "cd"),
    ],
)
def test_choice(asked, ids):
    choice = choose(TABLE, **asked)
    assert list(choice.kept) == [*ids]
    assert sorted([*choice.kept, *itertools.chain(*choice.rejected.values())]) == TABLE["id"], "each is named once"


def test_what_is_inferred_says_from_what():
    """A table without labels, of another version, does not say that there were none."""
    table = table_of(["bad", "open", "open"], rules=["answers", "", ""]) | {"said": [""] * 3}
    assert choose(table).lines()[0] == "Rejected: 1 by inference from the outcomes."
    for more in ({"label": ["", "good", ""]}, {"said": ["worse than 1", "", ""]}):
        assert choose(table | more).lines()[0] == "Rejected: 1 by inference from your answers."
    del table["label"]
    assert choose(table).lines()[0] == "Rejected: 1 by inference from your answers."
