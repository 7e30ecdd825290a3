"""Rows of episodes whose phase is text, and of a game of three players."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

N, T = 12, 25
PHASES = np.array(["reach", "grasp", "lift"])


def episodes(**changes):
    """Rows of twelve episodes in order; the phase changes within each of them."""
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


def game(n=N, steps=20):
    """Rows of three players, step by step; the last episode is first in the file; player C acts by chance in e2."""
    rng = np.random.default_rng(3)
    rows = []
    for m in reversed(range(n)):
        for t in range(steps):
            for k, player in enumerate("ABC"):
                state = rng.normal(size=2)
                best = rng.random() if (m, player) == (2, "C") else 0.0
                move = int(state[0] + 0.3 * rng.normal() > 0) if not best else int(best > 0.5)
                rows.append({"episode": f"e{m}", "step": t, "player": player, "a0": state[0], "a1": state[1], "k": k})
                rows[-1]["action"] = ("left", "right")[move]
    table = pa.Table.from_pylist(rows)
    return table.drop_columns(["k"]).rename_columns(["episode", "step", "player", "s0", "s1", "action"])
