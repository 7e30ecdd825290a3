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

from rpil.adversaries import AUTO, Adversary, adversary
from rpil.assumptions import assumptions
from rpil.audit import Audit, summarise
from rpil.belief import Belief, believe, evidence
from rpil.cloning import PolicyEstimator
from rpil.crossfit import cross_fitted
from rpil.demonstrations import Demonstrations
from rpil.demonstrators import STRANGERS, Company
from rpil.em import Result, State
from rpil.engines import Engine, InMemory, Streamed
from rpil.errors import DataError
from rpil.features import N_LANDMARKS, FeatureMap, Untouched
from rpil.files import StrPath
from rpil.formats.dataset import Dataset
from rpil.identify import competing_groups
from rpil.inputs import (
    as_demonstrations,
    as_prior,
    coded_actions,
    coded_like,
    known_labels,
    known_space,
    ridge_of,
    who_gave,
)
from rpil.large import REFIT_TOL, Source, fit_large, is_large
from rpil.policies import linear_policy
from rpil.policies.estimator import estimator_policy
from rpil.problem import Problem
from rpil.refine import refine
from rpil.reliability import PointMasses, Reliability, TwoBetas
from rpil.search import Setting, fit

Array = NDArray[Any]

_SINGLE = {"discrete": 100_000, "continuous": 1_000_000}
"""Entries of a design matrix from which a search is faster in single precision, by kind of actions. Trust needs no more
digits, but least squares do."""

_FEW = 32
"""Observations up to which folding them costs little."""

