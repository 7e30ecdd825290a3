"""A recording: the demonstrations in a file, with a description of them and what the file says of every step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import SMALLEST, Id, check_any
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.guard import guarded
from rpil.data.id_values import check_ids
from rpil.data.recorded_facts import Facts, outcome_of_steps, tells
from rpil.formats.columns import ColumnOptions, Columns
from rpil.formats.dataset import Dataset
from rpil.formats.description import Description, commas, outcome_options
from rpil.formats.layout import Layout
from rpil.formats.metadata import Metadata
from rpil.formats.places import Cuts, Order, Trims, find_cuts, find_places
from rpil.formats.rows import Rows, TableRows, read_columns
from rpil.formats.scan import Scan, scan
from rpil.formats.spool import spool
from rpil.formats.step_tables import StepTables
from rpil.formats.store import copied_rows
from rpil.formats.table import numbers_or_missing
from rpil.formats.table_facts import Origin, different, fact_columns, find_facts, tasks_of
from rpil.formats.times import Clock, Times, clock_columns, find_clock

if TYPE_CHECKING:
    import pyarrow as pa

    from rpil.numerics.types import Array

StepColumns = Callable[[slice], "pa.Table | None"]
"""The columns of some steps by which a file itself numbers its rows, if it does."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """The demonstrations in a file; they are checked when they are first asked for, the description before.

    Attributes
    ----------
    description : Description
    load : function of options
        Makes the demonstrations, which may have missing values if the options allow it.
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
    options : ColumnOptions
        Those with which it was opened.
    cuts : function of trims
        The steps that they keep, by their places in the file.
    write_some : function of ids, a path and cuts, optional
        Writes some of the demonstrations to a new file of the same format; None where no file was opened.
    chosen : function of a mask of the M demonstrations, optional
        The recording of those that it chooses.
    ids : tuple
        Of all demonstrations in the file, also of those that the options leave out.
    faulty : set of int
        Numbers of the demonstrations in which a value is missing or infinite.
    set_aside : tuple of ids
        The demonstrations that were left out because of these.
    """

    description: Description
    load: Callable[[ColumnOptions], Demonstrations | Dataset]
    step_columns: StepColumns = lambda _: None
    operators: list[tuple[str, object]] = field(default_factory=list)
    tasks: Mapping[str, str] = field(default_factory=dict)
    times: Callable[[], Times] = Times
    read_facts: Callable[[], Facts] = Facts
    options: ColumnOptions = ColumnOptions()
    cuts: Callable[[Trims], Cuts] = lambda _: {}
    write_some: Callable[[Sequence[Id], StrPath, Cuts], None] | None = None
    chosen: Callable[[Array], Recording] | None = None
    ids: tuple[Id, ...] = ()
    faulty: Set[int] = frozenset()
    set_aside: tuple[Id, ...] = ()

    def __repr__(self) -> str:
        return "\n".join(self.description.short())

    def describe(self) -> Description:
        """Counts, columns and their roles, as ``rpil info`` prints them."""
        return self.description

    def keep(self, ids: Sequence[Id], output: StrPath, trims: Trims = MappingProxyType({})) -> None:
        """Write some demonstrations, with all that the file says of them, to a new file or folder of the same format.

        Parameters
        ----------
        ids : sequence of ids
            Those to write, in the order of the file.
        output : path
            A file there is replaced whole; a folder must not be there yet. The data themselves are never changed.
        trims : mapping of id to (int, int), optional
            The first step to keep of a demonstration, and the first after those to keep; of others all are kept.
            ``rpil.check(recording).trims`` has those of idle ends.

        Raises
        ------
        DataError
            Where an id is unknown, a demonstration has no such steps, the output cannot be written or is in the data,
            the format cannot be given back, or the demonstrations were not opened from a file.
        """
        if self.write_some is None:
            raise DataError(f"{self.description.source}: it was not opened from a file; write it with rpil.write.")
        if isinstance(ids, str):
            raise DataError(f"The ids are one text, {ids!r}; give a sequence of ids, and then the new path.")
        check_ids(trims, self.ids, self.description.source, "trims")
        wanted = {*map(str, ids)}
        self.write_some(ids, output, self.cuts({m: ends for m, ends in trims.items() if str(m) in wanted}))

    @cached_property
    def facts(self) -> Facts:
        """Order, sessions and outcomes of the demonstrations; a `DataError` where a named column cannot say them."""
        with guarded(self.description.source):
            return self.read_facts()

    @cached_property
    def demonstrations(self) -> Demonstrations | Dataset:
        """The demonstrations; a `DataError` where a value is missing or of the wrong kind."""
        with guarded(self.description.source):
            return self.load(self.options)


def from_tables(found: StepTables, on_disk: bool = False) -> Recording:
    """The recording in tables; `on_disk` they never are in memory all."""
    import pyarrow as pa

    columns, origin = found.columns, found.origin
    if on_disk:
        return from_rows(copied_rows(spool(found.tables, origin.source), found.sizes), columns, origin)
    whole = list(found.tables)
    check_any(len(whole), origin.source)
    table = pa.concat_tables(whole, promote_options="permissive")
    return from_rows(TableRows(table, origin.source, sizes=found.sizes), columns, origin)


def from_rows(rows: Rows, columns: Columns, origin: Origin, layout: Layout | None = None) -> Recording:
    """The recording in rows, which in memory may lie in any order; a `DataError` where ids are missing."""
    places, rows = find_places(rows, columns, origin.source)
    if layout is None:
        head = next(rows.tables(0, int(places.offsets[-1]), columns.data))[1]
        layout = Layout.of(head, columns, origin.metadata.names)
    return from_scan(rows, columns, scan(rows, layout, columns, origin.source, places), origin)


def from_demonstrations(
    demonstrations: Demonstrations, format_name: str, columns: Columns | None = None, others: Mapping[str, Array] = {}
) -> StepTables:
    """The table of demonstrations in memory, of a format that has no table of columns.

    `others` have a value for each step, in the order of the demonstrations, and `columns` name them.
    """
    import pyarrow as pa

    d, names = demonstrations, demonstrations.observation_names
    observation = "observation" if len(names) > 1 else f"observation.{names[0]}"
    columns = replace(columns or Columns("episode", (), (), True), observations=(observation,), actions=("action",))
    actions = pa.array(d.actions.reshape(-1))
    table = {
        columns.episode: np.repeat(np.array(d.ids), d.lengths),
        observation: pa.FixedSizeListArray.from_arrays(pa.array(d.observations.reshape(-1)), len(names)),
        "action": actions if d.is_discrete else pa.FixedSizeListArray.from_arrays(actions, d.actions.shape[1]),
    }
    files, metadata = {d.source: d.n_steps}, Metadata(names={observation: names})
    origin = Origin(d.source, format_name, metadata)
    return StepTables([pa.table({**others, **table})], columns, origin, files)


def from_scan(rows: Rows, columns: Columns, found: Scan, origin: Origin) -> Recording:
    """The recording in rows that were read once; its demonstrations are in memory if the rows are."""
    places, metadata = found.places, origin.metadata
    columns = columns.without_observations(found.last_actions, "it repeats the last action")
    columns = replace(columns, outcomes=tuple(_outcomes(rows, columns, places.offsets)))

    @cache
    def read_clock() -> Clock | None:
        return find_clock(read_columns(rows, clock_columns(columns)), columns, places.offsets)

    def load(options: ColumnOptions) -> Demonstrations | Dataset:
        data = _dataset(rows, found, origin.source, options)
        return data.select(slice(None)) if isinstance(rows, TableRows) else data

    def step_columns(steps: slice) -> pa.Table | None:
        names = list(dict.fromkeys([*columns.index, *([places.order.column] if places.order.column else [])]))
        return read_columns(rows, names, steps) if names else rows.numbers(steps)

    def read_facts() -> Facts:
        table = read_columns(rows, fact_columns(columns))
        files = replace(origin, files=rows.files(places.offsets[:-1]))
        return find_facts(table, columns, places.offsets, places.ids, files)

    def read_times() -> Times:
        clock = read_clock()
        return Times(None if clock is None else clock.timestamps, metadata.fps, metadata.lengths)

    return Recording(
        _describe(columns, found, origin, read_clock()),
        load,
        step_columns,
        found.operators,
        tasks_of(found.tasks, metadata),
        read_times,
        read_facts,
        cuts=partial(find_cuts, rows=rows, places=places, source=origin.source),
        chosen=partial(_chosen, rows, columns, found, origin),
        ids=places.ids,
        faulty=found.statistics.faulty,
    )


def _outcomes(rows: Rows, columns: Columns, offsets: Array) -> Iterator[str]:
    """The columns that may be an outcome, without those that are read and the same for all demonstrations."""
    there = rows.table.column_names if isinstance(rows, TableRows) else columns.outcomes
    table = read_columns(rows, [name for name in columns.outcomes if name in there])
    for name in columns.outcomes:
        values = numbers_or_missing(table[name]) if name in table.column_names else None
        is_one = values is not None and values.shape[1] == 1
        if values is None or (is_one and tells(outcome_of_steps(values[:, 0].astype(float), offsets, name))):
            yield name


def _dataset(rows: Rows, found: Scan, source: str, options: ColumnOptions) -> Dataset:
    """The demonstrations in the rows; a `DataError` where a value is missing, infinite, or cannot be an action."""
    actions, classes, places = found.actions, found.actions.classes, found.places
    layout = replace(found.layout, allows_missing=options.allow_missing)
    if actions.fault is not None and (actions.kind == "refused" or not options.allow_missing):
        raise actions.fault
    if actions.fault is not None and layout.action.kind in "iu":  # numbers with gaps are no classes
        layout, classes = replace(layout, action=np.dtype(np.float64), n_parts=1), np.empty(0)
    values = classes, *found.action_range, options.memory
    data = Dataset(places.ids, places.offsets, source, rows, layout, *values)
    if not options.allow_missing:
        data.refuse_faulty(found.statistics.faulty)
    return data


def _chosen(rows: Rows, columns: Columns, found: Scan, origin: Origin, mask: Array) -> Recording:
    """The recording of the demonstrations of a mask (M,) alone, whose rows are scanned again."""
    places, kept = found.places.only(mask)
    part = rows.chosen(kept)
    again = scan(part, found.actions.layout, columns, origin.source, places)
    return from_scan(part, columns, again, origin.only(places.ids))


def _describe(columns: Columns, found: Scan, origin: Origin, clock: Clock | None) -> Description:
    places, metadata, layout = found.places, origin.metadata, found.layout
    n_steps = int(places.offsets[-1])
    seconds, recorded = clock.seconds(places.offsets) if clock else (None, None)
    ranges = found.statistics.ranges(layout.names)
    return Description(
        source=origin.source,
        format=origin.format_name,
        demonstrations=len(places.ids),
        steps=n_steps,
        observations=layout.observation_names,
        actions=layout.action_names,
        action_kind=found.actions.kind,
        action_reason=found.actions.reason,
        id_column=columns.episode,
        order_column=places.order.column,
        order=places.order.words,
        seconds=n_steps / metadata.fps if metadata.fps else seconds,
        fps=metadata.fps or recorded,
        operator_column=columns.operator,
        operators=different(found.operators),
        task_column=columns.task,
        tasks=different(found.tasks, metadata.tasks),
        ignored={**ignored_columns(columns, places.order, metadata), **layout.left_out, **origin.ignored},
        missing=found.statistics.missing,
        ranges=ranges,
        outcomes=outcome_options(columns.outcomes),
        notes=(
            *_notes_on(columns.episode, found, metadata.fps, recorded),
            *origin.notes,
            *metadata.notes(len(places.ids), n_steps),
        ),
    )


def _notes_on(ids: str, found: Scan, declared: float | None, recorded: float | None) -> Iterator[str]:
    """Sentences on `ids` of single steps, on frames a second, and on observations that hardly differ."""
    places, layout, names = found.places, found.layout, found.layout.names
    if 1 < len(places.ids) == places.offsets[-1]:
        yield f"Each demonstration has one step: is {ids} the right column of the demonstration?"
    if declared and recorded and abs(recorded - declared) > 0.01 * declared:
        yield f"Declared are {declared:g} frames a second, which count here; the timestamps say {recorded:.3g}."
    constant = found.statistics.constant({name: names[name] for name, _ in layout.observations})
    halves = {name: high / 2 - low / 2 for name, (low, high) in found.statistics.ranges(names).items()}
    tiny = [name for name in layout.observation_names if 0 < halves.get(name, 0.0) < SMALLEST]
    if constant:
        todo = "leave out columns that the demonstrator could not see"
        yield f"Constant within each demonstration: {commas(constant)}; {todo}."
    if tiny:
        yield (
            f"Too small: values of {commas(tiny)} differ by less than {SMALLEST:g}, whose square is no number; use "
            "smaller units, or leave them out."
        )


def ignored_columns(columns: Columns, order: Order, metadata: Metadata) -> dict[str, str]:
    """What is not read, and why: also columns of time that are read for other things than the order of the steps."""
    times = [name for name in (*columns.orders, *columns.index) if name != order.column]
    videos = dict.fromkeys(metadata.videos, "video")
    return {**columns.ignored, **dict.fromkeys(times, "time or number of the step"), **videos}
