"""The weights file: what an audit says of each step, for any learner that takes weights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.formats import csv, parquet
from rpil.data.formats.table import step_columns

_WRITERS = {".parquet": parquet.write_tables, ".csv": csv.write_tables}

_STRETCH = 1 << 20
"""Steps that are written at a time."""


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

    def tables() -> Iterator[Any]:
        """A stretch at a time: weights may be in a file, and more than memory holds."""
        cuts = np.unique(np.append(np.searchsorted(offsets, np.arange(0, offsets[-1], _STRETCH)), len(ids)))
        for those in map(slice, cuts[:-1].tolist(), cuts[1:].tolist()):
            steps = slice(int(offsets[those.start]), int(offsets[those.stop]))
            its = offsets[those.start : those.stop + 1] - steps.start
            columns = step_columns(ids[those], its) | {
                "weight": np.asarray(step_weight[steps]),
                "expert_proba": np.repeat(expert_proba[those], np.diff(its)),
                "log_odds": np.repeat(log_odds[those], np.diff(its)),
            }
            yield pa.table(columns)

    writer(Path(path), tables())
