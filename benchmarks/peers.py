"""Other ways of deciding whom to trust, behind one interface: `METHODS[name](demonstrations, task) -> Answer`.

Every method learns the same policy, ours on features of kind `task.features` (a softmax; linear with Student's tails
where actions are continuous, which not all can do), so that methods differ by their treatment of trust alone. Each
docstring says what is as published and what had to be adapted or guessed. None reads the truth, but for the two that
are told a part of it: the oracle and RM-ENT.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.special import expit, logsumexp
from threadpoolctl import threadpool_limits

from rpil.data.coding import class_codes
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import AmbiguousWarning
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.numerics.blocks import log_softmax
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.softmax import SoftmaxPolicy, one_hot
from study.recipe import PaperRecipe

Array = NDArray[Any]
N_FOLDS = 5
ILEED_STARTS, ILEED_DIMENSIONS = 5, 2
BCND_POLICIES, BCND_ITERATIONS = 5, 5
MOM_STEPS = 1000


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

    def log_prob(self, X: Array, y: Array) -> Array:
        """log pi(a|s) of the actions y taken in X, (N,)."""
        return self.predict_log_proba(X)[np.arange(len(X)), np.searchsorted(self.classes_, y)]


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
    model = PaperRecipe(task.prior).fit(data)
    return Answer(model.log_odds_, model)


def rm_ent(data: Demonstrations, task: Task) -> Answer:
    """Robust maximum entropy (eq. 2 of the R-PIL paper): clone the M demonstrations that one policy explains best.

    As published: M is given, the true number of good demonstrations. Adapted: solved by concentration steps from many
    starts, see `rpil.estimators.rment`. The paper ranks nothing; the score is the mean log-likelihood under the final
    policy.
    """
    model = RMEnt(task.n_trusted or 0.5, features=_kind(data, task), random_state=task.seed).fit(data)
    return Answer(model.log_likelihood_, model)


def ileed(data: Demonstrations, task: Task) -> Answer:
    """Imitation learning by estimating the expertise of demonstrators (Beliaev et al., ICML 2022).

    As published: demonstrator i masters state s to the degree rho_i(s) = sigmoid(<f(s), w_i>), and the policy, the
    embedding f and all w_i maximise one likelihood; of several random starts the likeliest wins. For discrete actions
    in the form of the authors' code: the action pi means with probability rho, else one of the other K - 1, which is
    rho' pi + (1 - rho') / K with rho' = (K rho - 1) / (K - 1). Adapted: every demonstration is its own demonstrator,
    policy and embedding (of 2 dimensions) are linear in the features, L-BFGS takes the place of Adam, a weak ridge and
    w_i ~ N(0, 1) keep the optimum finite, 5 starts instead of 20 and each from the pooled policy. The score, the mean
    expertise of a demonstration over its own states, is ours.
    """
    problem, features, classes = _problem(data, _kind(data, task))
    rng = np.random.default_rng(task.seed)
    ridge = ridge_of(features, None, data.n_steps, problem.space)
    shapes = ileed_shapes(problem)
    with threadpool_limits(1, "blas"):
        pooled = _pooled(problem, ridge)
        ends = []
        for _ in range(ILEED_STARTS):
            embedding, expertise = (rng.normal(size=shape) for shape in shapes[1:])
            start = np.concatenate([pooled.weights.ravel(), embedding.ravel() / np.sqrt(len(ridge)), expertise.ravel()])
            ends.append(minimize(ileed_loss, start, (problem, ridge), "L-BFGS-B", jac=True, options={"maxiter": 300}))
    weights, embedding, expertise = unpacked(min(ends, key=lambda end: end.fun).x, shapes)
    rho = expit(((problem.features @ embedding) * problem.per_step(expertise)).sum(axis=1))
    return Answer(_mean(data, rho), Ensemble(((features, SoftmaxPolicy(weights, ridge)),), classes))


def ileed_shapes(problem: FitData) -> list[tuple[int, int]]:
    """Of the policy's weights, of the embedding, of the expertise."""
    n_columns = problem.features.shape[1]
    return [(n_columns, problem.space.n), (n_columns, ILEED_DIMENSIONS), (problem.n_demonstrations, ILEED_DIMENSIONS)]


def unpacked(parameters: Array, shapes: list[tuple[int, int]]) -> list[Array]:
    """One vector as arrays of these shapes."""
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    return [part.reshape(shape) for part, shape in zip(np.split(parameters, ends[:-1]), shapes, strict=True)]


