"""Columns of numbers and text as a file of the kind that its extension names, among them the weights of an audit."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from rpil.data.files import StrPath, check_extension, replacing
from rpil.data.json_files import finite
from rpil.data.names import STEP
from rpil.data.run import RUN_KEY, run_id
from rpil.formats import csv, parquet, table
from rpil.numerics.types import Array

EXTENSIONS = (".csv", ".parquet", ".json")
_BLOCK_STEPS = 1_048_576
_WRITERS = {".parquet": parquet.write_tables, ".csv": csv.write_tables}


def write_columns(
    path: StrPath, columns: Mapping[str, Sequence[object]], what: str, said: Mapping[str, str] = {}
) -> None:
    """Write columns, with what is `said` of them in the metadata of Parquet; JSON holds a list of objects, and null for
    what is no finite number. A `DataError` where the path has another extension, or cannot be written."""
    path = check_extension(path, EXTENSIONS, what)
    if path.suffix.lower() == ".json":
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(finite(rows), allow_nan=False, indent=1) + "\n", encoding="utf-8")
        return
    _WRITERS[path.suffix.lower()](path, iter([pa.table(columns).replace_schema_metadata(dict(said))]))


def write_weights(
    path: StrPath,
    ids: Sequence[object],
    offsets: Array,
    step_weight: Array,
    expert_proba: Array,
    log_odds: Array,
    step_columns: Callable[[slice], pa.Table | None] = lambda _: None,
) -> None:
    """Write one row per step, in the order of the steps: episode_index, step_index, weight, expert_proba, log_odds.

    `expert_proba` and `log_odds` (M,) are repeated for each step of their demonstration. Numbers of the rows that the
    file itself gives, such as ``index``, come with `Recording.step_columns`. A million steps are in memory at a time:
    `step_weight` (N,) may be in a file, and larger than memory. The metadata of a Parquet file hold the
    `rpil.data.run.run_id`.

    Raises
    ------
    DataError
        Where the path ends in neither .parquet nor .csv, or cannot be written.
    """
    writer = _WRITERS[check_extension(path, _WRITERS, "weights").suffix.lower()]
    metadata = {RUN_KEY: run_id(ids, offsets, log_odds)}
    repeated = {"expert_proba": expert_proba, "log_odds": log_odds}

    def tables() -> Iterator[pa.Table]:
        cuts = np.unique(np.append(np.searchsorted(offsets, np.arange(0, offsets[-1], _BLOCK_STEPS)), len(ids)))
        for block in map(slice, cuts[:-1].tolist(), cuts[1:].tolist()):
            steps = slice(int(offsets[block.start]), int(offsets[block.stop]))
            block_offsets = offsets[block.start : block.stop + 1] - steps.start
            lengths = np.diff(block_offsets)
            names = table.step_columns(ids[block], block_offsets)
            weights = {"weight": np.asarray(step_weight[steps])} | {
                name: np.repeat(values[block], lengths) for name, values in repeated.items()
            }
            own = step_columns(steps)
            taken = {*names, *weights} - {STEP}  # the file's own step column is kept
            numbers = dict(zip(own.column_names, own.columns, strict=True)) if own else {}
            numbers = {f"file.{name}" if name in taken else name: column for name, column in numbers.items()}
            yield pa.table(names | numbers | weights, metadata=metadata)

    writer(Path(path), tables())
