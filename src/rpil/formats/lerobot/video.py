"""Video files, by PyAV: frames are counted, looked at in a few of their pixels, and compared with the rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from threading import BoundedSemaphore
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import spans
from rpil.data.errors import DataError, guarded, optional
from rpil.data.files import check_readable
from rpil.data.text import duration
from rpil.formats.format import Defect, Shot
from rpil.numerics.types import Array

if TYPE_CHECKING:
    from av.container import InputContainer

PIXELS = 32  # of a frame that are looked at, in each direction
LARGEST_FRAME = 67_000_000  # pixels, each of which takes up to 3 bytes
_AT_ONCE = BoundedSemaphore(2)  # the review may ask for many frames

NEAR_SECONDS = 1e-4
"""Seconds by which a timestamp may differ from a frame: LeRobot loads no others."""

DARK = 32  # brightness, of 0 to 255, that no pixel of a black frame exceeds
SAME_MEAN, SAME_MOST = 0.5, 8  # change of brightness, of all pixels and of one, below which a frame repeats the other
LEAST_SAME = 0.8  # of the frames of a run, that repeat the one before
FROZEN_SECONDS = 1.0  # for which a picture may stay the same
REST = 0.05  # of the range of a joint: less is no motion
TIMES_USUAL = 3.0  # by which an episode must exceed the upper quartile of the others
LEAST_EPISODES = 4  # to know what is usual


def load_av() -> ModuleType:
    """The module av; a `MissingExtraError` where it is not installed."""
    module: ModuleType = optional("av", "To read videos", "video")
    return module


def frame_times(path: Path) -> Array:
    """Seconds at which the F frames of a video are shown, (F,), in the order of the file; none is decoded. A
    `DataError` where it is no video, or a damaged one."""
    with _opened(path) as source:
        stream = source.streams.video[0]
        shown = np.array([packet.pts for packet in source.demux(stream) if packet.size], dtype=np.int64)
        if not len(shown):
            raise ValueError("it holds no frame")
        return shown * float(stream.time_base or 0)


@contextmanager
def _opened(path: Path) -> Iterator[InputContainer]:
    fault = "it is no video, or a damaged one", "copy or download an MP4 file again"
    # A guess at its kind might take it for a list of other files, which would be opened.
    with guarded(path, *fault), load_av().open(str(check_readable(path).absolute()), format="mp4") as source:
        codec = source.streams.video[0].codec_context
        if codec.width * codec.height > LARGEST_FRAME:
            size = f"{codec.width} x {codec.height} pixels, over {LARGEST_FRAME:,}"
            raise DataError(f"{path}: its frames have {size}; write it with smaller ones.")
        codec.options = {"max_pixels": str(LARGEST_FRAME)}  # where the header says less than there is
        codec.thread_count = 1  # which takes the least work, and memory for one frame
        yield source


def look(path: Path) -> tuple[Array, Array]:
    """Seconds at which the F frames of a video are shown, (F,), and some of their pixels, (F, R, C), from 0 to 255."""
    times, pictures = [], []
    with _opened(path) as source:
        for frame in source.decode(source.streams.video[0]):
            if "yuv" not in frame.format.name or frame.format.components[0].bits != 8:
                frame = frame.reformat(format="gray")
            plane = frame.planes[0]
            rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
            rows = rows[: plane.height, : plane.width]
            down, right = (((np.arange(k := min(n, PIXELS)) + 0.5) * n / k).astype(int) for n in rows.shape)
            pictures.append(rows[np.ix_(down, right)])
            times.append(float(frame.time or 0.0))
    return np.array(times), np.array(pictures)


def picture(path: Path, seconds: float, fps: float, width: int) -> bytes:
    """The frame that a video shows at `seconds`, as a JPEG file with `width` pixels in a row; a `DataError` if none."""
    encoder = load_av().CodecContext.create("mjpeg", "w")
    with _AT_ONCE, _opened(path) as source:
        stream = source.streams.video[0]
        source.seek(max(0, int(seconds / float(stream.time_base or 1))), stream=stream)  # to the key frame before
        shown = (frame for frame in source.decode(stream) if float(frame.time or 0.0) > seconds - 0.5 / fps)
        frame = next(shown, None)
        if frame is None:
            raise DataError(f"{path}: it shows no frame at {seconds:.3f} s; copy or download the file again.")
        encoder.width, encoder.height = width, max(2, round(frame.height * width / frame.width))
        encoder.pix_fmt, encoder.time_base = "yuvj420p", Fraction(1)
        small = frame.reformat(encoder.width, encoder.height, encoder.pix_fmt)
        small.pts, small.time_base = 0, encoder.time_base
        return b"".join(bytes(packet) for packet in [*encoder.encode(small), *encoder.encode(None)])


def find_faults(shots: Sequence[Shot], fps: float, states: Mapping[int, Array] | None = None) -> Iterator[Defect]:
    """Videos that are not there, or damaged, and episodes with more or fewer frames than rows; with the `states` of the
    episodes, (N, D) each, also faults of the pictures."""
    by_file = defaultdict[Path, list[Shot]](list)
    for shot in shots:
        by_file[shot.path].append(shot)
    lost = {path for path in by_file if not path.is_file()}
    still = defaultdict[str, dict[int, tuple[int, int]]](dict)
    for camera in sorted({shot.camera for shot in shots}):
        paths = dict.fromkeys(shot.path for shot in shots if shot.camera == camera)
        if missing := [path for path in paths if path in lost]:
            said = f"{len(missing)} of {len(paths)} files are not there, the first is {missing[0]}"
            yield Defect("video file", camera, said)
    for path in [path for path in by_file if path not in lost]:
        own = by_file[path]
        try:
            times, frames = (frame_times(path), None) if states is None else look(path)
        except DataError as error:
            first, last = own[0].episode, own[-1].episode
            yield Defect("video file", str(first) if first == last else f"{first} to {last}", str(error).rstrip("."))
            continue
        for shot in own:
            inside = (times >= shot.start - 0.5 / fps) & (times < shot.end - 0.5 / fps)
            n, name, shown = int(inside.sum()), str(shot.episode), np.sort(times[inside])
            if n != shot.n_rows:
                yield Defect("video frames", name, f"{shot.camera} has {n} frames for {shot.n_rows} rows")
            elif (off := np.abs(shown - shot.start - np.arange(n) / fps).max()) > NEAR_SECONDS:
                said = f"LeRobot cannot load it, for {shot.camera} is up to {off:.3g} s off {fps:.3g} frames a second"
                yield Defect("frame times", name, f"{said}; correct from_timestamp, or write the video again")
            if frames is not None and inside.any():
                is_black = frames[inside].max(axis=(1, 2)) <= DARK
                if is_black.any():
                    since = duration(float(np.argmax(is_black)), 1 / fps)
                    said = f"{shot.camera} is black in {is_black.sum()} frames of {len(is_black)}, from {since}"
                    yield Defect("black frames", name, said)
                if not is_black.all():
                    still[shot.camera][shot.episode] = _stillness(frames[inside], is_black)
    for camera, of_episode in still.items():
        yield from _unchanged(camera, of_episode, fps, states or {})


def _stillness(seen: Array, is_black: Array) -> tuple[int, int]:
    """The longest run of frames that repeat the one before, and its first.

    A codec refines a picture that stays, and renews it at key frames: a few such changes between repeats end no run.
    """
    change = np.abs(np.diff(seen.astype(np.int16), axis=0))
    mean, most = change.mean(axis=(1, 2)), change.max(axis=(1, 2))
    same = (mean <= SAME_MEAN) & (most <= SAME_MOST) & ~is_black[1:]
    small = (mean <= 2 * SAME_MEAN) & (most <= 4 * SAME_MOST)
    moves = (mean > 8 * SAME_MEAN) | (most > 4 * SAME_MOST)
    first = length = 0
    for repeats in (same | (small & (np.convolve(same, [1, 0, 1], "same") == 2)), same):
        first, length = max(((a, b - a) for a, b in spans(repeats)), key=lambda run: run[1], default=(first, length))
        if length and same[first : first + length].mean() >= LEAST_SAME:
            break
    if length and moves.any():  # what comes before it is the same picture, if it differs by less than moving ones do
        off = np.abs(seen[:first].astype(float) - seen[first]).mean(axis=(1, 2)) > 0.5 * np.median(mean[moves])
        before = first - int(np.flatnonzero(np.append(True, off))[-1])
        first, length = first - before, length + before
    return length, first


def _unchanged(
    camera: str, of_episode: Mapping[int, tuple[int, int]], fps: float, states: Mapping[int, Array]
) -> Iterator[Defect]:
    """Frozen frames of a camera, beyond what is usual in it.

    A picture may stay while the joints, of which the `states` are, do not move either.
    """
    runs, firsts = (np.array(values) for values in zip(*of_episode.values(), strict=True))
    usual = TIMES_USUAL * np.quantile(runs, 0.75)
    for k, episode in enumerate(of_episode if len(runs) >= LEAST_EPISODES else ()):
        state = states.get(episode, np.zeros((0, 1)))
        part = state[firsts[k] : firsts[k] + runs[k]]
        rests = len(part) > 0 and (np.ptp(part, axis=0) <= REST * np.ptp(state, axis=0)).all()
        if runs[k] >= FROZEN_SECONDS * fps and runs[k] > usual and not rests:
            words = f"shows one picture for {duration(runs[k], 1 / fps)} from {duration(firsts[k], 1 / fps)} on"
            yield Defect("frozen picture", str(episode), f"{camera} {words}")
