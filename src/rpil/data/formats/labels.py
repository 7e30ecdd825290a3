"""The labels file: which demonstrations a person has judged, and how."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_readable
from rpil.data.formats.table import EPISODE, check_ids, listed

Label = Literal["expert", "adversary"]

_WORDS: dict[str, Label] = {"expert": "expert", "adversary": "adversary", "good": "expert", "bad": "adversary"}
_READERS = (".csv", ".json")


def read_labels(path: StrPath) -> dict[str, Label]:
    """Read labels from a CSV file with the columns ``id`` and ``label``, or from a JSON object of id to label.

    ``good`` and ``bad`` are accepted for ``expert`` and ``adversary``. Ids come back as text; see `match_labels`.

    Raises
    ------
    DataError
        One sentence naming the file and the demonstration: unknown words, an id labelled twice, no labels at all.
    """
    path = Path(path)
    if path.suffix.lower() not in _READERS:
        raise DataError(f"{path}: unknown extension {path.suffix!r} for labels; use one of {', '.join(_READERS)}.")
    check_readable(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        pairs = _csv_pairs(text, path.name) if path.suffix.lower() == ".csv" else _json_pairs(text, path.name)
    except (csv.Error, json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(f"{path.name}: it cannot be read as {path.suffix[1:].upper()}; write it again.") from error
    labels: dict[str, Label] = {}
    for name, word in pairs:
        label = _WORDS.get(word.strip().lower()) if isinstance(word, str) else None
        if label is None:
            raise DataError(
                f"{path.name}, demonstration {name!r}: unknown label {word!r}; write 'expert' or 'adversary', "
                "and leave out the demonstrations you cannot judge."
            )
        if name in labels:
            raise DataError(f"{path.name}, demonstration {name!r}: it is labelled twice; keep one of the labels.")
        labels[name] = label
    if not labels:
        raise DataError(f"{path.name}: it labels no demonstration; give at least one id and label.")
    return labels


def match_labels(labels: Mapping[str, Label], ids: Sequence[Any], source: str = "the labels") -> dict[int, bool]:
    """Index of each labelled demonstration to whether it is an expert's; ids are compared as text.

    Raises
    ------
    DataError
        Where a label is for an id that is not among `ids`.
    """
    check_ids(labels, ids, source, "the labels")
    index = {str(name): m for m, name in enumerate(ids)}
    return {index[name]: label == "expert" for name, label in labels.items()}


def match_given(labels: Mapping[Any, str], ids: Sequence[Any]) -> dict[int, bool]:
    """`match_labels` of what a caller wrote rather than a file.

    Raises
    ------
    DataError
        Where a label is neither "expert" nor "adversary", or for an unknown id.
    """
    for name, word in labels.items():
        if word not in ("expert", "adversary"):
            raise DataError(f"Demonstration {name!r}: the label {word!r} is unknown; use 'expert' or 'adversary'.")
    return match_labels({str(k): v for k, v in labels.items()}, ids)  # type: ignore[misc]


def _csv_pairs(text: str, source: str) -> Iterable[tuple[str, Any]]:
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True, strict=True)
    header = rows.fieldnames or ()
    column = next((name for name in ("id", *EPISODE) if name in header), None)
    if column is None or "label" not in header:
        raise DataError(f"{source}: the columns must be id and label (found {listed(header)}).")
    return [((row[column] or "").strip(), row["label"]) for row in rows]


def _json_pairs(text: str, source: str) -> Iterable[tuple[str, Any]]:
    # Pairs, not a dict, so that an id labelled twice is seen.
    pairs = json.loads(text, object_pairs_hook=list)
    if not text.lstrip().startswith("{"):
        raise DataError(f'{source}: it must hold one object such as {{"17": "expert"}}.')
    return pairs
