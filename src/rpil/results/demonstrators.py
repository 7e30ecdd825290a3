"""The demonstrators of an audit: their demonstrations, and, with answers, the trust in them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from rpil.data.archive import stored
from rpil.data.demonstrator_groups import Demonstrators
from rpil.numerics.types import Array, Float


@stored()
@dataclass(frozen=True)
class Interval:
    """A mean with a 95 % interval."""

    mean: float
    low: float
    high: float


@stored()
@dataclass(frozen=True)
class Demonstrator:
    """A demonstrator who gave several demonstrations; `Audit.verdict_counts` counts their words."""

    name: Hashable
    trust: Interval | None
    """The mean P(good) that is expected of another demonstration of this demonstrator; None without answers."""
    demonstrations: tuple[Hashable, ...]
    """Their ids."""


def rank_demonstrators(
    demonstrators: Demonstrators, trust: Float[Array, "U 3"], ids: Sequence[Hashable]
) -> tuple[Demonstrator, ...]:
    """The demonstrators with a name; `trust` holds the mean and the 95 % interval of each, and then the most trusted is
    the first, or nothing."""
    if not demonstrators.informative:
        return ()
    ranked = []
    for u, name in enumerate(demonstrators.names):
        if name is not None:
            own = tuple(ids[m] for m in np.flatnonzero(demonstrators.index == u).tolist())
            ranked.append(Demonstrator(name, Interval(*map(float, trust[u])) if len(trust) else None, own))
    return tuple(sorted(ranked, key=lambda demonstrator: -demonstrator.trust.mean if demonstrator.trust else 0.0))


def known_demonstrators(found: Sequence[Demonstrator], ids: Sequence[Hashable]) -> Demonstrators:
    """The demonstrators of the demonstrations `ids`, of which those that were `found` have a name."""
    who = {name: one.name for one in found for name in one.demonstrations}
    return Demonstrators.from_names([who.get(name) for name in ids]) if found else Demonstrators()
