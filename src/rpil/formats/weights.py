"""The weights file: what an audit says of each step, for any learner that takes weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.errors import DataError
from rpil.files import StrPath
from rpil.formats import csv, parquet
from rpil.formats.table import step_columns

_WRITERS = {".parquet": parquet.write_table, ".csv": csv.write_table}


def check_weights(path: StrPath) -> Path:
    """`path`, or a `DataError` naming the known extensions where it has none of them."""
    path = Path(path)
    if path.suffix.lower() not in _WRITERS:
        raise DataError(f"{path}: unknown extension {path.suffix!r} for weights; use one of {', '.join(_WRITERS)}.")
    return path


def write_weights(
    path: StrPath,
    ids: Sequence[Any],
    offsets: NDArray[np.int64],
    step_weight: NDArray[Any],
    expert_proba: NDArray[Any],
    log_odds: NDArray[Any],
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

    Raises
    ------
    DataError
        Where the path has another extension or cannot be written.
    """
    writer = _WRITERS[check_weights(path).suffix.lower()]
    import pyarrow as pa

    lengths = np.diff(offsets)
    table = step_columns(ids, offsets) | {
        "weight": np.asarray(step_weight),
        "expert_proba": np.repeat(expert_proba, lengths),
        "log_odds": np.repeat(log_odds, lengths),
    }
    writer(Path(path), pa.table(table))
