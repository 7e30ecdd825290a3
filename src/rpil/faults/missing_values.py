"""Values that are NaN or infinite, and the demonstrations that have none."""

from __future__ import annotations

import numpy as np

from rpil.data.arrays import Id
from rpil.data.demonstrations import Block
from rpil.faults.report import Fault
from rpil.numerics.types import Array, Bool


def set_aside(
    block: Block, ids: tuple[Id, ...], labels: tuple[str, ...]
) -> tuple[Block, Bool[Array, " M"], list[Fault]]:
    """The block without the demonstrations that have such values, a mask of those it keeps, and what the others have.

    `ids` are those of all demonstrations of the data, `labels` those of `column_labels`.
    """
    values = block.observations
    if block.actions.ndim == 2:
        values = np.concatenate([values, block.actions], axis=1)
    wrong: Array = np.logical_not(np.isfinite(values))
    lengths = np.diff(block.offsets)
    counts = np.add.reduceat(wrong.sum(axis=1), block.offsets[:-1])
    kept: Array = counts == 0
    if kept.all():
        return block, kept, []
    found = []
    for m in np.flatnonzero(~kept).tolist():
        rows = slice(int(block.offsets[m]), int(block.offsets[m + 1]))
        steps = np.flatnonzero(wrong[rows].any(axis=1))
        first, last = int(steps[0]), int(steps[-1])
        c = int(np.argmax(wrong[rows][first]))
        column = labels[c]
        sentence = f"{column} is {values[rows][first, c]} at step {first}"
        if counts[m] > 1:
            sentence += f", and {counts[m] - 1} more values up to step {last} are missing"
        name = ids[block.first + m]
        found.append(Fault("missing values", name, first, last, column, float(counts[m]), 0.0, np.inf, sentence))
    chosen, offsets = np.repeat(kept, lengths), np.append(0, np.cumsum(lengths[kept]))
    return Block(block.first, block.observations[chosen], block.actions[chosen], offsets), kept, found
