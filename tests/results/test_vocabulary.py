"""The words of an audit."""

from rpil.results.vocabulary import in_numbers


def test_numbers_in_words():
    counts = {"good": 1_000, "open": 0, "outlier": 1, "adversary": 2, "expert": 2, "bad": 3}
    assert in_numbers(counts) == "1,000 good, 1 outlier, 2 adversaries, 2 experts, 3 bad"
