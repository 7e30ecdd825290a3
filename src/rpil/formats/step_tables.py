"""What a format reads of a file: tables with a row for each step, and what they hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

from rpil.data.json_files import Parsed
from rpil.formats.columns import Columns
from rpil.formats.layout import Layout
from rpil.formats.metadata import Metadata
from rpil.formats.store import ParquetRows
from rpil.formats.table_facts import Origin

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True, eq=False)
class StepTables:
    """Tables one below the other, with a row for each step.

    Attributes
    ----------
    tables : iterable of pyarrow.Table
        Read one by one.
    columns : Columns
    origin : Origin
    sizes : mapping of str to int
        The numbers of rows from each file, for formats in which files may state the order of demonstrations.
    in_place : ParquetRows, optional
        The rows of the tables, if they are in Parquet files and are to stay there.
    layout : Layout, optional
        The arrays that the columns make, where more than the first rows tell it.
    """

    tables: Iterable[pa.Table]
    columns: Columns
    origin: Origin
    sizes: Mapping[str, int] = field(default_factory=dict)
    in_place: ParquetRows | None = None
    layout: Layout | None = None

    def with_ignored(self, names: Mapping[str, str]) -> StepTables:
        """The same, where parts of the file are not read for the reasons in `names`."""
        return replace(self, origin=replace(self.origin, ignored={**self.origin.ignored, **names}))

    def as_json(self) -> Parsed:
        """All but the tables, as a value of JSON."""
        origin = {**asdict(self.origin), "metadata": asdict(self.origin.metadata)}
        lengths = [*self.origin.metadata.lengths.items()]
        stamps = self.in_place and self.in_place.stamps
        facts = {"columns": asdict(self.columns), "origin": origin, "lengths": lengths, "sizes": self.sizes}
        return {**facts, "stamps": stamps}


def from_facts(facts: Parsed) -> StepTables:
    """What `StepTables.as_json` says of tables, without these."""
    lengths = {name: int(length) for name, length in facts["lengths"]}
    metadata = Metadata(**_tuples(facts["origin"]["metadata"]) | {"lengths": lengths})
    origin = Origin(**_tuples(facts["origin"]) | {"metadata": metadata})
    return StepTables((), Columns(**_tuples(facts["columns"])), origin, facts["sizes"])


def _tuples(value: Parsed) -> Parsed:
    """The value with tuples for lists, as the records have them."""
    if isinstance(value, dict):
        return {name: _tuples(one) for name, one in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
