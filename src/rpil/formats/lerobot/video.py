"""Video files, by PyAV: frames are copied without a new encoding, counted, and looked at in a few of their pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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

_FRESH = {"h264": (4, 0, (5,)), "hevc": (21, 1, (19, 20))}
"""Where the head of a codec says how long lengths are; the place of the type of a unit, and types of fresh frames."""

PIXELS = 32  # of a frame that are looked at, in each direction
LARGEST_FRAME = 67_000_000  # pixels, each of which takes up to 3 bytes
_AT_ONCE = BoundedSemaphore(2)  # the review may ask for many frames


def load_av() -> ModuleType:
    """The module av; a `MissingExtraError` where it is not installed."""
    module: ModuleType = optional("av", "To read or cut videos", "video")
    return module


@dataclass(frozen=True, eq=False)
class Packets:
    """The P packets of a video in the order of the file, which is that of decoding; each holds one frame."""

    shown: Array  # when a frame is shown, in units, (P,)
    decoded: Array
    is_key: Array  # whether it can be decoded, and followed by others, without those before it
    length: Array  # how long it is shown
    unit: float  # seconds

    @property
    def times(self) -> Array:
        """Seconds at which each frame is shown."""
        return self.shown * self.unit

    @classmethod
    def of(cls, path: Path) -> Packets:
        """Packets of a file; a `DataError` where it is no video, or a damaged one."""
        with _opened(path) as source:
            stream = source.streams.video[0]
            codec, head = stream.codec_context.name, stream.codec_context.extradata or b""
            packets = (packet for packet in source.demux(stream) if packet.size)
            found = [
                (p.pts, p.dts, p.is_keyframe and _is_fresh(bytes(p), codec, head), p.duration or 0) for p in packets
            ]
            shown, decoded, is_key, length = np.array(found, dtype=np.int64).reshape(-1, 4).T
            if not len(shown) or not is_key[0]:
                raise ValueError("it does not begin with a frame")
            return cls(shown, decoded, is_key.astype(bool), length, float(stream.time_base or 0))


def _is_fresh(data: bytes, codec: str, head: bytes) -> bool:
    """Whether a decoder forgets all frames before a key frame: in H.264 and HEVC some are followed by older ones."""
    if codec not in _FRESH or len(head) < 22:
        return True
    first, shift, fresh = _FRESH[codec]
    size, place = (head[first] & 3) + 1, 0  # bytes of the number before each unit
    while place + size < len(data):
        if data[place + size] >> shift & (63 if shift else 31) in fresh:
            return True
        place += size + int.from_bytes(data[place : place + size], "big")
    return False


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


def cut(path: Path, new: Path, spans: Sequence[tuple[float, float]], fps: float) -> list[float]:
    """Copy the frames of a video that are shown within `spans` to the new file `new`, one span after the other.

    Spans are in seconds, and a frame at the end of one belongs to the next. Nothing is encoded again: where the first
    frame of a span needs earlier ones, these are copied with it. Returned are the seconds at which the first frame of
    each span is shown in the new file.
    """
    packets, half = Packets.of(path), 0.5 / fps
    places, runs = list[tuple[int, int, int]](), list[list[int]]()  # with when the first frame is shown; joined
    for start, stop in spans:
        inside = np.flatnonzero((packets.times >= start - half) & (packets.times < stop - half))
        if not len(inside):
            raise DataError(f"{path}: no frame lies between {start:.3f} s and {stop:.3f} s; leave the episode out.")
        first_shown = int(packets.shown[inside].min())
        first = np.flatnonzero(packets.is_key & (packets.shown <= first_shown))[-1]
        places.append((int(first), int(inside.max()) + 1, first_shown))
    for begin, end, _ in sorted(places):
        if runs and begin <= runs[-1][1]:
            runs[-1][1] = max(end, runs[-1][1])
        else:
            runs.append([begin, end])
    # One run after the other is shown later by these units; frames that need others before it are left out.
    wanted, shift = np.zeros_like(packets.is_key), np.zeros_like(packets.shown)
    shown = decoded = 0  # where the next may begin
    for run in (slice(*bounds) for bounds in runs):
        by = shown - int(packets.shown[run][0])
        by = max(by, decoded - int(packets.decoded[run][0])) if wanted.any() else by
        wanted[run], shift[run] = packets.shown[run] >= packets.shown[run][0], by
        shown = int((packets.shown[run] + packets.length[run]).max()) + by
        decoded = int(packets.decoded[run][-1]) + 1 + by
    with guarded(path):
        _copy(path, new, packets, wanted, shift)
    return [(when + int(shift[begin])) * packets.unit for begin, _, when in places]


def _copy(path: Path, new: Path, packets: Packets, wanted: Array, shift: Array) -> None:
    """Copy the `wanted` packets."""
    av = load_av()
    with _open_mp4(path) as source, av.open(str(new), "w", format="mp4") as target:
        stream = source.streams.video[0]
        out = target.add_stream_from_template(stream, opaque=True)  # no encoder is needed
        out.time_base = stream.time_base
        for place, packet in enumerate(packet for packet in source.demux(stream) if packet.size):
            if wanted[place]:
                packet.pts = int(packets.shown[place] + shift[place])
                packet.dts = int(packets.decoded[place] + shift[place])
                packet.stream = out
                target.mux(packet)


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
