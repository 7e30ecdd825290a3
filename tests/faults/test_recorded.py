"""Times between frames, numbers of frames, and what is found beside the steps: in files of a folder, and videos."""

import numpy as np
import pytest

import lerobot_folders as folders
import rpil
from recordings import demonstrations, recording
from rpil.data.errors import DataError
from rpil.faults.checking import check
from rpil.faults.recorded import BY_LOOKING, find_frame_times, recorded_time
from rpil.formats.places import Times

DATA, FIVE = demonstrations(recording()), demonstrations(recording(5))
LENGTHS = DATA.lengths.tolist()


def clock(drop=(), data=FIVE, rate=50):
    """Timestamps at 50 frames a second, without those at the (demonstration, step, frames) of `drop`."""
    each = [np.arange(length) / rate for length in data.lengths]
    for m, step, frames in drop:
        each[m][step:] += frames / rate
    return np.concatenate(each)


@pytest.mark.parametrize(
    ("rule", "frames", "words", "severity"),
    [
        ("dropped frames", 3, "about 3 frames missing: 80 ms pass before 0.60 s (usual: 20 ms)", 6),
        ("repeated frames", -0.75, "1 frame too soon: 5 ms pass before 0.60 s (usual: 20 ms)", 1.5),
        ("repeated frames", -3, "time goes back by 0.04 s before 0.60 s (usual: +20 ms)", 6),
        ("dropped frames", np.nan, "the time is missing before 0.60 s (usual: 20 ms)", 2000),
    ],
)
def test_times_that_are_off_are_found(rule, frames, words, severity):
    report = check(FIVE, times=Times(clock([(3, 30, frames)]), 50.0))
    fault = report.findings[0]
    assert (fault.rule, fault.id, fault.first, fault.last) == (rule, 3, 29, 30)
    assert words in fault.sentence
    assert fault.severity == pytest.approx(severity)
    if np.isfinite(frames):
        assert len(report.findings) == 1
        assert (fault.value, fault.threshold) == pytest.approx((20 + 20 * frames, 30 if frames > 0 else 10))
    assert check(FIVE, times=Times(clock(), 50.0)).findings == ()


@pytest.mark.parametrize("step", [1, 2, 30, int(FIVE.lengths[3]) - 1])
def test_frames_are_dropped_in_the_demonstration_that_lacks_them(step, monkeypatch):
    monkeypatch.setattr("rpil.faults.recorded.BLOCK_STEPS", 20)  # of a block, and a sixteenth of those that are usual
    drop = [(3, step, 3), (4, step, 0.4)]  # the second within the limit
    (fault,) = check(FIVE, times=Times(clock(drop), 50.0)).findings
    assert (fault.rule, fault.id, fault.first, fault.last) == ("dropped frames", 3, step - 1, step)
    assert list(find_frame_times(Times(clock(drop)), FIVE, None)) == []
    (fault,) = check(FIVE, times=Times(clock([*drop, (3, 40, 2)]), 50.0)).findings
    assert (fault.last, fault.sentence.partition(":")[0]) == (step, "about 5 frames missing")
    times = clock([(4, 9, 4)])
    np.random.default_rng(0).shuffle(times[FIVE.offsets[3] : FIVE.offsets[4]])  # nothing is missing
    assert [f.id for f in check(FIVE, times=Times(times, 50.0)).findings if f.rule == "dropped frames"] == [4]
    set_back = clock([(3, 9, 4)])
    set_back[FIVE.offsets[3] + 20 : FIVE.offsets[4]] -= 5.0
    assert [f.id for f in check(FIVE, times=Times(set_back, 50.0)).findings if f.rule == "dropped frames"] == [3]


def test_a_clock_that_goes_slower_than_the_others_is_another_frame_rate(monkeypatch):
    own = np.repeat(np.arange(5) == 2, FIVE.lengths)
    for rate, found in ((1.02, [2]), (0.98, [2]), (1.005, [])):
        report = check(FIVE, times=Times(np.where(own, rate, 1.0) * clock(), 50.0))
        assert [f.id for f in report.findings] == found
        assert {f.rule for f in report.findings} <= {"frame rate"}
        if rate == 1.02:
            assert report.findings[0].sentence == "a frame comes every 20.4 ms, and in the others every 20 ms"
            assert report.findings[0].severity > 1
    own |= np.repeat(np.arange(5) == 3, FIVE.lengths)  # two of five: it is not known which is usual
    assert not check(FIVE, times=Times(np.where(own, 1.02, 1.0) * clock(), 50.0)).findings
    monkeypatch.setattr("rpil.faults.recorded.BLOCK_STEPS", 4)  # four of them have one step, which says nothing
    short = demonstrations([(x[:n], u[:n]) for n, (x, u) in zip([1] * 4 + [2] + [150] * 3, recording(8), strict=True)])
    assert recorded_time(times := Times(clock(data=short)), short) == pytest.approx(0.02)
    assert list(find_frame_times(times, short, 0.02)) == []


