"""Knowledge of demonstrations: labels, pairs that were compared, and outcomes, the columns of witnesses."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rpil.data.errors import DataError
from rpil.numerics.types import Array, Bool, Float, Int


def no_pairs() -> Int[Array, "0 2"]:
    """Nothing was compared."""
    return np.empty((0, 2), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Answers:
    """Knowledge of M demonstrations."""

    labels: Int[Array, " M"]
    """1 good, -1 bad, 0 unknown."""
    pairs: Int[Array, "P 2"]
    """The better and the worse demonstration of each pair that was compared."""
    outcomes: Float[Array, "M W"]
    """Value of each witness, higher is thought to be better; NaN where it is unknown."""
    tied: Int[Array, "T 2"] = field(default_factory=no_pairs)
    """The two demonstrations of each pair without a difference."""
    names: tuple[str, ...] = ()
    """Names of the witnesses; with a minus where less is better, so that the outcomes are negative."""
    flag: int | None = None
    """The number of the `only_flag` where these are some of the outcomes, or means of copies; else None."""
    heard: tuple[int, ...] | None = None
    """Sign of each witness: 1 where all else confirms it, -1 where all else turns it, 0 where it does not count; None
    before this is learned (`rpil.inference.witnesses`)."""
    marks: Int[Array, "S 4"] = field(default_factory=lambda: np.hstack([no_pairs(), no_pairs()]))
    """Rows that were called good or bad: the demonstration, the first row and the one after the last, and 1 or -1."""

    @classmethod
    def none(cls, n_demonstrations: int) -> Answers:
        """Nothing is known."""
        return cls(np.zeros(n_demonstrations, dtype=np.int64), no_pairs(), np.empty((n_demonstrations, 0)))

    @classmethod
    def of_labels(cls, labels: Int[Array, " M"]) -> Answers:
        """Labels alone."""
        return cls(labels, no_pairs(), np.empty((len(labels), 0)))

    @property
    def unsaid(self) -> Answers:
        """The outcomes alone."""
        return replace(self, labels=np.zeros_like(self.labels), pairs=no_pairs(), tied=no_pairs(), marks=self.marks[:0])

    @property
    def count(self) -> int:
        """The number of labels, of other demonstrations with a known outcome, and of pairs."""
        return int(np.count_nonzero((self.labels != 0) | self.has_outcome)) + len(self.compared)

    @property
    def has_outcome(self) -> Bool[Array, " M"]:
        """Where an outcome is known."""
        return np.asarray(np.isfinite(self.outcomes).any(axis=1))

    @property
    def compared(self) -> Int[Array, "_ 2"]:
        """The pairs without a difference, and the others."""
        return np.concatenate([self.tied, self.pairs])

    def select(self, indices: Sequence[int]) -> Answers:
        """The answers about some of the demonstrations, and about pairs of them."""
        chosen, place = list(indices), np.full(len(self.labels), -1)
        place[chosen] = np.arange(len(chosen))
        pairs, tied = _renumbered(self.pairs, place), _renumbered(self.tied, place)
        some = replace(self, labels=self.labels[chosen], outcomes=self.outcomes[chosen], flag=self.only_flag)
        marks = np.column_stack([place[self.marks[:, 0]], self.marks[:, 1:]])
        return replace(some, pairs=pairs, tied=tied, marks=marks[marks[:, 0] >= 0])

    def bad_rows(self, offsets: Int[Array, " _"]) -> Bool[Array, " N"]:
        """The rows that were called bad, of demonstrations with these `offsets`."""
        bad = np.zeros(int(offsets[-1]), dtype=bool)
        for m, start, end, sign in self.marks.tolist():
            bad[offsets[m] + start : offsets[m] + end] |= sign < 0
        return bad

    @property
    def sides(self) -> set[int]:
        """1 where some demonstration is said to be good or better, -1 where one is bad or worse."""
        if len(self.pairs):
            return {1, -1}
        of_outcomes = set[int]()
        for k, values in enumerate(self.outcomes[self.labels == 0].T):
            if self.heard is not None and not self.heard[k]:
                continue
            known = values[np.isfinite(values)]
            middle = 0.5 if k == self.only_flag or not len(known) else (known.min() + known.max()) / 2
            of_outcomes |= {*np.sign(known - middle).astype(int).tolist()}
        return ({*self.labels.tolist()} | of_outcomes) - {0}

    @property
    def contrast(self) -> bool:
        """Whether there are two answers or more, and they have both `sides`: from then on what they say acts."""
        return self.count > 1 and self.sides >= {1, -1}

    @property
    def only_flag(self) -> int:
        """The number of the only outcome of which every known value is 0 or 1, or the mean of copies of which each is;
        -1 where none or several are so."""
        if self.flag is not None:
            return self.flag
        flags = [k for k, values in enumerate(self.outcomes.T) if {*values[np.isfinite(values)].tolist()} <= {0.0, 1.0}]
        return flags[0] if len(flags) == 1 else -1

    def failed(self, log_odds: Float[Array, " M"]) -> Bool[Array, " M"]:
        """Demonstrations whose only flag is 0, where P(good) is 1/2 at most once labels and pairs contrast, or another
        outcome counts. None where all else turns it, or does not confirm it though one with a 0 is called good, or
        better than one with a 1."""
        k, heard, is_told = self.only_flag, self.heard, replace(self, outcomes=self.outcomes[:, :0]).contrast
        if k < 0:
            return np.zeros(len(self.labels), dtype=bool)
        zero, (better, worse) = np.asarray(self.outcomes[:, k] == 0), self.pairs.T
        denies = (self.labels[zero] > 0).any() or (zero[better] & (self.outcomes[worse, k] == 1)).any()
        speaks = is_told or bool(np.delete(heard or [0], k if heard else 0).any())
        return zero & ((log_odds <= 0) | (not speaks)) & (heard is None or heard[k] >= int(is_told and denies))

    @property
    def failure(self) -> str:
        """How a demonstration fails: the column of the flag, and its value there."""
        name = self.names[max(self.only_flag, 0)] if self.names else "outcome"
        return f"{name.removeprefix('-')} = {int(name.startswith('-'))}"

    def said(self, log_odds: Float[Array, " M"]) -> Int[Array, " M"]:
        """The labels, and -1 for those without one that `failed`."""
        return np.where(self.failed(log_odds) & (self.labels == 0), -1, self.labels)

    def once(self, copy_of: Int[Array, " M"]) -> Answers:
        """Answers about the K different demonstrations: one label, the mean outcome, and pairs, each once."""
        first, place = np.unique(copy_of, return_inverse=True)
        labels = np.sign(np.bincount(place, self.labels, len(first))).astype(np.int64)
        outcomes = np.full((len(first), self.outcomes.shape[1]), np.nan)
        for k, values in enumerate(self.outcomes.T):
            known = np.isfinite(values)
            count = np.bincount(place[known], minlength=len(first))
            np.divide(np.bincount(place[known], values[known], len(first)), count, out=outcomes[:, k], where=count > 0)
        pairs = np.unique(_renumbered(self.pairs, place), axis=0)
        tied = np.unique(np.sort(_renumbered(self.tied, place)), axis=0)
        return replace(self, labels=labels, pairs=pairs, outcomes=outcomes, tied=tied, flag=self.only_flag)

    def shared(self, copy_of: Int[Array, " M"]) -> Answers:
        """The same, where a label is that of all copies, and so is the outcome of those whose own is unknown."""
        once, place = self.once(copy_of), np.unique(copy_of, return_inverse=True)[1]
        outcomes = np.where(np.isfinite(self.outcomes), self.outcomes, once.outcomes[place])
        return replace(self, labels=once.labels[place], outcomes=outcomes, flag=self.only_flag)

    def rows(self, columns: Float[Array, "M C"]) -> tuple[Float[Array, "R D"], int]:
        """The rows of the regression: (1, x_m) of each demonstration, and then x_i - x_j of each pair, those without a
        difference both ways; and how many these are."""
        single = np.column_stack([np.ones(len(columns)), columns])
        better, worse = np.concatenate([self.pairs, self.tied, self.tied[:, ::-1]]).T
        return np.concatenate([single, single[better] - single[worse]]), len(better)

    def evidence(self, log_odds: float) -> Float[Array, " R"]:
        """The log-likelihood ratio of each of these rows by labels and pairs, if an answer is right with `log_odds`."""
        n_pairs = len(self.pairs) + 2 * len(self.tied)
        return log_odds * np.concatenate([self.labels, np.ones(n_pairs)])


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
        said = f"{ids[m]!r} is labelled good and {ids[other]!r}, a copy of it, bad; change one of the labels."
        raise DataError(f"{source}: {said}")
