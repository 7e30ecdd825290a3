"""What LeRobot's `meta` and videos say, against the data: planted faults are found, and nothing in what is right."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

import lerobot_folders as folders
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.lerobot.check import find_defects, mend

pytest.importorskip("av", reason="needs the extra video")

LENGTHS = (9, 30, 25, 28, 26)
VERSIONS = pytest.mark.parametrize("version", ["v3.0", "v2.1"])


def found(root, look=False):
    return [(one.what, one.place) for one in find_defects(root, look)]


def change_info(root, **values):
    place = root / "meta" / "info.json"
    place.write_text(json.dumps(json.loads(place.read_text()) | values))


@VERSIONS
def test_nothing_is_found_in_a_folder_that_is_right(tmp_path, version):
    root = folders.write(tmp_path / "drive", LENGTHS, version, ("front", "wrist"))
    assert found(root, look=True) == []
    formats.keep(root, tmp_path / "kept", [1, 3, 4])
    assert found(tmp_path / "kept", look=True) == []
    assert mend(root) == []


def test_totals_and_statistics_are_mended_after_a_backup(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS)
    before = json.loads((root / "meta" / "stats.json").read_text())
    wrong = json.dumps(before | {"action": before["action"] | {"std": [20.0, 20.0]}})
    (root / "meta" / "stats.json").write_text(wrong)
    change_info(root, total_frames=7)
    assert found(root) == [("totals", "meta/info.json"), ("statistics", "meta/stats.json")]
    assert len(mend(root)) == 2
    assert found(root) == []
    assert (root / "meta" / "stats.json.bak").read_text() == wrong
    now = json.loads((root / "meta" / "stats.json").read_text())
    np.testing.assert_allclose(now["action"]["std"], before["action"]["std"])
    assert now["observation.images.front"] == before["observation.images.front"]
    change_info(root, total_episodes=99)
    mend(root)
    assert (root / "meta" / "info.json.bak2").is_file()


@pytest.mark.parametrize("name", ["info.json", "stats.json"])
def test_a_file_that_is_a_link_is_not_mended(tmp_path, name):
    """In the Hub's cache another snapshot may have the same file."""
    root = folders.write(tmp_path / "datasets--me--drive" / "snapshots" / "1f2e", LENGTHS, cameras=())
    stats = json.loads((root / "meta" / "stats.json").read_text())
    (root / "meta" / "stats.json").write_text(json.dumps(stats | {"action": stats["action"] | {"std": [20.0, 20.0]}}))
    change_info(root, total_frames=7)
    blob = tmp_path / "datasets--me--drive" / "blobs" / "0a1b"
    blob.parent.mkdir()
    (root / "meta" / name).rename(blob)
    (root / "meta" / name).symlink_to(blob)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.*") if file.is_file()} | {blob: blob.read_bytes()}
    with pytest.raises(DataError, match=f"{name}: it is a link, and is not mended; mend a copy"):
        mend(root)
    assert {file: file.read_bytes() for file in before} == before
    assert not [*tmp_path.rglob("*.bak")]


def test_frames_before_the_rows_of_a_trimmed_episode_are_no_fault(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, "v2.1", options={"g": "4", "crf": "30"})
    formats.keep(root, tmp_path / "kept", [1, 2], trims={1: (7, 20)})
    file = tmp_path / "kept" / "data" / "chunk-000" / "episode_000000.parquet"
    assert pq.read_table(file)["timestamp"][0].as_py() > 0
    assert found(tmp_path / "kept", look=True) == []
    table = pq.read_table(file)
    later = folders.pa.array(table["timestamp"].to_numpy() + np.float32(2 / folders.FPS))
    pq.write_table(table.set_column(table.column_names.index("timestamp"), "timestamp", later), file)
    assert ("frame count", "0") in found(tmp_path / "kept")


