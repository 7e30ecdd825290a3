"""Episodes that are kept with their videos: read again in LeRobot's way, frame by frame."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lerobot_folders as folders
from rpil.data.errors import DataError
from rpil.formats.lerobot.checked_folder import find_defects
from rpil.formats.registry import find

pytest.importorskip("av", reason="needs the extra video")

LENGTHS = (9, 12, 7, 10, 8, 11, 6)
REAL = Path(__file__).parents[4] / "shared" / "data" / "formats"


def assert_same(new, old):
    """An episode of the new folder has the frames and numbers of one of the old."""
    assert new.keys() == old.keys()
    for key in new.keys() - {"rows"}:
        assert len(new[key]) == len(old[key])
        for one, other in zip(new[key], old[key], strict=True):
            np.testing.assert_array_equal(one, other)
    for name in ("action", "observation.state"):
        if name in new["rows"].column_names:
            assert new["rows"][name].to_pylist() == old["rows"][name].to_pylist()


def test_frames_of_kept_episodes_are_the_same(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, cameras=("front", "wrist"))
    old = folders.read(root)
    for ids in ([1, 2, 4, 6], [5]):
        output = tmp_path / f"kept{len(ids)}"
        find(root).keep(output, ids)
        new = folders.read(output)
        assert len(new) == len(ids)
        for one, m in zip(new, ids, strict=True):
            assert_same(one, old[m])
        assert len([*output.rglob("*.mp4")]) == 2 * len({m // 3 for m in ids})
        info = json.loads((output / "meta" / "info.json").read_text())
        assert (info["fps"], info["splits"]) == (folders.FPS, {"train": f"0:{len(ids)}"})


def test_statistics_are_those_of_the_kept_and_others_stay(tmp_path):
    root, ids = folders.write(tmp_path / "drive", LENGTHS), [1, 3, 6]
    stats = json.loads((root / "meta" / "stats.json").read_text()) | {"images.gone": {"min": [0]}}
    (root / "meta" / "stats.json").write_text(json.dumps(stats))
    expected = folders.image_statistics([one for m in ids for one in folders.pictures(m, LENGTHS[m])])
    for place in (root / "meta").glob("*.json*"):  # as an editor of Windows saves them
        place.write_text(place.read_text(), encoding="utf-8-sig")
    find(root).keep(tmp_path / "kept", ids)
    found = json.loads((tmp_path / "kept" / "meta" / "stats.json").read_text())
    assert found["images.gone"] == {"min": [0]}
    for name in ("min", "max", "mean", "std", "count"):
        np.testing.assert_allclose(found["observation.images.front"][name], expected[name], rtol=1e-6)
    actions = pq.read_table(tmp_path / "kept" / "data")["action"].to_pylist()
    np.testing.assert_allclose(found["action"]["min"], np.min(actions, axis=0))


def test_episodes_within_each_other_are_sorted(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS)
    old = folders.read(root)
    file = root / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(file)
    pq.write_table(table.take(np.argsort(table["frame_index"].to_numpy(), kind="stable")), file)
    find(root).keep(tmp_path / "kept", [0, 2, 4])
    for one, m in zip(folders.read(tmp_path / "kept"), [0, 2, 4], strict=True):
        assert_same(one, old[m])


def test_videos_that_are_missing_are_named(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS, cameras=("front", "wrist"))
    video = root / "videos/observation.images.wrist/chunk-000/file-001.mp4"
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:27\nsize 82515\n"
    video.write_bytes(pointer)
    with pytest.raises(DataError, match="pointer of Git LFS"):
        find(root).keep(tmp_path / "kept", [0, 4])
    video.write_bytes(b"no video" * 40)
    find(root).keep(tmp_path / "damaged", [0, 4])
    assert any("no video, or a damaged one" in one.sentence for one in find_defects(tmp_path / "damaged", False))
    video.unlink()
    with pytest.raises(DataError, match=r"file-001\.mp4: this video is not there; download it, .* write the list"):
        find(root).keep(tmp_path / "kept", [0, 4])
    find(root).keep(tmp_path / "kept", [0, 1])
    assert len(folders.read(tmp_path / "kept")) == 2


def test_an_episode_in_two_files_is_refused(tmp_path):
    root = folders.write(tmp_path / "drive", LENGTHS)
    first, second, *_ = sorted((root / "data").rglob("*.parquet"))
    moved = (table := pq.read_table(first)).slice(len(table) - 1)
    pq.write_table(table.slice(0, len(table) - 1), first)
    pq.write_table(pa.concat_tables([moved, pq.read_table(second)]), second)
    m = moved["episode_index"][0].as_py()
    said = rf"demonstration {m}: it is both in .*{first.name} and in .*{second.name}; write its rows to one file"
    with pytest.raises(DataError, match=said):
        find(root).keep(tmp_path / "kept", [m])
    folders.change_info(root, total_frames=1)
    assert any("total_frames" in one.sentence for one in find_defects(root, False))


@pytest.mark.parametrize("place", ["../../{video_key}.mp4", "videos/../../secret.mp4"])
def test_no_video_outside_the_folder_is_read(tmp_path, place):
    root = folders.write(tmp_path / "drive", LENGTHS)
    for name in ("observation.images.front.mp4", "secret.mp4"):
        (tmp_path / name).write_bytes(b"key")
        (tmp_path.parent / name).write_bytes(b"key")
    lacks, names = "video_path is not there; write the path", {"features": {"../../x": {"dtype": "video"}}}
    for change, said in (({"video_path": place}, "."), ({"video_path": None}, lacks), (names, "no name of a camera")):
        folders.change_info(root, **change)
        with pytest.raises(DataError, match=said):
            find(root).keep(tmp_path / "kept", [1])


@pytest.mark.skipif(not REAL.is_dir(), reason="needs files of other people's tools")
@pytest.mark.parametrize(("name", "ids"), [("lerobot_v3_video", [1, 2, 7, 11])])
def test_what_lerobot_itself_wrote(tmp_path, name, ids):
    old = folders.read(REAL / name)
    find(REAL / name).keep(tmp_path / "kept", ids)
    new = folders.read(tmp_path / "kept")
    assert len(new) == len(ids)
    for one, m in zip(new, ids, strict=True):
        assert_same(one, old[m])
