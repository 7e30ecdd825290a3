"""A recording: the demonstrations in a file, with a description of them and what the file says of every step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import action_kind, check_any, group_rows, number_reason
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.facts import Facts
from rpil.data.guard import guarded
from rpil.formats import table as flat
from rpil.formats.columns import Columns
from rpil.formats.dataset import Dataset
from rpil.formats.description import Description, listed, outcome_options
from rpil.formats.lerobot import Metadata
from rpil.formats.order import Order, check_one_id, find_order
from rpil.formats.table_facts import (
    Origin,
    different,
    fact_columns,
    find_facts,
    pairs_of,
    tasks_of,
)
from rpil.formats.times import Clock, Times, find_clock
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

StepColumns = Callable[[slice], "pa.Table | None"]
"""The columns of some steps by which a file itself numbers its rows, if it does."""


@dataclass(frozen=True, eq=False)
class Recording:
    """The demonstrations in a file; they are checked when they are first asked for, the description before.

    Attributes
    ----------
    description : Description
    load : function
        Makes the demonstrations.
    step_columns : function of a slice of the N steps
        The file's own numbers of its rows, such as ``index``, in the order of the steps.
    operators : list of pairs
        The different pairs of a demonstration's id, as text, and the value in the column of operators.
    tasks : mapping of str to str
        What was to be done in each demonstration, by its id as text; empty where the file does not say.
    times : function
        Reads what the file says of its own times and lengths.
    read_facts : function
        Reads what the file says of order, sessions and outcomes.
    """

    description: Description
    load: Callable[[], Demonstrations | Dataset]
    step_columns: StepColumns = lambda _: None
    operators: list[tuple[str, object]] = field(default_factory=list)
    tasks: Mapping[str, str] = field(default_factory=dict)
    times: Callable[[], Times] = Times
    read_facts: Callable[[], Facts] = Facts

    @cached_property
    def facts(self) -> Facts:
        """Order, sessions and outcomes of the demonstrations; a `DataError` where a named column cannot say them."""
        with guarded(self.description.source):
            return self.read_facts()

    @cached_property
    def demonstrations(self) -> Demonstrations | Dataset:
        """The demonstrations; a `DataError` where a value is missing or of the wrong kind."""
        with guarded(self.description.source):
            return self.load()

    def with_ignored_files(self, paths: Sequence[str]) -> Recording:
        """The same, where files beside those of the recording are not read."""
        return self.with_ignored({PurePosixPath(path).name: "a text table beside Parquet files" for path in paths})

    def with_ignored(self, names: Mapping[str, str]) -> Recording:
        """The same, where parts of the file that are no columns are not read for the reasons in `names`."""
        return replace(self, description=replace(self.description, ignored={**self.description.ignored, **names}))

    @classmethod
    def of(cls, demonstrations: Demonstrations, name: str, ignored: Mapping[str, str] | None = None) -> Recording:
        """Of demonstrations in memory, from a format called `name` that has no table of columns."""
        d = demonstrations
        n_parts = 0 if d.is_discrete else d.actions.shape[1]
        actions = tuple(f"action.{a}" for a in range(n_parts)) or ("action",)
        description = Description(
            source=d.source,
            format=name,
            demonstrations=len(d),
            steps=d.n_steps,
            observations=d.observation_names,
            actions=actions,
            action_kind=d.action_kind,
            action_reason=number_reason(n_parts) if n_parts else action_kind(d.actions, d.source, "auto")[1],
            id_column="episode_ids",
            ignored=ignored or {},
            ranges=_ranges(d.observation_names, d.observations) | (_ranges(actions, d.actions) if n_parts else {}),
            notes=_constant_note(constant_parts(d.observation_names, d.observations, d.offsets)),
        )
        return cls(description, lambda: demonstrations)


def from_table(
    table: pa.Table,
    columns: Columns,
    source: str,
    format_name: str,
    metadata: Metadata = Metadata(),
    notes: tuple[str, ...] = (),
    files: Mapping[str, int] | None = None,
) -> Recording:
    """The recording in a table, whose rows may lie in any order; a `DataError` where ids are missing.

    `files` are the numbers of rows from each file, for formats in which files may state the order of demonstrations.
    """
    check_any(table.num_rows, source)
    names, group = flat.id_codes(table, columns.episode, lambda row: f"{source}, row {row + 1}")

    def at(row: int) -> str:
        return f"{source}, demonstration {names[group[row]]!r}, row {row + 1}"

    order = find_order(table, columns, group, at)
    check_one_id(table, columns, group, order, at)
    chosen, offsets, rows = group_rows(group, order.values)
    ids = tuple(names[g] for g in chosen.tolist())

    def load() -> Demonstrations:
        actions, action_names = _actions(table, columns, at, metadata.names)
        observations, parts = flat.stack_columns(table, columns.observations, at, metadata.names)
        if rows is not None:
            observations, actions = observations[rows], actions[rows]
        return Demonstrations(observations, actions, offsets, ids, parts, source, columns.action_kind, action_names)

    numbers = _numbers_of_rows(table, own_numbers(columns, order), rows)
    clock = find_clock(table, columns, rows, offsets)
    described = _describe(table, columns, order, rows, offsets, metadata, clock)
    all_notes = (*described.notes, *notes, *metadata.notes(len(ids), len(table)))
    description = replace(described, source=source, format=format_name, notes=all_notes)
    operators, tasks = (pairs_of(table, name, names, group) for name in (columns.operator, columns.task))
    description = replace(description, operators=different(operators), tasks=different(tasks, metadata.tasks))
    times = times_of(clock, metadata)
    own = table.select(fact_columns(columns))

    def read_facts() -> Facts:
        firsts = offsets[:-1] if rows is None else rows[offsets[:-1]]
        origin = Origin(source, files_of(firsts, files or {}), metadata)
        return find_facts(own if rows is None else own.take(rows), columns, offsets, ids, origin)

    return Recording(description, load, numbers, operators, tasks_of(tasks, metadata), lambda: times, read_facts)


def files_of(firsts: Array, files: Mapping[str, int]) -> list[str]:
    """The file of each demonstration by its first row in a table, which has so many rows of each of the `files`."""
    names, ends = list(files), np.cumsum(list(files.values()))
    return [names[k] for k in np.searchsorted(ends, firsts, side="right").tolist()] if names else []


def times_of(clock: Clock | None, metadata: Metadata) -> Times:
    return Times(None if clock is None else clock.timestamps, metadata.fps, metadata.lengths)


def own_numbers(columns: Columns, order: Order) -> list[str]:
    return list(dict.fromkeys([*columns.index, *([order.column] if order.column else [])]))


def _actions(
    table: pa.Table, columns: Columns, at: flat.Place, joints: Mapping[str, Sequence[str]]
) -> tuple[Array, tuple[str, ...]]:
    """Actions, and names of their parts."""
    if not columns.one_action:
        return flat.stack_columns(table, columns.actions, at, joints)
    actions = flat.column_values(table, columns.actions[0], at)
    names = flat.part_names({columns.actions[0]: actions[:1].size}, joints)
    several = actions.ndim == 2 and actions.shape[1] > 1
    return actions.astype(np.result_type(actions, np.float32), copy=False) if several else actions, names


def _numbers_of_rows(table: pa.Table, names: list[str], rows: Array | None) -> StepColumns:
    """The file's own numbers of its rows, in the order of the steps; where it has none, and rows moved, their place."""
    import pyarrow as pa

    numbers = table.select(names)
    if rows is not None:
        numbers = numbers.take(rows) if names else pa.table({"row": rows + 1})
    return lambda steps: numbers.slice(steps.start, steps.stop - steps.start) if numbers.num_columns else None


