"""Columns of numbers and text as a file of the kind that its extension names."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from rpil.data.files import StrPath, check_extension, replacing
from rpil.formats import csv, parquet

EXTENSIONS = (".csv", ".parquet", ".json")


def write_columns(
    path: StrPath, columns: Mapping[str, Sequence[object]], what: str, said: Mapping[str, str] = {}
) -> None:
    """Write columns, with what is `said` of them in the metadata of Parquet; JSON holds a list of objects, and null for
    what is no finite number. A `DataError` where the path has another extension, or cannot be written."""
    path = check_extension(path, EXTENSIONS, what)
    if path.suffix.lower() == ".json":
        rows = [dict(zip(columns, map(_finite, row), strict=True)) for row in zip(*columns.values(), strict=True)]
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(rows, allow_nan=False, indent=1) + "\n", encoding="utf-8")
        return
    import pyarrow as pa

    writer = csv if path.suffix.lower() == ".csv" else parquet
    writer.write_tables(path, iter([pa.table(columns).replace_schema_metadata(dict(said))]))


def _finite(value: object) -> object:
    return value if not isinstance(value, float) or math.isfinite(value) else None
