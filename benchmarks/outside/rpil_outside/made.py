"""Lay episodes end to end in a shuffled order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpil import Demonstrations
from rpil_outside.world import Made


def laid_out(
    episodes: Sequence[tuple[np.ndarray, np.ndarray]],
    good: np.ndarray,
    success: np.ndarray | None,
    good_steps: Sequence[np.ndarray] | None,
    rng: np.random.Generator,
) -> Made:
    """Return the episodes, observations and actions of each, in an order that `rng` draws."""
    order = rng.permutation(len(episodes))
    rows, acts = zip(*(episodes[m] for m in order), strict=True)
    offsets = np.append(0, np.cumsum([len(each) for each in rows]))
    return Made(
        Demonstrations(np.concatenate(rows), np.concatenate(acts), offsets),
        np.asarray(good, dtype=bool)[order],
        None if success is None else np.asarray(success)[order].astype(int),
        None if good_steps is None else np.concatenate([good_steps[m] for m in order]),
    )
