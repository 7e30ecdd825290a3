"""Which demonstrations are kept, by which rule the others are rejected, and tables of verdicts read back as written."""

import itertools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from audits import make_audit
from rpil.data.errors import DataError
from rpil.inference.answers import Answers
from rpil.results.choice import KEEP_RULES, RULES_OF_VERDICTS, Asked, choose, read_verdicts
from rpil.results.settings import KeepSettings
from rpil.results.verdict_table import choice_of, verdict_columns, write_verdicts
from rpil.results.vocabulary import SIDES

SETTINGS = KeepSettings()
TABLE = {
    "id": ["a", "b", "c", "d", "e"],
    "verdict": ["similar", "outlier", "open", "similar", "open"],
    "expert_proba": [0.99, 0.02, 0.6, 0.95, 0.6],
    "log_odds": ["5", "-4", "0.4", "3", "0.4"],  # as in a file of text
}


def kept(table, **asked):
    return list(choose(table, SETTINGS, Asked(**asked)).kept)


@pytest.mark.parametrize(
    ("asked", "ids"),
    [
        ({}, "acde"),
        ({"share": 0.8}, "acde"),
        ({"share": 0.6}, "acd"),
        ({"share": 0.01}, "a"),
        ({"share": 1}, "abcde"),
        ({"at_least": 0.6}, "acde"),
        ({"at_least": 0.991}, ""),
        ({"ignored": {"outlier"}}, "abcde"),
        ({"faulty": {"a", "b"}}, "cde"),
        ({"share": 0.6, "faulty": {"a"}}, "cd"),
    ],
)
def test_choice(asked, ids):
    choice = choose(TABLE, SETTINGS, Asked(**asked))
    assert list(choice.kept) == [*ids]
    assert sorted([*choice.kept, *itertools.chain(*choice.rejected.values())]) == TABLE["id"], "each is named once"
    assert not choice.undecided


def table_of(words, labels=None, most=None):
    ids = [f"d{m}" for m in range(len(words))]
    columns = {"id": ids, "verdict": list(words), "label": list([""] * len(words) if labels is None else labels)}
    return columns if most is None else {**columns, "max_outliers": [most] * len(words)}


def rule_by_brute_force(table, asked):
    """The rule of each demonstration, or nothing, in the words of docs/command-line.md, one demonstration at a time."""
    rows = list(zip(table["id"], table["verdict"], table["label"], strict=True))
    n_outliers = sum(word == "outlier" and label == "" for _, word, label in rows)
    most = float(table["max_outliers"][0]) if "max_outliers" in table else 0.2
    rules = []
    for name, word, label in rows:
        rule = ""
        if label == "" and word == "outlier" and n_outliers <= most * len(rows):
            rule = "outlier"
        if label == "" and word in ("bad", "adversary"):
            rule = {"bad": "answers", "adversary": "adversary"}[word]
        if rule in asked.ignored:
            rule = ""
        if name in asked.faulty:
            rule = "faults"
        if label == "bad" and "labels" not in asked.ignored:
            rule = "labels"
        rules.append(rule)
    return rules


@pytest.mark.parametrize("seed", range(60))
def test_every_rule_by_brute_force(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    share = rng.dirichlet(np.ones(len(SIDES)) * 0.3)
    words = rng.choice([*SIDES], n, p=share / share.sum())
    labels = rng.choice(["", "good", "bad"], n, p=[0.8, 0.1, 0.1])
    table = table_of(words, labels, [None, 1.0, 0.2, 0.0, "0.5"][seed % 5])
    ignored = {rule for rule in ("labels", *RULES_OF_VERDICTS.values()) if rng.random() < 0.2}
    asked = Asked(ignored=ignored, faulty={f"d{m}" for m in range(n) if rng.random() < 0.1})
    rules = rule_by_brute_force(table, asked)
    choice = choose(table, SETTINGS, asked)
    assert choice.kept == tuple(name for name, rule in zip(table["id"], rules, strict=True) if not rule)
    for rule in KEEP_RULES:
        ids = tuple(name for name, own in zip(table["id"], rules, strict=True) if own == rule)
        assert choice.rejected.get(rule, ()) == ids
    undecided = [
        name
        for name, word, label, rule in zip(table["id"], words, labels, rules, strict=True)
        if word == "outlier" and not label and not rule and "outlier" not in ignored
    ]
    assert list(choice.undecided) == undecided
    assert bool(choice.reason) == bool(undecided)


def test_the_table_of_the_page_is_what_is_done():
    """Each word of its rows, for one demonstration among ten, in either column."""
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    lines = page.partition("| a demonstration | before two answers | after two answers |")[2].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in itertools.takewhile(bool, lines)]
    done = {"labelled bad": ("open", "bad"), "labelled good": ("outlier", "good"), "bad by inference": ("bad", "")}
    done |= {word: (word, "") for word in ("outlier", "adversary", "similar", "good", "expert", "open")}
    named = set()
    for what, before, after in rows:
        words = [what] if what.startswith("labelled") else re.split(r", | from answers| \(", what)
        for word in filter(done.__contains__, words):
            named.add(word)
            for most, said in ((0.2, before), (1.0, after)):
                verdict, label = done[word]
                table = table_of([verdict] + ["open"] * 9, [label] + [""] * 9, most)
                if said != "there is none":
                    assert ("d0" in kept(table)) == said.startswith("kept"), (word, said)
    assert named == {*done}


