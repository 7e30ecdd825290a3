"""Who gave which demonstration: a file of its own, or a column of the data."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_readable
from rpil.data.formats.table import EPISODE, listed

_READERS = (".csv", ".json")


def read_demonstrators(where: str, data: StrPath) -> dict[str, str]:
    """Demonstrator of each demonstration, by its id as text.

    Parameters
    ----------
    where : str
        A CSV file with the columns ``id`` and ``demonstrator``, a JSON object of id to demonstrator; or else the name
        of a column, or NPZ array, of the data.
    data : path
        The file that holds the demonstrations.

    Raises
    ------
    DataError
        One sentence naming the file: nothing of that name, a demonstration with two demonstrators, an empty name.
    """
    path = Path(where)
    own = path.suffix.lower() in _READERS
    source = path.name if own else f"{Path(data).name}, {where!r}"
    try:
        pairs = _of_file(check_readable(path)) if own else _of_column(check_readable(data), where)
    except (csv.Error, json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(f"{path.name}: it cannot be read as {path.suffix[1:].upper()}; write it again.") from error
    found: dict[str, str] = {}
    for name, who in pairs:
        if not who:
            raise DataError(f"{source}, demonstration {name!r}: it has no demonstrator; name one, or leave it out.")
        if found.setdefault(name, who) != who:
            raise DataError(f"{source}, demonstration {name!r}: both {found[name]!r} and {who!r} gave it; name one.")
    if not found:
        raise DataError(f"{source}: it names no demonstrator; give at least one id and demonstrator.")
    return found


def _of_file(path: Path) -> list[tuple[str, str]]:
    text = path.read_text(encoding="utf-8-sig")
    if path.suffix.lower() == ".json":
        if not text.lstrip().startswith("{"):
            raise DataError(f'{path.name}: it must hold one object such as {{"17": "Ann"}}.')
        pairs = json.loads(text, object_pairs_hook=list)
        return [(name, _name(who, f"{path.name}, demonstration {name!r}")) for name, who in pairs]
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True, strict=True)
    header = rows.fieldnames or ()
    column = next((name for name in ("id", *EPISODE) if name in header), None)
    if column is None or "demonstrator" not in header:
        raise DataError(f"{path.name}: the columns must be id and demonstrator (found {listed(header)}).")
    found = []
    for row in rows:
        name = (row[column] or "").strip()
        if not name or None in row:
            said = "it names no demonstration" if not name else "it has more values than there are columns"
            raise DataError(f"{path.name}, line {rows.line_num}: {said}; give one id and one demonstrator.")
        found.append((name, (row["demonstrator"] or "").strip()))
    return found


def _name(who: Any, where: str) -> str:
    if not isinstance(who, str | int):
        raise DataError(f"{where}: the demonstrator is neither text nor a whole number; name one, or leave it out.")
    return str(who)


def _of_column(path: Path, name: str) -> list[tuple[str, str]]:
    """Pairs without repetition; one value for each step, or in an NPZ file for each demonstration."""
    columns = _arrays(path, name) if path.suffix.lower() == ".npz" else _columns(path, name)
    episode = next((columns[spelling] for spelling in ("episode_ids", *EPISODE) if spelling in columns), None)
    if episode is None or name not in columns:
        raise DataError(f"{path.name}: it holds no {name!r}; name a column of it, or a .csv or .json file.")
    who = columns[name]
    if len(who) != len(episode):
        episode = episode[np.sort(np.unique(episode, return_index=True)[1])]  # in order of first appearance
    if who.ndim != 1 or len(who) != len(episode):
        raise DataError(f"{path.name}: {name!r} has the shape {who.shape}; give one for each step or demonstration.")
    pairs = zip(_texts(episode), _texts(who), strict=True)
    return list(dict.fromkeys(pairs))


def _columns(path: Path, name: str) -> dict[str, NDArray[Any]]:
    import pyarrow as pa

    wanted = (*EPISODE, name)
    try:
        if path.suffix.lower() == ".parquet":
            import pyarrow.parquet as pq

            schema = pq.read_schema(path)
            table = pq.read_table(path, columns=[column for column in wanted if column in schema.names])
        else:
            from pyarrow import csv as pacsv

            with pacsv.open_csv(path) as reader:
                names = reader.schema.names
            kept = [column for column in wanted if column in names]
            options = pacsv.ConvertOptions(include_columns=kept, column_types=dict.fromkeys(kept, pa.string()))
            table = pacsv.read_csv(path, convert_options=options)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path.name}: {name!r} cannot be read from it; write it again.") from error
    return {column: table[column].to_numpy(zero_copy_only=False) for column in table.column_names}


def _arrays(path: Path, name: str) -> dict[str, NDArray[Any]]:
    with np.load(path, allow_pickle=False) as stored:  # a sound file: the demonstrations were read from it
        return {key: stored[key] for key in ("episode_ids", *EPISODE, name) if key in stored.files}


def _texts(values: NDArray[Any]) -> list[str]:
    """As ids are written: whole numbers without a decimal point."""
    if values.dtype.kind == "f" and (values == np.round(values)).all():
        values = values.astype(np.int64)
    return ["" if value is None else str(value).strip() for value in values.tolist()]
