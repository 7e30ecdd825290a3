"""From a score or weights to a deed: `COLUMNS[name](case)` says how demonstrations rank, and what a learner is given.

A column of a peer keeps the 60 % with the highest scores, unless its paper has a weight for each step or changes
actions. A column that was told answers is scored on the other demonstrations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType

import numpy as np

from rpil import Audit, Demonstrations

from .ours import COUNTS, Case
from .peers import PEERS

SHARE = 0.6
"""Of the demonstrations, kept by score."""


@dataclass(frozen=True, eq=False)
class Deed:
    """What a column makes of a draw."""

    score: np.ndarray
    """(M,), higher is better."""
    weights: np.ndarray
    """(N,) for training."""
    told: tuple[str, ...] = ()
    """Ids of the demonstrations about which it was told."""
    corrected: Demonstrations | None = None
    """The demonstrations with other actions, where the method changes these."""


def best(score: np.ndarray, lengths: np.ndarray, share: float = SHARE) -> np.ndarray:
    """A weight of 1 for each step of the share with the highest scores, of at least one demonstration."""
    order = np.argsort(-score, kind="stable")[: max(round(share * len(score)), 1)]
    return np.repeat(np.isin(np.arange(len(score)), order).astype(float), lengths)


def by_peer(peer: ModuleType, case: Case) -> Deed:
    answers = case.random_answers(getattr(peer, "N_ANSWERS", 0))
    given = case.made, answers, case.seed
    score = np.asarray(peer.score(*given), dtype=float)
    if hasattr(peer, "corrected"):
        return Deed(score, np.ones(case.data.n_steps), corrected=peer.corrected(*given))
    weights = peer.weights(*given) if hasattr(peer, "weights") else best(score, case.data.lengths)
    return Deed(score, np.asarray(weights, dtype=float), tuple(answers))


def by_keep(case: Case) -> Deed:
    return Deed(case.audit.log_odds, case.kept(case.audit))


def by_share(case: Case) -> Deed:
    return Deed(case.audit.log_odds, best(case.audit.log_odds, case.data.lengths))


def by_ranges(case: Case) -> Deed:
    return Deed(case.audit.log_odds, case.ranges())


def by_weights(case: Case) -> Deed:
    audit = case.learned()
    return Deed(audit.log_odds, np.asarray(audit.step_weight))


def by_answers(count: int, asked: bool, weighs: bool, case: Case) -> Deed:
    audit: Audit = case.answered(count, asked)
    weights = np.asarray(audit.step_weight) if weighs else case.kept(audit)
    told = np.flatnonzero(audit.answers.labels).tolist()
    return Deed(audit.log_odds, weights, tuple(str(audit.ids[m]) for m in told))


OURS: dict[str, Callable[[Case], Deed]] = {
    "rpil keep": by_keep,
    "RPIL() weights": by_weights,
    "rpil ranges": by_ranges,
    "rpil best 60 %": by_share,
    **{
        f"rpil {count} {way}": partial(by_answers, count, way == "asked", False)
        for count in COUNTS
        for way in ("asked", "random")
    },
    "rpil 8 asked, weights": partial(by_answers, 8, True, True),
}
FIRST, *OTHERS, LAST = PEERS
COLUMNS: dict[str, Callable[[Case], Deed]] = {
    FIRST: partial(by_peer, PEERS[FIRST]),
    **OURS,
    **{name: partial(by_peer, PEERS[name]) for name in [*OTHERS, LAST]},
}


def auroc(deed: Deed, case: Case) -> float | None:
    """Of good against bad demonstrations that it was not told of; None where one sort is missing."""
    rest = np.array([str(name) not in deed.told for name in case.data.ids])
    good, score = case.made.good[rest].astype(bool), deed.score[rest]
    if not (good.any() and not good.all()):
        return None
    return float(((score[good, None] > score[~good]) + 0.5 * (score[good, None] == score[~good])).mean())
