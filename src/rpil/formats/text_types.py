"""Types of columns of text whose texts say more than numbers do: ids, single actions, operators and tasks."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

from rpil.data.cells import from_cells
from rpil.formats import table as flat
from rpil.formats.columns import Columns

if TYPE_CHECKING:
    import pyarrow as pa


def exact(table: pa.Table, columns: Columns, decimal: str, types: Mapping[str, pa.DataType]) -> pa.Table:
    """Ids, single actions, operators and tasks by the `types` that `exact_type` gives for all of their texts."""
    for name, column in texts_of(table, columns, decimal).items():
        table = table.set_column(table.column_names.index(name), name, column.cast(types[name]))
    return table


def texts_of(table: pa.Table, columns: Columns, decimal: str) -> dict[str, pa.ChunkedArray]:
    """The columns of text but observations, without spaces around; "" as null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    found, observations = {}, {*columns.observations}
    for name in table.column_names:
        if name not in observations and flat.kind_of_type(table[name].type) == "text":
            column = from_cells(pc.utf8_trim_whitespace(table[name].cast(pa.string())))
            if name in columns.actions and decimal == ",":
                column = pc.replace_substring(column, ",", ".")
            found[name] = pc.if_else(pc.equal(column, ""), None, column)
    return found


def written_as(column: pa.ChunkedArray, floats: bool) -> set[str]:
    """How the texts of a column are written, all together: as whole numbers that come back ("number"), that do not, as
    01 and -0 do ("digits"), as decimals if `floats` ("decimal"), or otherwise ("text"); and whether any has more digits
    than a float ("long")."""
    import pyarrow as pa

    with suppress(pa.ArrowInvalid):
        return {"number" if column.cast(pa.int64()).cast(pa.string()).equals(column) else "digits", *_long(column)}
    if floats:
        with suppress(pa.ArrowInvalid):
            column.cast(pa.float64())
            return {"decimal", *_long(column)}
    return {"text"}


def _long(column: pa.ChunkedArray) -> tuple[str, ...]:
    import pyarrow.compute as pc

    return ("long",) if pc.any(pc.match_substring_regex(column, r"^[+-]?\d{19,}$")).as_py() else ()


def exact_type(written: set[str]) -> pa.DataType:
    """Integers if that loses nothing, else floats where there are decimals, else text.

    Whole numbers of over 64 bits stay text, because several would become the same float.
    """
    import pyarrow as pa

    if "text" in written or {"decimal", "long"} <= written:
        return pa.string()
    return pa.float64() if "decimal" in written else pa.string() if "digits" in written else pa.int64()
