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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import Tags
from threadpoolctl import threadpool_limits

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.estimators.cloning import LinearPolicySpec, PolicyEstimator, as_demonstrations
from rpil.estimators.task import Task
from rpil.numerics.parallel import in_parallel
from rpil.numerics.types import Array
from rpil.policies.features import ridge_of
from rpil.policies.linear import LinearPolicy, linear_policy
from rpil.policies.settings import SelectionSettings

START_STEPS, START_TOL, N_CARRIED = 2, 1e-3, 5
"""Concentration steps of every start, as in FAST-LTS; the largest entry of the gradient, a step, at which its policy is
fitted; and the best starts that go on until the selection stays the same. The last two are chosen by hand."""


@dataclass(frozen=True, eq=False)
class Selection:
    """A selection of demonstrations and the policy fitted to them."""

    policy: LinearPolicy
    log_likelihood: Array
    """Mean log-likelihood of a step of each demonstration under the policy, in nats."""
    selected: Array
    objective: float
    """The value of eq. 2, which no concentration step raises."""
    n_fits: int
    converged: bool
    """Whether the selected demonstrations are those that the policy explains best."""


def fit_selected(data: FitData, policy: LinearPolicy, selected: Array, tol: float) -> Selection:
    """Fit the policy to the `selected` (M,) demonstrations, each weighted as one of average length."""
    weight, subset = selected * data.lengths.mean() / data.lengths, data.select(np.flatnonzero(selected))
    policy, _ = policy.fit(subset, subset.per_step(weight[selected]), tol=tol)
    log_likelihood = data.sum_steps(policy.log_prob(policy.outputs(data.features), data.actions)) / data.lengths
    penalty = policy.penalty() / data.lengths.mean()
    objective = (penalty - log_likelihood[selected].sum()) / selected.sum()
    return Selection(policy, log_likelihood, selected, float(objective), n_fits=1, converged=False)


def concentrate(data: FitData, start: Selection, n_trusted: int, tol: float, max_iter: int) -> Selection:
    """Concentration steps: select the `n_trusted` demonstrations that the policy explains best, and fit it to them."""
    n_fits, current = int(start.selected.sum() == n_trusted), start
    for _ in range(max_iter):
        best = np.argsort(-current.log_likelihood, kind="stable")[:n_trusted]
        selected = np.isin(np.arange(data.n_demonstrations), best)
        if (selected == current.selected).all():
            return replace(current, n_fits=n_fits, converged=True)
        current, n_fits = fit_selected(data, current.policy, selected, tol), n_fits + 1
    return replace(current, n_fits=n_fits)


def starts(n_demonstrations: int, n_trusted: int, n_starts: int, rng: np.random.Generator) -> list[Array]:
    """The demonstrations (M,) to which the policy of each start is fitted: all, single ones in random order, and random
    `n_trusted` where there are more starts than demonstrations.

    Small subsets come first, as in FAST-LTS: they are the likeliest to contain no bad demonstration.
    """
    numbers = np.arange(n_demonstrations)
    subsets = [np.ones(n_demonstrations, dtype=bool), *(numbers == m for m in rng.permutation(numbers))]
    while len(subsets) < n_starts:
        subsets.append(np.isin(numbers, rng.choice(numbers, n_trusted, replace=False)))
    return subsets[:n_starts]


def search(
    data: FitData, policy: LinearPolicy, n_trusted: int, subsets: Sequence[Array], tol: float, max_iter: int
) -> Selection:
    """The best selection from starts with policies fitted to the `subsets` (M,)."""

    def begin(subset: Array) -> Selection:
        return concentrate(data, fit_selected(data, policy, subset, START_TOL), n_trusted, START_TOL, START_STEPS)

    def go_on(start: Selection) -> Selection:
        return concentrate(data, fit_selected(data, start.policy, start.selected, tol), n_trusted, tol, max_iter)

    candidates = sorted(in_parallel(begin, subsets, data.features), key=lambda start: -start.objective)
    distinct = {start.selected.tobytes(): start for start in candidates}  # the best of equal selections comes last
    carried = sorted(distinct.values(), key=lambda start: start.objective)[:N_CARRIED]
    return min(in_parallel(go_on, carried, data.features), key=lambda start: start.objective)


