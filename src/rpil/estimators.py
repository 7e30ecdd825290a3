"""The scikit-learn face of the mixture: `RPIL`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from rpil.adversaries import AUTO, Adversary
from rpil.audit import Audit, summarise
from rpil.belief import believe, evidence
from rpil.cloning import LARGE, PolicyEstimator
from rpil.demonstrations import Demonstrations
from rpil.em import Result, State
from rpil.errors import DataError
from rpil.features import FeatureMap, Untouched
from rpil.identify import competing_groups
from rpil.inputs import (
    as_demonstrations,
    as_prior,
    coded_actions,
    coded_like,
    known_labels,
    ridge_of,
    who_gave,
)
from rpil.policies import linear_policy
from rpil.policies.estimator import estimator_policy
from rpil.priors import ByLength
from rpil.problem import Problem
from rpil.refine import refine
from rpil.reliability import PointMasses, Reliability, TwoBetas
from rpil.search import Setting, fit, unseen
from rpil.suggestions import opinions

Array = NDArray[Any]

_FEW = 32
"""Observations up to which folding them costs little."""

_TOLD = 0.05
"""Nats, for a standard deviation of log length, from which it is said that length counts."""

_REFIT_TOL = 1e-6
"""Gradient, a step, at which the final policy is done: its actions have long stopped changing."""


class AmbiguousWarning(UserWarning):
    """The data hold several groups that may each be the expert; `RPIL.audit_` says which to label."""


class RPIL(PolicyEstimator):
    """Robust probabilistic imitation learning: a policy from demonstrations of unknown quality, and how far to trust
    each of them.

    Parameters
    ----------
    features : {"raw", "folded", "spline", "poly", "nystroem", "auto"}
        What the policy sees of an observation, see `rpil.features`. "auto" chooses, with the ridge, once trust is
        decided: by the likelihood of held-out demonstrations, each with as much say as it is trusted.
    policy : scikit-learn estimator, optional
        What an expert's policy is like: a classifier with `predict_proba` (a regressor where actions are continuous)
        that takes `sample_weight`, a pipeline or a search of such; or what `rpil.TorchPolicy` makes. It sees the
        observations as they are. Its likelihoods are cross-fitted over demonstrations, so that it cannot memorise bad
        ones. A linear one proposes what to trust, and it decides. By default the policy is linear in `features`.
    adversary : str or Adversary
        What bad demonstrators do. "auto" fits several and keeps the one under which held-out demonstrations are most
        likely; or "constant", "uniform", "marginal", "complement" (the paper's), "normalised complement", "confusion",
        "own policy", or an instance such as ``Confusion.given(matrix)``.
    prior : float or (float, float), optional
        P(expert): fixed, or estimated under Beta(a, b). By default it is estimated under Beta(2, 2) and may depend on
        the length of a demonstration, in the direction that the data show, see `rpil.priors`; (2, 2) keeps length out.
    C : float, optional
        Inverse ridge strength, as in `BehavioralCloning`.
    level : {"both", "demonstration"}
        "both": every demonstration has a reliability, the share of its steps that are the expert's, so that partly bad
        demonstrations are understood. "demonstration": all or nothing, the paper's model.
    m_step : {"joint", "expert_only"}
        "expert_only" drops the adversary's term from the policy's M-step, as the paper's code does.
    labels : mapping of id to {"expert", "adversary"}, optional
        What is known; fixes responsibilities, and the search starts from there. `fit` takes them too.
    search_features : str
        What the policy sees while trust is decided: a kind of features, or "auto", which is `features`, but where that
        is "raw" or "auto": then it is "folded" if there are few observations, since a straight line mistakes an expert
        in a rare situation for an adversary, and "raw" if there are many.
    n_single : int
        Starts from single demonstrations, beside the pooled one and the one where all demonstrations weigh the same.
    annealing : int
        Temperatures that each start passes through before EM proper; 0 is none.
    max_iter : int
        EM iterations.
    tol : float
        Gain of the objective, in nats a demonstration, at which EM stops.
    random_state : int
        Same seed, same bits.
    action_box : (low, high), optional
        Bounds of continuous actions, numbers or one for each part; by default what the demonstrations span.
    progress : callable, optional
        Called with a few words at every stage of a fit.

    Attributes
    ----------
    audit_ : Audit
        Verdicts, log-odds, weights of the steps, what cannot be known.
    log_odds_, expert_proba_ : (M,) arrays
        In the order of ``audit_.ids``.
    classes_ : (K,) array
    coef_, intercept_ : arrays
    lower_bound_ : float
        The EM objective.
    n_iter_ : int
    converged_ : bool

    References
    ----------
    Crowe, "Robust Probabilistic Imitation Learning": eq. 3, 7, 9, 11; docs/model.md says what is repaired and added.

    Examples
    --------
    >>> from rpil import RPIL
    >>> model = RPIL().fit(observations, actions, groups=episode)    # doctest: +SKIP
    >>> model.audit_.verdicts                                        # doctest: +SKIP
    """

    def __init__(
        self,
        features: str = "raw",
        policy: Any = None,
        adversary: str | Adversary = "auto",
        prior: float | tuple[float, float] | None = None,
        C: float | None = None,
        level: str = "both",
        m_step: str = "joint",
        labels: Mapping[Any, str] | None = None,
        search_features: str = "auto",
        n_single: int = 3,
        annealing: int = 0,
        max_iter: int = 200,
        tol: float = 1e-3,
        random_state: int = 0,
        action_box: tuple[ArrayLike, ArrayLike] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        self.features = features
        self.policy = policy
        self.adversary = adversary
        self.prior = prior
        self.C = C
        self.level = level
        self.m_step = m_step
        self.labels = labels
        self.search_features = search_features
        self.n_single = n_single
        self.annealing = annealing
        self.max_iter = max_iter
        self.tol = tol
        self.random_state = random_state
        self.action_box = action_box
        self.progress = progress

    def fit(
        self,
        X: ArrayLike | Demonstrations,
        y: ArrayLike | None = None,
        groups: ArrayLike | None = None,
        labels: Mapping[Any, str] | None = None,
        demonstrators: Mapping[Any, Any] | Sequence[Any] | None = None,
    ) -> RPIL:
        """Learn from observations X (N, D), actions y (N,) and the demonstration of each step, groups (N,).

        `Demonstrations` are accepted in the place of the three. `demonstrators` says who gave which demonstration, by
        id or one for each in order: then those of one person speak for each other, as far as people are found to
        differ, see `rpil.demonstrators`. Whoever is left out by id, or None, is somebody else every time.

        Raises
        ------
        DataError
            One sentence: constant actions, or one outside the declared box, a single demonstration, unknown label
            ids, unknown ids or a wrong number of `demonstrators`, none left that may be an expert's.
        """
        demonstrations = as_demonstrations(self, X, y, groups)
        source = demonstrations.source
        self.space_, self.classes_, codes = coded_actions(demonstrations, self.action_box)
        if len(demonstrations) < 2:
            raise DataError(f"{source}: one demonstration alone (n_samples=1) cannot be compared; give at least two.")
        if self.policy is not None:
            estimator_policy(self.policy, self.space_, len(codes))  # a wrong one is refused before any work
        known = known_labels(labels if labels is not None else self.labels, demonstrations)
        company = who_gave(demonstrators, demonstrations)
        progress = self.progress or (lambda _: None)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            progress("features")
            features = FeatureMap.fit(self._search_kind(demonstrations), demonstrations.observations)
            problem = Problem(
                features.design(
                    demonstrations.observations, single=demonstrations.n_steps * features.n_columns > LARGE
                ),
                codes,
                demonstrations.offsets,
                self.space_,
                known,
                company=company,
            )
            setting = self._setting(features, problem)
            auto = isinstance(self.adversary, str) and self.adversary == "auto"
            candidates = AUTO[self.space_.kind] if auto else (self.adversary,)
            rng = np.random.default_rng(self.random_state)
            result, runs = fit(problem, setting, candidates, rng, progress)
            read: FeatureMap | Untouched = features
            seen, outputs = problem, unseen(problem, setting, result)
            if self.policy is not None:
                read = Untouched()
                seen = replace(problem, features=read.design(demonstrations.observations))
                start = estimator_policy(self.policy, self.space_, len(codes))
                result = refine(seen, setting, start, result, progress)
                outputs = result.posterior.outputs
            progress("competing groups")
            groups_found = competing_groups(problem, setting, result, runs, rng)
            self._finish(demonstrations, codes, read, seen, result, outputs, groups_found)
            solutions = opinions(self.expert_proba_, [run.posterior.expert for run in runs])
            self.audit_: Audit = replace(self.audit_, solutions=solutions)
        return self

    @property
    def log_odds_(self) -> Array:
        """Log-odds of expert against adversary, (M,)."""
        return self.audit_.log_odds

    @property
    def expert_proba_(self) -> Array:
        """P(expert) of each demonstration, (M,)."""
        return self.audit_.expert_proba

    def score_demonstrations(
        self, X: ArrayLike | Demonstrations, y: ArrayLike | None = None, groups: ArrayLike | None = None
    ) -> Array:
        """Log-odds of expert against adversary for demonstrations that were not fitted, (M,).

        Raises
        ------
        DataError
            Where an action is not among `classes_`.
        """
        check_is_fitted(self)
        demonstrations = as_demonstrations(self, X, y, groups, reset=False)
        codes = coded_like(self.classes_, self.space_.n_parts, demonstrations)
        design = self.search_features_.design(demonstrations.observations)
        nobody = np.zeros(len(demonstrations), dtype=int)
        problem = Problem(design, codes, demonstrations.offsets, self.space_, nobody)
        by_node = evidence(problem, self.state_, self.state_.policy.outputs(design))
        return self.belief_.log_odds(by_node, problem.lengths)

    def _search_kind(self, demonstrations: Demonstrations) -> str:
        if self.search_features != "auto":
            return self.search_features
        few = demonstrations.n_observations <= _FEW
        if self.features not in ("raw", "auto"):
            return self.features
        return "folded" if few and demonstrations.is_discrete else "raw"

    def _setting(self, features: FeatureMap, problem: Problem) -> Setting:
        ridge = ridge_of(features, self.C, len(problem.actions), problem.space)
        levels: dict[str, Callable[[], Reliability]] = {"both": TwoBetas.start, "demonstration": PointMasses}
        for name, value, known in (("level", self.level, levels), ("m_step", self.m_step, ("joint", "expert_only"))):
            if value not in known:
                raise DataError(f"There is no {name} {value!r}; choose {' or '.join(known)}.")
        return Setting(
            policy=linear_policy(problem.space, ridge, len(problem.actions)),
            prior=as_prior(self.prior, problem.lengths),
            reliability=levels[self.level](),
            mode=self.m_step,  # type: ignore[arg-type]
            n_single=self.n_single,
            annealing=self.annealing,
            max_iter=self.max_iter,
            tol=self.tol,
        )

    def _finish(
        self,
        demonstrations: Demonstrations,
        codes: Array,
        features: FeatureMap | Untouched,
        problem: Problem,
        result: Result,
        outputs: Array,
        competing: list[Array],
    ) -> None:
        """Keep what was found, and refit the policy to the expert's term alone: the adversary's biases it."""
        self.search_features_: FeatureMap | Untouched = features
        self.state_: State = result.state
        self.belief_, log_odds = believe(problem, result, outputs)
        self.n_iter_ = max(1, len(result.history) - 1)
        self.lower_bound_ = result.objective
        self.converged_ = result.converged
        audit = summarise(problem, result, self.belief_, log_odds, demonstrations.ids, competing)
        weight = audit.step_weight
        if weight.sum() < 1.0:  # nobody is trusted: what little is the expert's, wherever it is
            weight = result.posterior.step
        if self.policy is None:
            self._learn(demonstrations, codes, weight, weight > 0.5 * weight.max(), _REFIT_TOL)
        else:
            self.features_, self.policy_ = features, result.state.policy.finished(problem, weight)  # type: ignore[attr-defined]
        self.audit_ = replace(audit, assumptions=tuple(_assumptions(self, problem)))
        if not result.converged:
            warnings.warn("EM stopped at max_iter; raise max_iter or tol.", ConvergenceWarning, stacklevel=3)
        if competing:
            which = ", ".join(repr(m) for m in self.audit_.to_label)
            warnings.warn(
                f"{demonstrations.source}: {len(competing)} groups of demonstrations each agree among themselves and "
                f"nothing says which is the expert; label one of each, say {which}.",
                AmbiguousWarning,
                stacklevel=3,
            )


def _assumptions(model: RPIL, problem: Problem) -> list[str]:
    """What was taken for granted, one sentence each."""
    labelled = int((problem.labels != 0).sum())
    said = [
        "Experts agree with one another: in similar states they act alike.",
        f"Steps that follow one another tell the same in part: {model.belief_.power:.2f} of each counts.",
        f"P(nobody is an adversary, or nothing tells who) is {model.belief_.alike:.2f}; beforehand it was one half.",
        f"The policy is linear in {model.features_.kind} features."
        if model.policy is None
        else f"The policy is a {type(model.policy).__name__}; each demonstration was judged by one fitted to others.",
        "The order of demonstrations and any reward were not used.",
    ]
    if model.level == "demonstration":
        said.append("A demonstration is good or bad as a whole.")
    if isinstance(model.prior, float):
        said.append(f"The share of experts was given as {model.prior}.")
    prior = model.belief_.prior
    if isinstance(prior, ByLength) and abs(prior.slope) >= _TOLD:
        more = "more" if prior.slope > 0 else "less"
        nats = f"{abs(prior.slope):.1f} nats for each standard deviation of the logarithm of their length"
        said.append(f"Longer demonstrations are trusted {more} than short ones, by {nats}: learned from the others.")
    if labelled:
        said.append(f"{labelled} labels were taken as certain.")
    if problem.company.said:
        said.append(problem.company.said)
    return said
