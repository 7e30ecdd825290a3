"""Robust maximum entropy: the policy of the `n_trusted` demonstrations that one policy explains best.

Eq. 2 of the paper chooses weights w of the demonstrations and the policy Lambda together, H of M being trusted:

    min over w, Lambda  of  - 1/H sum_m w_m l_m(Lambda) + penalty,      sum w = H,  0 <= w <= 1

where l_m = 1/N_m sum_n log pi(a_n|s_n): a demonstration is an empirical distribution, so that it counts by its mean
over steps. The weights enter linearly, hence for a given policy the best H demonstrations have weight 1 and the others
0. This is a trimmed likelihood, and is solved as FAST-LTS solves trimmed least squares (Rousseeuw and Van Driessen,
2006): many starts make a few concentration steps (select, then fit), the most promising go on until the selection
stays.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from math import ceil
from operator import index

import numpy as np
from numpy.typing import ArrayLike
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import Tags
from threadpoolctl import threadpool_limits

from rpil.data.coding import code_actions
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.estimators.cloning import PolicyEstimator
from rpil.estimators.final_policy import LinearPolicySpec
from rpil.estimators.validation import as_demonstrations
from rpil.numerics.parallel import in_parallel
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.linear import linear_policy
from rpil.policies.protocol import Policy

_SHORT = 2
"""Concentration steps of every start."""

_CARRIED = 5
"""Starts that go on."""

_ROUGH = 1e-3
"""Gradient, a step, that will do to tell starts apart."""


@dataclass(frozen=True, eq=False)
class Trimmed:
    """Where concentration steps ended.

    Attributes
    ----------
    policy : Policy
    log_likelihood : (M,) array
        Mean over the steps of each demonstration, under the policy.
    kept : (M,) bool array
        The demonstrations that the policy was fitted to.
    history : (steps,) array
        The objective of eq. 2 after every fit; it never rises.
    converged : bool
        Whether `kept` are the best under the policy.
    """

    policy: Policy
    log_likelihood: Array
    kept: Array
    history: Array
    converged: bool

    @property
    def objective(self) -> float:
        return float(self.history[-1])


def fitted(data: FitData, policy: Policy, kept: Array, tol: float) -> Trimmed:
    """The policy, from `policy` on, of the demonstrations `kept` (M,), each counting as one of average length."""
    weight = kept * data.lengths.mean() / data.lengths
    trusted = data.select(np.flatnonzero(kept))
    policy, _ = policy.fit(trusted, trusted.per_step(weight[kept]), tol=tol)
    taken = policy.log_prob(policy.outputs(data.features), data.actions)
    log_likelihood = data.sum_steps(taken) / data.lengths
    penalty = policy.penalty() / data.lengths.mean()
    objective = (penalty - log_likelihood[kept].sum()) / kept.sum()
    return Trimmed(policy, log_likelihood, kept, np.array([objective]), converged=False)


def concentrate(data: FitData, found: Trimmed, n_trusted: int, tol: float, max_iter: int) -> Trimmed:
    """Keep the `n_trusted` demonstrations that the policy explains best, fit it to them, until they stay the same."""
    history = list(found.history) if found.kept.sum() == n_trusted else []  # others are no values of this objective
    for _ in range(max_iter):
        best = np.argsort(-found.log_likelihood, kind="stable")[:n_trusted]
        kept = np.isin(np.arange(data.n_demonstrations), best)
        if (kept == found.kept).all():
            return Trimmed(found.policy, found.log_likelihood, kept, np.array(history), converged=True)
        found = fitted(data, found.policy, kept, tol)
        history.append(found.objective)
    return Trimmed(found.policy, found.log_likelihood, found.kept, np.array(history), converged=False)


def starts(n_demonstrations: int, n_trusted: int, n_starts: int, rng: np.random.Generator) -> list[Array]:
    """Demonstrations (M,) that the first policy of each start is fitted to: all of them, single ones in random order,
    and, should there be more starts than demonstrations, random `n_trusted`.

    As in FAST-LTS small subsets come first, because they are the likeliest to hold no bad demonstration.
    """
    everyone = np.arange(n_demonstrations)
    found = [np.ones(n_demonstrations, dtype=bool), *(everyone == m for m in rng.permutation(everyone))]
    while len(found) < n_starts:
        found.append(np.isin(everyone, rng.choice(everyone, n_trusted, replace=False)))
    return found[:n_starts]


def search(
    data: FitData, policy: Policy, n_trusted: int, n_starts: int, tol: float, max_iter: int, rng: np.random.Generator
) -> Trimmed:
    """The best of many starts, of which the most promising `_CARRIED` go on after a few steps."""

    def begin(chosen: Array) -> Trimmed:
        return concentrate(data, fitted(data, policy, chosen, _ROUGH), n_trusted, _ROUGH, _SHORT)

    def go_on(found: Trimmed) -> Trimmed:
        return concentrate(data, fitted(data, found.policy, found.kept, tol), n_trusted, tol, max_iter)

    begun = in_parallel(begin, starts(data.n_demonstrations, n_trusted, n_starts, rng), data.features)
    different = {found.kept.tobytes(): found for found in sorted(begun, key=lambda found: -found.objective)}
    promising = sorted(different.values(), key=lambda found: found.objective)[:_CARRIED]
    return min(in_parallel(go_on, promising, data.features), key=lambda found: found.objective)


class RMEnt(PolicyEstimator):
    """Robust maximum entropy: clone the `n_trusted` demonstrations that one policy explains best.

    Parameters
    ----------
    n_trusted : int or float
        How many demonstrations are trusted, or what share of them, in (0, 1), rounded up; by default half, which is
        as many bad ones as any estimator can do without knowing more.
    features : {"raw", "folded", "spline", "poly", "nystroem", "auto"}
        What the policy sees of an observation; "auto" chooses with all demonstrations trusted alike.
    C : float, optional
        Inverse ridge strength, as in `BehavioralCloning`; each demonstration counts as one of average length.
    n_starts : int
        Policies that the search starts from, of all demonstrations and of single ones.
    max_iter : int
        Concentration steps of a start, at most.
    tol : float
        Largest gradient entry, a step, at which the solver stops.
    random_state : int
        Same seed, same bits.

    Attributes
    ----------
    weights_ : (M,) array
        1 for the demonstrations that are trusted and 0 for the others, in the order of `ids_`.
    log_likelihood_ : (M,) array
        Mean log-likelihood of a step of each demonstration: how well the policy explains it.
    ids_ : tuple
        The demonstrations.
    objective_ : float
        What is minimised: minus the mean `log_likelihood_` of the trusted, plus the ridge.
    n_iter_ : int
        Fits of the best start, from when it was among the most promising.
    converged_ : bool
    classes_ : (K,) array
    coef_, intercept_ : arrays

    References
    ----------
    Crowe, "Robust Probabilistic Imitation Learning", eq. 2; docs/model.md.

    Examples
    --------
    >>> from rpil import RMEnt
    >>> model = RMEnt(n_trusted=10).fit(observations, actions, groups=episode)    # doctest: +SKIP
    >>> model.weights_                                                            # doctest: +SKIP
    """

    def __init__(
        self,
        n_trusted: int | float = 0.5,
        features: str = "raw",
        C: float | None = None,
        n_starts: int = 20,
        max_iter: int = 100,
        tol: float = 1e-6,
        random_state: int = 0,
    ) -> None:
        self.n_trusted = n_trusted
        self.features = features
        self.C = C
        self.n_starts = n_starts
        self.max_iter = max_iter
        self.tol = tol
        self.random_state = random_state

    def fit(self, X: ArrayLike | Demonstrations, y: ArrayLike | None = None, groups: ArrayLike | None = None) -> RMEnt:
        """Learn from observations X (N, D), actions y (N,) and the demonstration of each step, groups (N,).

        `Demonstrations` are accepted in the place of the three.

        Raises
        ------
        DataError
            One sentence: constant actions, a single demonstration, an impossible `n_trusted`.
        """
        demonstrations = as_demonstrations(self, X, y, groups)
        source = demonstrations.source
        self.space_, self.classes_, codes = code_actions(demonstrations)
        if len(demonstrations) < 2:
            raise DataError(f"{source}: one demonstration alone (n_samples=1) cannot be compared; give at least two.")
        n_trusted = self._number_trusted(len(demonstrations), source)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            equal = (1.0 / demonstrations.lengths)[demonstrations.groups]
            spec = LinearPolicySpec(self.features, self.C, self.tol)
            choice = spec.choice(demonstrations, codes, np.ones(len(codes)), self.space_)
            self.features_ = FeatureMap.fit(choice.kind, demonstrations.observations, equal, choice.ridge)
            data = FitData(
                self.features_.design(demonstrations.observations),
                codes,
                demonstrations.offsets,
                self.space_,
                np.zeros(len(demonstrations), dtype=int),
            )
            weight = n_trusted * demonstrations.lengths.mean()
            policy = linear_policy(self.space_, ridge_of(self.features_, self.C, weight, self.space_), weight)
            rng = np.random.default_rng(self.random_state)
            found = search(data, policy, n_trusted, max(1, self.n_starts), self.tol, self.max_iter, rng)
        self.policy_ = found.policy.with_temperature(choice.temperature)
        self.ids_ = demonstrations.ids
        self.weights_ = found.kept.astype(float)
        self.log_likelihood_ = found.log_likelihood
        self.objective_ = found.objective
        self.n_iter_ = len(found.history)
        self.converged_ = found.converged
        if not found.converged:
            warnings.warn("Concentration stopped at max_iter; raise it.", ConvergenceWarning, stacklevel=2)
        return self

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        # without groups every row is a demonstration, and the half that one policy explains best leaves out a class
        tags.classifier_tags.poor_score = True
        return tags

    def _number_trusted(self, n_demonstrations: int, source: str) -> int:
        given = self.n_trusted
        if isinstance(given, float | np.floating) and 0 < given < 1:
            return ceil(round(given * n_demonstrations, 9))  # .28 of 25 is 7, whatever floating point says
        try:
            number = index(given)  # type: ignore[arg-type]
        except TypeError:
            number = 0
        if not 1 <= number <= n_demonstrations:
            raise DataError(
                f"{source}: n_trusted={given!r} of {n_demonstrations} demonstrations; give a whole number from 1 to "
                f"{n_demonstrations}, or a share between 0 and 1."
            )
        return number
