"""Other ways of deciding whom to trust, behind one interface: `METHODS[name](demonstrations, task) -> Answer`.

Every method learns the same policy, our softmax on features of kind `task.features`, so that methods differ by their
treatment of trust alone. Each docstring says what is as published and what had to be adapted or guessed. None reads the
truth, but for the two that are told a part of it: the oracle and RM-ENT.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rpil.adversaries import Complement
from rpil.cloning import BehavioralCloning
from rpil.demonstrations import Demonstrations
from rpil.em import Prior, Problem, State, run
from rpil.estimators import RPIL, AmbiguousWarning
from rpil.features import FeatureMap
from rpil.inputs import action_codes, ridge_of
from rpil.passes import logsumexp
from rpil.policies import SoftmaxPolicy
from rpil.reliability import PointMasses
from rpil.rment import RMEnt

Array = NDArray[Any]
N_FOLDS = 5


@dataclass(frozen=True, eq=False)
class Task:
    """What a method is told beside the demonstrations.

    Attributes
    ----------
    features : str
        Kind of features, the same for all methods of a run.
    seed : int
    prior : float
        P(expert), for the paper's recipe alone: it gives .2 for Mountain Car, .5 for Lunar Lander, .75 for Acrobot.
    n_trusted : int, optional
        How many demonstrations are good: RM-ENT alone is told, and takes half of them where it is not.
    good : (M,) bool array, optional
        Which ones: the oracle alone is told.
    """

    features: str = "raw"
    seed: int = 0
    prior: float = 0.5
    n_trusted: int | None = None
    good: Array | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method finds.

    Attributes
    ----------
    scores : (M,) array or None
        Higher is more trusted; None where the method does not rank.
    policy : Any or None
        Has `predict`, `predict_log_proba` and `classes_`; None where the method only ranks.
    """

    scores: Array | None
    policy: Any | None


Method = Callable[[Demonstrations, Task], Answer]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The mean of softmax policies, pi(k|s) = 1/E sum_e pi_e(k|s); often E = 1."""

    members: tuple[tuple[FeatureMap, SoftmaxPolicy], ...]
    classes_: Array

    def predict_log_proba(self, X: Array) -> Array:
        """log pi(k|s), (N, K)."""
        each = np.stack([policy.log_proba(features.design(X)) for features, policy in self.members])
        return logsumexp(each, 0) - np.log(len(each))

    def predict(self, X: Array) -> Array:
        """The most likely action, (N,)."""
        return self.classes_[self.predict_log_proba(X).argmax(axis=1)]


def rpil(data: Demonstrations, task: Task) -> Answer:
    """Ours, at its defaults."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AmbiguousWarning)
        model = RPIL(features=task.features, random_state=task.seed).fit(data)
    return Answer(model.log_odds_, model)


def trust_all(data: Demonstrations, task: Task) -> Answer:
    """Behavioural cloning of everything."""
    return Answer(None, _cloned(data, _kind(data, task)))


def oracle(data: Demonstrations, task: Task) -> Answer:
    """Behavioural cloning of the demonstrations that are good: the truth is given."""
    return Answer(None, _cloned(data.select(task.good), _kind(data, task)))


def papers_recipe(data: Demonstrations, task: Task) -> Answer:
    """R-PIL (Crowe) as its tables were made: eq. 7, 9 and 11 with the raw complement 1 - pi.

    As published: the raw observation whatever `task.features` is, a prior that is given, M-steps on the expert's term
    alone, 101 EM iterations from the pooled fit, the policy of the last one. Adapted: everything is in logs, the
    published products underflow after some thousand steps; a ridge of C = 1e6, without which separable demonstrations
    have no finite fit.
    """
    problem, features, classes = _problem(data, "raw")
    ridge = ridge_of(features, 1e6, data.n_steps, problem.n_actions)
    with threadpool_limits(1, "blas"):
        pooled, _ = SoftmaxPolicy.zero(problem.n_actions, ridge).fit(problem.features, problem.one_hot(_ones(data)))
        start = State(pooled, Complement(), Prior(task.prior, fixed=True), PointMasses())
        end = run(problem, start, mode="expert_only", max_iter=101, tol=0.0, m_iter=10, m_cg=50)
    return Answer(end.posterior.log_odds, Ensemble(((features, end.state.policy),), classes))


