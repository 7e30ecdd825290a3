"""Order, sessions and outcomes of a file: what it states, in memory and on disk, and nothing that it does not."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import lerobot_folders as folders
import rpil
from lerobot_folders import change_info
from problems import refused
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats import read_recording
from rpil.formats.columns import ColumnOptions
from rpil.formats.parquet import fill
from rpil.formats.places import Clock, unit_of
from samples import LENGTHS, OWNERS, STATES, lerobot

SUCCESS = np.array([0, 0, 0, 1, *[0] * 6, *[0] * 4, 1])
"""A flag of which only the last value of each demonstration counts: 1, 0, 1."""


def facts(path, **options):
    return formats.read_recording(path, ColumnOptions(**options)).facts


def written(folder: Path, suffix: str) -> Path:
    """The same columns in every format, with rows of the demonstrations that do not lie together in memory."""
    columns = {"episode": OWNERS, "x": STATES[:, 0], "action": STATES[:, 1], "next.success": SUCCESS}
    columns |= {"reward": np.arange(15.0), "day": np.array(["mon", "tue", "mon"])[OWNERS], "half": np.arange(15) / 2}
    path = folder / f"a.{suffix}"
    if suffix == "npz":
        arrays = {"observations": STATES[:, :1], "actions": STATES[:, 1:], "episode_ids": OWNERS}
        others = {name: columns[name] for name in ("next.success", "reward", "half")}
        np.savez(path, **arrays, **others, day=columns["day"])
    elif suffix == "parquet":
        pq.write_table(pa.table(columns), path, row_group_size=4)
    else:
        pa.csv.write_csv(pa.table(columns), path)
    return path


READS = ["parquet", "csv", "npz"]


@pytest.mark.parametrize("suffix", READS)
def test_outcomes_are_read_when_they_are_named_and_are_no_observations(tmp_path, suffix):
    path = written(tmp_path, suffix)
    rewards = [np.arange(15.0)[m == OWNERS].sum() for m in range(3)]
    for name, expected in (("next.success", [1, 0, 1]), ("reward", rewards), ("length", LENGTHS)):
        np.testing.assert_array_equal(facts(path, outcome=name).outcomes, [expected])
        worse = facts(path, outcome=("length", f"-{name}"))
        np.testing.assert_array_equal(worse.outcomes[1], float(name == "next.success") - np.array(expected))
        assert (worse.outcome_names, worse.outcomes[0].tolist()) == (("length", f"-{name}"), [*LENGTHS])
    assert facts(path).outcomes == ()
    seen = formats.read_recording(path, ColumnOptions(outcome="half"))
    assert "half" not in seen.description.observations
    with refused("'half' is neither .*; write 1 for a success and 0 for a failure, or name .* with outcome="):
        seen.facts  # noqa: B018
    with refused("'nothing'"):
        facts(path, outcome="nothing")


@pytest.mark.parametrize("suffix", READS)
def test_sessions_are_read_and_no_observations(tmp_path, suffix):
    path = written(tmp_path, suffix)
    recording = formats.read_recording(path, ColumnOptions(session="day"))
    assert recording.facts.sessions == ("mon", "tue", "mon")
    assert "day" not in recording.description.observations
    assert facts(path, session="file").sessions == (path.name,) * 3
    assert facts(path).sessions == ()
    with refused("demonstration 0: column 'half' changes"):
        facts(path, session="half")
    with refused("'day' is neither one number for each demonstration, .*, or name another column"):
        facts(written(tmp_path, "csv"), outcome="day")


IDS = np.array([7, 7, 3, 3, 7])  # the rows of one demonstration need not lie together
TIMES = np.array([0.0, 0.1, 5.0, 5.1, 0.2])
IN_ORDER = [0.0, 0.1, 0.2, 5.0, 5.1]
TABLE = pa.table({"episode_index": IDS, "timestamp": TIMES, "observation": TIMES**2, "action": [0, 1, 0, 1, 1]})


def timestamps(path, **options):
    return read_recording(path, **options).times().timestamps


def with_times(values):
    return TABLE.set_column(1, "timestamp", pa.array(values))


def test_timestamps_come_in_the_order_of_the_demonstrations(tmp_path):
    pa.csv.write_csv(TABLE, tmp_path / "a.csv")
    arrays = {"observations": TIMES[:, None], "actions": np.array([0, 1, 0, 1, 1]), "timestamps": TIMES}
    np.savez(tmp_path / "a.npz", episode_ids=IDS, **arrays)
    for name in ("a.csv", "a.npz"):
        np.testing.assert_allclose(timestamps(tmp_path / name), IN_ORDER, atol=1e-12)


@pytest.mark.parametrize("unit", ["ms", "ns"])
def test_timestamps_are_in_seconds(tmp_path, unit):
    times = pa.array((TIMES * (1e3 if unit == "ms" else 1e9)).astype(np.int64))
    pq.write_table(with_times(times).rename_columns(["id", f"time_{unit}", "x", "action"]), tmp_path / "a.parquet")
    np.testing.assert_allclose(timestamps(tmp_path / "a.parquet"), IN_ORDER, atol=1e-9)
    typed = with_times(times.cast(pa.timestamp(unit))).rename_columns(["id", "recorded", "x", "action"])
    pq.write_table(typed, tmp_path / "b.parquet")
    found = timestamps(tmp_path / "b.parquet", options=ColumnOptions(order="recorded"))
    np.testing.assert_allclose(found, IN_ORDER, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [
        ("time", [0.0, 0.5], 1.0),
        ("time", [0.0, 1.0], None),  # whole numbers may count anything
        ("time", [0, 1], None), ("x", [0.0, 0.5], None), ("stamp_ms", [0, 1], 1e-3), ("ms", [0, 1], None),
        *(("x", [0, 17 * 10**n], unit) for n, unit in ((8, None), (11, 1e-3), (14, 1e-6), (17, 1e-9))),
    ],
)  # fmt: skip
def test_the_unit_of_a_time_is_known_by_its_name_or_its_size(name, values, unit):
    assert unit_of(name, pa.array(values).type, np.array(values)) == unit


def test_a_clock_that_goes_back_tells_no_time():
    for ticks, told in (([0.0, 1, 2, 3], (2.0, 1.0)), ([0.0, 1, 3, 2], (None, None))):
        assert Clock(np.array(ticks), 1.0).seconds(np.array([0, 2, 4])) == told


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:2776b1487c\nsize 82515\n"


def without_videos(root, version):
    """Three episodes of version 2 with a file each, or of version 3."""
    return folders.write(root, (5, 6, 7), version, cameras=())


@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
@pytest.mark.parametrize("empty", ["removed", "emptied"])
def test_meta_without_data_is_said(tmp_path, version, empty):
    root = without_videos(tmp_path / "drive", version)
    shutil.rmtree(root / "data")
    if empty == "emptied":
        (root / "data").mkdir()
    for use in (rpil.read, rpil.open):
        with pytest.raises(DataError, match=r"data set of LeRobot of 3 episodes, and no Parquet file is in data"):
            use(root)


def test_pointers_of_git_lfs_are_named(tmp_path):
    root = without_videos(tmp_path / "drive", "v2.1")
    for file in [*(root / "data").rglob("*.parquet"), *(root / "meta").glob("*.jsonl")]:
        file.write_bytes(POINTER)
    with pytest.raises(DataError, match=r"episode_000000\.parquet: it is a pointer of Git LFS"):
        formats.read_recording(root)
    (tmp_path / "lift.npz").write_bytes(POINTER)
    with pytest.raises(DataError, match="pointer of Git LFS"):
        rpil.read(tmp_path / "lift.npz")


def test_numbers_as_text_and_nested_names_are_read(tmp_path):
    root = lerobot(tmp_path)
    features = {name: {"shape": [2], "names": [["a", "b"]]} for name in ("observation.state", "action")}
    change_info(root, fps="25", total_frames="15", features=features)
    description = formats.read_recording(root).description
    note = "25 frames a second are declared, and count here; by the timestamps it is 30."
    assert (description.fps, description.notes) == (25, (note,))
    assert description.observations == ("state.a", "state.b")


def test_paths_are_filled_without_running_what_they_say():
    template = "videos/chunk-{chunk_index:03d}/{video_key}/{episode_index}.mp4"
    assert fill(template, 7, 12, "front") == "videos/chunk-007/front/12.mp4"
    for template in ("{file_index.__class__}", "{file_index:0999999999d}", "{file_index!r}"):
        assert fill(template, 1, 1) == template
    with pytest.raises(KeyError):
        fill("{secret}", 1, 1)
