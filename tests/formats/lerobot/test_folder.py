"""LeRobot's folders, in the layout that its version 3.0 writes, and what is given back to it."""

import json

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lerobot_folders as folders
from lerobot_folders import change_info
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from rpil.formats.registry import find


@pytest.fixture
def dataset(tmp_path):
    """Four episodes in two files, with two tasks; the rows about episodes name the wrong file for the second."""
    root = folders.write(tmp_path / "drive", (4, 6, 5, 7), cameras=(), per_file=2)
    for file in (root / "data").rglob("*.parquet"):
        table = pq.read_table(file)
        number = pa.array(table["episode_index"].to_numpy() % 2)
        pq.write_table(table.set_column(table.column_names.index("task_index"), "task_index", number), file)
    # The texts are the index, and the rows do not come in the order of their numbers.
    pd.DataFrame({"task_index": [1, 0]}, index=["lift", "put down"][::-1]).to_parquet(root / "meta" / "tasks.parquet")
    with folders.changing_episodes(root) as rows:
        rows[1]["data/file_index"] = 1
    return root


def test_data_are_believed_and_not_the_metadata(dataset):
    change_info(dataset, total_frames=30, total_episodes=5)
    description = formats.read_recording(dataset).description
    assert (description.demonstrations, description.steps, description.notes) == (4, 22, ())


def test_metadata_that_cannot_be_opened_are_refused(dataset):
    (dataset / "meta" / "info.json").unlink()
    assert formats.read_recording(dataset).description.format == "Parquet, 2 files"
    (dataset / "meta" / "info.json").mkdir()
    with pytest.raises(DataError, match=r"info\.json: it does not describe a data set .*, or move it away"):
        formats.read_recording(dataset)


def test_ids_of_a_column_are_not_taken_for_numbers_of_episodes(dataset):
    with pytest.raises(DataError, match="keep writes no folder by other ids than its own; write the list"):
        find(dataset).keep(dataset.with_name("kept"), [1], ColumnOptions(id="task_index"))
    assert not dataset.with_name("kept").exists()
    with pytest.raises(DataError, match=r"^drive/data/chunk-000/file-000\.parquet: no column is called 'operator'"):
        formats.read_recording(dataset, ColumnOptions(operator="operator"))  # which may be in meta/episodes


def test_lines_of_json_of_version_2(dataset):
    change_info(dataset, codebase_version="v2.1")
    (dataset / "meta" / "tasks.parquet").unlink()
    lines = [{"task_index": 1, "task": "put down"}, {"task_index": 0, "task": "lift"}]
    (dataset / "meta" / "tasks.jsonl").write_text("\n".join(map(json.dumps, lines)), encoding="utf-8-sig")
    (dataset / "data" / "chunk-000" / "file-000.parquet").rename(dataset / "data" / "chunk-000" / "episode_0.parquet")
    recording = formats.read_recording(dataset)
    assert (recording.tasks["3"], recording.description.format) == ("put down", "LeRobot v2.1, 2 files")
    with pytest.raises(DataError, match=r"version 'v2\.1', which LeRobot converts to 3\.0; write the list with -o"):
        find(dataset).keep(dataset.with_name("kept"), [1])
    (dataset / "meta" / "tasks.jsonl").write_text("{}", encoding="utf-16")
    with pytest.raises(DataError, match=r"its tasks cannot be read .*; write them again in UTF-8"):
        formats.read_recording(dataset)


@pytest.mark.parametrize("place", ["meta/extra", "meta/note.txt", "data/chunk-000/file-002.parquet"])
def test_what_a_link_leads_to_is_not_published(dataset, place):
    secret = dataset.with_name("home")
    secret.mkdir()
    (secret / "id_rsa").write_text("key")
    (dataset / place).symlink_to(secret / "id_rsa" if (dataset / place).suffix else secret)
    for use in (formats.read, lambda path: find(path).keep(path.with_name("kept"), [1])):
        with pytest.raises(DataError, match=f"{place}: it is a link that leads out"):
            use(dataset)
    assert not dataset.with_name("kept").exists()