def ileed_loss(parameters: Array, problem: FitData, ridge: Array) -> tuple[float, Array]:
    """Penalised negative log-likelihood of ILEED, and its gradient."""
    weights, embedding, expertise = unpacked(parameters, ileed_shapes(problem))
    n_others = problem.space.n - 1
    log_proba = log_softmax(problem.features @ weights)
    proba, log_pi = np.exp(log_proba), taken(problem, log_proba)
    pi, others = np.exp(log_pi), -np.expm1(log_pi)
    embedded, own = problem.features @ embedding, problem.per_step(expertise)
    rho = expit((embedded * own).sum(axis=1))
    likelihood = np.maximum(rho * pi + (1 - rho) * others / n_others, np.finfo(float).tiny)
    penalty = 0.5 * ((ridge[:, None] * weights**2).sum() + (ridge[:, None] * embedding**2).sum() + (expertise**2).sum())

    by_logit = (rho - (1 - rho) / n_others) * pi / likelihood  # d log p / d log pi
    by_skill = rho * (1 - rho) * (pi - others / n_others) / likelihood  # d log p / d <f(s), w>
    hot_by_logit = one_hot(problem.actions, by_logit, problem.space.n)
    slopes = (
        ridge[:, None] * weights - problem.features.T @ (hot_by_logit - by_logit[:, None] * proba),
        ridge[:, None] * embedding - problem.features.T @ (by_skill[:, None] * own),
        expertise - problem.sum_steps(by_skill[:, None] * embedded),
    )
    return float(penalty - np.log(likelihood).sum()), np.concatenate([slope.ravel() for slope in slopes])


def bcnd(data: Demonstrations, task: Task) -> Answer:
    """Behavioral cloning from noisy demonstrations (Sasaki and Yamashina, ICLR 2021).

    As published: the steps are split into K disjoint sets, one policy is cloned from each, with every step weighted by
    the likelihood of its action under the mean policy of the iteration before; K = 5, 5 iterations. Guessed: the split
    is at random and by steps. Adapted: each fit is carried to its optimum. The score is the mean of the final weights.
    """
    class_codes(data.actions, data.source)
    kind = _kind(data, task)
    part = np.random.default_rng(task.seed).permutation(data.n_steps) % BCND_POLICIES
    weight = np.ones(data.n_steps)
    for _ in range(BCND_ITERATIONS):
        policies = [_cloned(data, kind, weight * (part == k)) for k in range(BCND_POLICIES)]
        policy = Ensemble(tuple((one.features_, one.policy_) for one in policies), policies[0].classes_)
        weight = np.exp(policy.log_prob(data.observations, data.actions))
    return Answer(_mean(data, weight), policy)