def test_a_clock_of_whole_seconds_tells_gaps_of_seconds_alone():
    assert not check(FIVE, times=Times(np.floor(clock()), 50.0)).findings
    report = check(FIVE, times=Times(np.floor(clock([(2, 30, 150)])), 50.0))
    assert [(f.rule, f.id) for f in report.findings] == [("dropped frames", 2)]
    assert "coarser" in check(FIVE, times=Times(np.floor(clock()))).not_checked["dropped frames"]


def test_other_numbers_of_frames_than_the_recording_says_are_found():
    frames = dict(enumerate(LENGTHS)) | {5: LENGTHS[5] - 2, 3: 1000, "a": 40, "b": 2}
    many, absent, few = check(DATA, times=Times(frames=frames)).findings
    n, steps = LENGTHS[3], LENGTHS[5]
    assert [fault.severity for fault in (many, absent, few)] == [1001 - n, 43, 3]
    found = [(fault.first, fault.last, fault.value, fault.threshold) for fault in (many, absent, few)]
    assert found == [(0, n - 1, n, 1000), (0, 0, 0, 42), (0, steps - 1, steps, steps - 2)]
    assert many.sentence == f"it has {n} steps, {1000 - n} fewer than the 1,000 that the recording says"
    assert absent.sentence == "the recording names 2 more demonstrations of 42 steps, not in the data: a and b"
    assert few.sentence == f"it has {steps} steps, 2 more than the {steps - 2} that the recording says"


@pytest.mark.parametrize(
    ("timestamps", "said"),
    [
        (clock(data=DATA, rate=18.5), ["declared are 20 frames a second; the timestamps say 18.5"]),
        (clock(data=DATA, rate=20), []),
        (np.floor(clock(data=DATA, rate=20)), []),  # a clock of whole seconds
        (np.floor(clock(data=DATA, rate=20) / 0.03) * 0.03, []),
        (clock([(m, step, 10) for m in range(12) for step in (21, 31)], DATA, 20), []),  # gaps of half a second
        (clock(data=DATA, rate=20) - 0.01 * (np.arange(DATA.n_steps) % 3), []),  # two short steps and a long one
        (None, []),
    ],
)
def test_other_frames_a_second_than_declared_are_one_finding(timestamps, said):
    report = rpil.check(DATA, times=Times(timestamps, 20.0))
    found = [one for one in report.findings if one.rule == "timestamps"]
    assert [one.sentence for one in found] == said
    assert {(one.id, one.first, one.last) for one in found} <= {("", 0, 0)}
    assert report.odd == tuple(dict.fromkeys(one.id for one in report.lines if one.id != ""))


@pytest.mark.parametrize(("n", "n_found"), [(150, 1), (2, 0)])
def test_another_rate_is_known_of_demonstrations_shorter_than_a_second_but_not_of_few_frames(n, n_found):
    """Times go on through all; the first demonstration has one step, of which nothing is known."""
    lengths = [1] + [n] * 4 + [150] * 3
    data = demonstrations([(x[:k], u[:k]) for k, (x, u) in zip(lengths, recording(8), strict=True)])
    report = check(data, times=Times(9.0 + np.arange(data.n_steps) / 1850, 2000.0))
    assert report.counts.get("timestamps", 0) == n_found


def test_findings_of_files_and_videos_are_in_the_same_table(tmp_path):
    pytest.importorskip("av", reason="needs the extra video")
    root = folders.write(tmp_path / "drive", [30] * 5, per_file=1)
    video = folders.videos(root, "v3.0", "front", 1)
    folders.write_video(video, [0 * picture for picture in folders.pictures(0, 30)], "libx264", {"g": "2"})
    folders.change_info(root, total_frames=7)
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
        rpil.check(DATA, video=True)
