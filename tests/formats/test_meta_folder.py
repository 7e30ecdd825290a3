"""What LeRobot's `meta` says, where it is incomplete, odd, or not there."""

import shutil

import pytest

import lerobot_folders as folders
import rpil
from lerobot_folders import change_info
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.meta_folder import fill
from samples import lerobot

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


@pytest.mark.parametrize(("n", "words"), [(1, "1 camera is not used: "), (2, "2 cameras are not used: ")])
def test_cameras_that_were_not_used_are_counted(tmp_path, n, words):
    root = lerobot(tmp_path)
    features = {f"observation.images.{k}": {"dtype": ("image", "video")[k]} for k in range(n)}
    change_info(root, features=features)
    assert any(words in note for note in formats.read_recording(root).description.notes)


def test_paths_are_filled_without_running_what_they_say():
    template = "videos/chunk-{chunk_index:03d}/{video_key}/{episode_index}.mp4"
    assert fill(template, 7, 12, "front") == "videos/chunk-007/front/12.mp4"
    for template in ("{file_index.__class__}", "{file_index:0999999999d}", "{file_index!r}"):
        assert fill(template, 1, 1) == template
    with pytest.raises(KeyError):
        fill("{secret}", 1, 1)
