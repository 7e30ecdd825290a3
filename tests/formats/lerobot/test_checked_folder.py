"""What LeRobot's `meta` and videos say, against the data: planted faults are found, and nothing in what is right."""

import re
from itertools import cycle

import numpy as np
import pyarrow.parquet as pq
import pytest

import lerobot_folders as folders
from lerobot_folders import change_info
from rpil.data.errors import DataError
from rpil.faults.recorded import OF_FILES
from rpil.formats.lerobot.checked_folder import find_defects, find_shots
from rpil.formats.registry import find

pytest.importorskip("av", reason="needs the extra video")

LENGTHS = (9, 30, 25, 28, 26)
VERSIONS = pytest.mark.parametrize("version", ["v3.0", "v2.1"])


def found(root, look=False):
    return [(one.what, one.place) for one in find_defects(root, look)]


@VERSIONS
def test_nothing_is_found_in_a_folder_that_is_right(tmp_path, version):
    root = folders.write(tmp_path / "drive", LENGTHS, version, ("front", "wrist"))
    assert found(root, look=True) == []
    if version == "v3.0":
        find(root).keep(tmp_path / "kept", [1, 3, 4])
        assert found(tmp_path / "kept", look=True) == []


@pytest.mark.parametrize("size", [0.5, "many", True])
def test_a_size_of_chunks_that_is_none_is_named(tmp_path, size):
    root = folders.write(tmp_path / "drive", LENGTHS)
    change_info(root, chunks_size=size)
    (defect,) = find_defects(root, False)
    assert f"info.json: chunks_size is {size}, no whole number above 0" in defect.sentence
    with pytest.raises(DataError, match=r"info\.json: it cannot be read .*chunks_size"):
        find(root).keep(tmp_path / "kept", [1])


def test_an_episode_table_that_does_not_fit_the_data(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS)
    with folders.changing_episodes(root) as rows:
        rows[1]["length"], rows[2]["dataset_to_index"], rows[3]["data/file_index"] = 3, 1, 0
    assert found(root) == [("episode table", m) for m in "123"]


@pytest.mark.parametrize(("gone", "said"), [((3,), "episode 3 is"), ((0, 2), "episodes 0, 2 are"), ((4,), None)])
def test_episodes_that_lerobot_would_not_find_by_position_are_named(tmp_path, gone, said):
    root = folders.write(tmp_path / "drive", LENGTHS, cameras=(), per_file=1)
    for m in gone:
        (root / "data" / "chunk-000" / f"file-{m:03d}.parquet").unlink()
    n, remedy = 5 - len(gone), "LeRobot looks for episodes and videos by position; number the"
    expected = f"{said} missing of 0-4; {remedy} {n} that are there from 0 to {n - 1}, as rpil keep does"
    sentences = [one.sentence for one in find_defects(root, False) if one.what == "missing episodes"]
    assert sentences == [expected] * bool(said)


@VERSIONS
def test_videos_that_are_missing_damaged_or_too_short(tmp_path, version):
    root = folders.write(tmp_path / "drive", LENGTHS, version, ("front", "wrist"))
    videos = sorted((root / "videos").rglob("*.mp4"))
    front = [file for file in videos if "front" in str(file)]
    front[1].write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    assert found(root) == [("video file", "3 to 4" if version == "v3.0" else "1")]
    front[1].unlink()
    assert found(root) == [("video file", "observation.images.front")]
    frames = [one for m in (range(3) if version == "v3.0" else [0]) for one in folders.pictures(m, LENGTHS[m])]
    folders.write_video(front[0], frames[:-2], "libx264", {"g": "2"})
    assert ("video frames", "2" if version == "v3.0" else "0") in found(root)