def _describe(
    table: pa.Table,
    columns: Columns,
    order: Order,
    rows: Array | None,
    offsets: Array,
    metadata: Metadata,
    clock: Clock | None,
) -> Description:
    """All of a description but the names of file and format."""
    missing: dict[str, int] = {}
    ranges: dict[str, tuple[float, float]] = {}
    names: dict[str, tuple[str, ...]] = {}
    constant: list[str] = []
    for name in (*columns.observations, *columns.actions):
        values = flat.numbers_or_missing(table[name])
        n_missing = table[name].null_count if values is None else int(np.isnan(values).sum())
        missing |= {name: n_missing} if n_missing else {}
        names[name] = flat.part_names({name: 1 if values is None else values.shape[1]}, metadata.names)
        ranges |= {} if values is None else _ranges(names[name], values)
        if values is not None and name in columns.observations:
            constant += constant_parts(names[name], values if rows is None else values[rows], offsets)
    seconds, fps = clock.seconds(offsets) if clock else (None, None)
    if metadata.fps:
        seconds, fps = len(table) / metadata.fps, metadata.fps
    actions = tuple(part for name in columns.actions for part in names[name])
    kind, reason = _kind_of_action(table, columns, len(actions))
    return Description(
        source="",
        format="",
        demonstrations=len(offsets) - 1,
        steps=len(table),
        observations=tuple(part for name in columns.observations for part in names[name]),
        actions=actions,
        action_kind=kind,
        action_reason=reason,
        id_column=columns.episode,
        order_column=order.column,
        order=order.words,
        seconds=seconds,
        fps=fps,
        operator_column=columns.operator,
        task_column=columns.task,
        ignored=ignored_columns(columns, order, metadata),
        missing=missing,
        ranges=ranges,
        outcomes=outcome_options([*metadata.split_outcomes, *columns.outcomes]),
        notes=_constant_note(constant),
    )


