"""Statistics as LeRobot writes them: of numbers, and of episodes joined as LeRobot joins them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.json_files import Parsed
from rpil.data.memory import check_memory
from rpil.formats import table as flat
from rpil.formats.parquet_file import read_table
from rpil.numerics.types import Array

ColumnStatistics = Mapping[str, Parsed]
"""Lists by name: min, max, mean, std, count, and quantiles called q01 to q99."""

ByFeature = dict[str, ColumnStatistics]
"""Those of each feature."""

MOMENTS: dict[str, Callable[..., Array]] = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}


def joined(episodes: Sequence[ColumnStatistics]) -> dict[str, Parsed]:
    """Those of episodes together, by their counts: of quantiles the mean, as LeRobot has it."""
    counts = np.array([np.ravel(one["count"])[0] for one in episodes], dtype=float)
    names = [name for name in episodes[0] if name != "count" and all(name in one for one in episodes)]
    values = {name: np.array([one[name] for one in episodes], dtype=float) for name in names}

    def average(of_each: Array) -> Array:
        return np.asarray(np.average(of_each, axis=0, weights=counts))

    found = {name: (MOMENTS[name](x, axis=0) if name in ("min", "max") else average(x)) for name, x in values.items()}
    if "std" in found:
        found["std"] = np.sqrt(average(values["std"] ** 2 + (values["mean"] - found["mean"]) ** 2))
    return {"count": [int(counts.sum())], **{name: numbers.tolist() for name, numbers in found.items()}}


def of_data(data: Path, like: Mapping[str, ColumnStatistics]) -> ByFeature:
    """Those of the columns of numbers in the Parquet files of a folder that `like` names, which says what each has.

    Numbers are added in the order of the rows, as LeRobot does.
    """
    files = sorted(data.rglob("*.parquet"))
    kinds = {field.name: flat.kind_of_type(field.type) for field in pq.read_schema(files[0])}
    found: ByFeature = {}
    for name in like:  # of which one is in memory
        tables: list[pa.Table] = []
        for file in files if kinds.get(name, "nested") != "nested" else ():
            tables.append(read_table(file, [name]))
            check_memory(sum(table.nbytes for table in tables), f"{data}, column {name!r}")
        column = pa.concat_tables(tables, promote_options="permissive")[name] if tables else None
        numbers = None if column is None else flat.numbers_or_missing(column)
        if numbers is not None:
            columns = np.asarray(numbers.T, dtype=np.float64)
            own = {what: compute(columns, axis=1) for what, compute in MOMENTS.items() if what in like[name]}
            quantiles = [what for what in like[name] if what[:1] == "q" and what[1:].isdigit()]
            own |= {what: np.quantile(columns, int(what[1:]) / 100, axis=1) for what in quantiles}
            lists = {what: values.tolist() for what, values in own.items()}
            found[name] = {**like[name], **lists, "count": [len(numbers)]}
    return found


def shifted(one: ColumnStatistics, by: float) -> dict[str, Parsed]:
    """Those of the same numbers with `by` added."""
    moved = (name for name in one if name not in ("std", "count"))
    return dict(one) | {name: [value + by for value in one[name]] for name in moved}
