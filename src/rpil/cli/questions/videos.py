"""Videos of demonstrations, looked up by number: no name that a browser sends becomes a path."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rpil.data.errors import DataError, MissingExtraError
from rpil.data.folders import check_inside
from rpil.formats.format import Shot
from rpil.formats.lerobot.video import load_av, picture
from rpil.formats.registry import find_format

FRAME_WIDTH = 320
"""Pixels."""

NOT_THERE = "There are no videos of these demonstrations in their folder."


@dataclass(frozen=True)
class EpisodeVideos:
    """Where each camera saw each demonstration, by its number, in the folder `top`."""

    top: Path
    fps: float
    shots: Mapping[int, Sequence[Shot]] = field(default_factory=dict)
    has_frames: bool = False
    """Whether single frames can be shown."""
    note: str = ""
    """A sentence on what cannot be shown, and why."""

    @classmethod
    def of(cls, source: str, ids: Sequence[Hashable], fps: float | None) -> EpisodeVideos:
        """Those of the data at `source`; none where their format has none, or where they are not there."""
        top, shots = Path(source), dict[int, list[Shot]]()
        known = find_format(source) if top.exists() else None
        if known is None or known.shots is None or not fps:
            return cls(top, 1.0, note="These data have no videos.")
        numbers = {str(name): m for m, name in enumerate(ids)}
        try:
            for shot in known.shots(top):
                if str(shot.episode) in numbers and shot.path.is_file():
                    shots.setdefault(numbers[str(shot.episode)], []).append(shot)
        except DataError as error:
            return cls(top, fps, note=f"Videos are not shown. {error}")
        try:
            load_av()
        except MissingExtraError as error:
            return cls(top, fps, shots, False, str(error) if shots else NOT_THERE)
        return cls(top, fps, shots, bool(shots), "" if shots else NOT_THERE)

    def of_one(self, m: int) -> dict[str, object]:
        """The videos of demonstration `m`: the camera, and where in its file in seconds; whether single frames can be
        shown; and the note."""
        found = [
            {"camera": shot.camera, "start": shot.start, "end": min(shot.end, shot.start + shot.n_rows / self.fps)}
            for shot in self.shots.get(m, ())
        ]
        return {"videos": found, "frames": self.has_frames, "note": self.note}

    def file(self, m: int, camera: int) -> Path:
        """The file in which a camera saw demonstration `m`; a `DataError` where there is none, or it lies elsewhere."""
        shot = self._shot(m, camera)
        check_inside(shot.path, self.top)
        if not shot.path.is_file():
            raise DataError(f"{shot.path.name}: this video is not there any more; download it again.")
        return shot.path

    def frame(self, m: int, camera: int, step: int) -> bytes:
        """What a camera saw at a step, as a small JPEG file; a `DataError` where there is no such frame."""
        shot = self._shot(m, camera)
        if not 0 <= step < shot.n_rows:
            raise DataError(f"Demonstration {shot.episode} has no step {step}.")
        return picture(self.file(m, camera), shot.start + step / self.fps, self.fps, FRAME_WIDTH)

    def _shot(self, m: int, camera: int) -> Shot:
        shots = self.shots.get(m, ())
        if not 0 <= camera < len(shots):
            raise DataError("There is no such video.")
        return shots[camera]