class RMEnt(PolicyEstimator):
    """Robust maximum entropy: clone the `n_trusted` demonstrations that one policy explains best.

    Parameters
    ----------
    n_trusted : int or float
        Number of trusted demonstrations, or their share in (0, 1), rounded up; by default half, because
        no estimator withstands more bad ones than that.
    features : {"raw", "folded", "nystroem", "auto"}
        Features of the observations; "auto" chooses with all demonstrations trusted alike.
    C : float, optional
        Inverse ridge strength, as in `BehavioralCloning`; each demonstration counts as one of average length.
    n_starts : int
        Policies that the search starts from, of all demonstrations and of single ones.
    max_iter : int
        Concentration steps of a start, at most.
    tol : float
        Largest gradient entry, a step, at which the solver stops.
    random_state : int
        Seed; the same seed gives the same bits.
    groups : {"rows"}, optional
        "rows" takes every row for a demonstration where `fit` gets no groups; by default that is an error.

    Attributes
    ----------
    weights_ : (M,) array
        1 for the demonstrations that are trusted and 0 for the others, in the order of `ids_`.
    log_likelihood_ : (M,) array
        Mean log-likelihood of a step of each demonstration: how well the policy explains it.
    ids_ : tuple
        The demonstrations.
    objective_ : float
        The minimised objective: minus the mean `log_likelihood_` of the trusted, plus the ridge.
    n_iter_ : int
        Fits of the best start since it was among the most promising.
    converged_ : bool
    classes_ : (K,) array

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
        groups: Literal["rows"] | None = None,
    ) -> None:
        self.n_trusted = n_trusted
        self.features = features
        self.C = C
        self.n_starts = n_starts
        self.max_iter = max_iter
        self.tol = tol
        self.random_state = random_state
        self.groups = groups

    def fit(self, X: ArrayLike | Demonstrations, y: ArrayLike | None = None, groups: ArrayLike | None = None) -> RMEnt:
        """Learn from observations X (N, D), actions y (N,) and the demonstration of each step, groups (N,).

        `Demonstrations` may replace the three.

        Raises
        ------
        DataError
            One sentence: rows without groups, constant actions, a single demonstration, an impossible `n_trusted`.
        """
        demonstrations = as_demonstrations(self, X, y, groups)
        task = Task.of(demonstrations)
        space, self.space_, self.classes_ = task.space, task.space, task.classes
        given, n = self.n_trusted, len(demonstrations)
        if isinstance(given, float | np.floating) and 0 < given < 1:
            given = ceil(round(given * n, 9))  # .28 of 25 is 7, whatever floating point says
        if not isinstance(given, int | np.integer) or not 1 <= given <= n:
            wrong = f"n_trusted={given!r} of {n} demonstrations"
            remedy = f"give a whole number from 1 to {n}, or a share between 0 and 1"
            raise DataError(f"{demonstrations.source}: {wrong}; {remedy}.")
        n_trusted = int(given)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            equal = (1.0 / demonstrations.lengths)[demonstrations.groups]
            spec = LinearPolicySpec(self.features, self.C, self.tol, SelectionSettings())
            codes = task.codes(demonstrations)
            choice = spec.choice(demonstrations, codes, np.ones(len(codes)), space)
            self.features_ = spec.feature_map(choice, demonstrations.observations, equal)
            data = task.data(demonstrations, self.features_)
            weight = n_trusted * demonstrations.lengths.mean()
            policy = linear_policy(space, ridge_of(self.features_, self.C, weight, space), weight)
            rng = np.random.default_rng(self.random_state)
            subsets = starts(len(demonstrations), n_trusted, max(1, self.n_starts), rng)
            selection = search(data, policy, n_trusted, subsets, self.tol, self.max_iter)
        self.policy_ = selection.policy.with_temperature(choice.temperature)
        self.ids_ = demonstrations.ids
        self.weights_ = selection.selected.astype(float)
        self.log_likelihood_ = selection.log_likelihood
        self.objective_ = selection.objective
        self.n_iter_ = selection.n_fits
        self.converged_ = selection.converged
        if not selection.converged:
            warnings.warn("Concentration stopped at max_iter; raise it.", ConvergenceWarning, stacklevel=2)
        return self

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        # where every row is a demonstration, the half that one policy explains best leaves out a class
        tags.classifier_tags.poor_score = True
        return tags
