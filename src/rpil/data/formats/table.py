"""The table of Parquet and CSV files: one row per step; columns that hold data are found by name, others not read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import LONGEST_TEXT, as_array, check_any
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.memory import check_memory
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

Place = Callable[[int], str]
"""The place of a row of a table in messages: its file, demonstration and number."""

EPISODE = ("episode_index", "episode_id", "episode_ids", "episode")
ACTION = ("action", "actions")
STEP = "step_index"
# fmt: off
RESERVED = frozenset({
    "frame_index", "step", STEP, "timestamp", "index", "task_index", "task",
    "reward", "rewards", "return", "next.reward", "next.done", "next.success", "done", "terminated", "truncated",
    "weight", "expert_proba", "log_odds", "label",
    "is_good", "episode_quality", "episode_return", "demonstrator", "demonstrator_id",
    "demonstrator_ids", "noise_level", "agent_level", "trial_ids",
})
# fmt: on
# pandas writes its row index under these names; as an observation it would reveal the order of the rows.
_ROW_INDEX = re.compile(r"__index_level_\d+__|Unnamed: \d+|")
_OBSERVATION = re.compile(r"observation|obs($|[._\d])")
_OBSERVATION_PREFIX = re.compile(r"(observations?|obs)[._]?")
_ACTION_PART = re.compile(r"actions?[._]")


@dataclass(frozen=True)
class Columns:
    """Names of the columns that hold data."""

    episode: str  # id of the demonstration
    actions: tuple[str, ...]  # one column named in `ACTION`, or one for each number of a continuous action
    observations: tuple[str, ...]

    @property
    def all(self) -> list[str]:
        return [self.episode, *self.actions, *self.observations]

    @property
    def one_action(self) -> bool:
        """Whether the action is one column, which may then be discrete."""
        return self.actions[0] in ACTION


def is_data(name: str) -> bool:
    """Whether a column called `name` holds data: demonstration, step, action or, by its prefix, an observation."""
    return bool(name in (*EPISODE, *ACTION, STEP) or _ACTION_PART.match(name) or _OBSERVATION.match(name))


def quoted(names: Iterable[object], most: int = 12) -> str:
    """Up to `most` of the names, quoted, for a message."""
    texts = [repr(name) for name in names]
    return ", ".join(texts[:most]) + (", ..." if len(texts) > most else "")


def check_ids(names: Iterable[object], ids: Iterable[object], source: str, what: str) -> None:
    """A `DataError` naming the first `names` that are no ids, compared as text, and `what` is to be corrected."""
    texts = dict.fromkeys(map(str, ids))
    unknown = [str(name) for name in names if str(name) not in texts]
    if unknown:
        wrong, right = quoted(unknown, 5), quoted(texts, 5)
        raise DataError(f"{source}: no demonstration is called {wrong}; the ids are {right}; correct {what}.")


def find_columns(names: Sequence[str], source: str) -> Columns:
    """The columns to read, by their names; a `DataError` where a name appears twice, or columns cannot be found."""
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise DataError(f"{source}: column {repeated[0]!r} appears twice; rename or drop one of them.")
    found = quoted(names)
    episode = [name for name in EPISODE if name in names]
    if not episode:
        raise DataError(
            f"{source}: no column says which demonstration a row is from: name it {EPISODE[0]} (found {found})."
        )
    actions = [name for name in ACTION if name in names][:1] or [name for name in names if _ACTION_PART.match(name)]
    if not actions:
        raise DataError(f"{source}: no column holds the action: name it {ACTION[0]} (found {found}).")
    observations = [name for name in names if _OBSERVATION.match(name)] or [
        name for name in names if not (name in RESERVED or _ROW_INDEX.fullmatch(name) or is_data(name))
    ]
    if not observations:
        raise DataError(f"{source}: no column holds observations: name them observation.* (found {found}).")
    return Columns(episode[0], tuple(actions), tuple(observations))


def to_demonstrations(table: pa.Table, columns: Columns, source: str) -> Demonstrations:
    """`Demonstrations` from the `columns` of a ``pyarrow.Table``; the rows of one need not lie together.

    A `DataError` on missing values, text where numbers are due, lists of unequal length, and as of `Demonstrations`.
    """
    check_any(table.num_rows, source)
    ids = column_values(table, columns.episode, lambda row: f"{source}, row {row + 1}")

    def at(row: int) -> str:
        return f"{source}, demonstration {ids[row].tolist()!r}, row {row + 1}"

    if columns.one_action:
        actions = column_values(table, columns.actions[0], at)
        if actions.ndim == 2 and actions.shape[1] > 1:
            actions = actions.astype(np.result_type(actions, np.float32), copy=False)
    else:
        actions, _ = stack_columns(table, columns.actions, at)
    observations, names = stack_columns(table, columns.observations, at)
    return Demonstrations.from_groups(observations, actions, ids, observation_names=names, source=source)


def from_demonstrations(demonstrations: Demonstrations, truth: Mapping[str, Array]) -> pa.Table:
    """The ``pyarrow.Table`` that `to_demonstrations` reads back, with one more column for each `truth` (M,)."""
    import pyarrow as pa

    columns = step_columns(demonstrations.ids, demonstrations.offsets)
    for name, column in zip(demonstrations.observation_names, demonstrations.observations.T, strict=True):
        columns[f"observation.{name}"] = column
    if demonstrations.is_discrete:
        columns["action"] = demonstrations.actions
    else:
        columns |= {f"action.{a}": column for a, column in enumerate(demonstrations.actions.T)}
    return pa.table(columns | {name: np.repeat(values, demonstrations.lengths) for name, values in truth.items()})


def step_columns(ids: Sequence[object], offsets: Array) -> dict[str, Array]:
    """The two columns that identify a step: the id of its demonstration, and its number within it, from 0."""
    lengths = np.diff(offsets)
    return {
        EPISODE[0]: np.repeat(np.array(ids), lengths),
        STEP: np.arange(offsets[-1]) - np.repeat(offsets[:-1], lengths),
    }


def stack_columns(table: pa.Table, names: Sequence[str], at: Place) -> tuple[Array, tuple[str, ...]]:
    """Columns of numbers side by side, (N, D), and a name for each; a column of lists counts as several."""
    blocks = {}
    for name in names:
        block = column_values(table, name, at)
        if block.dtype.kind == "U":
            row = next((row for row, text in enumerate(block) if not _is_number(text)), 0)
            text = str(block[row])[:40]
            raise DataError(
                f"{at(row)}: column {name!r} holds text ({text!r}) where numbers are due; write numbers, or drop it."
            )
        blocks[name] = block.reshape(len(block), -1)
    single = all(block.dtype == np.float32 for block in blocks.values())
    stacked = np.concatenate(list(blocks.values()), axis=1, dtype=np.float32 if single else np.float64)
    short = tuple(part for name, block in blocks.items() for part in _parts(name, block.shape[1]))
    if len(set(short)) < len(short):
        short = tuple(f"{name}.{k}" for name, block in blocks.items() for k in range(block.shape[1]))
    return stacked, short


def _parts(name: str, width: int) -> list[str]:
    short = _OBSERVATION_PREFIX.sub("", name, count=1) if _OBSERVATION.match(name) else name
    return [short or "0"] if width == 1 else [f"{short}.{k}" if short else str(k) for k in range(width)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def column_values(table: pa.Table, name: str, at: Place) -> Array:
    """One column as (N,) numbers or text, or as (N, K) numbers where it holds lists.

    A `DataError` on missing values, lists of unequal length, or values of another type.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    def refuse_nulls(column: pa.ChunkedArray | pa.Array, per_row: int = 1) -> None:
        if column.null_count:
            row = pc.index(pc.is_null(column), True).as_py() // per_row
            raise DataError(f"{at(row)}: column {name!r} has no value; fill it in or leave the demonstration out.")

    column = table[name]
    kind = column.type
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    is_text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
    if kind != column.type and not is_text:
        column = column.cast(kind)
    refuse_nulls(column)
    if pa.types.is_list(column.type) or pa.types.is_large_list(column.type) or pa.types.is_fixed_size_list(column.type):
        widths = pc.list_value_length(column).to_numpy()
        if np.any(widths != widths[0]):
            row = int(np.argmax(widths != widths[0]))
            raise DataError(f"{at(row)}: column {name!r} holds {widths[row]} numbers, not {widths[0]} as in row 1.")
        flat = column.combine_chunks().flatten()
        refuse_nulls(flat, per_row=max(int(widths[0]), 1))
        if _is_numeric(flat.type):
            return np.reshape(flat.to_numpy(zero_copy_only=False), (table.num_rows, -1))
    elif _is_numeric(column.type):
        return np.asarray(column.to_numpy())
    elif pa.types.is_decimal(column.type):
        return np.asarray(column.cast(pa.float64()).to_numpy())
    elif is_text:
        texts, rows = encoded_texts(column, name, at)
        check_memory(4.0 * len(rows) * max(map(len, texts), default=0), at(0))
        return np.asarray(as_array(texts, f"the texts of column {name!r}", at(0))[rows])
    raise DataError(f"{at(0)}: column {name!r} holds {column.type} where numbers or text are due; convert or drop it.")


def encoded_texts(column: pa.ChunkedArray, name: str, at: Place) -> tuple[list[str], Array]:
    """The different texts in a column, and the number (N,) of that of each row: a long text is in memory once.

    A `DataError` where a text is missing, too long or not Unicode.
    """
    encoded = column.dictionary_encode().unify_dictionaries().combine_chunks()
    rows = encoded.indices.to_numpy()
    try:
        texts = encoded.dictionary.to_pylist()
    except UnicodeDecodeError as error:
        raise DataError(f"{at(0)}: column {name!r} holds text that is not Unicode; write it again.") from error
    for k, text in enumerate(texts):
        if text is None or len(text) > LONGEST_TEXT:
            fault = f"holds a text of {len(text):,} characters; shorten it" if text else "has no value; fill it in"
            raise DataError(f"{at(int(np.argmax(rows == k)))}: column {name!r} {fault}.")
    return texts, rows


def _is_numeric(kind: pa.DataType) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))
