"""A copy of a folder of LeRobot 3.0 whose ``meta/episodes`` says more of each episode, as LeRobot can filter by it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rpil.data.files import new_folder
from rpil.data.folders import check_inside, copy_folder
from rpil.formats.parquet_file import read_table


def annotate(path: Path, output: Path, columns: Mapping[str, Mapping[str, object]]) -> None:
    """Copy the data, the videos and ``meta``, and add `columns`, by name, with a value for each episode's number as
    text; null where there is none. Columns of these names that are there already are replaced."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for entry in (path / "videos").rglob("*"):
        check_inside(entry, path)
    with new_folder(output) as new:
        for name in ("data", "meta", "videos"):
            if (path / name).is_dir():
                copy_folder(path / name, new / name)
        for place in (new / "meta" / "episodes").rglob("*.parquet"):
            table = read_table(place)
            episodes = [*map(str, table["episode_index"].to_pylist())]
            table = table.drop_columns([name for name in columns if name in table.column_names])
            for name, values in columns.items():
                table = table.append_column(name, pa.array([values.get(episode) for episode in episodes]))
            pq.write_table(table, place)
