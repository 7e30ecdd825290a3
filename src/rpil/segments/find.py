"""Segments of demonstrations."""

from __future__ import annotations

import numpy as np

from rpil.segments.idle import idle_rows
from rpil.segments.table import KINDS, Segments


def find_segments(demonstrations, step_scores=None, takeover=None, labels=(), rng=None, settings=None):
    """A stub: idle and takeover segments alone."""
    offsets = demonstrations.offsets
    kind = np.zeros(demonstrations.n_steps, dtype=np.int8)
    kind[idle_rows(demonstrations)] = KINDS.index("idle")
    if takeover is not None:
        kind[takeover > 0] = KINDS.index("takeover")
    cut = np.append(True, kind[1:] != kind[:-1])
    cut[offsets[:-1]] = True
    start = np.flatnonzero(cut)
    m = np.searchsorted(offsets, start, side="right") - 1
    end = np.append(start[1:], len(kind))
    return Segments(m, start - offsets[m], end - offsets[m], kind[start], np.full(len(m), np.nan), [""] * len(m))
