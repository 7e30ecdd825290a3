"""The state of a long fit in a file, from which an interrupted fit goes on to the same bits."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpil.data.archive import VERSION, Decoder, encode, read_archive, rpil_version, write_archive
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.guard import guarded
from rpil.numerics.types import Array
from rpil.scale.ascent import AscentState

CHECKPOINT_SCHEMA = "rpil checkpoint"


@dataclass(frozen=True)
class Checkpoint:
    """The checkpoint file of a fit."""

    path: Path
    fingerprint: str
    """Digest of the settings and the data of the fit."""

    @classmethod
    def of(cls, path: StrPath, settings: str, arrays: Iterable[Array]) -> Checkpoint:
        """The checkpoint of a fit with such `settings` to such data."""
        digest = hashlib.sha256(settings.encode())
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        return cls(Path(path), digest.hexdigest())

    def keep(self, state: AscentState) -> None:
        """Write the state after a pass."""
        arrays: dict[str, Array] = {}
        header = {
            "schema": CHECKPOINT_SCHEMA,
            "version": VERSION,
            "rpil": rpil_version(),
            "fingerprint": self.fingerprint,
            "state": encode(state, "state", arrays),
        }
        write_archive(self.path, header, arrays)

    def read(self) -> AscentState | None:
        """The state that `keep` wrote last; None where there is no file.

        Raises
        ------
        DataError
            Where the file is of another fit, or damaged.
        """
        if not self.path.exists():
            return None
        header, arrays = read_archive(self.path, CHECKPOINT_SCHEMA, "it is no checkpoint of rpil; choose another name")
        if header.get("fingerprint") != self.fingerprint:
            raise DataError(f"{self.path}: it is of other data, settings or kind of computer; delete it to start anew.")
        with guarded(self.path, "its parts do not belong together", "delete it to start anew"):
            state = Decoder(arrays).value(header["state"])
            if not isinstance(state, AscentState):
                raise TypeError(type(state))
        return state

    def done(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)
