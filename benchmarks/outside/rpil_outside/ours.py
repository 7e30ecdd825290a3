"""The columns of rpil: what an audit keeps, weighs and cuts without answers, and after four and eight of them."""

from __future__ import annotations

import time
import warnings
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

import rpil
from rpil import Audit

if TYPE_CHECKING:
    from .world import Made

COUNTS = 4, 8
"""Answers that a person gives."""


class Case:
    """One draw of a cell, audited once."""

    def __init__(self, made: Made, seed: int) -> None:
        self.made, self.data, self.seed = made, made.demonstrations, seed
        self.seconds = 0.0
        """CPU seconds of the audit."""

    @cached_property
    def audit(self) -> Audit:
        begin = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            audit = rpil.audit(self.data)
        self.seconds = time.process_time() - begin
        return audit

    @cached_property
    def drawn(self) -> list[int]:
        """The demonstrations that are asked about at random, in this order."""
        return np.random.default_rng([self.seed, 8]).permutation(len(self.data)).tolist()

    def random_answers(self, count: int) -> dict[str, bool]:
        """True answers about the first `count` drawn ones, by ids as text."""
        return {str(self.data.ids[m]): bool(self.made.good[m]) for m in self.drawn[:count]}

    def answered(self, count: int, asked: bool) -> Audit:
        """The audit after `count` true answers: about those that it asks for, one after the other, or drawn ones."""
        audit = self.audit
        for m in self.drawn[: min(count, len(self.data)) if audit.columns.size else 0]:
            name = audit.suggest_labels(1)[0] if asked else self.data.ids[m]
            audit = audit.answered({name: "good" if self.made.good[audit.index(name)] else "bad"})
        return audit

    def kept(self, audit: Audit) -> np.ndarray:
        """A weight of 1 for each step that ``rpil keep`` keeps."""
        names = set(audit.choice.kept)
        return np.repeat([float(name in names) for name in self.data.ids], self.data.lengths)

    def ranges(self) -> np.ndarray:
        """A weight of 1 for each row that is kept by ``rpil keep --ranges``: of kept demonstrations, not idle ones."""
        weight = np.zeros(self.data.n_steps)
        for name, spans in self.audit.ranges(rpil.idle_rows(self.data)).items():
            first = int(self.data.offsets[self.audit.index(name)])
            for begin, end in spans:
                weight[first + begin : first + end] = 1.0
        return weight

    def learned(self) -> Audit:
        """The audit of the learner, whose weights of steps do not wait for answers."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return rpil.RPIL().fit(self.data).audit_
