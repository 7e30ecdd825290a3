"""The identity of a run: outputs with the same run id tell of the same answer."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from rpil.numerics.types import Array

RUN_KEY = "rpil.run"
"""Key of the run id among the metadata of a Parquet file."""


def run_id(ids: Sequence[object], offsets: Array, log_odds: Array) -> str:
    """Twelve hexadecimal digits, a digest of the ids, lengths and log-odds of the M demonstrations.

    It depends on the answer and not on the time, so that the same data, options and seed give the same files.
    """
    digest = hashlib.sha256("\0".join(map(str, ids)).encode("utf-8", "surrogatepass"))
    for values in (np.asarray(offsets, np.int64), np.asarray(log_odds, np.float64)):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:12]
