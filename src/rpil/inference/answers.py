"""What answers say of demonstrations: Bayesian logistic regression of "good" on the columns of demonstrations.

    P(answer r is "yes") = l_r + (1 - l_r - e) sigma(A_r w),         w ~ N(w_0, Lambda^-1)

A row A_r is (1, x_m) for a label of demonstration m, whose columns x_m are those of `rpil.inference.channels`, and
(0, x_i - x_j) for "i is better than j"; "no difference" is half a win of either (Davidson 1970). An outcome is an
answer t in [0, 1], the share of the known ones that are lower. w_0 says that those that agree are good: it is
`by_ranking` on the first column, the ranking, and `by_group` on the last one, the group of scores. Answers of one side
move the offset alone. e is the rate of wrong answers; l_r is e too, or the share of the bad demonstrations whose
outcome of 1 is luck, on a grid: the posterior of w is Laplace's approximation for each, weighed by its evidence (MacKay
1992).

Answers give verdicts only where they predict each other: each is predicted by the others, which explain at least
`min_explained` of the log-loss that the share of good ones leaves. docs/model.md has the formulas.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit, logit, softmax

from rpil.data.archive import array_field, stored
from rpil.data.errors import DataError
from rpil.inference.settings import AnswerSettings
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Bool, Float, Int

NOTHING = 1e6
"""Precision of weights that are 0."""
BOUND = 0.02
"""Probabilities of answers stay so far from 0 and 1 where their losses are compared: one surprise is not all."""
MAX_ITER, TOL, MIN_STEP = 50, 1e-8, 1e-3
"""Iterations at most, the gain in nats at which they stop, and the least share of a step."""


def no_pairs() -> Int[Array, "0 2"]:
    """Nothing was compared."""
    return np.empty((0, 2), dtype=np.int64)


@stored()
@dataclass(frozen=True, eq=False)
class Answers:
    """What is known of M demonstrations."""

    labels: Int[Array, " M"] = field(metadata=array_field("M", np.int64))
    """1 good, -1 bad, 0 unknown."""
    pairs: Int[Array, "P 2"] = field(metadata=array_field("compared 2", np.int64))
    """The better and the worse demonstration of each pair that was compared."""
    outcome: Float[Array, " M"] = field(metadata=array_field("M", missing=True))
    """Higher is better; NaN where it is unknown."""
    tied: Int[Array, "T 2"] = field(default_factory=no_pairs, metadata=array_field("tied 2", np.int64))
    """The two demonstrations of each pair without a difference."""
    failure: str = "outcome = 0"
    """How a demonstration fails: the column of the outcome, and its value there."""
    flag: bool | None = None
    """Whether the outcomes, of which these are some, or means of copies, are a flag; None where these say so."""

    @classmethod
    def none(cls, n_demonstrations: int) -> Answers:
        """Nothing is known."""
        return cls(np.zeros(n_demonstrations, dtype=np.int64), no_pairs(), np.full(n_demonstrations, np.nan))

    @classmethod
    def of_labels(cls, labels: Int[Array, " M"]) -> Answers:
        """Labels alone."""
        return cls(labels, no_pairs(), np.full(len(labels), np.nan))

    @property
    def unsaid(self) -> Answers:
        """The outcomes alone."""
        return replace(self, labels=np.zeros_like(self.labels), pairs=no_pairs(), tied=no_pairs())

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
        return Answers(self.labels[chosen], pairs, self.outcome[chosen], tied, self.failure, self.is_flag)

    @property
    def compared(self) -> Int[Array, "_ 2"]:
        """The pairs without a difference, and the others."""
        return np.concatenate([self.tied, self.pairs])

    @property
    def _graded(self) -> Int[Array, " _"]:
        """The demonstrations without a label whose outcome is known."""
        return np.flatnonzero(np.isfinite(self.outcome) & (self.labels == 0))

    @property
    def are_outcomes(self) -> Bool[Array, " R"]:
        """Which of the R answers are outcomes."""
        return np.repeat([False, True, False, False], self._counts)

    @property
    def sides(self) -> set[int]:
        """1 where some demonstration is said to be good or better, -1 where one is bad or worse."""
        graded = np.sign(self.ranks()[self._graded] - 0.5).astype(int)
        return {1, -1} if len(self.pairs) else {*self.labels.tolist(), *graded.tolist()} - {0}

    @property
    def said(self) -> Int[Array, " M"]:
        """The labels, and -1 where there is none and the outcome is a flag, which is 0."""
        failed = (self.outcome == 0) & (self.labels == 0)
        return np.where(failed, -1, self.labels) if failed.any() and self.is_flag else self.labels

    @property
    def contrast(self) -> bool:
        """Whether there are two answers or more, and they have both `sides`: from then on what they say acts."""
        return self.count > 1 and len(self.sides) > 1

    def only(self, kept: Bool[Array, " R"]) -> Answers:
        """Those of the R answers, in the order of `rows`, that are `kept`."""
        of_labels, of_outcomes, of_tied, of_pairs = np.split(kept, np.cumsum(self._counts[:-1]))
        labels, outcome = self.labels.copy(), self.outcome.copy()
        labels[np.flatnonzero(labels)[~of_labels]] = 0
        outcome[self._graded[~of_outcomes]] = np.nan
        return Answers(labels, self.pairs[of_pairs], outcome, self.tied[of_tied], self.failure, self.is_flag)

    def once(self, copy_of: Int[Array, " M"]) -> Answers:
        """Those about the K different demonstrations: one label, the mean outcome, and pairs, each once."""
        first, place = np.unique(copy_of, return_inverse=True)
        labels = np.sign(np.bincount(place, self.labels, len(first))).astype(np.int64)
        known = np.isfinite(self.outcome)
        total = np.bincount(place[known], self.outcome[known], len(first))
        count = np.bincount(place[known], minlength=len(first))
        outcome = np.divide(total, count, out=np.full(len(first), np.nan), where=count > 0)
        pairs = np.unique(_renumbered(self.pairs, place), axis=0)
        tied = np.unique(np.sort(_renumbered(self.tied, place)), axis=0)
        return Answers(labels, pairs, outcome, tied, self.failure, self.is_flag)

    def shared(self, copy_of: Int[Array, " M"]) -> Answers:
        """The same, where a label is that of all copies, and so is the outcome of those whose own is unknown."""
        once, place = self.once(copy_of), np.unique(copy_of, return_inverse=True)[1]
        outcome = np.where(np.isfinite(self.outcome), self.outcome, once.outcome[place])
        return Answers(once.labels[place], self.pairs, outcome, self.tied, self.failure, self.is_flag)

    @property
    def is_flag(self) -> bool:
        """Whether every known outcome is 0 or 1, or the mean of copies of which each is."""
        if self.flag is not None:
            return self.flag
        return {*self.outcome[np.isfinite(self.outcome)].tolist()} <= {0.0, 1.0}

    def ranks(self) -> Float[Array, " M"]:
        """The share of the known outcomes that are lower, ties half, or a flag itself; NaN where it is unknown."""
        ranks, known = np.full(len(self.outcome), np.nan), np.isfinite(self.outcome)
        values = self.outcome[known]
        if self.is_flag:
            ranks[known] = values
        elif known.any():
            ranks[known] = (mean_ranks(values) - 0.5) / len(values)
        return ranks

    def rows(self, channels: Float[Array, "M C"]) -> tuple[Float[Array, "R D"], Float[Array, " R"]]:
        """The matrix A and the answers t."""
        columns = np.column_stack([np.ones(len(channels)), channels])
        labelled, ranks, known = np.flatnonzero(self.labels), self.ranks(), self._graded
        compared = columns[self.compared[:, 0]] - columns[self.compared[:, 1]]
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
class AnswerPosterior:
    """K normal distributions of w, one for each share of lucky outcomes."""

    mean: Float[Array, "K D"]
    covariance: Float[Array, "K D D"]
    weight: Float[Array, " K"]
    """Posterior probabilities of the shares."""
    luck: Float[Array, " K"]
    error: float

    def proba(self, rows: Float[Array, "R D"], outcome: Float[Array, " R"] | None = None) -> Float[Array, " R"]:
        """P(yes) of right answers to the rows A; where the rank of an `outcome` is known, given how often these are
        wrong."""
        log_odds = self._moderated(rows)
        if outcome is not None:
            with np.errstate(divide="ignore"):
                by_outcome = np.nan_to_num(logit(outcome), posinf=np.inf, neginf=-np.inf)[:, None]
            least, most = np.log(self.error / (1 - self.luck)), np.log((1 - self.error) / self.luck)
            log_odds = log_odds + np.clip(by_outcome, least, most)
        return np.asarray(expit(log_odds) @ self.weight)

    def proba_given(self, rows: Float[Array, "R D"], is_outcome: Bool[Array, " R"]) -> Float[Array, " R"]:
        """P(yes) of answers to the rows A, of which some are wrong."""
        luck = np.where(is_outcome[:, None], self.luck, self.error)
        return np.asarray((luck + (1 - luck - self.error) * expit(self._moderated(rows))) @ self.weight)

    def _moderated(self, rows: Float[Array, "R D"]) -> Float[Array, "R K"]:
        """The logit of each row and distribution, nearer to 0 the less is known (MacKay 1992)."""
        variance = np.einsum("md,kde,me->mk", rows, self.covariance, rows)
        return np.asarray(rows @ self.mean.T / np.sqrt(1 + np.pi * variance / 8))


def posterior(columns: Float[Array, "M C"], answers: Answers, settings: AnswerSettings) -> AnswerPosterior:
    """The posterior of w. Answers of one side move the offset alone; outcomes of 0 and 1 alone, in which bad ones are
    often lucky, move it less."""
    rows, targets = answers.rows(columns)
    is_outcome = answers.are_outcomes
    flags = answers.is_flag and bool(is_outcome.any())
    anchor, precision = np.zeros(rows.shape[1]), np.full(rows.shape[1], settings.precision)
    anchor[1], anchor[-1] = settings.by_ranking, settings.by_group
    if flags and len(answers.only(~is_outcome).sides) < 2:
        precision[1:] = settings.weak_precision
    precision[0] = settings.offset_precision
    if len(answers.sides) < 2:
        precision[1:] = NOTHING
    luck = np.maximum(settings.luck if flags else (0.0,), settings.error)
    each, error = np.ones((len(luck), 1)), np.full((len(luck), 1), settings.error)
    wrongly_yes = np.where(is_outcome, luck[:, None], error)
    mean, covariance, evidence = _laplace(rows, targets, each * anchor, each * precision, wrongly_yes, error)
    return AnswerPosterior(mean, covariance, softmax(evidence), luck, settings.error)


def predicted(
    columns: Float[Array, "M C"], answers: Answers, settings: AnswerSettings
) -> tuple[Float[Array, " R"], Float[Array, " R"], Float[Array, " R"]]:
    """The answers t, P(yes) of each by the others, and by the share of the others that are "yes"; with many answers, by
    those of the other folds."""
    rows, targets = answers.rows(columns)
    fold, by_others, share = np.arange(len(rows)) % settings.max_folds, np.full(len(rows), 0.5), np.full(len(rows), 0.5)
    is_single = np.arange(len(rows)) < len(rows) - len(answers.compared)  # "better than" is "yes" as often as "no"
    for k in range(min(len(rows), settings.max_folds)):
        own = fold == k
        others = posterior(columns, answers.only(~own), settings)
        by_others[own] = others.proba_given(rows[own], answers.are_outcomes[own])
        known = targets[~own & is_single]
        share[own & is_single] = (known.sum() + 0.5) / (len(known) + 1)
    return targets, by_others, share


def explained(targets: Float[Array, " R"], by_others: Float[Array, " R"], share: Float[Array, " R"]) -> float:
    """The share of the log-loss of answers that the others explain, beyond the `share` of good ones (McFadden 1974)."""
    losses = []
    for each in (by_others, share):
        p = np.clip(each, BOUND, 1 - BOUND)
        losses.append(float((targets * np.log(p) + (1 - targets) * np.log(1 - p)).sum()))
    return 1 - losses[0] / losses[1]


def _laplace(
    rows: Float[Array, "R D"],
    targets: Float[Array, " R"],
    anchor: Float[Array, "K D"],
    precision: Float[Array, "K D"],
    luck: Float[Array, "K R"],
    error: Float[Array, "K 1"],
) -> tuple[Array, Array, Array]:
    """Mean and covariance of w, and the log-evidence, of K hypotheses, by Fisher scoring with halved steps; an answer
    is wrongly "yes" at the rate `luck`, wrongly "no" at `error`."""
    share, each = 1 - luck - error, np.arange(rows.shape[1])

    def yes_and_no(w: Array) -> tuple[Array, Array, Array]:
        proba = expit(w @ rows.T)
        return luck + share * proba, error + share * (1 - proba), share * proba * (1 - proba)

    def log_joint(w: Array) -> Array:
        yes, no, _ = yes_and_no(w)
        return np.asarray(
            np.log(yes) @ targets + np.log(no) @ (1 - targets) - 0.5 * (precision * (w - anchor) ** 2).sum(1)
        )

    def slope_and_information(w: Array) -> tuple[Array, Array]:
        yes, no, change = yes_and_no(w)
        slope = (change * (targets / yes - (1 - targets) / no)) @ rows - precision * (w - anchor)
        # Fisher's information, which is never negative, in the place of the curvature.
        information = np.swapaxes((change**2 / (yes * no))[:, :, None] * rows, 1, 2) @ rows
        information[:, each, each] += precision
        return slope, information

    w, reached = anchor, log_joint(anchor)
    for _ in range(MAX_ITER):
        slope, information = slope_and_information(w)
        step = np.linalg.solve(information, slope[..., None])[..., 0]
        if (slope * step).sum(axis=1).max() < TOL:
            break
        size = np.ones((len(w), 1))
        while (lower := (now := log_joint(w + size * step)) < reached - TOL).any() and size.min() > MIN_STEP:
            size[lower] /= 2
        w, reached = np.where(lower[:, None], w, w + size * step), np.where(lower, reached, now)
    _, information = slope_and_information(w)
    evidence = reached + 0.5 * (np.log(precision).sum(axis=1) - np.linalg.slogdet(information)[1])
    return w, np.linalg.inv(information), np.asarray(evidence)
