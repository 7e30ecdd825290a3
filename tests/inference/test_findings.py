"""The table of findings."""

from typing import get_args

from rpil.inference.findings import DECIDED, FINDINGS, Finding


def test_each_finding_is_explained_in_one_sentence_that_accuses_nobody():
    assert set(get_args(Finding)) == FINDINGS.keys()
    assert set(DECIDED) < FINDINGS.keys()
    for finding, sentence in FINDINGS.items():
        assert sentence.endswith(".")
        assert sentence.count(". ") == 0
        assert "adversar" not in sentence or finding == "mixture"
