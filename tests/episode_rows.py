"""Rows of episodes, and files of them."""

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

N, T = 12, 25
PHASES = np.array(["reach", "grasp", "lift"])


def episodes(**changes):
    """Rows of twelve episodes in order; their phase, a text, is not read."""
    rng = np.random.default_rng(0)
    step = np.tile(np.arange(T), N)
    columns = {
        "episode": np.repeat([f"e{m}" for m in range(N)], T),
        "step": step,
        "time_s": step * 0.1,
        "phase": PHASES[step // 5 % 3],
        "x": rng.normal(size=N * T),
        "action": rng.normal(size=N * T),
    }
    return pa.table({name: column for name, column in (columns | changes).items() if column is not None})


def written(table, suffix, folder):
    path = folder / f"a.{suffix}"
    if suffix == "folder":
        path.mkdir()
        pq.write_table(table, path / "a.parquet")
    else:
        (pa.csv.write_csv if suffix == "csv" else pq.write_table)(table, path)
    return path
