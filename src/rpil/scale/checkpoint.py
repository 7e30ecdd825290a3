"""How far the final policy of a long fit is, in a file: after a Ctrl-C it goes on from there, to the same bits."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpil.data.archive import VERSION, Decoder, encode, read_archive, rpil_version, write_archive
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.numerics.types import Array
from rpil.scale.ascent import AscentState

SCHEMA = "rpil checkpoint"


@dataclass(frozen=True)
class Checkpoint:
    """The file of a fit, and what it must have been fitted to.

    Attributes
    ----------
    path : Path
    fingerprint : str
        Of settings and data.
    """

    path: Path
    fingerprint: str

    @classmethod
    def of(cls, path: StrPath, settings: str, arrays: Iterable[Array]) -> Checkpoint:
        """The checkpoint of a fit with such `settings` to such data."""
        digest = hashlib.sha256(settings.encode())
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        return cls(Path(path), digest.hexdigest())

    def keep(self, polished: AscentState) -> None:
        """Write where the passes are."""
        arrays: dict[str, Array] = {}
        header = {
            "schema": SCHEMA,
            "version": VERSION,
            "rpil": rpil_version(),
            "fingerprint": self.fingerprint,
            "polished": encode(polished, "polished", arrays),
        }
        write_archive(self.path, header, arrays)

    def read(self) -> AscentState | None:
        """What `keep` wrote last; None where there is no file.

        Raises
        ------
        DataError
            Where the file is of another fit, or damaged.
        """
        if not self.path.exists():
            return None
        header, arrays = read_archive(self.path, SCHEMA, "it is no checkpoint of rpil; choose another name")
        if header.get("fingerprint") != self.fingerprint:
            raise DataError(f"{self.path}: it is of other data, or other settings; delete it to start anew.")
        try:
            polished = Decoder(arrays).value(header["polished"])
            if not isinstance(polished, AscentState):
                raise TypeError(type(polished))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise DataError(f"{self.path}: its parts do not belong together; delete it to start anew.") from error
        return polished

    def done(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)