def median_of_means(data: Demonstrations, task: Task) -> Answer:
    """Robust imitation learning from corrupted demonstrations (Liu et al., 2022).

    As published: min over pi, max over pi' of the median over blocks of loss(pi) - loss(pi'), by alternating gradient
    steps on the block that is the median. Adapted: a block is one demonstration, since the steps of a demonstration are
    good or bad together and a larger block is the likelier to hold a bad one; steps of length 1 are preconditioned by
    the features' covariance; pi starts from the pooled policy, pi' from the uniform one; the mean of the last half of
    the path is returned. The paper ranks nothing, and how often a demonstration is the median says little, the best
    being as far from it as the worst: the score is the mean log-likelihood under the final policy.
    """
    problem, features, classes = _problem(data, _kind(data, task))
    ridge = ridge_of(features, None, 1.0, problem.space)
    hot = one_hot(problem.actions, np.ones(data.n_steps), problem.space.n)
    with threadpool_limits(1, "blas"):
        covariance = problem.features.T @ problem.features / data.n_steps + np.diag(ridge + 1e-9)
        factor = cho_factor(covariance)

        def losses(weights: Array) -> Array:
            return -problem.sum_steps(taken(problem, log_softmax(problem.features @ weights))) / problem.lengths

        def stepped(weights: Array, block: int) -> Array:
            steps = slice(*problem.offsets[block : block + 2])
            rows = problem.features[steps]
            slope = rows.T @ (np.exp(log_softmax(rows @ weights)) - hot[steps]) / len(rows) + ridge[:, None] * weights
            return weights - cho_solve(factor, slope)

        weights = _pooled(problem, ridge * data.n_steps).weights
        rival, path = np.zeros_like(weights), []
        ours_losses, rivals_losses = losses(weights), losses(rival)
        for _ in range(MOM_STEPS):
            weights = stepped(weights, _median(ours_losses - rivals_losses))
            ours_losses = losses(weights)
            rival = stepped(rival, _median(ours_losses - rivals_losses))
            rivals_losses = losses(rival)
            path.append(weights)
    policy = SoftmaxPolicy(np.mean(path[MOM_STEPS // 2 :], axis=0), ridge)
    return Answer(-losses(policy.weights), Ensemble(((features, policy),), classes))


def _median(values: Array) -> int:
    """The index of the (lower) median."""
    return int(np.argsort(values, kind="stable")[(len(values) - 1) // 2])


def cleanlab(data: Demonstrations, task: Task) -> Answer:
    """Confident learning (Northcutt et al., 2021), by its own package: actions are labels that may be wrong.

    As published: the label quality score (self-confidence) on out-of-sample probabilities, and training without the
    steps that `find_label_issues` flags. Adapted: folds are whole demonstrations, the score of a demonstration is the
    mean of its steps'.
    """
    from cleanlab.filter import find_label_issues
    from cleanlab.rank import get_label_quality_scores

    classes, codes = class_codes(data.actions, data.source)
    proba = np.empty((data.n_steps, len(classes)))
    for held_out, policy in _cross_fitted(data, task):
        proba[held_out] = policy.predict_proba(data.observations[held_out])
    quality = get_label_quality_scores(codes, proba)
    kept = ~find_label_issues(codes, proba, n_jobs=1)
    return Answer(_mean(data, quality), _cloned(data, _kind(data, task), kept.astype(float)))


def mean_log_likelihood(data: Demonstrations, task: Task) -> Answer:
    """How well one policy, cloned from everything, explains a demonstration: the mean over its steps."""
    return Answer(_mean(data, _cloned(data, _kind(data, task)).log_prob(data.observations, data.actions)), None)


def cross_fitted_log_likelihood(data: Demonstrations, task: Task) -> Answer:
    """The same with policies that have not seen the demonstration: 5 folds of whole demonstrations."""
    log_prob = np.empty(data.n_steps)
    for held_out, policy in _cross_fitted(data, task):
        log_prob[held_out] = policy.log_prob(data.observations[held_out], data.actions[held_out])
    return Answer(_mean(data, log_prob), None)


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
    "ILEED": ileed,
    "BCND": bcnd,
    "median of means": median_of_means,
    "cleanlab": cleanlab,
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
    """Our policy; `weight` (N,) may leave steps out, and their actions are still known."""
    return BehavioralCloning(features=kind).fit(data, sample_weight=weight)


def _problem(data: Demonstrations, kind: str) -> tuple[FitData, FeatureMap, Array]:
    """The demonstrations behind a feature map, for methods with an optimiser of their own; the map; the actions."""
    classes, codes = class_codes(data.actions, data.source)
    features = FeatureMap.fit(kind, data.observations)
    nobody = np.zeros(len(data), dtype=int)
    return (
        FitData(features.design(data.observations), codes, data.offsets, Discrete(len(classes)), nobody),
        features,
        classes,
    )


def _pooled(problem: FitData, ridge: Array) -> SoftmaxPolicy:
    """The policy that trusts every step."""
    return SoftmaxPolicy.zero(problem.space.n, ridge).fit(problem, np.ones(len(problem.actions)))[0]


def taken(problem: FitData, log_proba: Array) -> Array:
    """Log-probability of the action taken, (N, K) -> (N,)."""
    return np.take_along_axis(log_proba, problem.actions[:, None], axis=1)[:, 0]


def _mean(data: Demonstrations, values: Array) -> Array:
    """Means over the steps of each demonstration, (N,) -> (M,)."""
    return np.add.reduceat(values, data.offsets[:-1]) / data.lengths


def _cross_fitted(data: Demonstrations, task: Task) -> Iterator[tuple[Array, BehavioralCloning]]:
    """Folds of whole demonstrations, as steps (N,) bool, and policies cloned from the others."""
    kind = _kind(data, task)
    folds = np.random.default_rng(task.seed).permutation(len(data)) % N_FOLDS
    for fold in range(min(N_FOLDS, len(data))):
        held_out = (folds == fold)[data.groups]
        yield held_out, _cloned(data, kind, (~held_out).astype(float))
