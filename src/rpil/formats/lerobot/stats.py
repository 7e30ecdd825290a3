"""Statistics as LeRobot writes them: of numbers, and of episodes joined as LeRobot joins them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.json_files import Parsed
from rpil.data.memory import check_memory
from rpil.formats import table as flat
from rpil.formats.parquet_file import read_table
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

ColumnStatistics = Mapping[str, Parsed]
"""Lists by name: min, max, mean, std, count, and quantiles called q01 to q99."""

_MOMENTS: dict[str, Callable[..., Array]] = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}


def of_numbers(values: Array, like: Iterable[str]) -> dict[str, list[float]]:
    """Those of numbers (N, K) that are among the names `like`, and the count."""
    values = values.astype(np.float64)
    found = {name: compute(values, axis=0).tolist() for name, compute in _MOMENTS.items() if name in like}
    quantiles = [name for name in like if name[:1] == "q" and name[1:].isdigit()]
    found |= {name: np.quantile(values, int(name[1:]) / 100, axis=0).tolist() for name in quantiles}
    return found | {"count": [len(values)]}


def joined(episodes: Sequence[ColumnStatistics]) -> dict[str, Parsed]:
    """Those of episodes together, by their counts: of quantiles the mean, as LeRobot has it."""
    counts = np.array([np.ravel(one["count"])[0] for one in episodes], dtype=float)
    names = [name for name in episodes[0] if all(name in one for one in episodes)]
    by_name = {name: np.array([one[name] for one in episodes], dtype=float) for name in names if name != "count"}
    found: dict[str, Parsed] = {"count": [int(counts.sum())]}
    for name, values in by_name.items():
        if name in ("min", "max"):
            found[name] = _MOMENTS[name](values, axis=0).tolist()
        elif name == "std":
            mean = np.average(by_name["mean"], axis=0, weights=counts)
            variance = np.average(values**2 + (by_name["mean"] - mean) ** 2, axis=0, weights=counts)
            found[name] = np.sqrt(variance).tolist()
        else:
            found[name] = np.average(values, axis=0, weights=counts).tolist()
    return found


def of_data(data: Path, like: Mapping[str, ColumnStatistics]) -> dict[str, dict[str, Parsed]]:
    """Those of the columns of numbers in the Parquet files of a folder that are named in `like`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    files = sorted(data.rglob("*.parquet"))
    schema = pq.read_schema(files[0])
    names = [name for name in like if name in schema.names and flat.kind_of_type(schema.field(name).type) != "nested"]
    found: dict[str, dict[str, Parsed]] = {}
    for name in names:  # of which one is in memory
        tables: list[pa.Table] = []
        for file in files:
            tables.append(read_table(file, [name]))
            check_memory(sum(table.nbytes for table in tables), f"{data}, column {name!r}")
        found |= of_table(pa.concat_tables(tables, promote_options="permissive"), like)
    return found


def moments_of_data(data: Path, names: Collection[str]) -> dict[str, dict[str, Parsed]]:
    """Those that are no quantiles: one of the columns `names` of one file is in memory."""
    found = []
    for file in sorted(data.rglob("*.parquet")):
        of_columns = [of_table(read_table(file, [name]), {name: _MOMENTS}) for name in names]
        found.append({name: moments for one in of_columns for name, moments in one.items()})
    return {name: joined([own[name] for own in found if name in own]) for name in found[0]}


def of_table(table: pa.Table, like: Mapping[str, ColumnStatistics]) -> dict[str, dict[str, Parsed]]:
    """Those of the columns of numbers in a table."""
    read = {name: flat.numbers_or_missing(table[name]) for name in like if name in table.column_names}
    return {name: {**like[name], **of_numbers(own, like[name])} for name, own in read.items() if own is not None}


def shifted(one: ColumnStatistics, by: float) -> dict[str, Parsed]:
    """Those of the same numbers with `by` added."""
    moved = (name for name in one if name not in ("std", "count"))
    return dict(one) | {name: [value + by for value in one[name]] for name in moved}
