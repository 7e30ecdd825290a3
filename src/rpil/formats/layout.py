"""How the columns of a table become observations and actions: names, widths and types of the arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.formats import table as flat
from rpil.formats.columns import Columns
from rpil.formats.table import Place
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

Widths = tuple[tuple[str, int], ...]
"""Columns, and the numbers that each holds in a row."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The arrays that columns make.

    Attributes
    ----------
    observations, actions : tuple of pairs
        The columns, and the numbers that each holds in a row.
    observation_names, action_names : tuple of str
        Of the D numbers of an observation, and of the numbers of an action.
    observation, action : dtype
    n_parts : int
        Numbers of a continuous action; 0 where actions are discrete, and where a single number may yet be.
    """

    observations: Widths
    actions: Widths
    observation_names: tuple[str, ...]
    action_names: tuple[str, ...]
    observation: np.dtype[np.generic]
    action: np.dtype[np.generic]
    n_parts: int = 0

    @classmethod
    def of(cls, table: pa.Table, columns: Columns, joints: Mapping[str, Sequence[str]]) -> Layout:
        """By the types of the columns, and the first lists in them; `joints` name the numbers of a list."""
        observations, actions = (
            {name: _width(table[name]) for name in names} for names in (columns.observations, columns.actions)
        )
        types = [_value_type(table[name].type) for name in columns.actions]
        action, n_parts = _stacked(types), sum(actions.values())
        if columns.one_action and n_parts == 1 and not (types[0].kind == "f" and _is_list(table, columns.actions[0])):
            n_parts, action = 0, action if types[0].kind == "f" else types[0]
        return cls(
            tuple(observations.items()),
            tuple(actions.items()),
            flat.part_names(observations, joints),
            flat.part_names(actions, joints),
            _stacked([_value_type(table[name].type) for name in columns.observations]),
            action,
            n_parts,
        )

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Names of the numbers in each column."""
        found: dict[str, tuple[str, ...]] = {}
        for widths, names in ((self.observations, self.observation_names), (self.actions, self.action_names)):
            first = 0
            for column, width in widths:
                found[column] = names[first : first + width]
                first += width
        return found

    @property
    def columns(self) -> list[str]:
        """The columns that are read."""
        return [name for name, _ in (*self.actions, *self.observations)]

    @property
    def shape(self) -> tuple[object, ...]:
        """What must be the same in all files of a recording."""
        return self.observations, self.actions, self.action.kind, self.n_parts

    def empty(self, n_steps: int) -> tuple[Array, Array]:
        """Uninitialised observations (n_steps, D) and actions, (n_steps,) or (n_steps, A)."""
        # As in the files, so that nothing is transposed.
        order: Literal["F", "C"] = "F" if max((width for _, width in self.observations), default=1) == 1 else "C"
        shape = (n_steps, self.n_parts) if self.n_parts else (n_steps,)
        return np.empty((n_steps, len(self.observation_names)), self.observation, order), np.empty(shape, self.action)

    def fill(self, observations: Array, actions: Array, table: pa.Table, at: Place) -> None:
        """Write the rows of `table` to the two arrays; a `DataError` where a value is missing or of the wrong kind."""
        with guarded(at(0)):
            _fill(observations, table, self.observations, at)
            self.fill_actions(actions, table, at)

    def fill_actions(self, actions: Array, table: pa.Table, at: Place) -> None:
        """Write the actions of `table`, which needs no other columns, to the array."""
        _fill(actions.reshape(len(actions), -1), table, self.actions, at)


def _fill(out: Array, table: pa.Table, widths: Widths, at: Place) -> None:
    start = 0
    for name, width in widths:
        block = flat.column_values(table, name, at)
        if block.dtype.kind == "U" and out.dtype.kind != "U":
            raise flat.no_numbers(block, name, at)
        block = block.reshape(len(block), -1)
        if block.shape[1] != width:
            raise DataError(f"{at(0)}: column {name!r} holds {block.shape[1]} numbers, not {width} as elsewhere.")
        out[:, start : start + width] = block
        start += width


def _is_list(table: pa.Table, name: str) -> bool:
    return flat.kind_of_type(table.schema.field(name).type) == "list"


def _width(column: pa.ChunkedArray) -> int:
    """Numbers in a row, by the first that has a value."""
    if flat.kind_of_type(column.type) != "list":
        return 1
    first = next((value for value in column if value.is_valid), None)
    return 1 if first is None else len(first)


def _value_type(kind: pa.DataType) -> np.dtype[np.generic]:
    """The type of NumPy of the values of a column: float32 or float64, int64 for whole numbers, or text."""
    import pyarrow as pa

    if flat.kind_of_type(kind) == "text":
        return np.dtype(np.str_)
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    if flat.kind_of_type(kind) == "list":
        kind = kind.value_type
    if pa.types.is_float32(kind):
        return np.dtype(np.float32)
    return np.dtype(np.int64 if pa.types.is_integer(kind) or pa.types.is_boolean(kind) else np.float64)


def _stacked(types: Sequence[np.dtype[np.generic]]) -> np.dtype[np.generic]:
    """The type of columns side by side."""
    return np.dtype(np.float32 if all(kind == np.float32 for kind in types) else np.float64)
