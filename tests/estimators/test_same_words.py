"""The same data with other names of columns, in other files or in another order: the same words about the same ones."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil

KINDS = ("discrete", "continuous", "text")
NAMES = {"time_s": "Zeit", "x": "shoulder", "v": "b", "w": "A"}
STARTED = 1.7e9


def world(seed: int, n: int = 14) -> pa.Table:
    """Demonstrations of which the last ones are bad; from every second seed on the time says when they were made."""
    rng, kind = np.random.default_rng([56, seed]), KINDS[seed % 3]
    lengths = rng.integers(30, 60, size=n)
    owner, step = np.repeat(np.arange(n), lengths), np.concatenate([np.arange(length) for length in lengths])
    n_bad = round(n * (0, 0.2, 0.35, 0.5)[seed // 4 % 4])
    seen = np.cumsum(rng.normal(scale=0.3, size=(len(owner), 3)), axis=0) % 4 - 2
    wanted = seen @ rng.normal(size=(3, 2)) + 0.1 * rng.normal(size=(len(owner), 2))
    wanted[owner >= n - n_bad] = rng.normal(scale=wanted.std(axis=0), size=(len(owner), 2))[owner >= n - n_bad]
    side = (wanted[:, 0] > 0).astype(int)
    actions = {
        "discrete": {"action": side + (wanted[:, 1] > 0)},
        "continuous": {"action.0": wanted[:, 0], "action.1": wanted[:, 1]},
        "text": {"action": np.array(["left", "right"])[side]},
    }[kind]
    begins = STARTED + 100.0 * np.arange(n)[owner] if seed % 2 else 0.0
    columns = {"episode": owner, "time_s": begins + 0.05 * step, **dict(zip("xvw", seen.T, strict=True))}
    return pa.table(columns | actions)


def said(path):
    """The finding, the word about each demonstration, and the doubts."""
    audit = rpil.audit(path)
    return audit.finding, dict(zip(map(str, audit.ids), audit.verdicts, strict=True)), audit.doubts


def variants(table: pa.Table, folder, seed: int):
    """Names of variants, and what to audit."""
    rng = np.random.default_rng(seed)
    owner, names = table["episode"].to_numpy(), table.column_names

    def write(name, changed):
        path = folder / f"{name}.parquet"
        pq.write_table(changed, path)
        return path

    yield "as it was", write("plain", table)
    for time in ("utc", "Zeit", "foo"):
        other = NAMES | {"time_s": time}
        yield f"time called {time}", write(time, table.rename_columns([other.get(name, name) for name in names]))
    yield "columns in another order", write("columns", table.select(rng.permutation(names).tolist()))
    rows = np.concatenate([np.flatnonzero(owner == m) for m in rng.permutation(owner[-1] + 1)])
    yield "demonstrations in another order", write("order", table.take(rows))
    split = folder / "split"
    split.mkdir()
    for m in range(owner[-1] + 1):
        pq.write_table(table.filter(owner == m), split / f"f{m:03}.parquet")
    yield "a file each", split
    halves = folder / "halves"
    halves.mkdir()
    for k, some in enumerate((owner < 7, owner >= 7)):
        pq.write_table(table.filter(some), halves / f"part{k}.parquet")
    yield "two files", halves


@pytest.mark.parametrize("seed", [6, 7])  # discrete and continuous, with and without times, and some bad ones
def test_names_files_and_order_change_no_word(seed, tmp_path):
    found = {name: said(path) for name, path in variants(world(seed), tmp_path, seed)}
    assert {name: one for name, one in found.items() if one != found["as it was"]} == {}
