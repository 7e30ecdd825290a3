"""A recording: the demonstrations in a file, with a description of them and what the file says of every step."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath
from rpil.data.fit_data import Facts
from rpil.data.id_values import check_ids
from rpil.data.text import OBSERVATION, counted, plain_name
from rpil.formats.columns import TIME_OF_STEP, ColumnOptions, Columns, Ids, by_column
from rpil.formats.format import Dataset, Defect, Layout, StepTables
from rpil.formats.places import Clock, Times, different, find_clock, find_facts, find_places, pairs_of
from rpil.formats.scan import Description, Scan, commas, left_out_lines, scan
from rpil.formats.steps import ArrowFile, Steps
from rpil.formats.table import NESTED, end_to_end, numbers_or_missing
from rpil.numerics.types import Array, Bool

GOAL = re.compile(r"(^|[./])(desired_)?goal([./]|_\w{1,3}$|$)", re.IGNORECASE)
"""Names of goals, and not of whether one was reached."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """The demonstrations in a file; they are checked when they are first asked for, the description before.

    Attributes
    ----------
    description : Description
        Counts, columns and their roles, as ``rpil info`` prints them.
    steps, columns, found, origin : Steps, Columns, Scan, StepTables
        The steps of the demonstrations, their columns, what one pass over them found, and where they come from.
    clock : Clock, optional
        The column of time.
    ids : tuple
        Of all demonstrations in the file, also of those that the options leave out.
    options : ColumnOptions
        Those with which it was opened.
    write_some : function of ids and a path, optional
        Writes some of the demonstrations to a new file of the same format; None where no file was opened.
    set_aside : tuple of ids
        The demonstrations that were left out because a value is missing or infinite.
    find_defects : function of whether to look at videos, optional
        What the files beside the demonstrations say otherwise than these; None where the format has no such files.
    """

    description: Description
    steps: Steps
    columns: Columns
    found: Scan
    origin: StepTables
    clock: Clock | None
    ids: tuple[Id, ...]
    options: ColumnOptions = ColumnOptions()
    write_some: Callable[[Sequence[Id], StrPath], None] | None = None
    set_aside: tuple[Id, ...] = ()
    find_defects: Callable[[bool], list[Defect]] | None = None

    def __repr__(self) -> str:
        return "\n".join(self.description.short())

    def keep(self, ids: Sequence[Id], output: StrPath) -> None:
        """Write some demonstrations, with all that the file says of them, to a new file or folder; or a list of them.

        Parameters
        ----------
        ids : sequence of ids
            Those to write, in the order of the file.
        output : path
            A file there is replaced whole; a folder must not be there yet. The data themselves are never changed. To
            ``.json`` or ``.txt`` the list of the ids is written, of any format: ``{"episodes": [...]}``, or one a line.

        Raises
        ------
        DataError
            Where an id is unknown, the output cannot be written or is in the data, the format is not written, or
            the demonstrations were not opened from a file.
        """
        if self.write_some is None:
            raise DataError(f"{self.description.source}: it was not opened from a file; write it with rpil.write.")
        if isinstance(ids, str):
            raise DataError(f"The ids are one text, {ids!r}; give a sequence of ids, and then the new path.")
        self.write_some(ids, output)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Sentences on what is not read because it is damaged, or a value is missing."""
        return left_out_lines(self.origin.skipped, self.set_aside)

    @cached_property
    def operators(self) -> list[tuple[str, object]]:
        """The different pairs of a demonstration's id, as text, and the value in the column of operators."""
        return pairs_of(self.steps, self.columns.operator)

    @cached_property
    def tasks(self) -> dict[str, str]:
        """The task of each demonstration, by its id as text; empty where the file does not say."""
        names, found = self.origin.metadata.tasks, defaultdict[str, list[str]](list)
        for m, value in pairs_of(self.steps, self.columns.task):
            found[m].append("" if value is None else names.get(str(value), str(value)))
        return {m: "; ".join(sorted(tasks)) for m, tasks in found.items()}  # several are one task together

    @property
    def interventions(self) -> Bool[Array, " N"] | None:
        """Whether a person had taken over in each step; None where no column says it."""
        name = self.columns.intervention
        values = None if name is None else numbers_or_missing(self.steps.read([name])[name])
        return None if values is None or not np.isin(values, (0, 1)).all() else values > 0

    def times(self) -> Times:
        """The statements of the file on its own times and lengths."""
        metadata = self.origin.metadata
        ticks, unit = (self.clock.ticks, self.clock.unit or 1.0) if self.clock else (None, 1.0)
        seconds = ticks if ticks is None or unit == 1.0 else ticks * unit  # one copy in memory
        return Times(seconds, metadata.fps, metadata.lengths)

    def step_columns(self, steps: slice) -> pa.Table | None:
        """The numbers of its rows that the file itself has, such as ``index``, of some steps in their order."""
        names = [*self.columns.index, *([self.columns.order] if self.columns.order else [])]
        if names or self.steps.place is None:
            return self.steps.read(names, steps) if names else None
        return pa.table({"row": self.steps.numbers(np.arange(steps.start, steps.stop)) + 1})

    @cached_property
    def facts(self) -> Facts:
        """Order, sessions and outcomes of the demonstrations; a `DataError` where a named column cannot say them."""
        with guarded(self.description.source):
            return find_facts(self.steps, self.columns, self.origin.metadata)

    @cached_property
    def demonstrations(self) -> Demonstrations | Dataset:
        """The demonstrations; a `DataError` where a value is missing or of the wrong kind."""
        with guarded(self.description.source):
            return self.load(self.options)

    def load(self, options: ColumnOptions) -> Demonstrations | Dataset:
        """The demonstrations, in memory if the rows are; a `DataError` where a value cannot be an action, or is missing
        or infinite and the options do not allow it."""
        found, steps, layout = self.found, self.steps, replace(self.found.layout, allows_missing=options.allow_missing)
        if found.fault is not None and (found.kind == "refused" or not options.allow_missing):
            raise found.fault
        classes, n = found.classes, len(layout.actions)
        if found.fault is not None and layout.action.kind in "iu":  # numbers with gaps are no classes
            layout, classes = replace(layout, action=np.dtype(np.float64), n_parts=1), np.empty(0)
        ends = found.low[:n], found.high[:n]
        data = Dataset(steps.ids, steps.offsets, steps.source, steps, layout, classes, *ends, options.memory)
        for m in () if options.allow_missing else sorted(found.faulty):  # an error that names the value
            replace(data, source=(steps.files(steps.offsets[m : m + 1]) or [steps.source])[0]).select([m])
        return data.select(slice(None)) if isinstance(steps.table, pa.Table) else data


