"""Videos of demonstrations: which there are, where they lie, and their frames."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import lerobot_folders
from rpil.cli.questions.session import FRAME_WIDTH, EpisodeVideos
from rpil.data.errors import DataError

av = pytest.importorskip("av")

LENGTHS = [20, 30, 25, 15]


@pytest.fixture(scope="module", params=["v3.0", "v2.1"])
def folder(request, tmp_path_factory):
    # Frames between key frames, some of which are shown in another order than they are stored in.
    options = {"g": "12", "bf": "2", "crf": "18"}
    root = tmp_path_factory.mktemp("frames") / "set"
    return lerobot_folders.write(root, LENGTHS, request.param, cameras=("front", "side"), options=options)


def decoded(picture: bytes):
    codec = av.CodecContext.create("mjpeg", "r")
    return codec.decode(av.Packet(picture))[0].to_ndarray(format="rgb24").astype(float)


def test_the_frame_of_a_step_is_that_of_its_video(folder):
    videos = EpisodeVideos.of(str(folder), (2, 0, 1, 3), lerobot_folders.FPS)
    assert videos.note == ""
    for m, episode in enumerate((2, 0, 1, 3)):
        for camera in range(2):
            made = lerobot_folders.pictures(100 * camera + episode, LENGTHS[episode])
            for step in (0, 1, 7, 13, LENGTHS[episode] - 1):
                found = decoded(videos.frame(m, camera, step))
                assert found.shape == (FRAME_WIDTH * 48 // 64, FRAME_WIDTH, 3)
                found = found[20::40, 20::40].mean(axis=2)  # the middles of the squares
                truth = np.array([frame[4::8, 4::8].mean(axis=2) for frame in made])
                assert np.argmin(np.abs(truth - found).mean(axis=(1, 2))) == step


def test_what_is_not_there_is_said(folder, tmp_path, monkeypatch):
    assert EpisodeVideos.of("d.parquet", (0,), 20.0).note == "These data have no videos."
    assert EpisodeVideos.of("hf://datasets/a/b", (0,), 20.0).note == "These data have no videos."
    videos = EpisodeVideos.of(str(folder), ("no", "such"), 20.0)
    assert videos.note == "There are no videos of these demonstrations in their folder."
    videos = EpisodeVideos.of(str(folder), range(4), 20.0)
    for m, camera, step in ((4, 0, 0), (0, 2, 0), (0, -1, 0), (0, 0, 20), (0, 0, -1)):
        with pytest.raises(DataError):
            videos.frame(m, camera, step)
    monkeypatch.setitem(sys.modules, "av", None)
    without = EpisodeVideos.of(str(folder), range(4), 20.0)
    assert "rpil[video]" in without.note
    assert without.file(0, 0) == videos.file(0, 0), "videos are played all the same"


def test_a_folder_whose_link_leads_out_of_it_shows_none(tmp_path):
    root = lerobot_folders.write(tmp_path / "set", [8, 8])
    (file,) = root.rglob("*.mp4")
    (tmp_path / "secret.mp4").write_bytes(file.read_bytes())
    file.unlink()
    file.symlink_to(tmp_path / "secret.mp4")
    videos = EpisodeVideos.of(str(root), (0, 1), 20.0)
    assert not videos.shots
    assert "leads out of" in videos.note
