"""Recorded material of demonstrations: curves of actions and observations, and videos, looked up by number, so that no
name that a browser sends becomes a path."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

from rpil.data.demonstrations import Block, Demonstrations
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import check_inside
from rpil.data.text import printable
from rpil.formats.dataset import Dataset
from rpil.formats.format import Shot
from rpil.formats.lerobot.video import load_av, picture
from rpil.formats.registry import find_format
from rpil.numerics.types import Array, Float
from rpil.results.html.page import View, packed, significant
from rpil.results.judged import bin_means, bin_starts

MAX_CURVES = 200
"""Columns that a page can draw: the parts of the action, and the first observations."""

N_SPREAD = 30
"""Demonstrations in which the spread of a column is measured, evenly spaced: all of many would take long to read."""

N_POINTS = 48
"""Points of a curve where one column of all demonstrations is drawn."""

CUT = 0.005
"""Share of the values at either end that are drawn at the edge, so that one spike does not flatten all others."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """The columns of demonstrations."""

    data: Demonstrations | Dataset

    @cached_property
    def columns(self) -> list[View]:
        """Each column's name, whether it is of the action, the spread of its values, and its classes, if any."""
        data = self.data
        actions = data.action_names or [f"action {k}" for k in range(data.n_actions)] or ["action"]
        names = [*actions, *data.observation_names][:MAX_CURVES]
        some = data.select(np.unique(np.linspace(0, len(data) - 1, N_SPREAD).round().astype(int)))
        with np.errstate(all="ignore"):  # of the largest numbers it may be infinite, which JSON is not
            spread = [float(np.nan_to_num(self._values(some, k).std())) for k in range(len(names))]
        return [
            {"name": printable(name), "is_action": k < len(actions), "spread": significant(spread[k])}
            | {"classes": [printable(one) for one in data.classes.tolist()] if k < len(actions) else []}
            for k, name in enumerate(names)
        ]

    def curves(self, m: int) -> list[View]:
        """The columns of demonstration `m`, each packed by itself; of classes their numbers."""
        one, curves = self.data.select([m]), []
        for k, column in enumerate(self.columns):
            values = self._values(one, k)
            binned = values[bin_starts(len(values))] if column["classes"] else bin_means(values)
            curves.append(packed({"value": binned}))
        return curves

    def column(self, k: int) -> View:
        """Column `k` of every demonstration, on one scale, by number as text; see `rpil.results.html.page.packed`."""
        if not 0 <= k < len(self.columns):
            raise DataError("There is no such column.")
        curves: list[Array] = []
        for block in chain.from_iterable(self.data.shards()):
            for own in np.split(self._values(block, k), block.offsets[1:-1]):
                curves.append(own[np.linspace(0, len(own) - 1, N_POINTS).astype(int)])
        low, high = np.nanquantile(curves, (CUT, 1 - CUT)).tolist()
        return packed({str(m): own for m, own in enumerate(curves)}, (low, high))

    def _values(self, some: Block | Demonstrations, k: int) -> Float[Array, " N"]:
        """Column `k` of some of the data: first come the parts of the action, then the observations."""
        n_parts = max(self.data.n_actions, 1)
        if k >= n_parts:
            return some.observations[:, k - n_parts].astype(float)
        actions = np.searchsorted(self.data.classes, some.actions) if self.data.is_discrete else some.actions
        return actions.reshape(len(actions), -1)[:, k].astype(float)


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
        """Videos of the data at `source`; none where their format has none, or where they are not there."""
        top, shots = Path(source), dict[int, list[Shot]]()
        known = find_format(source) if top.exists() else None
        if known is None or known.shots is None or not fps:
            return cls(top, 1.0, note="These data have no videos.")
        numbers = {str(name): m for m, name in enumerate(ids)}
        try:
            for shot in known.shots(top):
                if str(shot.episode) in numbers and shot.path.is_file():
                    shots.setdefault(numbers[str(shot.episode)], []).append(shot)
            if shots:
                load_av()
        except DataError as error:
            return cls(top, fps, note=f"Videos are not shown. {error}")
        except MissingExtraError as error:
            return cls(top, fps, shots, note=str(error))
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
        """A camera's picture at a step, as a small JPEG file; a `DataError` where there is no such frame."""
        shot = self._shot(m, camera)
        if not 0 <= step < shot.n_rows:
            raise DataError(f"Demonstration {shot.episode} has no step {step}.")
        return picture(self.file(m, camera), shot.start + step / self.fps, self.fps, FRAME_WIDTH)

    def _shot(self, m: int, camera: int) -> Shot:
        shots = self.shots.get(m, ())
        if not 0 <= camera < len(shots):
            raise DataError("There is no such video.")
        return shots[camera]