@pytest.mark.parametrize("size", [0.5, 0, -3, 1.5, "many", True, None])
def test_a_size_of_chunks_that_is_none_is_named(tmp_path, size):
    root = folders.write(tmp_path / "drive", LENGTHS, "v2.1")
    change_info(root, chunks_size=size)
    (note,) = [text for text in formats.read_recording(root).description.notes if "meta" in text]
    assert "cannot be used: chunks_size." in note
    (defect,) = find_defects(root, False)
    assert f"info.json: chunks_size is {size}, no whole number above 0" in defect.sentence
    with pytest.raises(DataError, match=r"info\.json: it cannot be read .*chunks_size"):
        formats.keep(root, tmp_path / "kept", [1])


def test_totals_of_a_partial_download_are_named_and_left(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, "v2.1")
    (root / "data" / "chunk-000" / "episode_000003.parquet").unlink()
    assert ("episode table", "meta") in found(root)
    assert mend(root) == []


def test_an_episode_table_that_does_not_fit_the_data(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS)
    place = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    rows = pq.read_table(place).to_pylist()
    rows[1]["length"], rows[2]["dataset_to_index"], rows[3]["data/file_index"] = 3, 1, 0
    pq.write_table(folders.pa.Table.from_pylist(rows), place)
    assert found(root) == [("episode table", m) for m in "123"]


def test_metadata_that_cannot_be_used_do_not_stop_the_others(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, "v2.1")
    change_info(root, chunks_size="many", total_frames=3)
    assert found(root) == [("totals", "meta/info.json"), ("metadata", "meta")]
    (root / "meta" / "episodes.jsonl").write_text("{")
    assert set(found(root)) == {("metadata", "meta")}


@VERSIONS
def test_videos_that_are_missing_damaged_or_too_short(tmp_path, version):
    root = folders.write(tmp_path / "drive", LENGTHS, version, ("front", "wrist"))
    videos = sorted((root / "videos").rglob("*.mp4"))
    front = [file for file in videos if "front" in str(file)]
    front[1].write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    assert [what for what, _ in found(root)] == ["video file"]
    front[1].unlink()
    assert found(root) == [("video file", "observation.images.front")]
    frames = [one for m in (range(3) if version == "v3.0" else [0]) for one in folders.pictures(m, LENGTHS[m])]
    folders.write_video(front[0], frames[:-2], "libx264", {"g": "2"})
    assert ("frame count", "2" if version == "v3.0" else "0") in found(root)


@VERSIONS
def test_black_frozen_repeated_and_exchanged_pictures(tmp_path, version):
    lengths = (30, 30, 30, 30, 30, 30, 30)
    root = folders.write(tmp_path / "drive", lengths, version, ("front", "wrist"), per_file=1)
    shots = {key: [folders.pictures(100 * k + 7, 30) for _ in lengths] for k, key in enumerate(("front", "wrist"))}
    for key, own in shots.items():  # a scene of its own, in which a little moves
        scene = own[0][0] // 2
        for m, frames in enumerate(own):
            own[m] = [scene + one // 4 for one in (folders.pictures(10 * m + ord(key[0]), 30))]
            assert len(frames) == 30
    black = np.zeros_like(scene)
    shots["front"][1][5:8] = [black] * 3
    shots["front"][2][4:] = [shots["front"][2][4]] * 26
    shots["wrist"][3] = [shots["wrist"][3][k - k % 2] for k in range(30)]
    shots["front"][4], shots["wrist"][4] = shots["wrist"][4], shots["front"][4]
    for key, own in shots.items():
        for m, frames in enumerate(own):
            folder = root / "videos"
            name = f"observation.images.{key}"
            place = folder / name / f"chunk-000/file-{m:03d}.mp4"
            place = place if version == "v3.0" else folder / f"chunk-000/{name}/episode_{m:06d}.mp4"
            folders.write_video(place, frames, "libx264", {"g": "2", "crf": "20"})
    expected = [("black frames", "1"), ("exchanged cameras", "4"), ("frozen picture", "2"), ("repeated frames", "3")]
    assert sorted(found(root, look=True)) == expected
    assert found(root) == []
