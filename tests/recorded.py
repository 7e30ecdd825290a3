"""Demonstrations of the toy problems, and tables of them in several Parquet files."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq

from problems import make, make_continuous
from rpil.data.demonstrations import Demonstrations
from rpil.formats import table as flat


def demonstrations(continuous=False, kind="random", ids=None, single=False):
    """120 demonstrations of 20 to 60 steps, `single` with float32 observations."""
    toy = (make_continuous if continuous else make)(kind, 0, n_good=80, n_bad=40, steps=(20, 60))
    observations = toy.observations.astype(np.float32 if single else float)
    return Demonstrations(observations, toy.actions, toy.offsets, ids)


def write_files(table, folder, n_files=3, row_group=333):
    """Write the rows of `table` to several files, which may cut a demonstration."""
    folder.mkdir(parents=True, exist_ok=True)
    bounds = np.linspace(0, len(table), n_files + 1).astype(int)
    for k in range(n_files):
        rows = table.slice(bounds[k], bounds[k + 1] - bounds[k])
        pq.write_table(rows, folder / f"{k}.parquet", row_group_size=row_group)
    return folder


def written(tmp_path, **options):
    """A folder with the files of `demonstrations(**options)`."""
    return write_files(flat.from_demonstrations(demonstrations(**options), {}), tmp_path / "many")
