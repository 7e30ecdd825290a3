"""The demonstrators of an audit: their demonstrations, with answers the trust in them, and their style in words."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpil.data.archive import stored
from rpil.data.demonstrators import Demonstrators
from rpil.numerics.types import Array, Float, Int
from rpil.results.facts import Fact

STYLES = {
    "pauses": ("fewer pauses", "more pauses"),
    "smoothness": ("less smooth", "smoother"),
    "path": ("a shorter path", "a longer path"),
}
"""The facts that describe a style, and the words for low and high ranks."""

MIN_STYLE_RANK = 0.15
"""Distance of the median rank of a demonstrator from the middle, 1/2, from which a style is named. By hand, not tuned."""

MIN_STYLE_LENGTH = 0.05
"""Distance of the ratio of median lengths from 1, from which it is named. Chosen by hand, not tuned."""


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


def style(lengths: Int[Array, " M"], facts: Mapping[str, Sequence[Fact]], own: Sequence[int]) -> str:
    """How the demonstrations `own` of a demonstrator differ from all in length and in the facts of `STYLES`, in words."""
    ratio = float(np.median(lengths[list(own)]) / np.median(lengths))
    said = []
    if abs(ratio - 1) >= MIN_STYLE_LENGTH:
        said.append(f"{'shorter' if ratio < 1 else 'longer'} ({ratio:.2f} of the median length)")
    for name, (low, high) in STYLES.items():
        rank = float(np.median([facts[name][m] for m in own])) if name in facts else 0.5
        if abs(rank - 0.5) >= MIN_STYLE_RANK:
            said.append(low if rank < 0.5 else high)
    return ", ".join(said) or "like the others"