def from_tables(found: StepTables, options: ColumnOptions = ColumnOptions()) -> Recording:
    """The recording of the demonstrations in tables that the options choose; a `DataError` where these name an unknown
    one, or leave none."""
    source, table, columns = found.source, found.tables, replace(found.columns, options=options)
    if not isinstance(table, ArrowFile):
        n_rows = sum(found.sizes.values())
        table = ArrowFile.of(table, source, n_rows) if options.on_disk else end_to_end([*table], source)
    steps, columns = find_places(Steps(table, source, found.sizes, found.place), columns)
    layout = Layout.of(steps.table.schema, columns)
    ids, asked = steps.ids, _asked(steps.ids, options, source)
    steps = steps.only(asked)
    seen, aside = scan(steps, layout, columns), list[Id]()
    if options.skip_bad is True and seen.faulty:
        is_sound = ~np.isin(np.arange(len(steps.ids)), [*seen.faulty])
        if not is_sound.any():
            raise DataError(f"{source}: in every demonstration a value is missing or infinite; exclude the column.")
        aside, steps = [steps.ids[m] for m in sorted(seen.faulty)], steps.only(is_sound)
        seen = scan(steps, layout, columns)
    ignored, found = seen.left_out, replace(found, tables=())
    columns = replace(
        columns,
        observations=tuple(m for m in columns.observations if m not in ignored),
        ignored={**columns.ignored, **by_column(ignored, columns.lists)},
        times=(*columns.times, *(m for m, why in ignored.items() if why == TIME_OF_STEP)),
    )
    if len(steps.ids) < len(ids) or options.split_gap or options.segment:
        declared = found.metadata.lengths
        lengths = {m: declared[m] for m in steps.ids if m in declared}
        found = replace(found, metadata=replace(found.metadata, lengths=lengths))
    clock = find_clock(steps, columns)
    n_asked = f"{asked.sum():,} of {len(ids):,} demonstrations are read, as asked."
    of_choice = [*([] if asked.all() else [n_asked]), *left_out_lines((), aside)]
    description = _describe(steps, columns, seen, found, clock, of_choice)
    return Recording(description, steps, columns, seen, found, clock, ids, options, set_aside=tuple(aside))


_RANGE = re.compile(r"(\d{1,18})\s*-\s*(\d{1,18})")


def _asked(ids: Sequence[Id], options: ColumnOptions, source: str) -> Array:
    """Whether each demonstration is among those that the options choose, (M,); a `DataError` naming unknown ones."""
    places = {str(m): k for k, m in enumerate(ids)}

    def numbers(wanted: Ids, option: str) -> list[int]:
        """The numbers of those that a user names, by ids of Python or of NumPy; an empty text names none."""
        found = list[int]()
        several = [wanted] if isinstance(wanted, str) or not isinstance(wanted, Iterable) else wanted
        for given in filter(None, map(str, () if wanted is None else several)):
            for name in [given] if given in places else map(str.strip, given.split(",")):
                ends = _RANGE.fullmatch(name)
                named = [name] if ends is None or name in places else sorted(ends.groups(), key=int)
                check_ids(named, places, source, option)
                low, high = named[0], named[-1]
                between = (k for m, k in places.items() if m.isdecimal() and int(low) <= int(m) <= int(high))
                found += [places[low]] if low == high else between
        return found

    only = numbers(options.only, "--only")
    mask = np.full(len(ids), not only)
    mask[only] = True
    mask[numbers(options.without, "--without")] = False
    if not mask.any():
        raise DataError(f"{source}: --only and --without leave no demonstration; correct them.")
    return mask


