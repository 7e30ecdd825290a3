"""Data sets on disk as worlds: NPZ files with `observations`, `actions` and `episode_ids` for every step.

For every demonstration, in ascending order of its id, there may be `is_good` (1 good, 0 bad, -1 in between) and
`episode_quality` (higher is better). All else is left alone. A JSON file of the same name may say the `family`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from trust_worlds import FAMILIES, Cell, World

FAMILY_OF = {
    "human_": "people",
    "overcooked": "overcooked",
    "tictactoe": "games",
    "rat_": "animals",
    "rilco_": "control agents",
    "vild_": "control agents",
    "metaworld_": "robot arms",
}
"""What names begin with; all else is "other"."""

OTHER = "other"
REAL = (*dict.fromkeys(FAMILY_OF.values()), OTHER)

STEPS = ("observations", "actions", "episode_ids")
Array = NDArray[Any]


def data_cells(folder: Path) -> tuple[dict[str, Cell], list[str]]:
    """The data sets of a folder that can be scored, by name, and a sentence for each that cannot."""
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise DataError(f"{folder.name}: there are no NPZ files; give the folder that holds them.")
    found, skipped = {}, []
    for path in paths:
        try:
            is_good = read(path).is_good
        except DataError as error:
            skipped.append(str(error))
            continue
        if {0, 1} <= set(is_good.tolist()):
            found[path.stem] = Cell(path.stem, family_of(path), read, (path,))
        else:
            skipped.append(f"{path.name}: `is_good` does not name both good and bad demonstrations; it is left out.")
    return found, skipped


def family_of(path: Path) -> str:
    """What the JSON beside a file says, else by the file's name."""
    beside = path.with_suffix(".json")
    try:
        described = json.loads(beside.read_text(encoding="utf-8")) if beside.exists() else {}
    except ValueError:
        raise DataError(f"{beside.name}: it is not JSON; mend it or take it away.") from None
    if isinstance(described, dict) and described.get("family"):
        if described["family"] in FAMILIES:
            raise DataError(
                f"{beside.name}: the family {described['family']!r} is that of generated worlds; name another."
            )
        return str(described["family"])
    return next((family for start, family in FAMILY_OF.items() if path.name.startswith(start)), OTHER)


def read(path: Path) -> World:
    """The demonstrations of a file; those without a truth are in between."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            held = {name: stored[name] for name in (*STEPS, "is_good", "episode_quality") if name in stored.files}
    except (OSError, ValueError, EOFError, BadZipFile):
        raise DataError(f"{path.name}: it cannot be read as an NPZ file of plain arrays; it is left out.") from None
    for name in STEPS:
        if name not in held:
            raise DataError(f"{path.name}: no array is called {name!r}; it is left out.")
    ids, index = np.unique(held["episode_ids"], return_inverse=True)
    order = np.argsort(index, kind="stable")
    return World(
        path.stem,
        family_of(path),
        held["observations"][order],
        held["actions"][order],
        index[order],
        per_demonstration(path, held, "is_good", np.full(len(ids), -1)).astype(int),
        per_demonstration(path, held, "episode_quality", None),
    )


def per_demonstration(path: Path, held: dict[str, Array], name: str, missing: Any) -> Any:
    """One number for each demonstration, or `missing`."""
    size = len(np.unique(held["episode_ids"]))
    found = held.get(name, missing)
    if found is not None and np.shape(found) != (size,):
        raise DataError(f"{path.name}: {name!r} has shape {np.shape(found)} for {size} demonstrations; it is left out.")
    return found
