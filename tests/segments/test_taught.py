"""Marked segments: which they are, and what the others learn from them."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.segments.find import SegmentSettings, find_segments, marked, taught
from rpil.segments.ranges import Segments
from worlds.tidying import tidied


def segments(n=40):
    start = np.tile([0, 10], n // 2)
    score = np.linspace(-2.0, 2.0, n)
    return Segments(np.arange(n) // 2, start, start + 10, np.zeros(n, dtype=np.int8), score, [""] * n)


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ((0, 0, 10, True), [1, 0]),
        ((0, 0, 10, False), [-1, 0]),
        ((0, 2, 20, True), [1, 1]),
        ((0, 12, 14, False), [0, -1]),
        ((0, 6, 13, True), [1, 0]),
        ((0, 5, 15, True), [1, 1]),
        ((0, 3, 4, True), [1, 0]),
        ((1, 0, 10, True), [0, 0]),
    ],
)
def test_a_label_marks_what_it_shares_half_with(label, expected):
    assert marked(segments(), [label])[:2].tolist() == expected


def test_one_side_changes_nothing_and_two_labels_make_probabilities():
    made = segments()
    assert taught(made, np.zeros((40, 1)), [(0, 0, 10, True), (3, 0, 10, True)], SegmentSettings()) is made
    found = taught(made, np.zeros((40, 1)), [(0, 0, 10, False), (19, 10, 20, True)], SegmentSettings())
    assert ((found.score > 0) & (found.score < 1)).all()
    assert np.array_equal(np.argsort(found.score), np.argsort(made.score))


def test_labels_are_learned_from_facts_that_the_ranking_lacks():
    made, rng = segments(160), np.random.default_rng(0)
    fact = rng.permutation(np.arange(160.0))
    labels = [(k // 2, 10 * (k % 2), 10 * (k % 2) + 10, bool(fact[k] > 80)) for k in range(80)]
    found = taught(made, fact[:, None], labels, SegmentSettings())
    assert np.corrcoef(found.score[80:], fact[80:] > 80)[0, 1] > 0.75
    assert np.abs(np.corrcoef(made.score[80:], fact[80:] > 80)[0, 1]) < 0.3
    said = np.array([reason == "is like what was marked bad" for reason in found.reason])
    assert said.any()
    assert (fact[said] <= 80).all()
    assert not said[:80].any()


def test_step_scores_are_a_fact():
    made = tidied("nobody", 20, 0).demonstrations
    plain = find_segments(made)
    first = made.offsets[plain.demonstration] + plain.start
    bad = np.random.default_rng(0).random(len(first)) < 0.5
    ratio = np.repeat(np.where(bad, -1.0, 1.0), plain.end - plain.start)
    told = [
        (int(m), int(a), int(b), not is_bad)
        for m, a, b, is_bad in zip(plain.demonstration, plain.start, plain.end, bad, strict=True)
    ]
    found = find_segments(made, ratio, labels=told[:20])
    assert len(first) == len(found.score)
    below = found.score[20:][bad[20:], None] < found.score[20:][~bad[20:]]
    assert below.mean() > 0.9  # of pairs of a bad and a good one
