"""Whether the demonstrations that are not trusted act alike, otherwise than the trusted, in the same states.

Noise of any kind has no policy: what it teaches explains little. Demonstrations that are simply bad often have one, but
in states of their own: they fall, give up, or never arrive. A second way of acting has a policy that explains its
demonstrations about as well as the trusted explain theirs, and it acts where the trusted are at home, too:

    gain_A = median over A of  mean_n [log pi_A - log q_A],     gain_B the same of B,    gain_B >= GAIN gain_A
    median over A of  mean_n [log pi_B - log q_A] <= OTHERWISE gain_A
    median over A of  sum_n [log pi_A - log pi_B] >= DISTINCT,      and the same of B
    overlap = mean over the steps of B of  min(1, p(s | A) / p(s | B)) >= OVERLAP

A and B are the trusted demonstrations and the others, pi_A and pi_B policies that are taught by one of them, held out;
q_A and q_B do not look at the state. Then nothing tells which of the two is the expert.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from rpil.judge.concentrate import mean_steps
from rpil.judge.held_out import Scorer, deal, fit_weighted, reference, standardised
from rpil.passes import Array
from rpil.problem import Problem
from rpil.spaces import Discrete

GAIN = 0.45
"""Of the trusted demonstrations' gain that a rival group reaches: between what noise and what flipped or shifted
actions reached in simulated worlds."""

OTHERWISE = 0.5
"""Of the trusted demonstrations' gain, at most what the rival group's policy reaches on them: a noisy version of the
same policy explains them nearly as well as their own."""

OVERLAP = 0.6
"""Of a rival group's steps that are where the trusted are at home: between flipped actions, recorded in the same
states, and robot arms that fail."""

DISTINCT = 5.0
"""Nats, for the median demonstration of either group, by which its own group's policy explains it better than the other
group's: by chance two groups divide demonstrations of one policy by one or two."""

FEWEST = 2
"""Demonstrations of a group."""

ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Rival:
    """The trusted demonstrations and those that act alike, otherwise.

    Attributes
    ----------
    trusted, rival : int arrays
        Indices of the demonstrations.
    gain : float
        Of the rival group by a policy of its own, relative to that of the trusted.
    overlap : float
        Share of its steps in states of the trusted.
    """

    trusted: Array
    rival: Array
    gain: float
    overlap: float

    @property
    def competes(self) -> bool:
        """Whether nothing tells which of the two groups is the expert."""
        return self.gain >= GAIN and self.overlap >= OVERLAP


def find_rival(
    problem: Problem, scorer: Scorer, trusted: Array, settled: bool, ridge: float, seed: int
) -> Rival | None:
    """The group of demonstrations that acts alike, otherwise than the `trusted` (M,) bool, if any.

    Parameters
    ----------
    trusted : (M,) bool array
        The demonstrations to compare with.
    settled : bool
        Whether who is trusted is decided; otherwise both groups take the demonstrations that they explain better.
    ridge, seed
        Of the policies and the folds.
    """
    if trusted.sum() < FEWEST or (~trusted).sum() < FEWEST:
        return None

    def explained(by: Scorer, group: Array) -> Array:
        return mean_steps(problem, by.held_out(problem.spread(group.astype(float)), ridge).log_prob)

    second, own = scorer.anew(), explained(scorer, trusted)
    rival = ~trusted & (own <= np.median(own[~trusted]))  # those least like the trusted
    for _ in range(ROUNDS):
        other = explained(second, rival)
        closer = (other > own) & ~(trusted & settled)
        if closer.sum() < FEWEST or (~closer).sum() < FEWEST:
            return None
        if (closer == rival).all():
            break
        rival = closer
        if not settled:
            trusted = ~rival
            own = explained(scorer, trusted)
    blind, blind_rival = (mean_steps(problem, reference(problem, group)) for group in (trusted, rival))
    gain, on_trusted = (float(np.median((of - blind)[trusted])) for of in (own, other))
    gain_rival = float(np.median((other - blind_rival)[rival]))
    if not gain > 0 or gain_rival < GAIN * gain or on_trusted > OTHERWISE * gain:
        return None
    nats = problem.lengths * (own - other)
    if np.median(nats[trusted]) < DISTINCT or np.median(-nats[rival]) < DISTINCT:
        return None
    found = np.flatnonzero(trusted), np.flatnonzero(rival)
    return Rival(*found, gain_rival / gain, state_overlap(problem, *found, seed))


def state_overlap(problem: Problem, first: Array, second: Array, seed: int) -> float:
    """Mean over the steps of the demonstrations `second` of min(1, p(s | first) / p(s | second)), held out."""
    both = problem.select(np.sort(np.concatenate([first, second])), unlabelled=True)
    is_first = both.spread(np.isin(np.sort(np.concatenate([first, second])), first))
    columns = np.column_stack([standardised(np.asarray(both.features, dtype=float)), np.ones(len(is_first))])
    states = Problem(columns, is_first.astype(int), both.offsets, Discrete(2), both.labels)
    fold = both.spread(deal(states, min(5, states.n_demonstrations), seed))
    ratio = np.ones(len(is_first))
    balance = np.where(is_first, 0.5 / is_first.sum(), 0.5 / (~is_first).sum()) * len(is_first)
    for k in range(int(fold.max()) + 1):
        rows = np.flatnonzero(fold != k)
        if len(np.unique(is_first[rows])) < 2:
            continue
        weights, _ = fit_weighted(states, rows, balance[rows], 1e-3)
        logits = columns[fold == k] @ weights
        proba = expit(logits[:, 1] - logits[:, 0])
        ratio[fold == k] = np.minimum(1.0, proba / np.maximum(1 - proba, 1e-12))
    return float(ratio[~is_first].mean())
