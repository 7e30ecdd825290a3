"""What answers say of demonstrations: Bayesian logistic regression of "good" on channels.

    P(answer r is "yes") = (1 - 2 e) sigma(A_r w) + e,         w ~ sum_d pi_d N(d w_0, Lambda^-1)

A row A_r is (1, x_m) for a label of demonstration m, whose columns x_m are ranks of its channels
(`rpil.inference.channels`), and (0, x_i - x_j) for "i is better than j". "No difference" is half a win of either, t =
1/2 in P(yes)^t P(no)^(1 - t): the model of Davidson (1970) where such answers are rare. Labels of one sort alone, as of
a reference, were chosen for their sort and say nothing of the share of good ones: their rows are (0, x_m). An outcome
is an answer t in [0, 1], the share of the known outcomes that are lower. Outcomes of 0 and 1 are yes by luck in a share
of the bad demonstrations, on a grid from e on: P(1) = (1 - luck - e) sigma(A_r w) + luck. P(good) of a demonstration
whose outcome is known is by its columns and by the outcome. w_0 is 1 on agreement, the first column, `group_weight` on
the group of scores, the last one, and 0 on the others: without answers the ranking is the one by agreement. The
direction d is 1, or -1 where the ones that agree are bad; answers of one side alone cannot tell, and d is 1. e is the
rate of wrong answers, on a grid. For each d, luck and e the posterior of w is Laplace's approximation, and its evidence
weighs it; P(good) integrates over w (MacKay 1992). Channels are correlated, and this posterior is wider than it should
be: so the logit is multiplied by `sharpness`.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit, logsumexp
from scipy.stats import rankdata

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.inference.settings import AnswerSettings
from rpil.numerics.types import Array, Bool, Float, Int


@stored(labels="M", pairs="compared 2", outcome="M", tied="tied 2")
@dataclass(frozen=True, eq=False)
class Answers:
    """What is known of M demonstrations."""

    labels: Int[Array, " M"]
    """1 good, -1 bad, 0 unknown."""
    pairs: Int[Array, "P 2"]
    """The better and the worse demonstration of each pair that was compared."""
    outcome: Float[Array, " M"]
    """Higher is better; NaN where it is unknown."""
    tied: Int[Array, "T 2"] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    """The two demonstrations of each pair without a difference."""
    _flag: bool | None = None
    """Whether outcomes that are means of copies were a flag before; None where the outcomes themselves say so."""

    @classmethod
    def none(cls) -> Answers:
        """Of no demonstrations."""
        return cls.of_labels(np.empty(0, dtype=np.int64))

    @classmethod
    def of_labels(cls, labels: Int[Array, " M"]) -> Answers:
        """Labels alone."""
        return cls(labels, np.empty((0, 2), dtype=np.int64), np.full(len(labels), np.nan))

    @property
    def any(self) -> bool:
        """Whether anything is known."""
        return self.count > 0

    @property
    def count(self) -> int:
        """R, the number of labels, of known outcomes of other demonstrations, and of pairs."""
        return sum(self._counts)

    @property
    def _counts(self) -> list[int]:
        """The numbers of labels, of outcomes of others, of pairs without a difference, and of other pairs."""
        return [int(np.count_nonzero(self.labels)), len(self._graded), len(self.tied), len(self.pairs)]

    def select(self, indices: Sequence[int]) -> Answers:
        """The answers about some of the demonstrations, and about pairs of them."""
        chosen, place = list(indices), np.full(len(self.labels), -1)
        place[chosen] = np.arange(len(chosen))
        pairs, tied = _renumbered(self.pairs, place), _renumbered(self.tied, place)
        return Answers(self.labels[chosen], pairs, self.outcome[chosen], tied)

    @property
    def about(self) -> list[tuple[int, ...]]:
        """The demonstrations that each of the R answers is about, in the order of `rows`."""
        alone = [*np.flatnonzero(self.labels).tolist(), *self._graded.tolist()]
        return [*((m,) for m in alone), *map(tuple, self.compared.tolist())]

    @property
    def compared(self) -> Int[Array, "_ 2"]:
        """The pairs without a difference, and the others."""
        return np.concatenate([self.tied, self.pairs])

    @property
    def _graded(self) -> Int[Array, " _"]:
        """The demonstrations without a label whose outcome is known."""
        return np.flatnonzero(np.isfinite(self.outcome) & (self.labels == 0))

    @property
    def _signs(self) -> Int[Array, " R"]:
        """Of the R answers, 1 for good, -1 for bad, 0 for a pair or an outcome in the middle."""
        graded = np.sign(self.ranks()[self._graded] - 0.5).astype(int)
        return np.concatenate([self.labels[self.labels != 0], graded, np.zeros(len(self.compared), dtype=int)])

    @property
    def are_outcomes(self) -> Bool[Array, " R"]:
        """Which of the R answers are outcomes."""
        return np.repeat([False, True, False, False], self._counts)

    @property
    def say_bad(self) -> Int[Array, " _"]:
        """The numbers of the answers that call a demonstration bad or worse."""
        return np.flatnonzero((self._signs < 0) | (np.arange(self.count) >= self.count - len(self.pairs)))

    @property
    def sides(self) -> set[int]:
        """1 where some demonstration is said to be good or better, -1 where one is bad or worse."""
        return {1, -1} if len(self.pairs) else {*self._signs.tolist()} - {0}

    def only(self, kept: Bool[Array, " R"]) -> Answers:
        """Those of the R answers, in the order of `rows`, that are `kept`."""
        of_labels, of_outcomes, of_tied, of_pairs = np.split(kept, np.cumsum(self._counts[:-1]))
        labels, outcome = self.labels.copy(), self.outcome.copy()
        labels[np.flatnonzero(labels)[~of_labels]] = 0
        outcome[self._graded[~of_outcomes]] = np.nan
        return Answers(labels, self.pairs[of_pairs], outcome, self.tied[of_tied], self.is_flag)

    def once(self, copy_of: Int[Array, " M"]) -> Answers:
        """The answers about the K different demonstrations, where `copy_of` is the first of the copies of each: one
        label, the mean outcome, and pairs of different ones, each once."""
        first, place = np.unique(copy_of, return_inverse=True)
        labels = np.sign(np.bincount(place, self.labels, len(first))).astype(np.int64)
        known = np.isfinite(self.outcome)
        total = np.bincount(place[known], self.outcome[known], len(first))
        count = np.bincount(place[known], minlength=len(first))
        outcome = np.divide(total, count, out=np.full(len(first), np.nan), where=count > 0)
        pairs = np.unique(_renumbered(self.pairs, place), axis=0)
        tied = np.unique(np.sort(_renumbered(self.tied, place)), axis=0)
        return Answers(labels, pairs, outcome, tied, self.is_flag)

    def shared(self, copy_of: Int[Array, " M"]) -> Answers:
        """The same, where a label or an outcome is that of all copies."""
        once, place = self.once(copy_of), np.unique(copy_of, return_inverse=True)[1]
        return Answers(once.labels[place], self.pairs, once.outcome[place], self.tied)

    @property
    def is_flag(self) -> bool:
        """Whether every known outcome is 0 or 1, or the mean of copies of which each is."""
        if self._flag is not None:
            return self._flag
        return {*self.outcome[np.isfinite(self.outcome)].tolist()} <= {0.0, 1.0}

    def ranks(self) -> Float[Array, " M"]:
        """The share of the known outcomes that are lower, ties half, in [0, 1], or a flag itself; NaN where the outcome
        is unknown."""
        ranks, known = np.full(len(self.outcome), np.nan), np.isfinite(self.outcome)
        values = self.outcome[known]
        if self.is_flag:
            ranks[known] = values
        elif known.any():
            ranks[known] = (rankdata(values) - 0.5) / len(values)
        return ranks

    def rows(self, channels: Float[Array, "M C"]) -> tuple[Float[Array, "R D"], Float[Array, " R"]]:
        """The matrix A and the answers t."""
        columns = np.column_stack([np.ones(len(channels)), channels])
        labelled, ranks, known = np.flatnonzero(self.labels), self.ranks(), self._graded
        compared = columns[self.compared[:, 0]] - columns[self.compared[:, 1]]
        if not len(known) and len({*self.labels[labelled].tolist()}) == 1:
            columns[:, 0] = 0.0  # they were chosen for their sort, and do not move the offset
        of_pairs = np.repeat([0.5, 1.0], [len(self.tied), len(self.pairs)])
        targets = [(self.labels[labelled] > 0).astype(float), ranks[known], of_pairs]
        return np.concatenate([columns[labelled], columns[known], compared]), np.concatenate(targets)


def _renumbered(pairs: Int[Array, "P 2"], place: Int[Array, " M"]) -> Int[Array, "_ 2"]:
    """The pairs by the new numbers, `place`: those of two demonstrations of which both have one, none -1."""
    new = place[pairs]
    return np.asarray(new[(new[:, 0] != new[:, 1]) & (new >= 0).all(axis=1)])


def check_copied_labels(
    answers: Answers, copy_of: Int[Array, " M"], ids: Sequence[Hashable], source: str = "the labels"
) -> None:
    """A `DataError` where one copy of a demonstration is labelled good and another one bad."""
    good, bad = (np.flatnonzero(answers.labels == label) for label in (1, -1))
    for m in good[np.isin(copy_of[good], copy_of[bad])].tolist():
        other = bad[copy_of[bad] == copy_of[m]][0]
        raise DataError(
            f"{source}: {ids[m]!r} is labelled good and {ids[other]!r}, a copy of it, bad; change one of the labels."
        )


@dataclass(frozen=True, eq=False)
class Posterior:
    """K normal distributions of w, one for each direction and rate of wrong answers."""

    mean: Float[Array, "K D"]
    covariance: Float[Array, "K D D"]
    log_weight: Float[Array, " K"]
    luck: Float[Array, " K"]
    error: Float[Array, " K"]
    """How often a bad demonstration ends as a good one does, and the rate of wrong answers."""
    sharpness: float
    """See `AnswerSettings`."""
    log_evidence: float
    """log P(answers), nats."""

    def proba(self, channels: Float[Array, "M C"], outcome: Float[Array, " M"] | None = None) -> Float[Array, " M"]:
        """P(good) of each demonstration; where the rank of its `outcome` is known, given how often outcomes
        are wrong."""
        logit_by_channels = self._moderated(np.column_stack([np.ones(len(channels)), channels]))
        if outcome is not None:
            with np.errstate(divide="ignore"):
                said = np.nan_to_num(logit(outcome), posinf=np.inf, neginf=-np.inf)[:, None]
            least, most = np.log(self.error / (1 - self.luck)), np.log((1 - self.error) / self.luck)
            logit_by_channels += np.clip(said, least, most)
        return np.asarray(expit(logit_by_channels) @ np.exp(self.log_weight))

    def proba_of(self, rows: Float[Array, "R D"], targets: Float[Array, " R"]) -> Float[Array, " R"]:
        """P of answers t to the rows A, of which none is wrong; of a tie, its share of the most that it can be."""
        yes = expit(self._moderated(rows)) @ np.exp(self.log_weight)
        is_tie = (rows[:, 0] == 0) & (targets == 0.5)
        return np.asarray(np.where(is_tie, 2 * np.sqrt(yes * (1 - yes)), targets * yes + (1 - targets) * (1 - yes)))

    def _moderated(self, rows: Float[Array, "R D"]) -> Float[Array, "R K"]:
        """The logit of each row and distribution, nearer to 0 the less is known (MacKay 1992)."""
        variance = np.einsum("md,kde,me->mk", rows, self.covariance, rows)
        return np.asarray(self.sharpness * (rows @ self.mean.T) / np.sqrt(1 + np.pi * variance / 8))


def posterior(channels: Float[Array, "M C"], answers: Answers, settings: AnswerSettings) -> Posterior:
    """The posterior of w. Answers of one side contrast nothing: they do not turn the direction. They move w less, and
    so do outcomes of 0 and 1, in which bad demonstrations are often lucky."""
    rows, targets = answers.rows(channels)
    n_columns, one_side, is_outcome = channels.shape[1] + 1, len(answers.sides) < 2, answers.are_outcomes
    flags = answers.is_flag and bool(is_outcome.any())
    weak = one_side or (flags and len(answers.only(~is_outcome).sides) < 2)
    precision = np.full(n_columns, settings.weak_precision if weak else settings.precision)
    precision[0] = settings.offset_precision
    anchor = np.zeros(n_columns)
    anchor[1], anchor[-1] = 1.0, settings.group_weight
    prior = {1.0: 1.0} if one_side else {1.0: settings.p_agreement, -1.0: 1 - settings.p_agreement}
    chances = settings.luck if flags else (0.0,)
    parts = [(d, max(luck, e), e) for d, luck, e in product(prior, chances, settings.error_rates)]
    fits = [_laplace(rows, targets, d * anchor, precision, np.where(is_outcome, luck, e), e) for d, luck, e in parts]
    mean, covariance, evidence = (np.stack(part) for part in zip(*fits, strict=True))
    direction, luck, error = np.array(parts).T
    log_weight = evidence + np.log([prior[d] for d in direction.tolist()])
    total = float(logsumexp(log_weight))
    log_evidence = total - np.log(len(chances) * len(settings.error_rates))
    return Posterior(mean, covariance, log_weight - total, luck, error, settings.sharpness, log_evidence)


def _laplace(
    rows: Array, targets: Array, anchor: Array, precision: Array, luck: Array, error: float
) -> tuple[Array, Array, Array]:
    """Mean and covariance of w, and the log-evidence; an answer is wrongly "yes" at the rate `luck`, (R,), and wrongly
    "no" at the rate `error`."""
    share = 1 - luck - error

    def parts(w: Array) -> tuple[Array, Array]:
        proba = expit(rows @ w)
        yes, no = luck + share * proba, error + share * (1 - proba)
        slope = share * proba * (1 - proba) * (targets / yes - (1 - targets) / no)
        return slope, targets * np.log(yes) + (1 - targets) * np.log(no)

    def loss(w: Array) -> tuple[float, Array]:
        slope, log_prob = parts(w)
        away = w - anchor
        return float(0.5 * precision @ away**2 - log_prob.sum()), precision * away - rows.T @ slope

    found = minimize(loss, anchor, jac=True, method="L-BFGS-B", options={"gtol": 1e-6})
    proba = expit(rows @ found.x)
    # Fisher's information, which is never negative, in the place of the curvature.
    yes = luck + share * proba
    information = (share * proba * (1 - proba)) ** 2 / (yes * (1 - yes))
    hessian = (rows * information[:, None]).T @ rows + np.diag(precision)
    evidence = -found.fun - 0.5 * np.linalg.slogdet(hessian)[1] + 0.5 * np.log(precision).sum()
    return found.x, np.linalg.inv(hessian), np.asarray(evidence)