def test_black_and_frozen_pictures(tmp_path):
    lengths = (30, 30, 30, 30, 30, 30, 30)
    root = folders.write(tmp_path / "drive", lengths, "v3.0", ("front", "wrist"), per_file=1)
    shots = {key: [folders.pictures(100 * k + 7, 30) for _ in lengths] for k, key in enumerate(("front", "wrist"))}
    for key, own in shots.items():  # a scene of its own, in which a little moves
        scene = own[0][0] // 2
        for m, frames in enumerate(own):
            own[m] = [scene + one // 4 for one in (folders.pictures(10 * m + ord(key[0]), 30))]
            assert len(frames) == 30
    black = np.zeros_like(scene)
    shots["front"][1][5:8] = [black] * 3
    shots["front"][2][4:] = [shots["front"][2][4]] * 26
    for key, own in shots.items():
        for m, frames in enumerate(own):
            folders.write_video(folders.videos(root, "v3.0", key, m), frames, "libx264", {"g": "2", "crf": "20"})
    expected = [("black frames", "1"), ("frozen picture", "2")]
    assert (sorted(found(root, look=True)), found(root)) == (expected, [])


def change_times(root, change):
    """Give the rows other timestamps, by their episode, frame and old timestamp."""
    for file in (root / "data").rglob("*.parquet"):
        table = pq.read_table(file)
        field = table.schema.field("timestamp")
        values = change(*(table[name].to_numpy() for name in ("episode_index", "frame_index", "timestamp")))
        changed = folders.pa.array(values).cast(field.type, safe=False)
        pq.write_table(table.set_column(table.column_names.index("timestamp"), field, changed), file)


SLOW = 20 / 18.5
FAULTY_TIMES = {
    "slow": (lambda m, k, t: t * SLOW, "all 5 episodes", "recorded 18.5; timestamps are up to 0.118 s off"),
    "a step too long": (
        lambda m, k, t: t + 0.013 * ((m == 2) & (k > 9)),
        "episode 2",
        "recorded 19.8; timestamps are up to 0.013 s off",
    ),
    "a drift": (lambda m, k, t: np.where(m == 4, t * 1.0005, t), "episode 4", "up to 0.000625 s off"),
    "missing": (lambda m, k, t: np.where((m == 3) & (k == 5), np.nan, t), "episode 3", "a timestamp is no number"),
    "at rest": (lambda m, k, t: np.where(m == 2, 0.013, t), "episode 2", "time stands still or goes back"),
    "back": (lambda m, k, t: t + 1.013 * ((m == 1) & (k == 3)), "episode 1", "time stands still or goes back"),
}


@pytest.mark.parametrize(("version", "fault"), [*zip(cycle(("v3.0", "v2.1")), FAULTY_TIMES, strict=False)])
def test_times_that_lerobot_does_not_load_are_named(tmp_path, version, fault):
    change, episodes, words = FAULTY_TIMES[fault]
    root = folders.write(tmp_path / "drive", LENGTHS, version)
    change_times(root, change)
    with pytest.raises(AssertionError):
        folders.read(root)  # which demands what LeRobot does
    defect = next(one for one in find_defects(root, False) if one.what == "timestamps")
    assert defect.place == episodes
    assert defect.sentence.startswith("LeRobot cannot load these rows: ")
    assert words in defect.sentence
    assert defect.sentence.endswith("; write frame_index / 20 in their place")


def test_times_without_videos_are_numbers_that_lerobot_does_not_check(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, cameras=())
    change_times(root, lambda m, k, t: t * SLOW + 3)
    (defect,) = (one for one in find_defects(root, False) if one.what == "timestamps")
    assert defect.sentence.startswith("declared are 20 frames a second, recorded 18.5; timestamps are up to ")
    assert "off; LeRobot loads these rows all the same, for they have no videos; write frame" in defect.sentence
    change_times(root, lambda m, k, t: t / SLOW)  # another start is no fault there
    assert "timestamps" not in dict(found(root))


def change_episodes(root, **values):
    place = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(place)
    for name, value in values.items():
        column = f"videos/observation.images.front/{name}"
        changed = folders.pa.array([value] * len(table), table.schema.field(column).type)
        table = table.set_column(table.column_names.index(column), column, changed)
    pq.write_table(table, place)


@pytest.mark.parametrize(("start", "n_kept"), [(None, 5), (np.nan, 2), (-1e300, 5)])  # files are copied, or cut
def test_times_of_videos_that_are_none_are_named_and_nothing_is_kept(tmp_path, start, n_kept):
    root = folders.write(tmp_path / "drive", LENGTHS)
    change_episodes(root, from_timestamp=start)
    assert found(root) == [("metadata", "meta")]
    said = re.escape(f"demonstration 0: from_timestamp is {start}, to_timestamp 0.45; correct them.")
    for use in (find_shots, lambda path: find(path).keep(tmp_path / "kept", range(n_kept))):
        with pytest.raises(DataError, match=said):
            use(root)
    assert [file.name for file in tmp_path.iterdir()] == ["drive"]
    find(root).keep(tmp_path / "kept.json", [1, 2])


def test_frames_between_those_of_the_rows_are_named(tmp_path):
    root = folders.write(tmp_path / "drive", (20, 20), per_file=1)
    change_episodes(root, from_timestamp=0.012, to_timestamp=1.012)
    assert found(root) == [("frame times", "0"), ("frame times", "1")]
    words = "LeRobot cannot load it, for observation.images.front is up to 0.012 s off"
    assert words in find_defects(root, False)[0].sentence


def test_an_end_at_the_last_frame_takes_that_frame(tmp_path):
    """As some programs write it, though LeRobot ends an episode after its last frame."""
    root = folders.write(tmp_path / "drive", LENGTHS, per_file=1)
    with folders.changing_episodes(root) as rows:
        for row in rows:
            row["videos/observation.images.front/to_timestamp"] -= 1 / folders.FPS
    assert found(root) == []
    find(root).keep(tmp_path / "kept", [1, 3])
    assert [len(one["observation.images.front"]) for one in folders.read(tmp_path / "kept")] == [30, 28]


def test_what_the_converter_of_lerobot_needs_is_named(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, "v2.1")
    (root / "meta" / "episodes_stats.jsonl").unlink()
    (defect,) = find_defects(root, False)
    assert (defect.what, defect.place) == ("statistics", "meta/episodes_stats.jsonl")
    assert "LeRobot's converter to version 3.0 needs it" in defect.sentence
    words = next(rule.words for rule in OF_FILES if rule.name == defect.what)
    assert "episodes_stats.jsonl, of version 2.1, is missing" in words