def from_demonstrations(demonstrations: Demonstrations, format_name: str) -> StepTables:
    """The table of demonstrations in memory, of a format that has no table of columns."""
    d, seen = demonstrations, [f"observation.{name}" for name in demonstrations.observation_names]
    acted = ["action"] if d.n_actions < 2 else [f"action.{k}" for k in range(d.n_actions)]
    lists = {"observation": seen} | ({} if d.is_discrete else {"action": acted})
    columns = Columns("episode", (*acted,), (*seen,), True, lists=lists)
    table = {columns.episode: np.repeat(np.array(d.ids), d.lengths), **dict(zip(seen, d.observations.T, strict=True))}
    table |= zip(acted, d.actions.reshape(d.n_steps, -1).T, strict=True)
    return StepTables([pa.table(table)], columns, d.source, format_name, {d.source: d.n_steps})


def _describe(
    steps: Steps, columns: Columns, found: Scan, origin: StepTables, clock: Clock | None, of_choice: Sequence[str]
) -> Description:
    metadata, layout, n_steps = origin.metadata, found.layout, len(steps)
    seconds, recorded = clock.seconds(steps.offsets) if clock else (None, None)
    operators, tasks = (pairs_of(steps, name) for name in (columns.operator, columns.task))
    # Columns of time are read for other things too than the order of the steps.
    others = (name for name in (*columns.orders, *columns.index) if name != columns.order)
    times, videos = dict.fromkeys(others, TIME_OF_STEP), dict.fromkeys(metadata.videos, "video")
    ranges, constant, missing = found.summary()
    return Description(
        source=origin.source,
        format=origin.format_name,
        demonstrations=len(steps.ids),
        steps=n_steps,
        observations=tuple(layout.observations.values()),
        actions=tuple(layout.actions.values()),
        action_kind=found.kind,
        action_reason=found.reason,
        id_column=columns.episode,
        order_column=columns.order,
        order=columns.order_words,
        seconds=n_steps / metadata.fps if metadata.fps else seconds,
        fps=metadata.fps or recorded,
        operator_column=columns.operator,
        operators=different(operators),
        task_column=columns.task,
        tasks=different(tasks, metadata.tasks),
        ignored={**columns.ignored, **times, **videos, **origin.ignored},
        missing=missing,
        ranges=ranges,
        notes=(*_notes(steps, columns, origin, recorded, constant), *of_choice),
    )


def _notes(
    steps: Steps, columns: Columns, origin: StepTables, recorded: float | None, constant: Sequence[str]
) -> list[str]:
    """Sentences on how steps were divided, on times that differ from those declared, and on what is not used."""
    notes, options, fps = list[str](), columns.options, origin.metadata.fps
    if options.split_gap:
        notes.append(f"A demonstration ends where more than {options.split_gap:g} s pass, or time starts again.")
    if options.segment:
        notes.append(f"Each stretch of {options.segment:g} s is a demonstration.")
    if 1 < len(steps.ids) == len(steps):
        notes.append(f"Each demonstration has one step: is {columns.episode} the right column of the demonstration?")
    goals = [m for m, why in columns.ignored.items() if GOAL.search(m) and why.startswith("not named as an")]
    if goals and not any(map(GOAL.search, columns.observations)):
        notes.append(f"No goal is read: --observations takes {commas(goals)}, with the names of all others.")
    nested = [m for m, why in columns.ignored.items() if why == NESTED and OBSERVATION.fullmatch(plain_name(m))]
    if nested and not any(OBSERVATION.fullmatch(plain_name(m)) for m in columns.observations):
        notes.append(f"No observation of {commas(nested)} is read, because of {NESTED}; other columns are, instead.")
    if fps and recorded and abs(recorded - fps) > 0.01 * fps:
        notes.append(f"{fps:g} frames a second are declared, and count here; by the timestamps it is {recorded:.3g}.")
    if constant and len(steps.ids) < len(steps):
        named = (f"observation {name}" if name.isdecimal() else name for name in constant)
        notes.append(f"Constant in each demonstration: {commas(named)}; exclude what nobody could see.")
    notes += [*origin.notes, *left_out_lines(origin.skipped)]
    if n := origin.metadata.n_cameras:
        cameras = f"{counted(n, 'camera')} {'are' if n > 1 else 'is'}"
        notes.append(f"{cameras} not used: rpil judges by numbers, not by images.")
    return notes