def test_exactly_a_fifth_is_rejected_and_one_more_is_not():
    assert all(k <= SETTINGS.max_outliers * (5 * k) for k in range(100_000)), "no rounding decides"
    for k in range(1, 40):
        at, above = (["outlier"] * count + ["open"] * (5 * k - count) for count in (k, k + 1))
        assert len(choose(table_of(at), SETTINGS).kept) == 4 * k
        assert len(choose(table_of(above), SETTINGS).undecided) == k + 1
    reason = "2 of 5 demonstrations are outliers, more than 20% of all: they are kept, because without two "
    assert choose(table_of(["outlier"] * 2 + ["open"] * 3), SETTINGS).reason.startswith(reason)


def test_a_share_or_a_probability_is_obeyed_in_full():
    table = {**table_of(["outlier"] * 9 + ["similar"], most=0.0), "log_odds": range(10), "expert_proba": [0.05] * 10}
    table["label"][9] = "bad"
    for asked, n in ((Asked(share=0.5), 4), (Asked(at_least=0.5), 0), (Asked(share=0.5, ignored={"labels"}), 5)):
        choice = choose(table, SETTINGS, asked)
        assert (len(choice.kept), choice.undecided, choice.reason) == (n, (), "")


def audit_with(words, answers, **changes):
    """An audit with so many labels and pairs, of which the last one repeats the first."""
    labels, pairs = np.zeros(len(words), dtype=np.int64), [(0, 1)] * answers.count("pair")
    labels[2 : 2 + answers.count("label")] = 1
    known = Answers(labels, np.array(pairs, dtype=np.int64).reshape(-1, 2), np.full(len(words), np.nan))
    return make_audit(words, answers=known, **changes)


@pytest.mark.parametrize(
    ("answers", "n_kept"),
    [([], 10), (["label"], 10), (["pair"], 10), (["pair", "pair"], 10), (["label"] * 2, 7), (["pair", "label"], 7)],
)
def test_answers_about_different_demonstrations_are_counted(answers, n_kept):
    words = ("similar",) * 7 + ("outlier",) * 3
    assert len(audit_with(words, answers).choice.kept) == n_kept


def test_answers_about_copies_are_one_answer():
    words, copy_of = ("similar",) * 7 + ("outlier",) * 3, np.array([0, 1, 2, 2, *range(4, 10)])
    audit = audit_with(words, ["label"] * 2, copy_of=copy_of)
    assert audit.max_outliers == 0.2
    assert len(audit.choice.undecided) == 3


def test_outcomes_are_answers():
    audit = make_audit(("similar",) * 7 + ("outlier",) * 3)
    outcome = np.where(np.arange(10) < 2, [1.0, 0.0] * 5, np.nan)
    assert len(replace(audit, answers=replace(audit.answers, outcome=outcome)).choice.kept) == 7


@pytest.mark.parametrize("extension", [".csv", ".parquet", ".json"])
def test_the_file_of_an_audit_says_the_same_as_the_audit(tmp_path, extension):
    ids = ["a\nb", 'say "x"', "é", "01", "=1", " a", "a ", "\x85", "+5", "\u2028,"]
    path = tmp_path / f"verdicts{extension}"
    for count in (0, 2):
        words = ("similar",) * 5 + ("open",) + ("outlier",) * (4 if count else 2) + ("similar",) * (0 if count else 2)
        audit = audit_with(words, ["label"] * count, ids=ids)
        write_verdicts(path, audit, verdict_columns(audit, {}))
        for asked in (Asked(), Asked(share=0.4), Asked(at_least=0.5), Asked(ignored={"outlier"})):
            expected = choice_of(audit, asked)
            assert expected.kept
            assert choose(verdict_columns(audit, {}), SETTINGS, asked) == expected
            assert choose(read_verdicts(path), SETTINGS, asked) == expected
        assert choice_of(audit).rejected


def test_words_of_a_named_adversary_are_read_and_unknown_ones_refused():
    table = {"id": ["a", "b", "c"], "verdict": ["expert", "adversary", "open"]}
    choice = choose(table, SETTINGS)
    assert (choice.kept, choice.rejected) == (("a", "c"), {"adversary": ("b",)})
    with pytest.raises(DataError, match="Demonstration 'b': the verdict 'perhaps' is unknown; write one of similar"):
        choose(table | {"verdict": ["good", "perhaps", "bad"]}, SETTINGS)
    for number in ("no", ""):
        with pytest.raises(DataError, match="max_outliers; give those that rpil audit wrote"):
            choose(table | {"max_outliers": [number] * 3}, SETTINGS)


