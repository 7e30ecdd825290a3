"""Video files, by PyAV: frames are counted, and looked at in a few of their pixels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from threading import BoundedSemaphore
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError, optional
from rpil.data.files import check_readable
from rpil.data.guard import guarded
from rpil.numerics.types import Array

if TYPE_CHECKING:
    from av.container import InputContainer

PIXELS = 32  # of a frame that are looked at, in each direction
LARGEST_FRAME = 67_000_000  # pixels, each of which takes up to 3 bytes
_AT_ONCE = BoundedSemaphore(2)  # the review may ask for many frames


def load_av() -> ModuleType:
    """The module av; a `MissingExtraError` where it is not installed."""
    module: ModuleType = optional("av", "To read videos", "video")
    return module


def frame_times(path: Path) -> Array:
    """Seconds at which the F frames of a video are shown, (F,), in the order of the file.

    No frame is decoded. A `DataError` where it is no video, or a damaged one.
    """
    with _opened(path) as source:
        stream = source.streams.video[0]
        shown = np.array([packet.pts for packet in source.demux(stream) if packet.size], dtype=np.int64)
        if not len(shown):
            raise ValueError("it holds no frame")
        return shown * float(stream.time_base or 0)


@contextmanager
def _opened(path: Path) -> Iterator[InputContainer]:
    fault = "it is no video, or a damaged one", "copy or download an MP4 file again"
    with guarded(path, *fault), _open_mp4(check_readable(path)) as source:
        codec = source.streams.video[0].codec_context
        if codec.width * codec.height > LARGEST_FRAME:
            size = f"{codec.width} x {codec.height} pixels, over {LARGEST_FRAME:,}"
            raise DataError(f"{path}: its frames have {size}; write it with smaller ones.")
        codec.options = {"max_pixels": str(LARGEST_FRAME)}  # where the header says less than there is
        codec.thread_count = 1  # which takes the least work, and memory for one frame
        yield source


def _open_mp4(path: Path) -> InputContainer:
    """The open file: a guess at its kind might take it for a list of other files, which would be opened."""
    source: InputContainer = load_av().open(str(path.absolute()), format="mp4")
    return source


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
