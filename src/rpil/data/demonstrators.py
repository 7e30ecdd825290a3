"""Demonstrators: the groups of demonstrations that one person, or one robot, gave."""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.formats.dataset import Dataset
from rpil.data.formats.table import check_ids
from rpil.numerics.types import Array


@dataclass(frozen=True)
class Strangers:
    """It is not known who gave what, or it tells nothing.

    Attributes
    ----------
    said : str
        Why it tells nothing, in one sentence; empty where demonstrators were not given.
    """

    said: str = ""


@dataclass(frozen=True, eq=False)
class Demonstrators:
    """Who gave which demonstration.

    Attributes
    ----------
    of : (M,) int array
        Demonstrator of each demonstration, 0 .. U-1.
    names : tuple
        Of the U demonstrators; None for an unknown one, who gave one demonstration.
    """

    of: Array
    names: tuple[Any, ...]
    said: str = "Demonstrations of one person speak for each other, as far as people were found to differ."

    @cached_property
    def indicator(self) -> Array:
        """1 where demonstrator u gave demonstration m, (U, M)."""
        return (np.arange(len(self.names))[:, None] == self.of).astype(float)

    @property
    def counts(self) -> Array:
        """Demonstrations of each, (U,)."""
        return np.bincount(self.of, minlength=len(self.names))


Company = Demonstrators | Strangers


def company(names: Sequence[Any]) -> Company:
    """Who gave each of M demonstrations, None for an unknown person; `Strangers` where that tells nothing: one gave
    all, or each gave one."""
    people = [(name, m if name is None else -1) for m, name in enumerate(names)]
    distinct = {who: u for u, who in enumerate(dict.fromkeys(people))}
    if len(distinct) == 1:
        return Strangers(f"One demonstrator, {names[0]!r}, gave all demonstrations, so who gave them tells nothing.")
    if len(distinct) == len(people):
        return Strangers("No demonstrator gave two demonstrations, so who gave them tells nothing.")
    return Demonstrators(np.array([distinct[who] for who in people]), tuple(name for name, _ in distinct))


def who_gave(
    demonstrators: Mapping[Any, Any] | Sequence[Any] | Array | None, demonstrations: Demonstrations | Dataset
) -> Company:
    """Who gave each demonstration; a warning where that tells nothing."""
    source, ids = demonstrations.source, demonstrations.ids
    if demonstrators is None:
        return Strangers()
    names: list[Any]
    if isinstance(demonstrators, Mapping):
        known = {str(name): who for name, who in demonstrators.items()}
        check_ids(known, ids, source, "the demonstrators")
        names = [known.get(str(m)) for m in ids]
    else:
        names = np.asarray(demonstrators).tolist() if np.ndim(demonstrators) == 1 else []
        if len(names) != len(ids):
            raise DataError(
                f"{source}: demonstrators has the shape {np.shape(demonstrators)}; give one for each of the {len(ids)} "
                "demonstrations, in their order."
            )
    for m, who in zip(ids, names, strict=True):
        if not isinstance(who, Hashable):
            raise DataError(
                f"{source}, demonstration {m!r}: the demonstrator {who!r} is no name; give text or a number."
            )
    found = company(names)
    if isinstance(found, Strangers):
        warnings.warn(f"{source}: {found.said}", UserWarning, stacklevel=3)
    return found
