"""Rules that choose demonstrations: each gives a weight to every step from what it may know.

A rule that needs no outcome, answer or truth is given none (`told`).
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

import rpil
from contestants.likelihood import cleanlab
from rpil import Audit
from rpil.data.demonstrations import Demonstrations
from rpil.inference.answers import Answers
from rpil.numerics.types import Array
from rpil.results.answering import with_answers
from rpil.results.choice import choose
from rpil.results.vocabulary import SIDES
from value.information import information, scaled
from value.worlds import World

SHORT = 0.6
"""Share of the demonstrations that count as short, or as informative."""
DIGITS = 9
"""Of weights."""
IDLE = 0.01
"""Standard deviations of a column; what changes less from step to step stands still."""


class Judged:
    """Demonstrations with what is computed from them once, without answers."""

    def __init__(self, demonstrations: Demonstrations) -> None:
        self.demonstrations, self.lengths = demonstrations, demonstrations.lengths

    @cached_property
    def audit(self) -> Audit:
        """That of ``rpil audit``, whose weights wait for answers."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return rpil.audit(self.demonstrations)

    @cached_property
    def learned(self) -> Audit:
        """That of the learner, whose weights do not."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return rpil.RPIL().fit(self.demonstrations).audit_

    @cached_property
    def information(self) -> Array:
        return information(self.demonstrations, 0)

    def per_step(self, value: Array) -> Array:
        """A number for each demonstration as one for each of its steps."""
        return np.repeat(np.asarray(value, dtype=float), self.lengths)


@dataclass(frozen=True, eq=False)
class Known:
    """What a rule may read."""

    judged: Judged
    seed: int
    success: Array | None = None
    """(M,) bool: how each ended."""
    is_good: Array | None = None
    """(M,) bool: the truth, for rules that ask a person."""


@dataclass(frozen=True)
class Rule:
    weights: Callable[[Known], Array]
    """Weights of the steps, (N,)."""
    needs: tuple[str, ...] = ()
    """Of "success" and "is_good"."""


def told(rule: Rule, world: World, judged: Judged, seed: int) -> Known:
    """What this rule may read, and nothing else."""
    return Known(judged, seed, **{fact: getattr(world, fact) for fact in rule.needs})


def weights_of(rule: Rule, world: World, judged: Judged, seed: int) -> Array:
    """The weights of the steps, the largest 1; all 1 where the rule would keep nothing. Rounded, so that weights that
    are equal but for rounding share a policy."""
    weight = np.asarray(rule.weights(told(rule, world, judged, seed)), dtype=float)
    return np.round(weight / weight.max(), DIGITS) if weight.max() > 0 else np.ones(len(weight))


def trimmed(known: Known) -> Array:
    """Without idle heads and tails: the state stands still, and the action is still the first or already the last."""
    data, weights = known.judged.demonstrations, []
    states, actions = (scaled(np.column_stack([each])) for each in (data.observations, data.actions))
    for begin, end in itertools.pairwise(data.offsets):
        rests = still(states[begin + 1 : end], states[begin : end - 1])
        rests = np.append(rests, rests[-1:])
        head, tail = (rests & still(actions[begin:end], actions[k]) for k in (begin, end - 1))
        idle = np.logical_and.accumulate(head) | np.logical_and.accumulate(tail[::-1])[::-1]
        weights.append(~idle)
    return np.concatenate(weights).astype(float)


def still(rows: Array, others: Array) -> Array:
    return (np.abs(rows - others) < IDLE).all(axis=1)


def keep(known: Known, share: float | None = None) -> Array:
    """What ``rpil keep`` writes, without options or with ``--share``."""
    return what_is_kept(known.judged, known.judged.audit, share)


def what_is_kept(judged: Judged, audit: Audit, share: float | None = None) -> Array:
    """What ``rpil keep`` writes of an audit."""
    kept: set[Hashable] = set(choose(audit.table(), share).kept)
    return judged.per_step([name in kept for name in audit.ids])


def successes(known: Known) -> Array:
    return known.judged.per_step(known.success)


def short_successes(known: Known) -> Array:
    """The shortest 60 % of the successes."""
    length = np.where(known.success, known.judged.lengths, np.inf)
    return known.judged.per_step(best(-length, SHORT * known.success.mean()) & known.success)


def with_outcomes(known: Known, count: int | None = None) -> Array:
    """The audit is told how all, or `count` drawn ones, ended."""
    audit, outcome = known.judged.audit, known.success.astype(float)
    if count is not None:
        outcome[np.random.default_rng(known.seed).permutation(len(outcome))[count:]] = np.nan
    if not np.nanmin(outcome) < np.nanmax(outcome) or not audit.columns.size:  # nothing can be learned
        return keep(known)
    answers = replace(Answers.none(len(outcome)), outcomes=outcome[:, None], names=("success",))
    return without_bad(with_answers(audit, answers))


def with_labels(known: Known, count: int, suggested: bool) -> Array:
    """The weights of steps after labels."""
    return without_bad(labelled(known, count, suggested)) if known.judged.audit.columns.size else keep(known)


def keep_with_labels(known: Known, count: int, suggested: bool) -> Array:
    """What ``rpil keep`` writes after labels."""
    return what_is_kept(known.judged, labelled(known, count, suggested))


def labelled(known: Known, count: int, suggested: bool) -> Audit:
    """A person labels `count` demonstrations: those that the audit suggests, one after the other, or drawn ones."""
    audit = known.judged.audit
    drawn = np.random.default_rng(known.seed).permutation(len(known.is_good))
    for k in range(min(count, len(drawn)) if audit.columns.size else 0):
        name = audit.suggest_labels(1)[0] if suggested else audit.ids[drawn[k]]
        audit = audit.answered({name: "good" if known.is_good[audit.index(name)] else "bad"})
    return audit


def without_bad(audit: Audit) -> Array:
    """The weights of steps, 0 for demonstrations that are called bad."""
    kept = np.array([SIDES[verdict] != "lower" for verdict in audit.verdicts])
    return audit.step_weight * np.repeat(kept, audit.lengths)


def best(score: Array, share: float) -> Array:
    """The share of the demonstrations, at least one, with the largest scores, (M,) bool."""
    ranked = np.argsort(-np.asarray(score, dtype=float), kind="stable")
    return np.isin(np.arange(len(score)), ranked[: max(round(share * len(score)), 1)])


ALL, ORACLE = "all", "oracle"
RULES: dict[str, Rule] = {
    ALL: Rule(lambda known: np.ones(known.judged.demonstrations.n_steps)),
    "keep": Rule(keep),
    "step weights": Rule(lambda known: known.judged.audit.step_weight),
    "trimmed": Rule(trimmed),
    "trimmed step weights": Rule(lambda known: trimmed(known) * known.judged.audit.step_weight),
    "probability": Rule(lambda known: known.judged.per_step(known.judged.audit.expert_proba)),
    "best 40 %": Rule(partial(keep, share=0.4)),
    "best 60 %": Rule(partial(keep, share=0.6)),
    "best 80 %": Rule(partial(keep, share=0.8)),
    "information 60 %": Rule(lambda known: known.judged.per_step(best(known.judged.information, SHORT))),
    "cleanlab 60 %": Rule(
        lambda known: known.judged.per_step(best(cleanlab(known.judged.demonstrations, known.seed), SHORT))
    ),
    "shortest 60 %": Rule(lambda known: known.judged.per_step(best(-known.judged.lengths, SHORT))),
    "successes": Rule(successes, ("success",)),
    "short successes": Rule(short_successes, ("success",)),
    "weighted successes": Rule(lambda known: known.judged.audit.step_weight * successes(known), ("success",)),
    "outcomes": Rule(with_outcomes, ("success",)),
    "ten outcomes": Rule(partial(with_outcomes, count=10), ("success",)),
    "4 suggested labels": Rule(partial(with_labels, count=4, suggested=True), ("is_good",)),
    "4 random labels": Rule(partial(with_labels, count=4, suggested=False), ("is_good",)),
    "8 suggested labels": Rule(partial(with_labels, count=8, suggested=True), ("is_good",)),
    "8 random labels": Rule(partial(with_labels, count=8, suggested=False), ("is_good",)),
    "keep, 4 suggested labels": Rule(partial(keep_with_labels, count=4, suggested=True), ("is_good",)),
    "keep, 8 suggested labels": Rule(partial(keep_with_labels, count=8, suggested=True), ("is_good",)),
    "keep, 8 random labels": Rule(partial(keep_with_labels, count=8, suggested=False), ("is_good",)),
    ORACLE: Rule(lambda known: known.judged.per_step(known.is_good), ("is_good",)),
}
