"""The judge around a policy that the user trains: two functions describe it, and it may be anything."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rpil.audit.assumptions import IN_SAMPLE_POLICY, assumption_sentences
from rpil.audit.record import Audit
from rpil.audit.summary import audit_from_judgement
from rpil.data.coding import code_actions, label_codes
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.inference.held_out import HeldOutLogProb, deal, log_reference
from rpil.inference.settings import MINORITY, HeldOutSettings, Minority
from rpil.inference.trust import judge
from rpil.numerics.regression import column_scales
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap

_PATIENCE = 3
"""Rounds without a gain after which training stops."""

_GAIN = 1e-3
"""Nats a step that a round of training must gain on held-out steps to count as a gain."""

_NEGLIGIBLE = 1e-6
"""Where no weight is larger, a policy is not trained."""

LogProb = Callable[[Any, Array, Array], Any]
Train = Callable[[Any, Array, Array, Array], Any]


@dataclass(frozen=True, eq=False)
class Reweighted:
    """What `reweight` finds.

    Attributes
    ----------
    policy : object
        The policy, trained on steps by their trust.
    audit : Audit
        Verdicts, log-odds, ``step_weight``: as `RPIL.audit_`.
    n_rounds : int
        How often the policy was trained.
    converged : bool
        Whether its training had stopped to gain before `max_rounds`.
    """

    policy: Any
    audit: Audit
    n_rounds: int
    converged: bool

    @property
    def step_weight(self) -> Array:
        """Weight of each step for training, in [0, 1], (N,)."""
        return self.audit.step_weight


@dataclass(eq=False)
class _Theirs:
    """Held-out log-probabilities of the user's policy: copies of `policy` judge a fold each, trained on the others."""

    policy: Any
    fit_data: FitData
    data: Demonstrations
    log_prob: LogProb
    train: Train
    fold: Array
    max_rounds: int
    progress: Callable[[str], None]
    ridges: tuple[float, ...] = ()
    found: dict[bytes, tuple[HeldOutLogProb, int]] = field(default_factory=dict)
    """By the weights of the steps: what copies said, and after how many rounds they were the best."""

    def cold_copy(self) -> _Theirs:
        return self

    def evaluate(self, weight: Array, ridge: float) -> HeldOutLogProb:
        """Of every step, by copies that were trained until it gains nothing more on the steps that teach."""
        key = weight.tobytes()
        if key not in self.found:
            self.found[key] = self._rounds(weight)
        return self.found[key][0]

    def _rounds(self, weight: Array) -> tuple[HeldOutLogProb, int]:
        n_folds = int(self.fold.max()) + 1
        copies = [deepcopy(self.policy) for _ in range(n_folds)]
        taught = [np.flatnonzero((self.fold != k) | (n_folds == 1)) for k in range(n_folds)]
        before = None if self.found else self._ask_all(copies)
        most, best, when = -np.inf, np.empty(len(weight)), 0
        for n in range(1, self.max_rounds + 1):
            self.progress(f"round {n}")
            copies = [self.teach(copy, rows, weight) for copy, rows in zip(copies, taught, strict=True)]
            said = self._ask_all(copies)
            if n == 1 and before is not None and np.array_equal(before, said):
                raise DataError(
                    "train changed nothing in copies of the policy; keep the optimiser with the policy, so that both "
                    "are copied, or make it within train."
                )
            explained = float(weight @ said / weight.sum())
            if explained > most + _GAIN:
                most, best, when = explained, said, n
            elif n - when >= _PATIENCE:
                break
        if not self.data.is_discrete:  # densities of actions in standard deviations, as the reference has them
            best = best + np.log(column_scales(self.data.actions)).sum()
        lapse, q = HeldOutSettings().lapse, log_reference(self.fit_data, np.ones(len(self.data), dtype=bool))
        log_prob = np.logaddexp(np.log1p(-lapse) + best, np.log(lapse) + q)  # an expert, too, may do anything at times
        return HeldOutLogProb(log_prob, log_prob - np.average(log_prob, weights=weight)), when

    def teach(self, policy: Any, rows: Array, weight: Array) -> Any:
        """`policy` after a round of training on `rows`."""
        if weight[rows].max() < _NEGLIGIBLE:  # the weighted mean of no steps is not a number
            return policy
        new = self.train(policy, self.data.observations[rows], self.data.actions[rows], weight[rows].copy())
        if new is None:
            return policy
        if not isinstance(new, type(policy)):
            types = type(new).__name__, type(policy).__name__
            raise DataError("train returned {}; let it return nothing, or the new policy, of type {}.".format(*types))
        return new

    def _ask_all(self, copies: list[Any]) -> Array:
        out = np.empty(len(self.fold))
        for k, copy in enumerate(copies):
            out[self.fold == k] = self._ask(copy, np.flatnonzero(self.fold == k))
        return out

    def _ask(self, policy: Any, rows: Array) -> Array:
        said = self.log_prob(policy, self.data.observations[rows], self.data.actions[rows])
        for method in ("detach", "cpu"):  # a tensor becomes an array without torch being known here
            said = getattr(said, method)() if hasattr(said, method) else said
        try:
            found = np.asarray(said, dtype=float)
        except (TypeError, ValueError):
            raise DataError(f"log_prob returned {type(said).__name__}; let it return {len(rows)} numbers.") from None
        if found.shape != (len(rows),):
            raise DataError(
                f"log_prob returned the shape {found.shape} for {len(rows)} steps; let it return ({len(rows)},), the "
                "log-probability of each action taken."
            )
        wrong = np.flatnonzero(np.isnan(found) | (found == np.inf))
        if len(wrong):
            step, m = rows[wrong[0]], self.data.groups[rows[wrong[0]]]
            raise DataError(
                f"{self.data.source}, demonstration {self.data.ids[m]!r}: log_prob returned {found[wrong[0]]} at step "
                f"{step - self.data.offsets[m]}; look at the loss, or lower the learning rate."
            )
        if self.data.is_discrete and found.max() > 1e-4:
            above = f"{found.max():.3g} for a discrete action"
            raise DataError(f"log_prob returned {above}, more than log 1; take logarithms.")
        return np.maximum(found, -700.0)  # whose exponential is still a positive number


