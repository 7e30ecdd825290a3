"""Methods that judge demonstrations, compared on demonstrations of which it is known who is good."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.frames import Backend, DataFrame, data_frame
from rpil.data.id_values import match_labels
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.words import SIDES

N_BOOTSTRAP = 2000
"""Of the bootstrap: enough for two digits of a 95 % interval."""

Method = RPIL | RMEnt | BehavioralCloning | Callable[[Demonstrations], ArrayLike]
Truth = Mapping[Any, bool | str] | Sequence[bool | str] | Array


@dataclass(frozen=True, eq=False)
class Judged:
    """What a method says of M demonstrations."""

    score: Float[Array, " M"]
    """The larger, the better."""
    words: Int[Array, " M"]
    """1 for those that it takes for good, -1 for bad, 0 where it does not say."""


def compare_methods(
    methods: Mapping[str, Method],
    demonstrations: Demonstrations,
    truth: Truth,
    *,
    seed: int = 0,
    backend: Backend | None = None,
) -> DataFrame:
    """Judge demonstrations by each of several methods, and count how often it is right.

    The truth is shown to no method. Estimators are cloned, so that yours stay as they are. `rpil.compare` compares the
    policies that are learned from choices of demonstrations; this compares the judges.

    Parameters
    ----------
    methods : mapping of str to RPIL, RMEnt, BehavioralCloning or function
        A function takes the demonstrations and returns a score for each, (M,), the larger the better. The score of
        `RPIL` is its log-odds, that of `RMEnt` and of `BehavioralCloning`, which trusts all demonstrations alike, the
        mean log-likelihood of the steps of a demonstration under their policy.
    demonstrations : Demonstrations
    truth : mapping of id to bool, or sequence of M bools
        Whether each demonstration is good; the words of labels ("good", "bad") will do. In a mapping those that are not
        known may be left out; they are judged with the others, and not counted.
    seed : int
        Of the bootstrap.
    backend : {"pandas", "polars", "pyarrow"}, optional
        As in `Audit.to_frame`.

    Returns
    -------
    data frame
        A row for each method, with the columns method; auroc, the probability that a good demonstration has a larger
        score than a bad one; auroc_low and auroc_high, its 95 % interval by the bootstrap over good and over bad
        demonstrations, the same resamples for all methods; right and wrong, the demonstrations with a word that is
        true, and false; open, those without; seconds, of the fit. A method that makes no mistake has an interval
        without width, which says little where there are few demonstrations. `RMEnt` trusts a number that was given, so
        each demonstration has a word; `BehavioralCloning` and functions give none.

    Raises
    ------
    DataError
        Without methods, where the truth fits no demonstrations or all are good or all bad, where a method is of
        another kind, or where a function returns no number for a demonstration.

    Examples
    --------
    >>> from rpil import RPIL, BehavioralCloning, RMEnt, compare_methods
    >>> methods = {"RPIL": RPIL(), "RM-ENT": RMEnt(0.5), "all": BehavioralCloning()}
    >>> compare_methods(methods, demonstrations, truth=is_good)    # doctest: +SKIP
    """
    if not isinstance(methods, Mapping) or not methods:
        raise DataError("There are no methods to compare: give a mapping with at least one, by its name.")
    known, is_good = _known(truth, demonstrations)
    rows = []
    for name, method in methods.items():
        begin = perf_counter()
        judged = _judged(str(name), method, demonstrations)
        seconds = perf_counter() - begin
        score, words = judged.score[known], judged.words[known]
        low, high = np.quantile(_auroc(score, is_good, _resamples(is_good, seed)), [0.025, 0.975])
        right = np.where(is_good, words > 0, words < 0)
        rows.append(
            {
                "method": str(name),
                "auroc": float(_auroc(score, is_good, [np.ones(len(score), dtype=int)])[0]),
                "auroc_low": float(low),
                "auroc_high": float(high),
                "right": int(right.sum()),
                "wrong": int(((words != 0) & ~right).sum()),
                "open": int((words == 0).sum()),
                "seconds": seconds,
            }
        )
    return data_frame({column: [row[column] for row in rows] for column in rows[0]}, backend)


def _known(truth: Truth, demonstrations: Demonstrations) -> tuple[Int[Array, " K"], Bool[Array, " K"]]:
    """The numbers of the demonstrations whose truth is known, and whether they are good."""
    ids, source = demonstrations.ids, demonstrations.source
    if not isinstance(truth, Mapping):
        if len(truth) != len(ids):
            raise DataError(
                f"{source}: truth has {len(truth)} values for {len(ids)} demonstrations; give one for each."
            )
        truth = dict(zip(ids, truth, strict=True))
    words = {m: value if isinstance(value, str) else {0: "bad", 1: "good"}.get(value) for m, value in truth.items()}
    unknown = next((m for m, word in words.items() if word is None), None)
    if unknown is not None:
        raise DataError(f"{source}, demonstration {unknown!r}: truth is {truth[unknown]!r}; give True or False.")
    found = match_labels({m: word for m, word in words.items() if word is not None}, ids, source)
    known = np.array(sorted(found), dtype=int)
    is_good = np.array([found[m] for m in known.tolist()], dtype=bool)
    if is_good.all() or not is_good.any():
        raise DataError(f"{source}: truth needs a good and a bad demonstration at least.")
    return known, is_good


def _judged(name: str, method: Method, demonstrations: Demonstrations) -> Judged:
    """What a method says of the demonstrations."""
    no_words = np.zeros(len(demonstrations), dtype=int)
    if isinstance(method, RPIL):
        audit = clone(method).fit(demonstrations).audit_
        sides = {"upper": 1, "open": 0, "lower": -1}
        return Judged(audit.log_odds, np.array([sides[SIDES[verdict]] for verdict in audit.verdicts]))
    if isinstance(method, RMEnt):
        selected = clone(method).fit(demonstrations)
        return Judged(selected.log_likelihood_, np.where(selected.weights_ > 0, 1, -1))
    if isinstance(method, BehavioralCloning):
        log_prob = clone(method).fit(demonstrations).log_prob(demonstrations.observations, demonstrations.actions)
        return Judged(np.add.reduceat(log_prob, demonstrations.offsets[:-1]) / demonstrations.lengths, no_words)
    if not callable(method):
        raise DataError(f"The method {name!r} is a {type(method).__name__}; give an RPIL, an RMEnt or a function.")
    score = np.asarray(method(demonstrations), dtype=float)
    if score.shape != no_words.shape or np.isnan(score).any():
        raise DataError(f"The method {name!r} returned no number for some demonstration; return a score for each.")
    return Judged(score, no_words)


def _auroc(
    score: Float[Array, " K"], is_good: Bool[Array, " K"], counts: Iterable[Int[Array, " K"]]
) -> Float[Array, " R"]:
    """The probability that a good demonstration has a larger score than a bad one, ties by half, in each resample."""
    values, place = np.unique(score, return_inverse=True)
    found = []
    for count in counts:
        good = np.bincount(place, count * is_good, minlength=len(values))
        bad = np.bincount(place, count * ~is_good, minlength=len(values))
        found.append(good @ (np.cumsum(bad) - bad / 2) / (good.sum() * bad.sum()))
    return np.array(found)


def _resamples(is_good: Bool[Array, " K"], seed: int) -> Iterator[Int[Array, " K"]]:
    """How often each demonstration is drawn in each resample, of the good and of the bad ones by themselves."""
    rng = np.random.default_rng(seed)
    for _ in range(N_BOOTSTRAP):
        count = np.zeros(len(is_good), dtype=int)
        for side in (is_good, ~is_good):
            n = int(side.sum())
            count[side] = rng.multinomial(n, np.full(n, 1 / n))
        yield count
