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

Texts = tuple["pa.ChunkedArray", "pa.Array"]
"""The different texts of a column, and the number of that of each row."""


def texts_of(table: pa.Table, columns: Columns, decimal: str) -> dict[str, Texts]:
    """The columns of text but observations, without spaces around each text; "" as null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    found: dict[str, Texts] = {}
    for name in {*table.column_names} - {*columns.observations}:
        if flat.kind_of_type(table[name].type) == "text":
            encoded = table[name].dictionary_encode().unify_dictionaries().combine_chunks()
            texts = from_cells(pa.chunked_array([pc.utf8_trim_whitespace(encoded.dictionary)]))
            if name in columns.actions and decimal == ",":
                texts = pc.replace_substring(texts, ",", ".")
            found[name] = pc.if_else(pc.equal(texts, ""), None, texts), encoded.indices
    return found


def written_as(texts: pa.ChunkedArray, floats: bool) -> set[str]:
    """How texts are written, all together: as whole numbers that come back ("number"), that do not, as 01 and -0 do
    ("digits"), as decimals if `floats` ("decimal"), or otherwise ("text"); and whether any has more digits than a float
    ("long")."""
    import pyarrow as pa
    import pyarrow.compute as pc

    long = {"long"} if pc.any(pc.match_substring_regex(texts, r"^[+-]?\d{19,}$")).as_py() else set()
    with suppress(pa.ArrowInvalid):
        return long | {"number" if texts.cast(pa.int64()).cast(pa.string()).equals(texts) else "digits"}
    if floats:
        with suppress(pa.ArrowInvalid):
            texts.cast(pa.float64())
            return long | {"decimal"}
    return {"text"}


def exact(table: pa.Table, texts: Mapping[str, Texts], written: Mapping[str, set[str]]) -> pa.Table:
    """Columns of text as integers if that loses nothing, else as floats where there are decimals, else as text.

    `written` is how all of their texts are. Whole numbers of over 64 bits stay text, because several would become the
    same float.
    """
    import pyarrow as pa

    for name, (different, rows) in texts.items():
        kinds, kind = written[name], pa.int64()
        if kinds & {"text", "decimal", "digits"}:
            exact_floats = "decimal" in kinds and not kinds & {"text", "long"}
            kind = pa.float64() if exact_floats else pa.string()
        table = table.set_column(table.column_names.index(name), name, different.cast(kind).take(rows))
    return table
