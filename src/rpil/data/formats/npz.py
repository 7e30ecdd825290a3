"""NPZ: NumPy arrays by name, one row per step, read without ever unpickling anything."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.formats.table import ACTION, EPISODE, quoted
from rpil.data.npy import read_arrays
from rpil.numerics.types import Array

_SPELLINGS = {
    "observations": ("observations", "observation"),
    "actions": ACTION[::-1],
    "episode_ids": ("episode_ids", *EPISODE),
}
_OPTIONAL = "observation_names"


def read(path: Path) -> Demonstrations:
    """Read ``observations``, ``actions``, ``episode_ids`` and, where there, ``observation_names``; nothing else."""
    source = path.name
    damaged = f"{source}: not an NPZ file, or a damaged or truncated one; write it again."
    with path.open("rb") as file:
        if file.read(2) != b"PK" or not zipfile.is_zipfile(file):  # numpy would take it for a pickle
            raise DataError(damaged)
    try:
        with zipfile.ZipFile(path) as stored:
            found = {name.removesuffix(".npy"): name for name in stored.namelist()}
            wanted = {what: next((n for n in spellings if n in found), None) for what, spellings in _SPELLINGS.items()}
            missing = next((what for what, name in wanted.items() if name is None), None)
            if missing:
                raise DataError(
                    f"{source}: no array is called {missing!r}; save it under that name (found {quoted(found)})."
                )
            names = [name for name in (*wanted.values(), _OPTIONAL) if name in found]
            arrays = read_arrays(stored, [found[name] for name in names], source)
    except DataError:
        raise
    except Exception as error:  # a damaged file makes zipfile, zlib, tokenize and numpy raise errors of many types
        if "allow_pickle" in str(error):
            raise DataError(
                f"{source}: it holds Python objects, which are never unpickled because that can run any code; "
                "save plain arrays of numbers or text, with numpy.asarray(values.tolist()) where they are objects."
            ) from error
        raise DataError(damaged) from error
    observations, actions, ids, *named = arrays
    return Demonstrations.from_groups(
        observations, actions, ids, observation_names=named[0] if named else (), source=source
    )


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, Array]) -> None:
    """Write the arrays that `read` reads, and each `truth` (M,) under its own name."""
    arrays = {
        "observations": demonstrations.observations,
        "actions": demonstrations.actions,
        "episode_ids": np.repeat(np.array(demonstrations.ids), demonstrations.lengths),
        _OPTIONAL: np.array(demonstrations.observation_names),
    }
    with replacing(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays, **truth)
