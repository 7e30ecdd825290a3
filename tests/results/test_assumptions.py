"""The sentences about the assumptions."""

from __future__ import annotations

from itertools import product

from audits import make_audit
from rpil.inference.findings import FINDINGS
from rpil.results import summary as assumptions
from rpil.results.answering import NOT_USED
from rpil.results.vocabulary import VOCABULARIES


def test_sentences_begin_with_the_finding_and_the_meaning_of_the_probability():
    for finding, anchor in product(FINDINGS, VOCABULARIES):
        sentences = assumptions.assumption_sentences(make_audit(finding=finding, anchor=anchor))
        assert sentences[:2] == (FINDINGS[finding], VOCABULARIES[anchor].explanation)
        assert len(sentences) == 3 + (anchor == "named adversary")
        assert all(sentence.endswith(".") for sentence in sentences)


def test_answers_and_doubts_are_told_in_the_place_of_what_was_not_used():
    audit = make_audit(
        anchor="answers", labels={0: 1, 1: -1}, doubts=("One part says most.",), notes=("Part 3 rests.",)
    )
    sentences = assumptions.assumption_sentences(audit)
    assert {"One part says most.", "Part 3 rests."} <= set(sentences)
    assert "P(good) is learned from 2 labels, each of which may be wrong." in sentences
    assert NOT_USED not in sentences
    assert NOT_USED in assumptions.assumption_sentences(make_audit())
