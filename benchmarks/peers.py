"""Other methods that rank demonstrations, behind one interface: `METHODS[name](demonstrations, task) -> Answer`.

Every method learns the same policy, ours on features of kind `task.features` (a softmax; linear with Student's tails
where actions are continuous, which not all can do), so that methods differ by their treatment of trust alone. Each
docstring says what is as published and what had to be adapted or guessed. None gets the truth, except the oracle (which
demonstrations are good) and RM-ENT (how many).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from threadpoolctl import threadpool_limits

from peers_common import (
    Answer,
    Array,
    Ensemble,
    Method,
    Task,
    cloned,
    cross_fitted,
    fit_data,
    kind_of,
    pooled_policy,
    step_mean,
    taken,
)
from peers_ileed import ileed
from rpil.data.coding import class_codes
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.numerics.blocks import log_softmax
from rpil.policies.features import ridge_of
from rpil.policies.softmax import SoftmaxPolicy, one_hot
from study.recipe import PaperRecipe

BCND_POLICIES, BCND_ITERATIONS = 5, 5
MOM_STEPS = 1000


def rpil(data: Demonstrations, task: Task) -> Answer:
    """Ours, at its defaults."""
    model = RPIL(features=task.features, random_state=task.seed).fit(data)
    return Answer(model.log_odds_, model)


def trust_all(data: Demonstrations, task: Task) -> Answer:
    """Behavioural cloning of everything."""
    return Answer(None, cloned(data, kind_of(data, task)))


def oracle(data: Demonstrations, task: Task) -> Answer:
    """Behavioural cloning of the demonstrations that are good: the truth is given."""
    return Answer(None, cloned(data.select(task.good), kind_of(data, task)))


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
    model = RMEnt(task.n_trusted or 0.5, features=kind_of(data, task), random_state=task.seed).fit(data)
    return Answer(model.log_likelihood_, model)


def bcnd(data: Demonstrations, task: Task) -> Answer:
    """Behavioral cloning from noisy demonstrations (Sasaki and Yamashina, ICLR 2021).

    As published: the steps are split into K disjoint sets, one policy is cloned from each, with every step weighted by
    the likelihood of its action under the mean policy of the iteration before; K = 5, 5 iterations. Guessed: the split
    is at random and by steps. Adapted: each fit is carried to its optimum. The score is the mean of the final weights.
    """
    class_codes(data.actions, data.source)
    kind = kind_of(data, task)
    part = np.random.default_rng(task.seed).permutation(data.n_steps) % BCND_POLICIES
    weight = np.ones(data.n_steps)
    for _ in range(BCND_ITERATIONS):
        policies = [cloned(data, kind, weight * (part == k)) for k in range(BCND_POLICIES)]
        policy = Ensemble(tuple((one.features_, one.policy_) for one in policies), policies[0].classes_)
        weight = np.exp(policy.log_prob(data.observations, data.actions))
    return Answer(step_mean(data, weight), policy)


def median_of_means(data: Demonstrations, task: Task) -> Answer:
    """Robust imitation learning from corrupted demonstrations (Liu et al., 2022).

    As published: min over pi, max over pi' of the median over blocks of loss(pi) - loss(pi'), by alternating gradient
    steps on the block that is the median. Adapted: a block is one demonstration, since the steps of a demonstration are
    good or bad together and a larger block is the likelier to hold a bad one; steps of length 1 are preconditioned by
    the features' covariance; pi starts from the pooled policy, pi' from the uniform one; the mean of the last half of
    the path is returned. The paper ranks nothing, and how often a demonstration is the median says little, the best
    being as far from it as the worst: the score is the mean log-likelihood under the final policy.
    """
    problem, features, classes = fit_data(data, kind_of(data, task))
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

        weights = pooled_policy(problem, ridge * data.n_steps).weights
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
    for held_out, policy in cross_fitted(data, task):
        proba[held_out] = policy.predict_proba(data.observations[held_out])
    quality = get_label_quality_scores(codes, proba)
    kept = ~find_label_issues(codes, proba, n_jobs=1)
    return Answer(step_mean(data, quality), cloned(data, kind_of(data, task), kept.astype(float)))


def mean_log_likelihood(data: Demonstrations, task: Task) -> Answer:
    """How well one policy, cloned from everything, explains a demonstration: the mean over its steps."""
    return Answer(step_mean(data, cloned(data, kind_of(data, task)).log_prob(data.observations, data.actions)), None)


def cross_fitted_log_likelihood(data: Demonstrations, task: Task) -> Answer:
    """The same with policies that have not seen the demonstration: 5 folds of whole demonstrations."""
    log_prob = np.empty(data.n_steps)
    for held_out, policy in cross_fitted(data, task):
        log_prob[held_out] = policy.log_prob(data.observations[held_out], data.actions[held_out])
    return Answer(step_mean(data, log_prob), None)


def length(data: Demonstrations, task: Task) -> Answer:
    """The number of steps: long is good. For the opposite belief take one minus its AUROC."""
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