def rm_ent(data: Demonstrations, task: Task) -> Answer:
    """Robust maximum entropy (eq. 2 of the R-PIL paper): clone the M demonstrations that one policy explains best.

    As published: M is given, the true number of good demonstrations. Adapted: solved by concentration steps from many
    starts, see `rpil.rment`. The paper ranks nothing; the score is the mean log-likelihood under the final policy.
    """
    model = RMEnt(task.n_trusted or 0.5, features=_kind(data, task), random_state=task.seed).fit(data)
    return Answer(model.log_likelihood_, model)


def mean_log_likelihood(data: Demonstrations, task: Task) -> Answer:
    """How well one policy, cloned from everything, explains a demonstration: the mean over its steps."""
    return Answer(_mean(data, _taken(data, _cloned(data, _kind(data, task)))), None)


def cross_fitted_log_likelihood(data: Demonstrations, task: Task) -> Answer:
    """The same with policies that have not seen the demonstration: 5 folds of whole demonstrations."""
    log_proba, codes = _cross_fitted(data, task)
    return Answer(_mean(data, log_proba[np.arange(data.n_steps), codes]), None)


def length(data: Demonstrations, task: Task) -> Answer:
    """The number of steps: long is good. Whoever believes the opposite reads one minus its AUROC."""
    return Answer(data.lengths.astype(float), None)


def random(data: Demonstrations, task: Task) -> Answer:
    """Uniform draws."""
    return Answer(np.random.default_rng(task.seed).random(len(data)), None)


METHODS: dict[str, Method] = {
    "rpil": rpil,
    "trust all": trust_all,
    "oracle": oracle,
    "paper's recipe": papers_recipe,
    "RM-ENT": rm_ent,
    "mean log-likelihood": mean_log_likelihood,
    "cross-fitted log-likelihood": cross_fitted_log_likelihood,
    "length": length,
    "random": random,
}


def _kind(data: Demonstrations, task: Task) -> str:
    """The kind of features, the same for every method; "auto" is what cloning chooses on all demonstrations."""
    return _chosen(data) if task.features == "auto" else task.features


@lru_cache(maxsize=1)
def _chosen(data: Demonstrations) -> str:
    return BehavioralCloning(features="auto").fit(data).features_.kind


def _cloned(data: Demonstrations, kind: str, weight: Array | None = None) -> BehavioralCloning:
    """Softmax regression; `weight` (N,) may leave steps out, and their actions are still known."""
    return BehavioralCloning(features=kind).fit(data, sample_weight=weight)


def _problem(data: Demonstrations, kind: str) -> tuple[Problem, FeatureMap, Array]:
    """The demonstrations behind a feature map, for methods with an optimiser of their own; the map; the actions."""
    classes, codes = action_codes(data.actions, data.source)
    features = FeatureMap.fit(kind, data.observations)
    nobody = np.zeros(len(data), dtype=int)
    return Problem(features.design(data.observations), codes, data.offsets, len(classes), nobody), features, classes


def _ones(data: Demonstrations) -> Array:
    return np.ones(data.n_steps)


def _taken(data: Demonstrations, policy: Any) -> Array:
    """log pi(a_n|s_n) of the actions taken, (N,)."""
    codes = np.searchsorted(policy.classes_, data.actions)
    return policy.predict_log_proba(data.observations)[np.arange(data.n_steps), codes]


def _mean(data: Demonstrations, values: Array) -> Array:
    """Means over the steps of each demonstration, (N,) -> (M,)."""
    return np.add.reduceat(values, data.offsets[:-1]) / data.lengths


def _cross_fitted(data: Demonstrations, task: Task) -> tuple[Array, Array]:
    """log pi(k|s) by policies cloned from the other folds of demonstrations, (N, K); codes of the actions, (N,)."""
    kind = _kind(data, task)
    folds = np.random.default_rng(task.seed).permutation(len(data)) % N_FOLDS
    classes, codes = action_codes(data.actions, data.source)
    log_proba = np.empty((data.n_steps, len(classes)))
    for fold in range(min(N_FOLDS, len(data))):
        held_out = (folds == fold)[data.groups]
        policy = _cloned(data, kind, (~held_out).astype(float))
        log_proba[held_out] = policy.predict_log_proba(data.observations[held_out])
    return log_proba, codes