_LANDMARKS = (50, N_LANDMARKS)
"""Of Nystroem's features where the search chose them itself, and where they were asked for."""


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
        in a rare situation for an adversary, and "raw" if there are many. Few observations and continuous actions are
        given to "nystroem", with fewer landmarks, and what "raw" finds is one more solution to compare.
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
    engine : Engine, optional
        Who runs passes over data that are many times larger than what a search needs to read, see `rpil.engines`: by
        default this process, on all its cores; from disk, where a `Dataset` is.
    checkpoint : path, optional
        Where a fit to so much data keeps how far it is, after every pass. Where the file exists the fit goes on from
        there, to the same bits; in the end it is removed.

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

    audit_: Audit

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
        engine: Engine | None = None,
        checkpoint: StrPath | None = None,
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
        self.engine = engine
        self.checkpoint = checkpoint

    def fit(
        self,
        X: ArrayLike | Demonstrations | Dataset,
        y: ArrayLike | None = None,
        groups: ArrayLike | None = None,
        labels: Mapping[Any, str] | None = None,
        demonstrators: Mapping[Any, Any] | Sequence[Any] | None = None,
    ) -> RPIL:
        """Learn from observations X (N, D), actions y (N,) and the demonstration of each step, groups (N,).

        `Demonstrations`, or what `rpil.open_dataset` finds on disk, are accepted in the place of the three.
        `demonstrators` says who gave which demonstration, by id or one for each in order: then those of one person
        speak for each other, as far as people are found to differ, see `rpil.demonstrators`. Whoever is left out by id,
        or None, is somebody else every time.

        Raises
        ------
        DataError
            One sentence: constant actions, or one outside the declared box, a single demonstration, unknown label
            ids, unknown ids or a wrong number of `demonstrators`, none left that may be an expert's.
        """
        if isinstance(X, Dataset):
            return self._fit_dataset(X, labels, demonstrators)
        demonstrations = as_demonstrations(self, X, y, groups)
        source = demonstrations.source
        self.space_, self.classes_, codes = coded_actions(demonstrations, self.action_box)
        if len(demonstrations) < 2:
            raise DataError(f"{source}: one demonstration alone (n_samples=1) cannot be compared; give at least two.")
        if self.policy is not None:
            estimator_policy(self.policy, self.space_, len(codes))  # a wrong one is refused before any work
        known = known_labels(labels if labels is not None else self.labels, demonstrations)
        company = who_gave(demonstrators, demonstrations)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            if self.policy is None and is_large(self, demonstrations):
                fit_large(self, demonstrations, known, company, self.engine or InMemory())
            else:
                self._fit_small(demonstrations, codes, known, company)
        return self

    def _fit_dataset(self, data: Dataset, labels: Mapping[Any, str] | None, demonstrators: Any) -> RPIL:
        """What is small is read, and fitted as anything else."""
        self.space_, self.classes_ = known_space(data, self.action_box)
        with threadpool_limits(1, "blas"):
            if self.policy is not None or not is_large(self, data):
                return self.fit(data.select(slice(None)), labels=labels, demonstrators=demonstrators)
            self.n_features_in_, self.observation_names_ = data.n_observations, data.observation_names
            known = known_labels(labels if labels is not None else self.labels, data)
            fit_large(self, data, known, who_gave(demonstrators, data), self.engine or Streamed())
        return self

    def _fit_small(self, demonstrations: Demonstrations, codes: Array, known: Array, company: Company) -> None:
        """A search that reads everything."""
        progress = self.progress or (lambda _: None)
        rng = np.random.default_rng(self.random_state)
        progress("features")
        features, lengths = self._search_map(demonstrations), demonstrations.lengths
        problem, setting = self._pose(features, demonstrations, codes, known, lengths, company)
        result, runs = self._search(demonstrations, problem, setting, lengths, rng)
        read: FeatureMap | Untouched = features if self.policy is None else Untouched()
        if self.policy is None:
            seen, outputs = problem, cross_fitted(problem, setting, result)
        else:
            seen = replace(problem, features=read.design(demonstrations.observations))
            start = estimator_policy(self.policy, self.space_, len(codes))
            result = refine(seen, setting, start, result, progress)
            outputs = result.posterior.outputs, None  # cross-fitted already, and nothing is told
        progress("competing groups")
        groups_found = competing_groups(problem, setting, result, runs, rng)
        believed = believe(seen, result.state, *outputs)
        self._keep(seen, result, *believed, demonstrations, groups_found)
        weight = self.audit_.step_weight
        if weight.sum() < 1.0:  # nobody is trusted: what little is the expert's, wherever it is
            weight = result.posterior.step
        self.search_features_: FeatureMap | Untouched = read
        if self.policy is None:
            self._learn(demonstrations, codes, weight, weight > 0.5 * weight.max(), REFIT_TOL)
        else:
            self.features_, self.policy_ = read, result.state.policy.finished(seen, weight)  # type: ignore[attr-defined]
        self._tell(seen, demonstrations.source)

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

    def _search_kinds(self, demonstrations: Demonstrations | Dataset) -> tuple[str, str | None]:
        """Features while trust is decided, and simpler ones that propose a solution to compare."""
        if self.search_features != "auto":
            return self.search_features, None
        if self.features not in ("raw", "auto"):
            return self.features, None
        if demonstrations.n_observations > _FEW:
            return "raw", None
        return ("folded", None) if demonstrations.is_discrete else ("nystroem", "raw")

    def _pose(
        self,
        features: FeatureMap,
        demonstrations: Demonstrations,
        codes: Array,
        known: Array,
        lengths: Array,
        company: Company = STRANGERS,
    ) -> tuple[Problem, Setting]:
        """What is searched, and how; `lengths` are of everybody, searched or not."""
        single = demonstrations.n_steps * features.n_columns > _SINGLE[self.space_.kind]
        design = features.design(demonstrations.observations, single=single)
        problem = Problem(design, codes, demonstrations.offsets, self.space_, known, company=company)
        return problem, self._setting(features, len(codes), lengths)

    def _search(
        self,
        demonstrations: Demonstrations,
        problem: Problem,
        setting: Setting,
        lengths: Array,
        rng: np.random.Generator,
    ) -> tuple[Result, list[Result]]:
        """What was found, and every start's run; where there are simpler features, theirs is a solution to compare."""
        progress = self.progress or (lambda _: None)
        candidates = self._candidates()
        _, simpler = self._search_kinds(demonstrations)
        alike = [of for of in candidates if adversary(of, self.space_, setting.policy).symmetric]
        hints = []
        if simpler is not None and alike:
            progress(f"{simpler} features")
            plain = FeatureMap.fit(simpler, demonstrations.observations)
            same = self._pose(plain, demonstrations, problem.actions, problem.labels, lengths, problem.company)
            hints = [fit(*same, alike, rng, progress)[0].posterior.expert]
        return fit(problem, setting, candidates, rng, progress, hints)

    def _search_map(self, demonstrations: Demonstrations) -> FeatureMap:
        """What the policy sees while trust is decided."""
        kind, simpler = self._search_kinds(demonstrations)
        return FeatureMap.fit(kind, demonstrations.observations, n_landmarks=_LANDMARKS[simpler is None])

    def _candidates(self) -> Sequence[str | Adversary]:
        auto = isinstance(self.adversary, str) and self.adversary == "auto"
        return AUTO[self.space_.kind] if auto else (self.adversary,)

    def _setting(self, features: FeatureMap, n_steps: int, lengths: Array) -> Setting:
        """Of a search through `n_steps`, where all demonstrations have such `lengths`."""
        ridge = ridge_of(features, self.C, n_steps, self.space_)
        levels: dict[str, Callable[[], Reliability]] = {"both": TwoBetas.start, "demonstration": PointMasses}
        for name, value, known in (("level", self.level, levels), ("m_step", self.m_step, ("joint", "expert_only"))):
            if value not in known:
                raise DataError(f"There is no {name} {value!r}; choose {' or '.join(known)}.")
        return Setting(
            policy=linear_policy(self.space_, ridge, n_steps),
            prior=as_prior(self.prior, lengths),
            reliability=levels[self.level](),
            mode=self.m_step,  # type: ignore[arg-type]
            n_single=self.n_single,
            annealing=self.annealing,
            max_iter=self.max_iter,
            tol=self.tol,
        )

    def _keep(
        self,
        problem: Problem,
        result: Result,
        belief: Belief,
        log_odds: Array,
        demonstrations: Source,
        competing: list[Array],
    ) -> None:
        """What was found about the demonstrations; their policy comes later."""
        self.state_: State = result.state
        self.belief_ = belief
        self.n_iter_ = max(1, len(result.history) - 1)
        self.lower_bound_ = result.objective
        self.converged_ = result.converged
        self.audit_ = summarise(problem, result, belief, log_odds, demonstrations.ids, competing)

    def _tell(self, problem: Problem, source: str) -> None:
        """What was taken for granted, and what the user should know before using it."""
        self.audit_ = replace(self.audit_, assumptions=tuple(assumptions(self, problem)))
        if not self.converged_:
            warnings.warn("EM stopped at max_iter; raise max_iter or tol.", ConvergenceWarning, stacklevel=4)
        if not self.audit_.identifiable:
            which = ", ".join(repr(m) for m in self.audit_.to_label)
            warnings.warn(
                f"{source}: {len(self.audit_.competing)} groups of demonstrations each agree among themselves and "
                f"nothing says which is the expert; label one of each, say {which}.",
                AmbiguousWarning,
                stacklevel=4,
            )
