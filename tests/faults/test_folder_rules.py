"""What is found beside the steps: other frames a second than are declared, files of a folder, and videos."""

from __future__ import annotations

import numpy as np
import pytest

import lerobot_folders as folders
import rpil
from recordings import demonstrations, recording
from rpil.data.errors import DataError
from rpil.faults.recorded import BY_LOOKING
from rpil.formats.metadata import Times

CLEAN = recording()
LENGTHS = [len(x) for x, _ in CLEAN]


def stamps(seconds):
    return np.concatenate([np.arange(n) * seconds for n in LENGTHS])


def late(clock):
    """Twice, half a second is missing."""
    return np.concatenate([clock[:n] + 0.5 * (np.arange(n) > 20) + 0.5 * (np.arange(n) > 30) for n in LENGTHS])


@pytest.mark.parametrize(
    ("timestamps", "said"),
    [
        (stamps(1 / 18.5), ["declared are 20 frames a second; the timestamps say 18.5"]),
        (stamps(1 / 20), []),
        (np.floor(stamps(1 / 20)), []),  # a clock of whole seconds
        (late(np.arange(max(LENGTHS)) / 20), []),
        (None, []),
    ],
)
def test_other_frames_a_second_than_declared_are_one_finding(timestamps, said):
    report = rpil.check(demonstrations(CLEAN), times=Times(timestamps, 20.0))
    found = [one for one in report.findings if one.rule == "timestamps"]
    assert [one.sentence for one in found] == said
    assert all(one.id == "" for one in found)
    assert report.odd == tuple(dict.fromkeys(one.id for one in report.lines if one.id != ""))


def test_findings_of_files_and_videos_are_in_the_same_table(tmp_path):
    pytest.importorskip("av", reason="needs the extra video")
    root = folders.write(tmp_path / "drive", [30] * 5, per_file=1)
    video = root / "videos" / "observation.images.front" / "chunk-000" / "file-001.mp4"
    folders.write_video(video, [0 * picture for picture in folders.pictures(0, 30)], "libx264", {"g": "2"})
    place = root / "meta" / "info.json"
    place.write_text(place.read_text().replace('"total_frames": 150', '"total_frames": 7'))
    plain, looked = rpil.check(root), rpil.check(root, video=True)
    assert [(one.rule, one.id) for one in plain.findings if one.rule == "totals"] == [("totals", "")]
    assert {rule.name for rule in BY_LOOKING} <= set(plain.not_checked)
    assert not {rule.name for rule in BY_LOOKING} & set(looked.not_checked)
    table = looked.table()
    assert ("black frames", "1") in [*zip(table["rule"], table["id"], strict=True)]
    assert "totals" in table["rule"]
    assert looked.odd == (1,)
    left_out = rpil.check(root, expected={"totals": ["all"]})
    assert "totals" not in left_out.counts
    assert left_out.n_expected == 1
    with pytest.raises(DataError, match="video= is for folders of LeRobot; leave it out"):
        rpil.check(demonstrations(CLEAN), video=True)
