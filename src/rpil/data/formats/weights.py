"""The weights file: the step weights of an audit, for any learner that takes weights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.files import StrPath, check_extension
from rpil.data.formats import csv, parquet
from rpil.data.formats.table import step_columns
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_WRITERS = {".parquet": parquet.write_tables, ".csv": csv.write_tables}

WRITE_STEPS = 1 << 20
"""Steps that are written at a time."""


def check_weights(path: StrPath) -> Path:
    """`path`, or a `DataError` naming the known extensions where it has none of them."""
    return check_extension(path, _WRITERS, "weights")


def write_weights(
    path: StrPath,
    ids: Sequence[object],
    offsets: Array,
    step_weight: Array,
    expert_proba: Array,
    log_odds: Array,
    block_steps: int = WRITE_STEPS,
) -> None:
    """Write one row per step, in the order of the steps: episode_index, step_index, weight, expert_proba, log_odds.

    Parameters
    ----------
    path : path ending in .parquet or .csv
    ids : (M,) ids
    offsets : (M + 1,) array
    step_weight : (N,) array
    expert_proba, log_odds : (M,) arrays
        Repeated for each step of their demonstration.
    block_steps : int
        Steps that are in memory at a time: `step_weight` may be in a file, and larger than memory.

    Raises
    ------
    DataError
        Where the path has another extension or cannot be written.
    """
    writer = _WRITERS[check_weights(path).suffix.lower()]
    import pyarrow as pa

    def tables() -> Iterator[pa.Table]:
        cuts = np.unique(np.append(np.searchsorted(offsets, np.arange(0, offsets[-1], block_steps)), len(ids)))
        for block in map(slice, cuts[:-1].tolist(), cuts[1:].tolist()):
            steps = slice(int(offsets[block.start]), int(offsets[block.stop]))
            block_offsets = offsets[block.start : block.stop + 1] - steps.start
            lengths = np.diff(block_offsets)
            columns = step_columns(ids[block], block_offsets) | {
                "weight": np.asarray(step_weight[steps]),
                "expert_proba": np.repeat(expert_proba[block], lengths),
                "log_odds": np.repeat(log_odds[block], lengths),
            }
            yield pa.table(columns)

    writer(Path(path), tables())
