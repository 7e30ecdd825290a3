"""Answers about segments: P(good) of every act, from simple columns of those that were marked.

The regression is that of demonstrations (`rpil.inference.answered`): the ranking counts beforehand, all else once answers
contrast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from rpil.inference.answered import answer
from rpil.inference.answers import Answers
from rpil.inference.channels import columns_of, components
from rpil.inference.settings import AnswerSettings, ChannelSettings
from rpil.numerics.types import Array, Float, Int
from rpil.segments.table import Segments

Label = tuple[int, int, int, bool]
"""The number of a demonstration, its first row, the row after the last, and whether these are good."""


def taught(
    segments: Segments,
    moved: Float[Array, "N C"],
    left: Float[Array, " N"],
    step_scores: Float[Array, " T"],
    offsets: Int[Array, " _"],
    labels: Sequence[Label],
) -> Segments:
    """The same with P(good) as score, where two marked segments contrast."""
    known = Answers.of_labels(marked(segments, labels))
    if not known.contrast:
        return segments
    first, last = (offsets[segments.demonstration] + row for row in (segments.start, segments.end))
    total = np.append(0.0, np.cumsum(step_scores))
    length, place = last - first, segments.start / np.diff(offsets)[segments.demonstration]
    facts = [segments.score, -left, (total[last] - total[first]) / length, -np.log(length), place]
    summaries = np.column_stack([moved, np.abs(moved), left, place])
    columns = columns_of(
        np.column_stack(facts), components(summaries, ChannelSettings()), segments.score, AnswerSettings()
    )
    found = answer(columns, known, AnswerSettings(), np.arange(len(columns)))
    bad = (found.verdicts < 0) & (known.labels == 0)
    reasons = [
        "is like what was marked bad" if is_bad and not reason else reason
        for is_bad, reason in zip(bad.tolist(), segments.reason, strict=True)
    ]
    return replace(segments, score=expit(found.log_odds), reason=reasons)


def marked(segments: Segments, labels: Sequence[Label]) -> Int[Array, " N"]:
    """1 of a segment of which a label that says good holds half the rows, or that holds half of such a label; -1 of bad."""
    found = np.zeros(len(segments.start), dtype=np.int64)
    for m, start, end, is_good in labels:
        shared = np.minimum(segments.end, end) - np.maximum(segments.start, start)
        least = np.minimum(segments.end - segments.start, end - start) / 2
        found[(segments.demonstration == m) & (shared > 0) & (shared >= least)] = 1 if is_good else -1
    return found
