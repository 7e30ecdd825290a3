"""One value for each of some demonstrations, by id: labels and demonstrators, in files or columns of their own."""

from __future__ import annotations

import csv
import json
import zipfile
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Literal, TypeVar, cast

import numpy as np

from rpil.data.arrays import check_text
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.formats.table import EPISODE, check_ids, quoted
from rpil.data.npy import read_arrays
from rpil.numerics.types import Array

Label = Literal["expert", "adversary"]
Key = TypeVar("Key", bound=Hashable)

_LABELS: dict[str, Label] = {"expert": "expert", "adversary": "adversary", "good": "expert", "bad": "adversary"}
_EXTENSIONS = (".csv", ".json")
_EPISODE_ARRAYS = ("episode_ids", *EPISODE)


def read_labels(path: StrPath) -> dict[str, Label]:
    """Read labels from a CSV file with the columns ``id`` and ``label``, or from a JSON object of id to label.

    ``good`` and ``bad`` are accepted for ``expert`` and ``adversary``. Ids come back as text; see `match_labels`. A
    `DataError` names the file and the demonstration: unknown words, an id labelled twice, no labels at all.
    """
    path = check_extension(path, _EXTENSIONS, "labels")
    labels: dict[str, Label] = {}
    for m, word in _read_pairs(check_readable(path), "label", "expert"):
        label = _LABELS.get(word.strip().lower()) if isinstance(word, str) else None
        if label is None:
            raise DataError(
                f"{path.name}, demonstration {m!r}: unknown label {word!r}; write 'expert' or 'adversary', "
                "and leave out the demonstrations you cannot judge."
            )
        if m in labels:
            raise DataError(f"{path.name}, demonstration {m!r}: it is labelled twice; keep one of the labels.")
        labels[m] = label
    if not labels:
        raise DataError(f"{path.name}: it labels no demonstration; give at least one id and label.")
    return labels


def match_labels(labels: Mapping[Key, str], ids: Sequence[object], source: str = "the labels") -> dict[int, bool]:
    """Number of each labelled demonstration to whether it is an expert's; ids are compared as text.

    A `DataError` where a label is neither "expert" nor "adversary", or an id is not among `ids`.
    """
    for m, label in labels.items():
        if label not in ("expert", "adversary"):
            raise DataError(f"Demonstration {m!r}: the label {label!r} is unknown; use 'expert' or 'adversary'.")
    check_ids(labels, ids, source, "the labels")
    number = {str(name): m for m, name in enumerate(ids)}
    return {number[str(name)]: label == "expert" for name, label in labels.items()}


def read_demonstrators(where: str, data: StrPath) -> dict[str, str]:
    """Demonstrator of each demonstration in the file `data`, by its id as text.

    `where` names a CSV file with the columns ``id`` and ``demonstrator``, a JSON object of id to demonstrator; or else
    a column, or NPZ array, of the data. A `DataError` names the file: nothing of that name, a demonstration with two
    demonstrators, an empty name.
    """
    path = Path(where)
    if path.suffix.lower() in _EXTENSIONS:
        source, pairs = path.name, _read_pairs(check_readable(path), "demonstrator", "Ann")
    else:
        source, pairs = f"{Path(data).name}, {where!r}", _column_pairs(check_readable(data), where)
    demonstrators: dict[str, str] = {}
    for m, value in pairs:
        place = f"{source}, demonstration {m!r}"
        if not isinstance(value, str | int):
            raise DataError(f"{place}: the demonstrator is neither text nor a whole number; name one, or leave it out.")
        name = str(value).strip()
        if not name:
            raise DataError(f"{place}: it has no demonstrator; name one, or leave it out.")
        check_text(name, "the demonstrator", place)
        if demonstrators.setdefault(m, name) != name:
            raise DataError(f"{place}: both {demonstrators[m]!r} and {name!r} gave it; name one.")
    if not demonstrators:
        raise DataError(f"{source}: it names no demonstrator; give at least one id and demonstrator.")
    return demonstrators


