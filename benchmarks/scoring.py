"""AUROC by pairs, its bootstrap, and one random stream for each data set: shared by all scripts."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

N_RESAMPLES = 2000
VERDICTS = ("typical", "open", "unlike")
Array = NDArray[Any]

_WORDS = {"good": "typical", "expert": "typical", "uncertain": "open", "bad": "unlike", "adversary": "unlike"}


def plain_words(verdicts: Iterable[str]) -> list[str]:
    """Verdicts in the words of `VERDICTS`, whatever the anchor of the audit and the version of rpil."""
    return [_WORDS.get(verdict, verdict) for verdict in verdicts]


def truth_words(good: Array) -> Array:
    """The right words for demonstrations that are good, or not."""
    return np.where(good, "typical", "unlike")


def count_words(verdicts: Iterable[str], good: Array) -> tuple[int, int]:
    """The number of demonstrations with a word, and of those with a wrong one."""
    words = np.array(plain_words(verdicts))
    given = words != "open"
    return int(given.sum()), int((given & (words != truth_words(good))).sum())


def pair_wins(good: Array, bad: Array) -> Array:
    """Pairs (G, B): 1 where a good demonstration (G,) scores above a bad one (B,), 1/2 where the scores are equal."""
    return (good[:, None] > bad) + 0.5 * (good[:, None] == bad)


def auroc(good: Array, bad: Array) -> float:
    """The share of pairs in which the good demonstration (G,) scores above the bad one (B,)."""
    return float(pair_wins(good, bad).mean())


def resampled_auroc(wins: Array, rng: np.random.Generator) -> Array:
    """The AUROC of as many good and bad demonstrations, drawn again with replacement, (N_RESAMPLES,)."""
    good, bad = (rng.multinomial(size, np.full(size, 1 / size), N_RESAMPLES) / size for size in wins.shape)
    return ((good @ wins) * bad).sum(axis=1)


def interval(draws: Array) -> list[float]:
    """The 2.5 and 97.5 % quantiles."""
    return [float(end) for end in np.quantile(draws, [0.025, 0.975])]


def stream(seed: int, name: str) -> np.random.Generator:
    """A generator that depends on the data set alone: results do not depend on which other sets are measured."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
