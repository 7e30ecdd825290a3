"""Which demonstrations are kept, and tables of verdicts read back as they were written."""

import json

import pytest

from audits import make_audit
from rpil.data.errors import DataError
from rpil.results.choice import kept_ids, read_verdicts
from rpil.results.verdict_table import verdict_columns, write_verdicts

TABLE = {
    "id": ["a", "b", "c", "d"],
    "verdict": ["typical", "unlike", "open", "typical"],
    "expert_proba": [0.99, 0.02, 0.6, 0.95],
    "log_odds": ["5", "-4", "0.4", "3"],  # as in a file of text
}


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        ({}, "acd"),
        ({"share": 0.75}, "acd"),
        ({"share": 0.01}, "a"),
        ({"share": 1}, "abcd"),
        ({"at_least": 0.6}, "acd"),
        ({"at_least": 0.991}, ""),
    ],
)
def test_choice(options, kept):
    assert kept_ids(TABLE, **options) == [*kept]


@pytest.mark.parametrize("extension", [".csv", ".parquet", ".json"])
def test_the_file_of_an_audit_says_the_same_as_the_audit(tmp_path, extension):
    audit = make_audit(ids=["a\nb", 'say "x"', "é", "01", "=1", " a", "a ", "\x85", "+5", "\u2028,"])
    path = tmp_path / f"verdicts{extension}"
    write_verdicts(path, audit, {})
    for options in ({}, {"share": 0.4}, {"at_least": 0.5}):
        expected = kept_ids(verdict_columns(audit, {}), **options)
        assert expected
        assert kept_ids(read_verdicts(path), **options) == expected


def test_words_of_the_first_version_are_read_and_unknown_ones_refused():
    table = {"id": ["a", "b", "c"], "verdict": ["expert", "adversary", "uncertain"]}
    assert kept_ids(table) == ["a", "c"]
    with pytest.raises(DataError, match="Demonstration 'b': the verdict 'perhaps' is unknown; write one of typical"):
        kept_ids(table | {"verdict": ["good", "perhaps", "bad"]})


def test_labels_are_verdicts(tmp_path):
    (tmp_path / "labels.csv").write_text("id,label\n3,good\n4,bad\n5,expert\n")
    (tmp_path / "labels.json").write_text(json.dumps({"3": "good", "4": "bad", "5": "good"}))
    for name in ("labels.csv", "labels.json"):
        table = read_verdicts(tmp_path / name)
        assert kept_ids(table) == ["3", "5"]
        with pytest.raises(DataError, match="no numbers in log_odds"):
            kept_ids(table, share=0.5)


@pytest.mark.parametrize("text", ["", "[]", "{", "[1]", '[{"id": 1, "verdict": "typical"}, {"id": 2}]'])
def test_files_that_are_no_verdicts_are_refused(tmp_path, text):
    (tmp_path / "v.json").write_text(text)
    with pytest.raises(DataError, match=r"v\.json"):
        read_verdicts(tmp_path / "v.json")
