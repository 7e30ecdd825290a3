"""The recording in files that stay on disk."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rpil.data.facts import Facts
from rpil.data.guard import guarded
from rpil.formats.dataset import Dataset
from rpil.formats.description import Description, outcome_options
from rpil.formats.lerobot import format_name
from rpil.formats.recording import Recording, files_of, ignored_columns, own_numbers, times_of
from rpil.formats.table_facts import Origin, different, fact_columns, file_names, find_facts, tasks_of
from rpil.formats.times import Times, clock_columns, find_clock

if TYPE_CHECKING:
    import pyarrow as pa


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
        operators=different(about.operators),
        task_column=columns.task,
        tasks=different(about.tasks, about.metadata.tasks),
        ignored=ignored_columns(columns, about.order, about.metadata),
        missing=statistics.missing,
        ranges=statistics.ranges,
        outcomes=outcome_options([*about.metadata.split_outcomes, *columns.outcomes]),
        notes=about.metadata.notes(len(data), data.n_steps),
    )
    return Recording(
        description,
        lambda: data,
        lambda steps: _stored_columns(data, steps, own_numbers(columns, about.order)),
        about.operators,
        tasks_of(about.tasks, about.metadata),
        lambda: _stored_times(data),
        lambda: _stored_facts(data),
    ).with_ignored_files(about.ignored_files)


def _stored_times(data: Dataset) -> Times:
    """From one reading of the columns of time."""
    columns = data.store.columns
    with guarded(data.source):
        table = _stored_columns(data, slice(0, data.n_steps), clock_columns(columns))
        clock = None if table is None else find_clock(table, columns, None, data.offsets)
    return times_of(clock, data.about.metadata)


def _stored_facts(data: Dataset) -> Facts:
    """From one reading of the columns of time, session and outcome."""
    import pyarrow as pa

    columns, groups = data.store.columns, data.store.groups
    named = dict(zip((group.path for group in groups), file_names(group.path for group in groups), strict=True))
    files = {named[group.path]: 0 for group in groups}
    for group in groups:
        files[named[group.path]] += group.last - group.first
    table = _stored_columns(data, slice(0, data.n_steps), fact_columns(columns))
    origin = Origin(data.source, files_of(data.offsets[:-1], files), data.about.metadata)
    return find_facts(pa.table({}) if table is None else table, columns, data.offsets, data.ids, origin)


def _stored_columns(data: Dataset, steps: slice, names: list[str]) -> pa.Table | None:
    """Some columns of some of the rows; None where there are none."""
    import pyarrow as pa

    tables = [table for _, table, _ in data.store.tables(steps.start, steps.stop, names)] if names else []
    return pa.concat_tables(tables, promote_options="permissive") if tables else None
