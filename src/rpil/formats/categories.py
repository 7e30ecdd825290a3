"""Observations that are text: each of few values is a number, 1 where the text is this one and else 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError
from rpil.data.names import is_observation
from rpil.formats.columns import Columns
from rpil.formats.places import Places
from rpil.formats.rows import Rows
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

MAX_CATEGORIES, _ROWS_EACH, _LONGEST_CATEGORY = 20, 10, 40
"""Different texts of an observation at most, rows for each of them on average and at least, and their characters."""


def are_few(texts: pa.Array) -> bool:
    """Whether there are only so many different `texts` that each may be a category, and none of them is a sentence."""
    there = [text for text in texts[: MAX_CATEGORIES + 2].to_pylist() if text is not None]
    return 0 < len(there) <= MAX_CATEGORIES and max(map(len, there)) <= _LONGEST_CATEGORY


def find_categories(rows: Rows, columns: Columns, places: Places) -> tuple[Columns, dict[str, tuple[str, ...]]]:
    """The different texts of each observation that is text, in order, and the columns without those that have too many.

    A column that nobody calls an observation is one only where it changes within demonstrations: else it describes
    them. One that the user names stays in any case.
    """
    import pyarrow as pa

    found: dict[str, tuple[str, ...]] = {}
    for name in columns.texts:
        texts, changes = pa.array([], pa.string()), columns.observations_given or is_observation(name)
        for row, table, _ in rows.tables(0, len(rows), [name]):
            encoded = table[name].cast(pa.string()).dictionary_encode().unify_dictionaries().combine_chunks()
            texts = pa.concat_arrays([texts, encoded.dictionary]).unique()
            codes, same = encoded.indices.fill_null(-1).to_numpy(), np.ones(len(table), dtype=bool)
            same[places.begins(row, len(table))] = same[:1] = False
            changes = changes or bool((codes != np.roll(codes, 1))[same].any())
            if not are_few(texts):
                break
        if are_few(texts) and len(texts) * _ROWS_EACH <= len(rows) and changes:
            found[name] = tuple(sorted(text for text in texts.to_pylist() if text is not None))
    left = {*columns.texts} - {*found} if not columns.observations_given else set[str]()
    if left == {*columns.observations} and left and not columns.history:
        raise DataError(f"{columns.source}: no column holds observations; name them with <option>.", "observations")
    return columns.without_observations(dict.fromkeys(sorted(left), "text")), found


def indicators(texts: pa.ChunkedArray, categories: Sequence[str]) -> Array:
    """A column for each of the K `categories`, (N, K); NaN where a text is missing."""
    import pyarrow as pa
    import pyarrow.compute as pc

    codes = pc.index_in(texts.cast(pa.string()), pa.array(categories)).fill_null(len(categories)).to_numpy()
    return np.asarray(np.vstack([np.eye(len(categories)), np.full(len(categories), np.nan)])[codes])
