"""The demonstrations to keep: by their verdicts, a share of the most trusted, or all from some probability on."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence, Set
from itertools import compress
from typing import cast

import numpy as np

from rpil.data.arrays import Id
from rpil.data.cells import from_cell
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.guard import guarded
from rpil.data.id_values import read_labels
from rpil.data.json_files import LARGEST_TABLE, parse, read_text
from rpil.formats.parquet_pages import read_table
from rpil.numerics.types import Array
from rpil.results.verdict_table import TABLE_EXTENSIONS
from rpil.results.words import SIDES, Side

Table = Mapping[str, Sequence[object]]

_OLD = {"uncertain": "open"}
"""A word that rpil 0.1 wrote, and what it is now."""


def kept_ids(table: Table, share: float | None = None, at_least: float | None = None) -> list[Id]:
    """The ids to keep of a table of verdicts, in its order: by default all but those called unlike, bad or adversary.

    One that is labelled bad is never kept.

    Parameters
    ----------
    table : mapping of column to M values
        As `rpil.results.verdict_table.verdict_columns` and `read_verdicts` give it.
    share : float, optional
        Keep this share of the demonstrations, in (0, 1]; those with the largest log-odds.
    at_least : float, optional
        Keep those whose probability is this or more.

    Raises
    ------
    DataError
        Where the table has no numbers to choose by, or a verdict is no word of an audit.
    """
    ids = list(cast(Sequence[Id], table["id"]))
    if at_least is not None:
        chosen = _numbers(table, "expert_proba") >= at_least
    elif share is not None:
        n_kept = max(round(share * len(ids)), 1)
        ranked = np.argsort(-_numbers(table, "log_odds"), kind="stable")
        chosen = np.isin(np.arange(len(ids)), ranked[:n_kept])
    else:
        chosen = np.array(
            [_side(verdict, name) != "lower" for name, verdict in zip(ids, table["verdict"], strict=True)]
        )
    labels = table.get("label", [""] * len(ids))
    return [name for name, kept, label in zip(ids, chosen.tolist(), labels, strict=True) if kept and label != "bad"]


def rows_of(table: Table, ids: Set[str]) -> Table:
    """The rows of a table of verdicts about the demonstrations `ids`, which are texts."""
    there = [str(name) in ids for name in table["id"]]
    return {column: list(compress(values, there)) for column, values in table.items()}


def read_verdicts(path: StrPath, ids: Iterable[object] = ()) -> Table:
    """The columns of a table of verdicts that an audit wrote, or of labels of the `ids`, which become verdicts.

    Raises
    ------
    DataError
        Where the file cannot be read as such.
    """
    path = check_readable(check_extension(path, TABLE_EXTENSIONS, "verdicts"))
    columns: dict[str, list[object]]
    with guarded(path.name, f"it cannot be read as {path.suffix[1:].upper()}", "write it again"):
        if path.suffix.lower() == ".parquet":
            columns = read_table(path).to_pydict()
        else:
            text = read_text(path, LARGEST_TABLE, "utf-8-sig")
            is_csv = path.suffix.lower() == ".csv"
            rows = list(
                csv.DictReader(io.StringIO(text, newline="")) if is_csv else parse(text, path.name, LARGEST_TABLE)
            )
            columns = {name: [row[name] for row in rows] for name in rows[0]} if isinstance(rows[0], dict) else {}
            if is_csv and "id" in columns:
                columns["id"] = [from_cell(str(name)) for name in columns["id"]]
    if {"id", "verdict"} <= {*columns}:
        return columns
    labels = read_labels(path, ids)
    return {"id": list(labels), "verdict": list(labels.values())}


def _side(verdict: object, name: Id) -> Side:
    word = _OLD.get(str(verdict), str(verdict))
    if word not in SIDES:
        raise DataError(f"Demonstration {name!r}: the verdict {word!r} is unknown; write one of {', '.join(SIDES)}.")
    return SIDES[word]


def _numbers(table: Table, column: str) -> Array:
    try:
        return np.array(cast(Sequence[float], table[column]), dtype=float)
    except (KeyError, ValueError, TypeError) as error:
        raise DataError(f"The verdicts have no numbers in {column}; give those that rpil audit wrote.") from error