def _read_pairs(path: Path, column: str, example: str) -> list[tuple[str, object]]:
    """Ids and values of a CSV file with the columns ``id`` and `column`, or of a JSON object; an id may come twice."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix.lower() == ".csv":
            return _csv_pairs(text, column, path.name)
        pairs = cast(list[tuple[str, object]], json.loads(text, object_pairs_hook=list))
    except DataError:
        raise
    except (csv.Error, ValueError, RecursionError) as error:  # ValueError: of Unicode, or of numbers of 5,000 digits
        raise DataError(f"{path.name}: it cannot be read as {path.suffix[1:].upper()}; write it again.") from error
    if not text.lstrip().startswith("{"):
        raise DataError(f'{path.name}: it must hold one object such as {{"17": "{example}"}}.')
    for m, _ in pairs:
        check_text(m, "an id", path.name)
    return pairs


def _csv_pairs(text: str, column: str, source: str) -> list[tuple[str, object]]:
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True, strict=True)
    header = rows.fieldnames or ()
    id_column = next((name for name in ("id", *EPISODE) if name in header), None)
    if id_column is None or column not in header:
        raise DataError(f"{source}: the columns must be id and {column} (found {quoted(header)}).")
    pairs: list[tuple[str, object]] = []
    for row in rows:
        m = (row[id_column] or "").strip()
        if not m or None in row:
            problem = "it names no demonstration" if not m else "it has more values than there are columns"
            raise DataError(f"{source}, line {rows.line_num}: {problem}; give one id and one {column}.")
        pairs.append((m, row[column] or ""))
    return pairs


def _column_pairs(path: Path, name: str) -> list[tuple[str, object]]:
    """Distinct pairs of id and value; a column has one value for each step, an NPZ array one for each demonstration."""
    columns = (_npz_columns if path.suffix.lower() == ".npz" else _table_columns)(path, (*_EPISODE_ARRAYS, name))
    episode = next((columns[spelling] for spelling in _EPISODE_ARRAYS if spelling in columns), None)
    if episode is None or name not in columns:
        raise DataError(f"{path.name}: it holds no {name!r}; name a column of it, or a .csv or .json file.")
    values = columns[name]
    if len(values) != len(episode):
        episode = episode[np.sort(np.unique(episode, return_index=True)[1])]  # in order of first appearance
    if values.ndim != 1 or len(values) != len(episode):
        raise DataError(f"{path.name}: {name!r} has the shape {values.shape}; give one for each step or demonstration.")
    return list(dict.fromkeys(zip(_as_text(episode), _as_text(values), strict=True)))


def _table_columns(path: Path, names: Sequence[str]) -> dict[str, Array]:
    """Those of the columns `names` that a Parquet or CSV file has."""
    import pyarrow as pa

    try:
        if path.suffix.lower() == ".parquet":
            import pyarrow.parquet as pq

            table = pq.read_table(path, columns=[name for name in pq.read_schema(path).names if name in names])
        else:
            from pyarrow import csv as pacsv

            with pacsv.open_csv(path) as reader:
                present = [name for name in reader.schema.names if name in names]
            options = pacsv.ConvertOptions(include_columns=present, column_types=dict.fromkeys(present, pa.string()))
            table = pacsv.read_csv(path, convert_options=options)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path.name}: {names[-1]!r} cannot be read from it; write it again.") from error
    return {column: table[column].to_numpy(zero_copy_only=False) for column in table.column_names}


def _npz_columns(path: Path, names: Sequence[str]) -> dict[str, Array]:
    with zipfile.ZipFile(path) as stored:  # an intact file: the demonstrations were read from it
        found = [name for name in names if f"{name}.npy" in stored.namelist()]
        return dict(zip(found, read_arrays(stored, [f"{name}.npy" for name in found], path.name), strict=True))


def _as_text(values: Array) -> list[str]:
    """As ids are written: whole numbers without a decimal point."""
    if values.dtype.kind == "f" and (values == np.round(values)).all():
        values = values.astype(np.int64)
    return ["" if value is None else str(value).strip() for value in values.tolist()]
