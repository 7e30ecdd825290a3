"""The vocabularies, and the words that audits with and without labels use."""

from __future__ import annotations

import pytest

from audits import make_audit
from rpil.results.vocabulary import SIDES, VOCABULARIES


@pytest.mark.parametrize("anchor", VOCABULARIES)
def test_each_vocabulary_names_its_probability_in_one_sentence(anchor):
    words = VOCABULARIES[anchor]
    assert words.probability == f"P({words.upper})"
    assert words.explanation.startswith(f"{words.probability} is the probability")
    assert words.explanation.endswith(".")
    assert words.explanation.count(". ") == 0
    assert [SIDES[word] for word in (words.upper, "open", words.lower)] == ["upper", "open", "lower"]


def test_words_change_at_the_thresholds():
    words = VOCABULARIES["none"]
    assert [words.verdict(p, 0.9) for p in (0.9, 0.899, 0.101, 0.099)] == ["similar", "open", "open", "outlier"]


def test_counts_have_the_words_of_the_audit_and_those_that_occur():
    audit = make_audit(("good", "good", "similar", "outlier"))
    assert audit.verdict_counts() == {"similar": 1, "good": 2, "open": 0, "outlier": 1}
    assert audit.verdict_counts((3,)) == {"similar": 0, "good": 0, "open": 0, "outlier": 1}


def test_experience_is_said_where_probabilities_are_graded():
    for words in VOCABULARIES.values():
        assert words.meaning([0.5, 0.6]) == " ".join(filter(None, (words.explanation, words.experience)))
        assert words.meaning([0.5, 0.5]) == words.explanation
