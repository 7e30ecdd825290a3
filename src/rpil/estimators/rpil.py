"""The scikit-learn face of the judge and of the paper's mixture: `RPIL`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.fit_data import DemonstratorNames, Outcome
from rpil.estimators.cloning import Given, PolicyEstimator, as_demonstrations
from rpil.estimators.pipeline import FitOptions, FitResult, Settings, final_policy
from rpil.estimators.task import Labels, Task, answers_of
from rpil.estimators.within_tasks import Statements, fit_task, fit_within_tasks
from rpil.formats.columns import Names
from rpil.formats.format import Dataset
from rpil.formats.recording import Recording
from rpil.inference.answers import Answers
from rpil.mixture.adversaries.protocol import Adversary
from rpil.mixture.em import State
from rpil.numerics.types import Array
from rpil.results.record import Audit
from rpil.scale.protocol import Engine


class RPIL(PolicyEstimator):
    """Robust probabilistic imitation learning: a policy from demonstrations of unknown quality, and the probability
    that each demonstration belongs with those that agree best.

    By default the judge (`rpil.inference.trust`) decides. The score of demonstration m is the mean held-out log-ratio
    of its N_m steps under a policy pi fitted to the training group, the demonstrations that agree best,

        y_m = (1 / N_m) sum_n [ log pi(a_n | s_n) - log q(a_n) ],

    where q is the reference. The probability, see `rpil.results.vocabulary`, follows from the mixture of one or two
    groups fitted to the scores. With a named `adversary`, RPIL fits the mixture of the paper (eq. 7, 9, 11) by EM:

        p(D) = prod_m [ p prod_n pi(a_n | s_n) + (1 - p) prod_n psi(a_n | s_n) ].

    Parameters
    ----------
    features : {"raw", "folded", "nystroem", "auto"}
        The feature map of the policy, see `rpil.policies.features`. "auto" chooses the map and the ridge by the
        held-out likelihood of the trusted demonstrations.
    policy : scikit-learn estimator, optional
        The policy: a classifier with `predict_proba`, or a regressor for continuous actions, that takes
        `sample_weight`; or a pipeline or search of these. It reads the observations without a feature map. By
        default the policy is linear in `features`.
    adversary : str or Adversary
        "auto" is the judge. The adversaries of the mixture are "constant", "uniform", "marginal", "complement" (the
        paper's), "normalised complement", "confusion", "own policy", or an instance such as
        ``Confusion.given(matrix)``. The mixture needs all data in memory.
    C : float, optional
        Inverse ridge strength of the final policy, as in `BehavioralCloning`.
    random_state : int
        Seed; the same seed gives the same bits.
    settings : Settings, optional
        Settings of every stage: the judge, the mixture (``prior``, ``m_step``, ``tol``), the sample of large data, the
        fit of the final policy. The ``prior`` also says which of two parts the judge's policy trusts.
    progress : callable, optional
        Called with one line of text at every stage.
    engine : Engine, optional
        Runs the passes over data that are too large for the judge to read, see `rpil.scale`. By default: this process,
        on data in memory or, for a `Dataset`, on disk.
    groups : {"rows"}, optional
        "rows" takes every row for a demonstration where `fit` gets no groups; by default that is an error.

    Attributes
    ----------
    audit_ : Audit
        Finding, verdicts, log-odds and step weights.
    expert_proba_ : (M,) array
        Probabilities, in the order of ``audit_.ids``.
    classes_ : (K,) array
        The discrete actions; empty for continuous actions.
    state_ : State or None
        The mixture with a named adversary.
    lower_bound_ : float
        Objective of the mixture in nats, or mean held-out log-likelihood of a step of the training group.
    n_iter_ : int
    converged_ : bool

    References
    ----------
    Crowe, "Robust Probabilistic Imitation Learning": eq. 2, 3, 7, 9, 11; docs/model.md describes what rpil adds.

    Examples
    --------
    >>> from rpil import RPIL
    >>> model = RPIL().fit(observations, actions, groups=episode)    # doctest: +SKIP
    >>> model.audit_.verdicts                                        # doctest: +SKIP
    """

    audit_: Audit
    state_: State | None
    n_iter_: int
    lower_bound_: float
    converged_: bool

    def __init__(
        self,
        features: str = "raw",
        policy: object = None,
        adversary: str | Adversary = "auto",
        C: float | None = None,
        random_state: int = 0,
        settings: Settings | None = None,
        progress: Callable[[str], None] | None = None,
        engine: Engine | None = None,
        groups: Literal["rows"] | None = None,
    ) -> None:
        self.features = features
        self.policy = policy
        self.adversary = adversary
        self.C = C
        self.random_state = random_state
        self.settings = settings
        self.progress = progress
        self.engine = engine
        self.groups = groups

    def fit(
        self,
        X: ArrayLike | Given | Dataset | Recording,
        y: ArrayLike | None = None,
        groups: ArrayLike | None = None,
        labels: Labels | StrPath | None = None,
        demonstrators: DemonstratorNames | str | None = None,
        outcome: Outcome | Names | StrPath | None = None,
    ) -> RPIL:
        """Decide which demonstrations to trust, and fit the final policy (`rpil.estimators.pipeline`).

        Parameters
        ----------
        X : (N, D) array, Recording, Demonstrations, Dataset, frame or list of trajectories
            Observations; all but an array hold actions and groups, too. `rpil.read` reads a frame without `y`.
            The demonstrations of a `Recording` (`rpil.open`) are judged within their tasks and sessions, as ``rpil
            audit`` does, and outcomes, order and demonstrators are those that it states; of several tasks, which are
            read into memory, one policy is learned.
        y : (N,) or (N, A) array
            Actions.
        groups : (N,) array
            The demonstration of each step; needed where X is an array, see the parameter of the constructor.
        labels : mapping of id to {"good", "bad", "better than ID", "same as ID"}, sequence of pairs, or path, optional
            Answers about demonstrations; a path is a file of them.
        demonstrators : mapping of id to name, or sequence of M names, or file or column of a `Recording`, optional
            The demonstrator of each demonstration. With answers they are evidence, see `rpil.inference.answered`. A
            demonstration without a name has a demonstrator of its own.
        outcome : mapping of id to number, or sequence of M numbers, or path or several, optional
            How each ended, such as its return; more is better, NaN is unknown. A flag of 0 is bad, see `audit`.

        Raises
        ------
        DataError
            One sentence: rows without groups, constant actions, a single demonstration, an unknown id, a wrong number
            of `demonstrators` or outcomes, an outcome that is the same for all, or only demonstrations labelled bad.
        """
        settings, progress = self.settings or Settings(), self.progress or (lambda _: None)
        run = self.random_state, settings, progress, self.engine
        options = FitOptions(self.features, self.adversary, *run, self.policy, self.C)
        if not isinstance(X, Recording):
            source = X if isinstance(X, Dataset) else as_demonstrations(self, X, y, groups)
            task = Task.of(source, answers_of(labels, outcome, source), demonstrators)
            _check_labels(task.answers, source.source)
            return self._keep(task, fit_task(task, options))
        # Each task and session is judged by itself, and one policy learned by the weights of all.
        stated = Statements.of(X, labels, demonstrators, outcome)
        _check_labels(stated.answers, X.description.source)
        audit, fits = fit_within_tasks(X, stated, options)
        if not audit.within:
            (task, result), *_ = fits
            return self._keep(task, replace(result, audit=audit))
        task, results = Task.of(X.demonstrations.select(slice(None))), [own for _, own in fits]
        options.progress("the policy")
        n_iter, bound = sum(own.n_iter for own in results), np.mean([own.lower_bound for own in results] or np.nan)
        sound = all(own.converged for own in results)
        result = FitResult(audit, *final_policy(task, options, audit.step_weight), None, n_iter, float(bound), sound)
        return self._keep(task, result)

    def _keep(self, task: Task, fitted: FitResult) -> RPIL:
        """Copy the result of a fit."""
        self.space_, self.classes_, self.n_features_in_ = task.space, task.classes, task.source.n_observations
        assert fitted.policy is not None
        self.features_, self.policy_ = fitted.features, fitted.policy
        self.state_, self.audit_ = fitted.state, fitted.audit
        self.n_iter_, self.lower_bound_, self.converged_ = fitted.n_iter, fitted.lower_bound, fitted.converged
        return self

    @property
    def expert_proba_(self) -> Array:
        """`Audit.expert_proba`, (M,); an AttributeError where there was no fit, or a file did not hold its audit."""
        if not hasattr(self, "audit_"):
            raise AttributeError("A saved RPIL holds no audit; call rpil.audit on the demonstrations, or fit it again.")
        return self.audit_.expert_proba


def _check_labels(answers: Answers, source: str) -> None:
    """A `DataError` where nobody may be good, so that no policy can be learned."""
    if (answers.labels < 0).all():
        raise DataError(f"{source}: all demonstrations are labelled bad; leave one that may be good.")
