"""Answers about segments: P(good) of every one, by the regression of demonstrations (`rpil.inference.answered`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from rpil.inference.answered import answer
from rpil.inference.answers import Answers
from rpil.inference.channels import normal_scores
from rpil.numerics.types import Array, Float, Int
from rpil.segments.kinds import Segments
from rpil.segments.settings import SegmentSettings

MarkedRows = tuple[int, int, int, bool]
"""The number of a demonstration, its first row, the row after the last, and whether these are good."""


def taught(
    segments: Segments, facts: Float[Array, "N F"], labels: Sequence[MarkedRows], settings: SegmentSettings
) -> Segments:
    """The same with P(good) as score, learned from the score and `facts`, where one label is good and one bad."""
    known = Answers.of_labels(marked(segments, labels))
    if not known.contrast:
        return segments
    score = np.nan_to_num(segments.score)
    columns = np.column_stack([normal_scores(np.column_stack([score, np.nan_to_num(facts)])), np.clip(score, -2, 2)])
    found = answer(columns, known, settings.answers, np.arange(len(columns)))
    is_new = ((found.verdicts < 0) & (known.labels == 0)).tolist()
    like = ["is like what was marked bad" if new else "" for new in is_new]
    reasons = [reason or other for reason, other in zip(segments.reason, like, strict=True)]
    return replace(segments, score=expit(found.log_odds), reason=reasons)


def marked(segments: Segments, labels: Sequence[MarkedRows]) -> Int[Array, " N"]:
    """1 of the segments that share half of their rows, or of those of a label, with one that says good; -1 of bad."""
    found = np.zeros(len(segments.start), dtype=np.int64)
    for m, start, end, is_good in labels:
        shared = np.minimum(segments.end, end) - np.maximum(segments.start, start)
        least = np.minimum(segments.end - segments.start, end - start) / 2
        found[(segments.demonstration == m) & (shared > 0) & (shared >= least)] = 1 if is_good else -1
    return found
