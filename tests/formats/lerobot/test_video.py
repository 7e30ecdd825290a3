"""Videos, of which one file alone is opened, whatever is in it."""

import numpy as np
import pytest

import lerobot_folders as folders
from rpil.data.errors import DataError
from rpil.formats.lerobot.checked_folder import find_defects
from rpil.formats.lerobot.video import frame_times, look, picture
from rpil.formats.registry import find

pytest.importorskip("av", reason="needs the extra video")

LISTS = {
    "ffconcat": "ffconcat version 1.0\nfile 'other.mp4'\n",
    "m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:1,\nother.mp4\n#EXT-X-ENDLIST\n",
}


@pytest.mark.parametrize("kind", LISTS)
@pytest.mark.parametrize("is_link", [False, True])
def test_a_list_of_other_files_is_no_video(tmp_path, kind, is_link):
    secret, other = tmp_path / "secret.mp4", tmp_path / "drive" / "other.mp4"
    folders.write_video(secret, folders.pictures(0, 5), "libx264", {"g": "2"})
    other.parent.mkdir()
    if is_link:
        other.symlink_to(secret)
    else:
        other.write_bytes(secret.read_bytes())
    path = other.with_name("video.mp4")
    path.write_text(LISTS[kind])
    for use in (frame_times, look):
        with pytest.raises(DataError, match=r"video\.mp4: it is no video, or a damaged one"):
            use(path)
        assert len(use(other)) > 0


def test_a_video_whose_table_of_sizes_is_wrong_is_damaged(tmp_path):
    """FFmpeg then says that something is not permitted; the file may be read, and permissions are no remedy."""
    path = tmp_path / "a.mp4"
    folders.write_video(path, folders.pictures(0, 5), "libx264", {"g": "2"})
    path.write_bytes(path.read_bytes().replace(b"stsz", b"free"))
    for use in (frame_times, lambda path: picture(path, 0.1, folders.FPS, 32)):
        with pytest.raises(DataError, match=r"a\.mp4: it is no video, or a damaged one .*download an MP4 file again"):
            use(path)


@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
def test_a_folder_of_videos_may_be_no_link_to_another_place(tmp_path, version):
    root = folders.write(tmp_path / "drive", (5, 6), version)
    (root / "videos").rename(tmp_path / "elsewhere")
    (root / "videos").symlink_to(tmp_path / "elsewhere")
    if version == "v3.0":
        with pytest.raises(DataError, match="it is a link that leads out"):
            find(root).keep(tmp_path / "kept", [0])
    (defect,) = find_defects(root, True)
    assert "it is a link that leads out" in defect.sentence
    assert np.array_equal(sorted(path.name for path in tmp_path.iterdir()), ["drive", "elsewhere"])


@pytest.mark.parametrize("use", [look, lambda path: picture(path, 0.1, folders.FPS, 32)])
def test_frames_that_are_too_large_are_not_decoded(tmp_path, monkeypatch, use):
    folders.write_video(tmp_path / "a.mp4", folders.pictures(0, 5), "libx264", {"g": "2"})
    monkeypatch.setattr("rpil.formats.lerobot.video.LARGEST_FRAME", 64 * 48 - 1)
    with pytest.raises(DataError, match=r"a\.mp4: its frames have 64 x 48 pixels"):
        use(tmp_path / "a.mp4")
