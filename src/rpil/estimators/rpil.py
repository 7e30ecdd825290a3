"""The scikit-learn face of the judge and of the paper's mixture: `RPIL`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from rpil.audit import assumptions
from rpil.audit.record import Audit
from rpil.audit.summary import audit_from_judgement, is_anyone_trusted
from rpil.data.coding import action_space, code_actions, encode_demonstrations, label_codes
from rpil.data.demonstrations import Demonstrations
from rpil.data.demonstrators import Demonstrators, group_by_demonstrator
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.fit_data import FitData
from rpil.data.formats.dataset import Dataset
from rpil.estimators.cloning import PolicyEstimator
from rpil.estimators.mixture_fit import check_options, fit_mixture
from rpil.estimators.validation import as_demonstrations
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.held_out import HeldOutModel, HeldOutPolicy, held_out_model
from rpil.inference.settings import Minority
from rpil.inference.trust import Judgement, judge
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.em import State, e_step
from rpil.numerics.types import Array
from rpil.policies.cross_fitted import cross_fitted_policy
from rpil.policies.features import FeatureMap, IdentityMap
from rpil.scale.disk import Streamed
from rpil.scale.fit import REFIT_TOL, fit_large, is_large
from rpil.scale.memory import InMemory
from rpil.scale.protocol import Engine

SINGLE = 50_000
"""Entries of the observations from which the judge reads discrete actions in single precision: trust needs no more
digits."""


class RPIL(PolicyEstimator):
    """Robust probabilistic imitation learning: a policy from demonstrations of unknown quality, and how far to trust
    each of them.

    By default each demonstration is scored by the mean held-out log-likelihood of its steps under a policy of those
    that are explained best,

        y_m = (1 / N_m) sum_n [ log pi(a_n | s_n) - log q(a_n) ],

    and P(expert) says in which of two groups of scores it is, if there are two (`rpil.inference`). With a named
    `adversary` it is the paper's mixture instead (eq. 7, 9, 11), for which ``m_step``, ``prior`` and ``tol`` are:

        p(D) = prod_m [ p prod_n pi(a_n | s_n) + (1 - p) prod_n psi(a_n | s_n) ].

    Parameters
    ----------
    features : {"raw", "folded", "spline", "poly", "nystroem", "auto"}
        What the policy sees of an observation, see `rpil.policies.features`. "auto" chooses, with the ridge, once trust
        is decided: by the likelihood of held-out demonstrations, each counted as far as it is trusted.
    policy : scikit-learn estimator, optional
        What an expert's policy is like: a classifier with `predict_proba` (a regressor where actions are continuous)
        that takes `sample_weight`, a pipeline or a search of such; or what `rpil.TorchPolicy` makes. It sees the
        observations as they are, and its held-out likelihoods decide. By default the policy is linear in `features`.
    adversary : str or Adversary
        "auto" is the judge. Otherwise what bad demonstrators do in the paper's mixture, fitted in memory: "constant",
        "uniform", "marginal", "complement" (the paper's), "normalised complement", "confusion", "own policy", or an
        instance such as ``Confusion.given(matrix)``.
    prior : float or (float, float), optional
        P(expert) of the mixture: fixed, or estimated under Beta(a, b); by default under Beta(2, 2).
    C : float, optional
        Inverse ridge strength of the final policy, as in `BehavioralCloning`.
    m_step : {"joint", "expert_only"}
        Of the mixture: "expert_only" drops the adversary's term from the policy's M-step, as the paper's code does.
    labels : mapping of id to {"expert", "adversary"}, optional
        What is known. `fit` takes them too.
    minority : {"ask", "trust", "distrust"}
        What to think of demonstrations that act alike and otherwise than the rest, in the same states: say that it
        cannot be known and ask for a label; take them for another good style; or take the larger group for the expert.
    search_features : str
        What the policy sees while trust is decided: a kind of features, or "auto", which is `features`, or "folded"
        where these are "raw" or "auto": a straight line mistakes an expert in a rare situation for an adversary.
    max_iter : int
        EM iterations of the mixture, and passes over much data.
    tol : float
        Gain of the mixture's objective, in nats a demonstration, at which EM stops.
    random_state : int
        Same seed, same bits.
    action_box : (low, high), optional
        Bounds of continuous actions, numbers or one for each part; by default what the demonstrations span.
    progress : callable, optional
        Called with a few words at every stage of a fit.
    engine : Engine, optional
        Runs passes over data that are many times larger than the sample that the judge reads, see `rpil.scale`: by
        default this process, on all its cores; from disk, where a `Dataset` is.
    checkpoint : path, optional
        Where a fit to so much data keeps how far the final policy is, after every pass. Where the file exists the fit
        goes on from there; in the end it is removed.

    Attributes
    ----------
    audit_ : Audit
        Verdicts, log-odds, weights of the steps, what cannot be known.
    log_odds_, expert_proba_ : (M,) arrays
        In the order of ``audit_.ids``.
    classes_ : (K,) array
    coef_, intercept_ : arrays
    judge_ : FittedJudge
        What scores demonstrations that were not fitted.
    state_ : State
        Of the mixture, where an adversary was named.
    lower_bound_ : float
        The mixture's objective, or the mean held-out log-likelihood of a step of the demonstrations that taught.
    n_iter_ : int
    converged_ : bool

    References
    ----------
    Crowe, "Robust Probabilistic Imitation Learning": eq. 2, 3, 7, 9, 11; docs/model.md says what is added.

    Examples
    --------
    >>> from rpil import RPIL
    >>> model = RPIL().fit(observations, actions, groups=episode)    # doctest: +SKIP
    >>> model.audit_.verdicts                                        # doctest: +SKIP
    """

    audit_: Audit
    judge_: FittedJudge | None
    state_: State | None

    def __init__(
        self,
        features: str = "raw",
        policy: Any = None,
        adversary: str | Adversary = "auto",
        prior: float | tuple[float, float] | None = None,
        C: float | None = None,
        m_step: str = "joint",
        labels: Mapping[Any, str] | None = None,
        minority: Minority = "ask",
        search_features: str = "auto",
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
        self.m_step = m_step
        self.labels = labels
        self.minority = minority
        self.search_features = search_features
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
        speak for each other, as far as people are found to differ, see `rpil.data.demonstrators`. A demonstration that
        is left out by id, or None, has a demonstrator of its own.

        Raises
        ------
        DataError
            One sentence: constant actions, or one outside the declared box, a single demonstration, unknown label
            ids, unknown ids or a wrong number of `demonstrators`, none left that may be an expert's.
        """
        check_options(self)
        if isinstance(X, Dataset):
            return self._fit_dataset(X, labels, demonstrators)
        demonstrations = as_demonstrations(self, X, y, groups)
        source = demonstrations.source
        self.space_, self.classes_, codes = code_actions(demonstrations, self.action_box)
        if len(demonstrations) < 2:
            raise DataError(f"{source}: one demonstration alone (n_samples=1) cannot be compared; give at least two.")
        if self.policy is not None:
            cross_fitted_policy(self.policy, self.space_, len(codes))  # a wrong one is refused before any work
        known = label_codes(labels if labels is not None else self.labels, demonstrations)
        people = group_by_demonstrator(demonstrators, demonstrations)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            if not self._judges:
                if people.informative or self.policy is not None:
                    raise DataError("A named adversary knows neither demonstrators= nor policy=; leave out one.")
                data, weight = fit_mixture(self, demonstrations, codes, known)
                self._finish(demonstrations, codes, data, weight)
            elif self.policy is None and is_large(self, demonstrations):
                fit_large(self, demonstrations, known, people, self.engine or InMemory())
            else:
                self._fit_judged(demonstrations, codes, known, people)
        return self

    def _fit_dataset(self, data: Dataset, labels: Mapping[Any, str] | None, demonstrators: Any) -> RPIL:
        """What is small is read, and fitted as anything else."""
        self.space_, self.classes_ = action_space(data, self.action_box)
        with threadpool_limits(1, "blas"):
            if self.policy is not None or not self._judges or not is_large(self, data):
                return self.fit(data.select(slice(None)), labels=labels, demonstrators=demonstrators)
            self.n_features_in_, self.observation_names_ = data.n_observations, data.observation_names
            known = label_codes(labels if labels is not None else self.labels, data)
            fit_large(self, data, known, group_by_demonstrator(demonstrators, data), self.engine or Streamed())
        return self

    @property
    def _judges(self) -> bool:
        """Whether the judge decides, and not the mixture with a named adversary."""
        return isinstance(self.adversary, str) and self.adversary == "auto"

    def _fit_judged(self, demonstrations: Demonstrations, codes: Array, known: Array, people: Demonstrators) -> None:
        """The judge reads everything."""
        progress = self.progress or (lambda _: None)
        progress("features")
        features = self.judge_map(demonstrations)
        n_entries = demonstrations.n_steps * demonstrations.n_observations
        single = self.space_.kind == "discrete" and n_entries > SINGLE
        design = features.design(demonstrations.observations, single=single)
        data = FitData(design, codes, demonstrations.offsets, self.space_, known, demonstrators=people)
        judgement, fitted = self.judge_problem(data)
        self.keep_judgement(judgement, fitted, data, demonstrations.ids)
        self.judge_features_ = features
        weight = self.audit_.step_weight
        if not is_anyone_trusted(self.audit_.expert_proba, data.lengths):
            weight = judgement.step_trust.step  # learn from the steps that are most likely an expert's
        progress("the policy")
        self._finish(demonstrations, codes, data, weight)

    def _finish(self, demonstrations: Demonstrations, codes: Array, data: FitData, weight: Array) -> None:
        """The final policy, from steps of `weight` (N,), and what the user should know."""
        if self.policy is None:
            self._learn(demonstrations, codes, weight, weight > 0.5 * weight.max(), REFIT_TOL)
        else:
            # Cross-fitted once more, by the final weights: that says how sure it may be.
            start = cross_fitted_policy(self.policy, self.space_, len(codes)).fit(data, weight)[0]
            self.features_, self.policy_ = self.judge_features_, start.fit_all(data, weight)
        self.explain(data, demonstrations.source)

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

        What labels say of two styles, or ``minority="trust"`` of a rival group, holds for the fitted ones alone.

        Raises
        ------
        DataError
            Where an action is not among `classes_`.
        """
        check_is_fitted(self)
        demonstrations = as_demonstrations(self, X, y, groups, reset=False)
        codes = encode_demonstrations(self.classes_, self.space_.n_parts, demonstrations)
        design = self.judge_features_.design(demonstrations.observations)
        nobody = np.zeros(len(demonstrations), dtype=int)
        data = FitData(design, codes, demonstrations.offsets, self.space_, nobody)
        if self.judge_ is None:
            assert self.state_ is not None
            return np.asarray(e_step(data, self.state_, self.state_.policy.outputs(design)).log_odds)
        return self.judge_.log_odds(self._measure(demonstrations, design, codes), demonstrations.offsets)

    def _measure(self, demonstrations: Demonstrations, design: Array, codes: Array) -> Array:
        """What each step counts for the score of its demonstration, (N,)."""
        assert self.judge_ is not None
        if self.judge_.scale is not None:
            return self.judge_.step_ratios(design, codes)[0]
        outputs = self.policy_.outputs(self.features_.design(demonstrations.observations))
        return self.judge_.step_ratios_of(self.policy_, outputs, codes)

    def judge_map(self, demonstrations: Demonstrations) -> FeatureMap | IdentityMap:
        """What the policy sees while trust is decided."""
        if self.policy is not None:
            return IdentityMap()
        kind = self.search_features
        if kind == "auto":
            kind = self.features if self.features not in ("raw", "auto") else "folded"
        return FeatureMap.fit(kind, demonstrations.observations)

    def judge_problem(self, data: FitData) -> tuple[Judgement, FittedJudge]:
        """The judgement of a problem, and what is kept to judge others."""
        model: HeldOutModel
        if self.policy is None:
            model = held_out_model(data, self.random_state)
        else:
            model = HeldOutPolicy(data, cross_fitted_policy(self.policy, self.space_, len(data.actions)))
        progress = self.progress or (lambda _: None)
        judgement = judge(data, model, seed=self.random_state, minority=self.minority, progress=progress)
        return judgement, FittedJudge.of(judgement, data, user_policy=self.policy is not None)

    def keep_judgement(self, judgement: Judgement, fitted: FittedJudge, data: FitData, ids: Sequence[Any]) -> None:
        """What was found about the demonstrations; their policy comes later."""
        self.state_, self.judge_ = None, fitted
        self.n_iter_ = len(judgement.scores.fit.history)
        self.lower_bound_ = float(judgement.scores.fit.history[-1])
        self.converged_ = True
        self.audit_ = audit_from_judgement(judgement, data, ids)

    def explain(self, data: FitData, source: str) -> None:
        """Add the assumptions to the audit, and warn of what the user should know before using it."""
        if self.policy is None:
            policy = assumptions.linear_policy(self.features_.kind)
        else:
            policy = assumptions.custom_policy(type(self.policy).__name__)
        sentences = assumptions.assumption_sentences(
            self.audit_.finding,
            policy,
            p_two_groups=None if self.judge_ is None else self.judge_.groups.p_two,
            whole_demonstrations=self.state_ is not None,
            expert_share=self.prior if isinstance(self.prior, float) else None,
            n_labels=int(np.count_nonzero(data.labels)),
            demonstrators=data.demonstrators.note,
        )
        self.audit_ = replace(self.audit_, assumptions=sentences)
        assumptions.warn_if_not_converged(self.converged_)
        assumptions.warn_if_ambiguous(self.audit_, source)