def constant_parts(names: tuple[str, ...], values: Array, offsets: Array) -> list[str]:
    """Names of the numbers (N, K) that differ between demonstrations, and never within one."""
    same = np.ones(len(values) - 1, dtype=bool)
    same[offsets[1:-1] - 1] = False
    repeats = values[1:] == values[:-1]
    chosen = repeats[same].all(axis=0) & ~repeats.all(axis=0) & same.any()
    return [name for name, is_constant in zip(names, chosen.tolist(), strict=True) if is_constant]


def _constant_note(names: list[str]) -> tuple[str, ...]:
    text = f"Constant within each demonstration: {listed(names)}; leave out what those who acted did not see."
    return (text,) if names else ()


def _ranges(names: tuple[str, ...], values: Array) -> dict[str, tuple[float, float]]:
    """Smallest and largest of the numbers (N, K) that are there."""
    low, high = np.fmin.reduce(values, axis=0).tolist(), np.fmax.reduce(values, axis=0).tolist()
    return {name: (a, b) for name, a, b in zip(names, low, high, strict=True) if a == a}


def ignored_columns(columns: Columns, order: Order, metadata: Metadata) -> dict[str, str]:
    """What is not read, and why: also columns of time that are read for other things than the order of the steps."""
    times = [name for name in (*columns.orders, *columns.index) if name != order.column]
    videos = dict.fromkeys(metadata.videos, "video")
    return {**columns.ignored, **dict.fromkeys(times, "time or number of the step"), **videos}


def _kind_of_action(table: pa.Table, columns: Columns, n_parts: int) -> tuple[str, str]:
    """Whether the action of `n_parts` numbers is discrete, and why, leaving missing values out."""
    import pyarrow as pa

    column = table[columns.actions[0]]
    if not columns.one_action or flat.kind_of_type(column.type) == "list":
        values = flat.numbers_or_missing(column)
        if values is None or not columns.one_action or values.shape[1] != 1:
            return "continuous", number_reason(n_parts)
        present = values[:, 0]
    else:
        present = flat.column_values(pa.table({"action": column.drop_null()}), "action", lambda _: "")
    present = present[~np.isnan(present)] if present.dtype.kind == "f" else present
    try:
        return action_kind(present, "", columns.action_kind)
    except DataError as error:
        return "refused", str(error).removeprefix(": ").rstrip(".")
