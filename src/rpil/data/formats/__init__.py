"""Reading and writing `Demonstrations`: Parquet, CSV and NPZ files; ``docs/formats.md`` says what each holds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from numpy.typing import ArrayLike

from rpil.data.arrays import as_array
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.formats import csv, npz, parquet
from rpil.data.formats.id_values import Label, match_labels, read_demonstrators, read_labels
from rpil.data.formats.table import is_data
from rpil.data.formats.weights import write_weights
from rpil.data.memory import Size, limited

__all__ = ["Label", "match_labels", "read_demonstrators", "read_labels", "write_weights"]

FORMATS: dict[str, ModuleType] = {".parquet": parquet, ".csv": csv, ".npz": npz}
"""Extension -> module with `read(path)` and `write(path, demonstrations, truth)`."""


def check_format(path: StrPath) -> Path:
    """`path`, or a `DataError` naming the known extensions where it has none of them."""
    return check_extension(path, FORMATS)


def read(path: StrPath, *, memory: Size | None = None) -> Demonstrations:
    """Read demonstrations from a .parquet, .csv or .npz file.

    Parameters
    ----------
    memory : int or str, optional
        Bytes that the data may take, as a number or as text such as "4GB"; by default half of the free memory.

    Raises
    ------
    DataError
        One sentence naming the file, the demonstration where there is one, and the remedy; before anything is read
        where the data would take more memory.
    """
    path = check_readable(check_format(path))
    with limited(memory):
        demonstrations: Demonstrations = FORMATS[path.suffix.lower()].read(path)
    return demonstrations


def write(path: StrPath, demonstrations: Demonstrations, truth: Mapping[str, ArrayLike] | None = None) -> None:
    """Write demonstrations to a .parquet, .csv or .npz file, which is whole or not there.

    Parameters
    ----------
    truth : mapping of name to (M,) array, optional
        True values for each demonstration, such as whether it is good, for scoring; `read` ignores them.

    Raises
    ------
    DataError
        Where the path cannot be written, or a truth would be taken for data.
    """
    path = check_format(path)
    arrays = {}
    for name, values in (truth or {}).items():
        arrays[name] = as_array(values, f"truth {name!r}", str(path))
        if arrays[name].shape != (len(demonstrations),):
            raise DataError(f"{path}: truth {name!r} needs one value for each of {len(demonstrations)} demonstrations.")
        if is_data(name):
            raise DataError(f"{path}: truth {name!r} would be taken for data; give it another name.")
    FORMATS[path.suffix.lower()].write(path, demonstrations, arrays)
