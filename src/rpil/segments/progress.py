"""Progress: how far a state is from where others end, in rows, learned from the others.

Two forests are fitted to all other demonstrations: whether a state is one in which demonstrations end, and how many rows
lie ahead. In the second, demonstrations count by how much they end where others end, and more rows than a quarter of
the demonstrations need are all one: what goes astray for long tells nothing more.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array, Float, Int
from rpil.segments.settings import SegmentSettings

ENDING_ROWS, LAST_SHARE = 3, 0.1
"""Last rows of a demonstration in which it ends, and the share of the median one that is neither end nor on the way."""


def deal(n: int, settings: SegmentSettings, rng: np.random.Generator) -> Int[Array, " M"]:
    """The fold of each of `n` demonstrations."""
    return np.asarray(rng.permutation(n) % min(settings.n_folds, n))


def rows_ahead(
    demonstrations: Demonstrations, settings: SegmentSettings, rng: np.random.Generator
) -> tuple[Float[Array, " N"], Float[Array, " M"]]:
    """Rows that lie ahead of each state, relative to the first quartile of lengths, and the probability of each last
    state that it is an end, by the other demonstrations."""
    from sklearn.ensemble import ExtraTreesClassifier, ExtraTreesRegressor

    states, lengths, groups = demonstrations.observations, demonstrations.lengths, demonstrations.groups
    ahead = demonstrations.offsets[groups + 1] - 1 - np.arange(len(groups))
    fold = deal(len(lengths), settings, rng)[groups]
    options: dict[str, Any] = {"n_estimators": settings.n_trees, "max_features": 0.5, "random_state": 0}
    ends, last = np.empty(len(groups)), demonstrations.offsets[1:] - 1
    chosen = thinned(ahead >= LAST_SHARE * np.median(lengths), settings.max_rows // 3) | (ahead < ENDING_ROWS)
    for k in range(int(fold.max()) + 1):
        others = chosen & (fold != k)
        forest = ExtraTreesClassifier(min_samples_leaf=3, class_weight="balanced", **options)
        forest.fit(states[others], ahead[others] < ENDING_ROWS)
        ends[fold == k] = forest.predict_proba(states[fold == k])[:, -1]
    short = float(np.quantile(lengths, 0.25))
    target, weight = np.minimum(ahead / short, 1.0), ends[last][groups] + 1e-3
    chosen, out = thinned(np.ones(len(groups), dtype=bool), settings.max_rows), np.empty(len(groups))
    for k in range(int(fold.max()) + 1):
        others = chosen & (fold != k)
        forest = ExtraTreesRegressor(min_samples_leaf=5, **options)
        forest.fit(states[others], target[others], sample_weight=weight[others])
        out[fold == k] = forest.predict(states[fold == k])
    return out, ends[last]


def thinned(chosen: Array, most: int) -> Array:
    """Every second, third and so on of the chosen rows, so that at most so many are left."""
    rows = np.flatnonzero(chosen)
    kept = np.zeros(len(chosen), dtype=bool)
    kept[rows[:: max(1, -(-len(rows) // most))]] = True
    return kept
