"""The judge around a training loop of the user's: two functions describe the policy, which may be anything."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from rpil.data.archive import settings_record
from rpil.data.copies import copies_among
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.estimators.task import Labels, Task, answers_of
from rpil.inference.answers import check_copied_labels
from rpil.inference.held_out import HeldOutModel, log_reference
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import judge, repeated
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.policies.folds import deal, out_of_fold
from rpil.results.judged import AuditSettings
from rpil.results.record import Audit
from rpil.results.summary import audit_from_judgement

IN_SAMPLE_POLICY = (
    "The policy was scored on the steps that it was trained on; this assumes that it cannot memorise actions."
)

P = TypeVar("P")
LogProb = Callable[[Any, Array, Array], object]
Train = Callable[[Any, Array, Array, Array], object]

PATIENCE, ROUND_GAIN, LEAST_TRAINED = 3, 1e-3, 1e-6
"""Rounds without a gain after which training stops; the gain of a round on held-out steps, in nats a step, that counts
as one; and the weight below which steps train no policy. Chosen by hand, not tuned."""


@settings_record(random_state="[0, inf)")
class ReweightOptions:
    """The options of `reweight`, which describes them."""

    n_folds: int = 3
    max_rounds: int = 50
    random_state: int = 0


@dataclass(frozen=True, eq=False)
class Reweighted:
    """The result of `reweight`."""

    policy: object
    """The policy, trained with the step weights of the audit."""
    audit: Audit
    """As `RPIL.audit_`; its `step_weight`, in [0, 1], (N,), trained the policy."""
    n_rounds: int
    """Rounds of training."""
    converged: bool
    """Whether training gained nothing more before `max_rounds`."""


@dataclass(frozen=True, eq=False)
class TrainedPolicy(HeldOutModel):
    """A policy that the user's functions train and evaluate: a held-out model for the judge.

    Each copy of the policy is trained on all folds but one and evaluated on that one.
    """

    policy: object
    fit_data: FitData
    data: Demonstrations
    log_prob: LogProb
    train: Train
    fold: Array
    max_rounds: int
    progress: Callable[[str], None]
    cache: dict[bytes, tuple[Array, int]] = field(default_factory=dict)
    """By the step weights: the held-out log-probabilities, and the round after which they were largest."""

    def evaluate(self, weight: Array, ridge: float) -> Array:
        """Held-out log-probabilities under copies trained with step weights (N,) until they gain nothing more."""
        key = weight.tobytes()
        if key not in self.cache:
            log_prob, n_rounds = self._train_copies(weight)
            if self.fit_data.space.has_density:  # densities of actions in spreads, like the reference
                log_prob = log_prob + np.log(ActionScale.of(self.fit_data).spread).sum()
            settings = HeldOutSettings()
            q = log_reference(self.fit_data, np.ones(len(self.data), dtype=bool), settings)
            # log[(1 - eps) pi + eps q], as in `rpil.inference.held_out`
            with_lapses = np.logaddexp(np.log1p(-settings.lapse) + log_prob, np.log(settings.lapse) + q)
            self.cache[key] = np.asarray(with_lapses), n_rounds
        return self.cache[key][0]

    def _train_copies(self, weight: Array) -> tuple[Array, int]:
        n_folds = int(self.fold.max()) + 1
        copies = [deepcopy(self.policy) for _ in range(n_folds)]
        training = [np.flatnonzero((self.fold != k) | (n_folds == 1)) for k in range(n_folds)]
        before = None if self.cache else self._held_out(copies)
        largest, best, best_round = -np.inf, np.empty(len(weight)), 0
        for n in range(1, self.max_rounds + 1):
            self.progress(f"round {n}")
            copies = [self.train_round(copy, rows, weight) for copy, rows in zip(copies, training, strict=True)]
            log_prob = self._held_out(copies)
            if n == 1 and before is not None and np.array_equal(before, log_prob):
                remedy = "keep the optimiser with the policy, so that both are copied, or make it within train"
                raise DataError(f"train changed nothing in copies of the policy; {remedy}.")
            mean = float(weight @ log_prob / weight.sum())
            if mean > largest + ROUND_GAIN:
                largest, best, best_round = mean, log_prob, n
            elif n - best_round >= PATIENCE:
                break
        return best, best_round

    def train_round(self, policy: P, rows: Array, weight: Array) -> P:
        """The policy after one round of training on some rows."""
        if weight[rows].max() < LEAST_TRAINED:  # a weighted mean of no steps is not a number
            return policy
        new = self.train(policy, self.data.observations[rows], self.data.actions[rows], weight[rows].copy())
        if new is None:
            return policy
        if not isinstance(new, type(policy)):
            types = type(new).__name__, type(policy).__name__
            raise DataError("train returned {}; let it return nothing, or the new policy, of type {}.".format(*types))
        return new

    def _held_out(self, copies: Sequence[object]) -> Array:
        return out_of_fold(self.fold, lambda k, test: self._evaluate_policy(copies[k], np.flatnonzero(test)))

    def _evaluate_policy(self, policy: object, rows: Array) -> Array:
        given = self.log_prob(policy, self.data.observations[rows], self.data.actions[rows])
        for method in ("detach", "cpu"):  # converts a tensor to an array without importing torch
            given = getattr(given, method)() if hasattr(given, method) else given
        try:
            log_prob = np.asarray(given, dtype=float)
        except (TypeError, ValueError):
            log_prob = np.empty(())
        if log_prob.shape != (len(rows),):
            what = f"log_prob returned {type(given).__name__} of shape {log_prob.shape} for {len(rows)} steps"
            raise DataError(f"{what}; let it return ({len(rows)},), the log-probability of each action taken.")
        wrong = np.flatnonzero(np.isnan(log_prob) | (log_prob == np.inf))
        if len(wrong):
            step, m = rows[wrong[0]], self.data.groups[rows[wrong[0]]]
            place = f"{self.data.source}, demonstration {self.data.ids[m]!r}"
            said = f"log_prob returned {log_prob[wrong[0]]} at step {step - self.data.offsets[m]}"
            raise DataError(f"{place}: {said}; look at the loss, or lower the learning rate.")
        if not self.fit_data.space.has_density and log_prob.max() > 1e-4:
            above = f"{log_prob.max():.3g} for a discrete action"
            raise DataError(f"log_prob returned {above}, more than log 1; take logarithms.")
        return np.asarray(np.maximum(log_prob, -700.0))  # the exponential of -700 is still positive


def reweight(
    policy: object,
    demonstrations: Demonstrations,
    *,
    log_prob: LogProb,
    train: Train,
    labels: Labels | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> Reweighted:
    """Train a policy of any kind with step weights that say how far each step is trusted, and find these weights.

    The judge of `RPIL` decides by the held-out log-likelihoods of copies of the policy: about eight times `n_folds`
    copies are trained. Then the policy is trained with the step weights.

    Parameters
    ----------
    policy : object
        A torch module, parameters, anything. It is trained, and returned.
    demonstrations : Demonstrations
    log_prob : function of (policy, observations (N, D), actions (N,) or (N, A))
        log pi(a|s) of each action taken, (N,), as an array or a tensor; -inf is taken as -700.
    train : function of (policy, observations, actions, weights (N,))
        Trains the policy, for an epoch, say, with weights in [0, 2]. Returns nothing, or the new policy, of the same
        type. Whatever it changes, such as an optimiser, must belong to the policy: copies of the policy have their own.
    labels : mapping of id to {"good", "bad"}, optional
        Answers about some demonstrations; those that they call bad get little weight in the last training.
    progress : callable, optional
        Called with a few words at every round.
    n_folds : int, default=3
        Copies of the policy, at most one for each different demonstration. Each is evaluated on the demonstrations
        that it was not trained on. With 1 a copy is evaluated on its training data: a policy that memorises explains
        bad actions as well as good ones.
    max_rounds : int, default=50
        Calls of `train` for a policy, at most; training stops when it gains nothing more on held-out steps.
    random_state : int, default=0
        Seed of the folds.

    Raises
    ------
    DataError
        One sentence: `log_prob` returns numbers that are not finite or of the wrong shape, `train` returns no policy or
        changes nothing, an option makes no sense, or the demonstrations are too few.

    Examples
    --------
    >>> result = reweight(net, demonstrations, log_prob=log_prob, train=one_epoch)    # doctest: +SKIP
    >>> result.audit.verdicts                                                         # doctest: +SKIP
    """
    if not isinstance(demonstrations, Demonstrations):
        raise DataError(f"reweight needs Demonstrations, not {type(demonstrations).__name__}; see rpil.read.")
    progress, chosen, settings = progress or (lambda _: None), ReweightOptions(**options), JudgeSettings()
    task = Task.of(demonstrations, answers_of(labels, None, demonstrations))
    copies = copies_among(demonstrations)
    check_copied_labels(task.answers, copies.copy_of, demonstrations.ids, demonstrations.source)
    n_folds = min(chosen.n_folds, len(copies.judged))
    once = demonstrations.select(copies.judged) if copies.any else demonstrations
    features = FeatureMap.fit("folded", once.observations, settings=FeatureSettings())
    data = task.data(once, features)
    fold = data.per_step(deal(data, n_folds, chosen.random_state))
    model = TrainedPolicy(policy, data, once, log_prob, train, fold, chosen.max_rounds, progress)
    judgement = judge(data, model, settings, progress, data)
    n_rounds = model.cache[data.per_step(judgement.scores.fit.group.astype(float)).tobytes()][1]
    judgement = repeated(judgement, copies, demonstrations.offsets)
    audit = audit_from_judgement(judgement, demonstrations, task.answers, task.demonstrators, AuditSettings())
    notes, method = filter(None, [*audit.notes, copies.sentence]), (IN_SAMPLE_POLICY,) * (n_folds == 1)
    audit = replace(audit, notes=tuple(notes), method=method)
    model = replace(model, data=demonstrations)  # the policy learns from copies as well
    for n in range(n_rounds):
        progress(f"training the policy: {n + 1} of {n_rounds}")
        policy = model.train_round(policy, np.arange(demonstrations.n_steps), audit.step_weight)
    return Reweighted(policy, audit, n_rounds, n_rounds < chosen.max_rounds)