@pytest.mark.parametrize(
    ("column", "asked"),
    [("verdict", Asked()), ("label", Asked()), ("label", Asked(share=0.5)), ("label", Asked(at_least=0.5))],
)
def test_a_table_with_a_longer_column_is_refused(column, asked):
    """No row is left out in silence."""
    with pytest.raises(ValueError, match="longer"):
        choose(TABLE | {column: ["open"] * 6}, SETTINGS, asked)


def test_labels_are_verdicts(tmp_path):
    (tmp_path / "labels.csv").write_text("id,label\n3,good\n4,bad\n5,expert\n")
    (tmp_path / "labels.json").write_text(json.dumps({"3": "good", "4": "bad", "5": "good"}))
    for name in ("labels.csv", "labels.json"):
        table = read_verdicts(tmp_path / name)
        assert kept(table) == ["3", "5"]
        assert choose(table, SETTINGS).rejected == {"labels": ("4",)}
        with pytest.raises(DataError, match="no numbers in log_odds"):
            kept(table, share=0.5)


def test_a_table_of_one_row_and_ids_that_only_a_spreadsheet_would_change(tmp_path):
    (tmp_path / "v.json").write_text(json.dumps([{"id": "'=1", "verdict": "similar"}]))
    (tmp_path / "v.csv").write_text("id,verdict\n'=1,similar\n")
    assert read_verdicts(tmp_path / "v.json")["id"] == ["'=1"]
    assert read_verdicts(tmp_path / "v.csv")["id"] == ["=1"]


def test_the_smallest_share_of_a_table_of_several_audits_holds():
    table = table_of(["outlier"] + ["open"] * 9) | {"max_outliers": [1.0] * 5 + [0.0] + [0.2] * 4}
    assert len(kept(table)) == 10


def test_a_choice_as_lists_and_lines():
    words = ["bad"] * 25 + ["good"] * 3
    choice = choose({"id": range(28), "verdict": words}, SETTINGS)
    rejected = ", ".join(map(str, range(20)))
    assert choice.lines()[1] == f"  by inference from your answers: {rejected} and 5 more"
    assert choice.to_dict() == {"episodes": [25, 26, 27], "rejected": {"answers": [*range(25)]}, "undecided": []}
    named = choose({"id": [1, "b", 3], "verdict": ["outlier", "bad", "open"]}, SETTINGS)
    assert named.to_dict() == {"episodes": ["1", "3"], "rejected": {"answers": ["b"]}, "undecided": ["1"]}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("[]", r"cannot be read as JSON \(IndexError"),
        ("{", r"cannot be read as JSON \(JSONDecodeError"),
        ("[1]", "it must hold one object"),
        ('[{"id": 1, "verdict": "similar"}, {"id": 2}]', r"cannot be read as JSON \(KeyError: 'verdict'"),
    ],
)
def test_files_that_are_no_verdicts_are_refused(tmp_path, text, said):
    (tmp_path / "v.json").write_text(text)
    with pytest.raises(DataError, match=rf"v\.json: .*{said}"):
        read_verdicts(tmp_path / "v.json")


def test_the_sentence_counts_each_rule():
    words = ["bad", "bad", "outlier", "adversary", "good"]
    choice = choose(table_of(words, ["bad", "", "", "", ""]), SETTINGS)
    said = "1 by your labels, 1 by inference from your answers, 1 as outliers, 1 like the adversary that was named"
    assert choice.lines()[:3] == [f"Rejected: {said}.", "  by your labels: d0", "  by inference from your answers: d1"]
    assert choose(table_of(["open"]), SETTINGS).lines() == []
    assert verdict_columns(make_audit(), {})["max_outliers"] == [0.2] * 10


def test_what_was_written_to_keep_is_carried_out_by_its_rules(tmp_path):
    table = {"id": [1, 2, 3, 4], "verdict": ["bad", "good", "outlier", "open"], "label": ["bad", "", "", ""]}
    for asked in (Asked(spared={"1"}, faulty={"4"}), Asked(faulty={"2"}), Asked(spared={"1", "3", "9"})):
        choice = choose(table | {"max_outliers": [1.0] * 4}, KeepSettings(), asked)
        path = tmp_path / "keep.json"
        path.write_text(json.dumps(choice.to_dict()))
        again = choose(read_verdicts(path, table["id"]), KeepSettings())
        assert ({*again.kept}, again.rejected) == ({*choice.kept}, choice.rejected)
        assert {*choice.kept}.isdisjoint([4] if asked.faulty == {"4"} else [])
    assert 1 in choice.kept, "spared, though it is labelled bad"


@pytest.mark.parametrize(
    "content",
    ['{"rejected": {}}', '{"episodes": 3, "rejected": {}}', '{"episodes": [[1]], "rejected": {}}',
     '{"episodes": [], "rejected": {"labels": 3}}', '{"episodes": [{}], "rejected": {}}'],
)  # fmt: skip
def test_a_list_to_keep_that_is_none_is_refused(tmp_path, content):
    path = tmp_path / "keep.json"
    path.write_text(content)
    with pytest.raises(DataError, match=r"keep\.json"):
        read_verdicts(path, [1])