def reweight(
    policy: Any,
    demonstrations: Demonstrations,
    *,
    log_prob: LogProb,
    train: Train,
    n_folds: int = 3,
    labels: Mapping[Any, str] | None = None,
    minority: Minority = "ask",
    max_rounds: int = 50,
    action_box: tuple[Any, Any] | None = None,
    random_state: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Reweighted:
    """Train a policy of any kind on demonstrations weighted by their trust, and find that trust.

    The judge of `RPIL` decides, by the held-out log-likelihoods of copies of the policy: some eight times `n_folds`
    copies are trained. Then the policy is trained with the weights that were found.

    Parameters
    ----------
    policy : object
        A torch module, parameters, anything. It is trained, and returned.
    demonstrations : Demonstrations
    log_prob : function of (policy, observations (N, D), actions (N,) or (N, A))
        log pi(a|s) of each action taken, (N,): an array or a tensor; -inf is taken as -700.
    train : function of (policy, observations, actions, weights (N,))
        Trains with steps that count by their weights, from 0 to 1, for an epoch, say. Returns nothing, or the new
        policy, of the same type. All that it changes must be copied with a policy, so an optimiser belongs to it.
    n_folds : int
        Copies of the policy, each trained without the demonstrations that it judges. With 1 a copy judges what it was
        trained on: a policy that can memorise explains bad actions as well as good ones.
    labels, minority
        As `RPIL`'s. Known adversaries are not trained on.
    max_rounds : int
        How often a policy is trained at most; it stops before, where training gains nothing more on held-out steps.
    action_box : (low, high), optional
        Bounds of continuous actions; by default what the demonstrations span.
    random_state : int
        For the folds.
    progress : callable, optional
        Called with a few words at every round.

    Raises
    ------
    DataError
        One sentence: `log_prob` returns something not finite or of the wrong shape, `train` something that is no
        policy or changes nothing, a parameter makes no sense, or the demonstrations are too few.

    Examples
    --------
    >>> found = reweight(net, demonstrations, log_prob=log_prob, train=one_epoch)    # doctest: +SKIP
    >>> found.audit.verdicts                                                         # doctest: +SKIP
    """
    if not isinstance(demonstrations, Demonstrations):
        raise DataError(f"reweight needs Demonstrations, not {type(demonstrations).__name__}; see rpil.read.")
    progress = progress or (lambda _: None)
    if len(demonstrations) < 2:
        raise DataError(f"{demonstrations.source}: one demonstration alone cannot be compared; give at least two.")
    if not 1 <= n_folds <= len(demonstrations):
        raise DataError(f"n_folds={n_folds!r} must be from 1 to the number of demonstrations, {len(demonstrations)}.")
    if max_rounds < 1:
        raise DataError(f"max_rounds={max_rounds!r} must be 1 or more.")
    if minority not in MINORITY:
        raise DataError(f"There is no minority {minority!r}; choose {' or '.join(MINORITY)}.")
    space, _, codes = code_actions(demonstrations, action_box)
    states = FeatureMap.fit("folded", demonstrations.observations).design(demonstrations.observations)
    data = FitData(states, codes, demonstrations.offsets, space, label_codes(labels, demonstrations))
    fold = data.per_step(deal(data, n_folds, random_state))
    theirs = _Theirs(policy, data, demonstrations, log_prob, train, fold, max_rounds, progress)
    judgement = judge(data, theirs, seed=random_state, minority=minority, progress=progress)
    audit = audit_from_judgement(judgement, data, demonstrations.ids)
    n_rounds = theirs.found[data.per_step(judgement.training_group.astype(float)).tobytes()][1]
    for n in range(n_rounds):
        progress(f"training the policy: {n + 1} of {n_rounds}")
        policy = theirs.teach(policy, np.arange(len(codes)), audit.step_weight)
    sentences = assumption_sentences(judgement.finding, IN_SAMPLE_POLICY if n_folds == 1 else "")
    return Reweighted(policy, replace(audit, assumptions=sentences), n_rounds, n_rounds < max_rounds)
