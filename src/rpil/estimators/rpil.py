"""The scikit-learn face of the judge and of the paper's mixture: `RPIL`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from rpil.audit import assumptions
from rpil.audit.record import Audit
from rpil.data.coding import encode_demonstrations
from rpil.data.demonstrations import Demonstrations
from rpil.data.files import StrPath
from rpil.data.fit_data import FitData
from rpil.data.formats.dataset import Dataset
from rpil.estimators.cloning import PolicyEstimator
from rpil.estimators.passes import Passes, is_sampled
from rpil.estimators.pipeline import Fitted, Options, Task, Whole, fit
from rpil.estimators.settings import Settings
from rpil.estimators.validation import as_demonstrations
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.settings import Minority
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.em import State, e_step
from rpil.numerics.types import Array
from rpil.scale.protocol import Engine


class RPIL(PolicyEstimator):
    """Robust probabilistic imitation learning: a policy from demonstrations of unknown quality, and how far to trust
    each of them.

    By default each demonstration is scored by the mean held-out log-likelihood of its steps under a policy of those
    that are explained best,

        y_m = (1 / N_m) sum_n [ log pi(a_n | s_n) - log q(a_n) ],

    and P(expert) says in which of two groups of scores it is, if there are two (`rpil.inference`). With a named
    `adversary` it is the paper's mixture instead (eq. 7, 9, 11):

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
    C : float, optional
        Inverse ridge strength of the final policy, as in `BehavioralCloning`.
    labels : mapping of id to {"expert", "adversary"}, optional
        What is known. `fit` takes them too.
    minority : {"ask", "trust", "distrust"}
        What to think of demonstrations that act alike and otherwise than the rest, in the same states: say that it
        cannot be known and ask for a label; take them for another good style; or take the larger group for the expert.
    random_state : int
        Same seed, same bits.
    action_box : (low, high), optional
        Bounds of continuous actions, numbers or one for each part; by default what the demonstrations span.
    settings : Settings, optional
        What only an expert changes: the stages of the judge, the mixture (``prior``, ``m_step``, ``tol``), the sample
        of large data, the fit of the final policy.
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
        C: float | None = None,
        labels: Mapping[Any, str] | None = None,
        minority: Minority = "ask",
        random_state: int = 0,
        action_box: tuple[ArrayLike, ArrayLike] | None = None,
        settings: Settings | None = None,
        progress: Callable[[str], None] | None = None,
        engine: Engine | None = None,
        checkpoint: StrPath | None = None,
    ) -> None:
        self.features = features
        self.policy = policy
        self.adversary = adversary
        self.C = C
        self.labels = labels
        self.minority = minority
        self.random_state = random_state
        self.action_box = action_box
        self.settings = settings
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
        options = self._options()
        options.check()
        source = X if isinstance(X, Dataset) else as_demonstrations(self, X, y, groups)
        task = Task.of(source, self.action_box, labels if labels is not None else self.labels, demonstrators, options)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            found = fit(Passes(task, options) if is_sampled(task, options) else Whole(task, options), options)
        self._keep(task, found)
        self._explain(task, options)
        return self

    def _explain(self, task: Task, options: Options) -> None:
        """Add the assumptions to the audit, and warn of what the user should know before using it."""
        prior, type_name = options.settings.mixture.prior, type(self.policy).__name__
        linear = self.policy is None
        sentences = assumptions.assumption_sentences(
            self.audit_.finding,
            assumptions.linear_policy(self.features_.kind) if linear else assumptions.custom_policy(type_name),
            p_two_groups=None if self.judge_ is None else self.judge_.groups.p_two,
            whole_demonstrations=self.state_ is not None,
            expert_share=prior if isinstance(prior, float) else None,
            n_labels=int(np.count_nonzero(task.labels)),
            demonstrators=task.demonstrators.note,
        )
        self.audit_ = replace(self.audit_, assumptions=sentences)
        assumptions.warn_if_not_converged(self.converged_)
        assumptions.warn_if_ambiguous(self.audit_, task.source.source)

    def _options(self) -> Options:
        given = self.get_params(deep=False)
        names = [field.name for field in fields(Options) if field.name in given]
        chosen = {name: given[name] for name in names} | {"settings": self.settings or Settings()}
        chosen["progress"] = self.progress or (lambda _: None)
        return Options(**chosen, seed=self.random_state)

    def _keep(self, task: Task, found: Fitted) -> None:
        """Copy the result of a fit."""
        decision = found.decision
        if isinstance(task.source, Dataset):
            self.n_features_in_, self.observation_names_ = task.source.n_observations, task.source.observation_names
        self.space_, self.classes_ = task.space, task.classes
        self.features_, self.policy_, self.judge_features_ = found.features, found.policy, found.judge_features
        self.judge_, self.state_, self.audit_ = decision.judge, decision.state, decision.audit
        self.n_iter_, self.lower_bound_, self.converged_ = decision.n_iter, decision.lower_bound, decision.converged

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
            return self.judge_.step_ratios(design, codes, (self.settings or Settings()).judge)[0]
        outputs = self.policy_.outputs(self.features_.design(demonstrations.observations))
        return self.judge_.step_ratios_of(self.policy_, outputs, codes, (self.settings or Settings()).judge)
