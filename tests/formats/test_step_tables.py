"""What leaves the process that imports a file."""

from __future__ import annotations

import json

from rpil.formats.columns import Columns
from rpil.formats.format import StepTables, from_facts
from rpil.formats.table_facts import Metadata, Origin


def test_all_but_the_tables_is_json():
    metadata = Metadata(fps=20.0, names={"x": ("a", "b")}, lengths={3: 5, "c": 7})
    columns = Columns("id", ("a",), ("x", "y"), True, ignored={"z": "image"}, times=("t",), chosen_parts={"x": ["x.a"]})
    origin = Origin("a.h5", "HDF5", metadata, ("A note.",))
    tables = StepTables([], columns, origin, {"a.h5": 4}).with_ignored({"q": "video"})
    again = from_facts(json.loads(json.dumps(tables.as_json())))
    assert again.columns == columns
    assert again.columns.ignored == columns.ignored
    assert again.columns.chosen_parts == {"x": ("x.a",)}
    assert again.origin == tables.origin
    assert again.origin.metadata.lengths == {3: 5, "c": 7}
    assert (again.sizes, again.origin.ignored) == ({"a.h5": 4}, {"q": "video"})
