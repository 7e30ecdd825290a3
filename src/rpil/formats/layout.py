"""How the columns of a table become observations and actions: names, widths and types of the arrays."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Literal

import numpy as np

from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.names import quoted, short_name
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
        Parts of an action; 0 where actions are discrete, and where a single number may yet be.
    masks : mapping of str to array
        Which numbers of a column are read, where not all are.
    left_out : mapping of str to str
        Names of those that are not, and why.
    allows_missing : bool
        Whether numbers may be NaN or infinite.
    """

    observations: Widths
    actions: Widths
    observation_names: tuple[str, ...]
    action_names: tuple[str, ...]
    observation: np.dtype[np.generic]
    action: np.dtype[np.generic]
    n_parts: int = 0
    masks: Mapping[str, Array] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    allows_missing: bool = False

    @classmethod
    def of(cls, table: pa.Table, columns: Columns, joints: Mapping[str, Sequence[str]]) -> Layout:
        """By the types of the columns, and the first lists in them; `joints` name the numbers of a list."""
        chosen = _Chosen(columns)
        observations, observation_names = chosen.parts(table, columns.observations, joints)
        actions, action_names = chosen.parts(table, columns.actions, joints)
        chosen.check()
        if not actions or not observations:
            what = "action" if observations else "observations"
            raise DataError(f"{columns.source}: <option> leaves nothing of the {what}; correct it.", "exclude")
        types = [value_type(table[name].type) for name in actions]
        action, n_parts = _stacked(types), sum(actions.values())
        column = next(iter(actions))
        is_list_of_floats = types[0].kind == "f" and flat.kind_of_type(table[column].type) == "list"
        may_be_class = columns.one_action and column not in chosen.masks and not is_list_of_floats
        if n_parts == 1 and (may_be_class or columns.action_kind == "discrete"):
            n_parts, action = 0, action if types[0].kind == "f" else types[0]
        return cls(
            *(tuple(observations.items()), tuple(actions.items()), observation_names, action_names),
            *(_stacked([value_type(table[name].type) for name in observations]), action, n_parts),
            *(chosen.masks, chosen.left_out, columns.allows_missing),
        )

    def without(self, columns: Container[str]) -> Layout:
        """The same without some columns of observations."""
        observations = tuple((name, width) for name, width in self.observations if name not in columns)
        own = self.names
        names = tuple(part for name, _ in observations for part in own[name])
        return replace(self, observations=observations, observation_names=names)

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
            self._fill(observations, table, self.observations, at)
            self._fill(actions.reshape(len(actions), -1), table, self.actions, at)

    def _fill(self, out: Array, table: pa.Table, widths: Widths, at: Place) -> None:
        start = 0
        for name, width in widths:
            block = flat.column_values(table, name, at, self.allows_missing)
            if block.dtype.kind == "U" and out.dtype.kind != "U":
                raise flat.no_numbers(block, name, at)
            block = block.reshape(len(block), -1)
            mask = self.masks.get(name, np.ones(width, dtype=bool))
            if block.shape[1] != len(mask):
                fault = f"holds {block.shape[1]} numbers, not {len(mask)} as elsewhere"
                raise DataError(f"{at(0)}: column {name!r} {fault}.")
            block = block[:, mask] if name in self.masks else block
            out[:, start : start + width] = block
            start += width


class _Chosen:
    """The numbers of columns that are read, by what the user says of their names, column by column."""

    def __init__(self, columns: Columns) -> None:
        self.columns, self.masks, self.left_out = columns, dict[str, Array](), dict[str, str]()
        self.unknown = dict.fromkeys(pattern for found in columns.chosen_parts.values() for pattern in found)
        self.unknown |= {pattern: None for pattern, is_known in columns.excluded_parts.items() if not is_known}
        self.known: list[str] = []

    def parts(
        self, table: pa.Table, columns: Sequence[str], joints: Mapping[str, Sequence[str]]
    ) -> tuple[dict[str, int], tuple[str, ...]]:
        """The `columns` of which a number is read, with how many, and the names of these numbers."""
        widths = {name: _width(table[name]) for name in columns}
        names, first, kept = flat.part_names(widths, joints), 0, dict[str, list[str]]()
        self.known += names
        for column, width in widths.items():
            own, chosen = names[first : first + width], self.columns.chosen_parts.get(column)
            excluded = {name for name in own if self._is_named(name, column, self.columns.excluded_parts)}
            named = {name for name in own if chosen is None or self._is_named(name, column, chosen)}
            kept[column] = [name for name in own if name in named and (name not in excluded or width == 1)]
            if len(kept[column]) < width:
                mask = self.masks[column] = np.isin(own, kept[column])
                reasons = ("excluded as asked" if name in excluded else "not among those named" for name in own)
                self.left_out |= {
                    name: why for name, why, is_read in zip(own, reasons, mask, strict=True) if not is_read
                }
            first += width
        left = {column: len(parts) for column, parts in kept.items() if parts or column not in self.masks}
        return left, tuple(name for parts in kept.values() for name in parts)

    def _is_named(self, name: str, column: str, patterns: Iterable[str]) -> bool:
        """Whether one of the `patterns` names a number, with the column's whole name or its short one."""
        spellings = {name.lower(), f"{column}.{name.removeprefix(short_name(column)).lstrip('.')}".lower()}
        found = [pattern for pattern in patterns if any(fnmatchcase(text, pattern.lower()) for text in spellings)]
        for pattern in found:
            self.unknown.pop(pattern, None)
        return bool(found)

    def check(self) -> None:
        """A `DataError` where a name that the user gave is that of no column and of no part."""
        for pattern in self.unknown:
            close = get_close_matches(pattern, self.known, 3) or self.known
            raise DataError(
                f"{self.columns.source}: no column, nor a number in one, is called {pattern!r}; correct <option>, "
                f"<option> or <option> (found {quoted(close)}).",
                ("exclude", "observations", "action"),
            )


def _width(column: pa.ChunkedArray) -> int:
    """Numbers in a row, by the first that has a value."""
    if flat.kind_of_type(column.type) != "list":
        return 1
    first = next((value for value in column if value.is_valid), None)
    return 1 if first is None else len(first)


def value_type(kind: pa.DataType) -> np.dtype[np.generic]:
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
