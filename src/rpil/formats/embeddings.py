"""Numbers of the user's own for each step, such as those of an encoder of images, as more observations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import are_whole
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.guard import guarded
from rpil.data.npy import opened_npz
from rpil.formats import table as flat
from rpil.formats.parquet_file import read_table
from rpil.formats.recording import Recording
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_INDEX = "index"


def with_embeddings(recording: Recording, path: StrPath) -> Recording:
    """The recording with the columns of a Parquet or NPZ file as more observations of each step.

    They are joined on ``index``, the number of a step; the demonstrations are read into memory. A `DataError` where
    either has no ``index``, or the file lacks a step or holds one twice.
    """
    names, index, values = _read(check_readable(check_extension(path, (".parquet", ".npz"), "embeddings")))
    description = recording.description
    text = f"{len(names):,} observations are from {Path(path).name}."
    for name in {*names}.intersection(description.observations):
        raise DataError(f"{path}: {description.source} has an observation {name!r} as well; give it another name.")

    def add(demonstrations: Demonstrations, own: pa.Table | None) -> Demonstrations:
        if own is None or _INDEX not in own.column_names:
            raise DataError(
                f"{description.source}: no column {_INDEX!r} numbers its steps; leave <option> out.", "embeddings"
            )
        steps = own[_INDEX].to_numpy()
        rows = np.minimum(np.searchsorted(index, steps), len(index) - 1)
        lost = np.flatnonzero(index[rows] != steps)
        if len(lost):
            raise DataError(f"{path}: {len(lost):,} steps are not in it, the first is {steps[lost[0]]}; add them.")
        observations = np.concatenate([demonstrations.observations, values[rows]], axis=1)
        return replace(
            demonstrations, observations=observations, observation_names=(*demonstrations.observation_names, *names)
        )

    described = replace(description, observations=(*description.observations, *names), notes=(*description.notes, text))
    return replace(recording, description=described, add=add)


def _read(path: Path) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the K columns, the index of each row (N,), in order, and the values (N, K)."""
    with guarded(path):
        if path.suffix.lower() == ".npz":
            with opened_npz(path) as stored:
                columns = {name: np.atleast_1d(array) for name, array in stored.read(stored.names).items()}
        else:
            table = read_table(path)
            wanted = [name for name in table.column_names if flat.kind_of_type(table[name].type) in ("list", "number")]
            read = {name: flat.numbers_or_missing(table[name]) for name in wanted}
            columns = {name: values for name, values in read.items() if values is not None}
            for name in read.keys() - columns.keys():
                raise DataError(f"{path}: column {name!r} needs a list of as many numbers in each row; write it again.")
        if _INDEX not in columns or len(columns) < 2:
            raise DataError(f"{path}: it needs a column 'index', and others of numbers; write them.")
        index = columns.pop(_INDEX)
        if index.size != len(index) or index.dtype.kind not in "iuf" or not are_whole(index):
            raise DataError(f"{path}: 'index' needs one whole number in each row; write it again.")
        index = index.reshape(-1).astype(np.int64)
        for name, values in columns.items():
            if len(values) != len(index):
                said = f"{name!r} has {len(values):,} rows, and 'index' has {len(index):,}"
                raise DataError(f"{path}: {said}; write one row for each step.")
        blocks = {name: np.reshape(values, (len(index), -1)) for name, values in columns.items()}
        order = np.argsort(index, kind="stable")
        index, values = index[order], np.concatenate(list(blocks.values()), axis=1)[order].astype(np.float32)
        if not len(index) or (np.diff(index) == 0).any() or not np.isfinite(values).all():
            raise DataError(f"{path}: a step is there twice, or a number is missing, or there is none; write it again.")
        return flat.part_names({name: block.shape[1] for name, block in blocks.items()}, {}), index, values
