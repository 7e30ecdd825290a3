"""Answers about segments: P(good) of every act, from simple columns of those that were marked.

The regression is that of demonstrations (`rpil.inference.answered`): the ranking counts beforehand, all else once
answers contrast.
"""

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

Label = tuple[int, int, int, bool]
"""The number of a demonstration, its first row, the row after the last, and whether these are good."""


def taught(
    segments: Segments, facts: Float[Array, "N F"], labels: Sequence[Label], settings: SegmentSettings
) -> Segments:
    """The same with P(good) as score, learned from the facts of each segment, where two marked segments contrast."""
    known = Answers.of_labels(marked(segments, labels))
    if not known.contrast:
        return segments
    middle = np.nanmedian(segments.score) if np.isfinite(segments.score).any() else 0.0
    score = np.nan_to_num(segments.score - middle)
    length = np.log(segments.end - segments.start)
    others = normal_scores(np.nan_to_num(np.column_stack([facts, length])))
    columns = np.column_stack([normal_scores(score[:, None]), others, np.clip(score, -2, 2)])
    found = answer(columns, known, settings.answers, np.arange(len(columns)))
    is_new = (found.verdicts < 0) & (known.labels == 0)
    reasons = [
        reason or ("is like what was marked bad" if new else "")
        for reason, new in zip(segments.reason, is_new.tolist(), strict=True)
    ]
    return replace(segments, score=expit(found.log_odds), reason=reasons)


def marked(segments: Segments, labels: Sequence[Label]) -> Int[Array, " N"]:
    """1 of the segments that share half of their rows, or of those of a label, with one that says good; -1 of bad."""
    found = np.zeros(len(segments.start), dtype=np.int64)
    for m, start, end, is_good in labels:
        shared = np.minimum(segments.end, end) - np.maximum(segments.start, start)
        least = np.minimum(segments.end - segments.start, end - start) / 2
        found[(segments.demonstration == m) & (shared > 0) & (shared >= least)] = 1 if is_good > 0 else -1
    return found
