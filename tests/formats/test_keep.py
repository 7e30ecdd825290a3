"""What is kept of a file is read as the same demonstrations were, and everything else of it is still there."""

import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from problems import refused
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.formats.columns import ColumnOptions
from rpil.formats.registry import find
from samples import assert_same

KEPT = [3, 0]


@pytest.fixture
def demonstrations():
    rng = np.random.default_rng(0)
    episodes = [(rng.normal(size=(5 + m, 2)), rng.integers(0, 3, 5 + m)) for m in range(4)]
    return Demonstrations.from_episodes(episodes)


def assert_kept(path, output):
    """`output` holds the demonstrations 0 and 3 of `path`."""
    assert_same(rpil.read(output), rpil.read(path).select([0, 3]))


def test_arrays_of_any_name_are_written_and_kept(tmp_path, demonstrations):
    """Those of `numpy.savez` may not be called as its arguments are."""
    truth = {name: np.arange(4.0) for name in ("file", "allow_pickle", "path", "archive", "args")}
    path, output = tmp_path / "all.npz", tmp_path / "some.npz"
    formats.write(path, demonstrations, truth)
    find(path).keep(output, KEPT)
    assert_kept(path, output)
    for file, values in ((path, [0, 1, 2, 3]), (output, [0, 3])):
        with zipfile.ZipFile(file) as stored:
            names = {name.removesuffix(".npy") for name in stored.namelist()}
            assert {member.compress_type for member in stored.infolist()} == {zipfile.ZIP_DEFLATED}
        assert names == {"observations", "actions", "episode_ids", "observation_names", *truth}
        with np.load(file, allow_pickle=False) as arrays:
            assert all(arrays[name].tolist() == values for name in truth)


def test_lines_of_text_stay_as_they_are(tmp_path):
    head = '# from the lab\nrun;force;"x pos";note\n'
    rows = {"07": '07;1;0,50;"lines; quoted"\n', "1": "1 ;0;1,25;\n", "a": '"a";1;1e0;é\n'}
    path, output = tmp_path / "t.csv", tmp_path / "kept.csv"
    text = head + rows["07"] + "# a comment\n" + 2 * rows["1"] + 2 * rows["a"] + rows["07"]
    path.write_text(text, encoding="utf-8")
    find(path).keep(output, ["a", "07"], ColumnOptions(id="run", action="force"))
    assert output.read_text(encoding="utf-8") == head + rows["07"] + "# a comment\n" + 2 * rows["a"] + rows["07"]


def test_all_columns_and_metadata_of_parquet_stay(tmp_path):
    images = pa.array([{"bytes": b"png", "path": None}] * 6)
    columns = {"episode_index": [0, 0, 1, 1, 2, 2], "action": list("abacab"), "observation.x": np.arange(6.0)}
    table = pa.table(columns | {"image": images}).replace_schema_metadata({"huggingface": "{}"})
    path, output = tmp_path / "a.parquet", tmp_path / "b.parquet"
    pq.write_table(table, path)
    find(path).keep(output, [0, 2])
    assert pq.read_table(output).equals(table.take([0, 1, 4, 5]), check_metadata=True)


def test_what_is_no_array_is_not_read(tmp_path, demonstrations):
    """Neither a text in the archive, nor times in a version of the format that is not known."""
    path, output = tmp_path / "all.npz", tmp_path / "some.npz"
    rpil.write(path, demonstrations)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("README.txt", "recorded on Monday")
    find(path).keep(output, KEPT)
    assert_kept(path, output)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("timestamps.npy", b"\x93NUMPY\x03\x00\x10\x00\x00\x00")
    assert rpil.read(path).ids == demonstrations.ids
    assert "timestamps" in formats.read_recording(path).description.ignored


def test_ids_and_path_in_the_wrong_order_are_told(tmp_path, demonstrations):
    formats.write(tmp_path / "all.csv", demonstrations)
    with refused(r"ids are one text, 'some\.csv'; give a sequence of ids, and then the new path"):
        rpil.open(tmp_path / "all.csv").keep("some.csv", [0])
