"""A recording: the demonstrations in a file, with a description of them and what the file says of every step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import action_kind, are_whole, check_any, group_rows, number_reason
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.formats import table as flat
from rpil.data.formats.columns import Columns
from rpil.data.formats.dataset import Dataset
from rpil.data.formats.description import Description, listed
from rpil.data.formats.lerobot import Metadata, format_name
from rpil.data.formats.order import Order, check_one_id, find_order
from rpil.data.formats.times import Clock, Times, clock_columns, find_clock
from rpil.data.guard import guarded
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

StepColumns = Callable[[slice], "pa.Table | None"]
"""The columns of some steps by which a file itself numbers its rows, if it does."""

MAX_NAMES = 20
"""Tasks and operators of a description, at most."""


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
    """

    description: Description
    load: Callable[[], Demonstrations | Dataset]
    step_columns: StepColumns = lambda _: None
    operators: list[tuple[str, object]] = field(default_factory=list)
    tasks: Mapping[str, str] = field(default_factory=dict)
    times: Callable[[], Times] = Times

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
) -> Recording:
    """The recording in a table, whose rows may lie in any order; a `DataError` where ids are missing."""
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

    numbers = _numbers_of_rows(table, _own_numbers(columns, order), rows)
    clock = find_clock(table, columns, rows, offsets)
    described = _describe(table, columns, order, rows, offsets, metadata, clock)
    all_notes = (*described.notes, *notes, *metadata.notes(len(ids), len(table)))
    description = replace(described, source=source, format=format_name, notes=all_notes)
    operators, tasks = (_pairs(table, name, names, group) for name in (columns.operator, columns.task))
    description = replace(description, operators=_values(operators), tasks=_values(tasks, metadata.tasks))
    times = _times(clock, metadata)
    return Recording(description, load, numbers, operators, tasks_of(tasks, metadata), lambda: times)


def _times(clock: Clock | None, metadata: Metadata) -> Times:
    return Times(None if clock is None else clock.timestamps, metadata.fps, metadata.lengths)


def from_dataset(data: Dataset) -> Recording:
    """The recording in files that stay on disk, which are read once for their ranges and missing values."""
    statistics = data.store.statistics()
    about, columns = data.about, data.store.columns
    fps = about.metadata.fps
    description = Description(
        source=data.source,
        format=format_name(about.metadata, about.n_files),
        demonstrations=len(data),
        steps=data.n_steps,
        observations=data.observation_names,
        actions=data.action_names,
        action_kind="discrete" if data.is_discrete else "continuous",
        action_reason=about.action_reason,
        id_column=columns.episode,
        order_column=about.order.column,
        order=about.order.words,
        seconds=data.n_steps / fps if fps else None,
        fps=fps,
        operator_column=columns.operator,
        operators=_values(about.operators),
        task_column=columns.task,
        tasks=_values(about.tasks, about.metadata.tasks),
        ignored=_ignored(columns, about.order, about.metadata),
        missing=statistics.missing,
        ranges=statistics.ranges,
        notes=about.metadata.notes(len(data), data.n_steps),
    )
    return Recording(
        description,
        lambda: data,
        lambda steps: _stored_columns(data, steps, _own_numbers(columns, about.order)),
        about.operators,
        tasks_of(about.tasks, about.metadata),
        lambda: _stored_times(data),
    ).with_ignored_files(about.ignored_files)


def _stored_times(data: Dataset) -> Times:
    """From one reading of the columns of time."""
    columns = data.store.columns
    with guarded(data.source):
        table = _stored_columns(data, slice(0, data.n_steps), clock_columns(columns))
        clock = None if table is None else find_clock(table, columns, None, data.offsets)
    return _times(clock, data.about.metadata)


def _stored_columns(data: Dataset, steps: slice, names: list[str]) -> pa.Table | None:
    """Some columns of some of the rows; None where there are none."""
    import pyarrow as pa

    tables = [table for _, table, _ in data.store.tables(steps.start, steps.stop, names)] if names else []
    return pa.concat_tables(tables, promote_options="permissive") if tables else None


def _own_numbers(columns: Columns, order: Order) -> list[str]:
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
        ignored=_ignored(columns, order, metadata),
        missing=missing,
        ranges=ranges,
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


def _ignored(columns: Columns, order: Order, metadata: Metadata) -> dict[str, str]:
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


def _pairs(table: pa.Table, name: str | None, ids: list[int | str], group: Array) -> list[tuple[str, object]]:
    """The different pairs of id, as text, and value, in the order of the file."""
    if name is None:
        return []
    column = table[name].dictionary_encode().unify_dictionaries().combine_chunks()
    values, codes = column.dictionary.to_pylist(), column.indices.fill_null(-1).to_numpy()
    _, first = np.unique(group * (len(values) + 1) + codes, return_index=True)
    found = [(str(ids[group[row]]), values[codes[row]] if codes[row] >= 0 else None) for row in np.sort(first).tolist()]
    return [(m, _as_whole(value)) for m, value in found]


def tasks_of(pairs: Sequence[tuple[str, object]], metadata: Metadata) -> dict[str, str]:
    """The task of each demonstration from pairs of its id and the values of a column; several are one task together."""
    names: dict[str, list[str]] = {}
    for m, value in pairs:
        names.setdefault(m, []).append("" if value is None else metadata.tasks.get(str(value), str(value)))
    return {m: "; ".join(sorted(tasks)) for m, tasks in names.items()}


def _as_whole(value: object) -> object:
    return int(value) if isinstance(value, float) and are_whole(np.array([value])) else value


def _values(pairs: Iterable[tuple[str, object]], names: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """The different values of pairs of id and value, the first ones, by their `names` if they have any."""
    values = dict.fromkeys(str(value) for _, value in pairs if value is not None)
    return tuple((names or {}).get(value, value) for value in list(values)[:MAX_NAMES])
