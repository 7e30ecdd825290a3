"""The vocabularies, and the words that audits with and without labels use."""

from audits import make_audit
from rpil.results.vocabulary import in_numbers


def test_counts_have_the_words_of_the_audit_and_those_that_occur_from_the_best_to_the_worst():
    audit = make_audit(("good", "outlier", "good", "open"))
    assert [*audit.verdict_counts().items()] == [("good", 2), ("open", 1), ("outlier", 1)]
    assert audit.verdict_counts((1,)) == {"good": 0, "open": 0, "outlier": 1}
    assert [*make_audit(("open",) * 2).verdict_counts().items()] == [("open", 2), ("outlier", 0)]
    assert [*make_audit(("good",), anchor="answers").verdict_counts()] == ["good", "open", "bad"]


def test_numbers_in_words():
    counts = {"good": 1_000, "open": 0, "outlier": 1, "adversary": 2, "expert": 2, "bad": 3}
    assert in_numbers(counts) == "1,000 good, 1 outlier, 2 adversaries, 2 experts, 3 bad"
