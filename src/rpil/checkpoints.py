"""How far a long fit has come, in a file: after a Ctrl-C it goes on from there, to the same bits."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rpil import __version__
from rpil.demonstrations import Demonstrations
from rpil.em import State
from rpil.errors import DataError
from rpil.passes import Array
from rpil.persistence import VERSION, Decoder, encode, read_archive, write_archive
from rpil.polish import Polished

SCHEMA = "rpil checkpoint"
_NOT_SETTINGS = ("progress", "engine", "checkpoint")


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
    def of(cls, path: Any, model: Any, offsets: Array, few: Demonstrations, labels: Array) -> Checkpoint:
        """For the settings of `model`, and data with such `offsets`, a sample and labels."""
        settings = {name: repr(value) for name, value in model.get_params().items() if name not in _NOT_SETTINGS}
        digest = hashlib.sha256(repr((sorted(settings.items()), few.ids, few.observation_names)).encode())
        for array in (offsets, few.observations, few.actions, labels):
            digest.update(np.ascontiguousarray(array).tobytes())
        return cls(Path(path), digest.hexdigest())

    def keep(self, found: State, competing: Sequence[Array], polished: Polished) -> None:
        """Write what the search found, and where the passes are."""
        arrays: dict[str, Array] = {}
        header = {
            "schema": SCHEMA,
            "version": VERSION,
            "rpil": __version__,
            "fingerprint": self.fingerprint,
            "found": encode(found, "found", arrays),
            "competing": [group.tolist() for group in competing],
            "state": encode(polished.state, "state", arrays),
            "history": encode(polished.history, "history", arrays),
            "converged": polished.converged,
            "anchor": None if polished.anchor is None else encode(polished.anchor, "anchor", arrays),
            "radius": polished.radius if np.isfinite(polished.radius) else None,
        }
        write_archive(self.path, header, arrays)

    def read(self) -> tuple[State, list[Array], Polished] | None:
        """What `keep` wrote last; None where there is no file.

        Raises
        ------
        DataError
            Where the file is of another fit, or damaged.
        """
        if not self.path.exists():
            return None
        header, arrays = read_archive(self.path, SCHEMA, "it is no checkpoint of rpil; choose another name")
        if header["fingerprint"] != self.fingerprint:
            raise DataError(f"{self.path}: it is of other data, or other settings; delete it to start anew.")
        try:
            decoder = Decoder(arrays)
            found, state = decoder.value(header["found"]), decoder.value(header["state"])
            history = decoder.array(header["history"], "iterations", np.float64)
            anchor = None if header["anchor"] is None else decoder.value(header["anchor"])
            radius = np.inf if header["radius"] is None else float(header["radius"])
            competing = [np.array(group, dtype=int) for group in header["competing"]]
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise DataError(f"{self.path}: its parts do not belong together; delete it to start anew.") from error
        return found, competing, Polished(state, history, bool(header["converged"]), radius, anchor)

    def done(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)
