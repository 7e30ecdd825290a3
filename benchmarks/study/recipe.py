"""The paper's recipe as it stands, for comparison: what `RPIL` repairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit
from threadpoolctl import threadpool_limits

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.estimators.cloning import PolicyEstimator, as_demonstrations
from rpil.mixture.adversaries.discrete import Complement
from rpil.mixture.em import State, run_em
from rpil.mixture.expert_prior import as_prior
from rpil.mixture.settings import MixtureSettings
from rpil.policies.features import FeatureMap, FeatureSettings, ridge_of
from rpil.policies.softmax import SoftmaxPolicy

NO_PENALTY = 1e6
"""C of a ridge too weak to matter, that keeps the solver's matrices regular."""


class PaperRecipe(PolicyEstimator):
    """R-PIL as the paper's experiments ran it.

    A demonstration is good or bad as a whole; the adversary is the raw complement 1 - pi; P(expert) is given; the
    policy sees the raw observation and is fitted to the expert's term alone, without a penalty. EM starts from the
    policy of all demonstrations and makes 101 iterations; less where nothing changes any more. Everything is in logs.

    Parameters
    ----------
    prior : float
        P(expert), fixed.
    max_iter : int
        EM iterations.
    newton : int
        Newton steps of an M-step at most. 100 is the whole fit, which is EM as the paper writes it; 1 is what `RPIL`
        does. It matters where the recipe is on a knife's edge: of 40 draws of Lunar Lander, corrupted, 1 ends with
        no demonstration trusted after whole fits, 3 after single steps.

    References
    ----------
    Crowe, "Robust Probabilistic Imitation Learning": eq. 3, 7, 9, 11.
    """

    def __init__(self, prior: float = 0.5, max_iter: int = 101, newton: int = 100) -> None:
        self.prior = prior
        self.max_iter = max_iter
        self.newton = newton

    def fit(
        self, X: ArrayLike | Demonstrations, y: ArrayLike | None = None, groups: ArrayLike | None = None
    ) -> PaperRecipe:
        """Learn from observations X (N, D), actions y (N,) and the demonstration of each step, groups (N,).

        `Demonstrations` are accepted in the place of the three.

        Raises
        ------
        DataError
            Where the actions are continuous, or the prior is no probability.
        """
        demonstrations = as_demonstrations(self, X, y, groups)
        if not demonstrations.is_discrete:
            raise DataError(f"{demonstrations.source}: the actions are continuous; the paper's recipe takes classes.")
        self.classes_, codes = np.unique(demonstrations.actions, return_inverse=True)
        prior = as_prior(self.prior)
        self.space_ = Discrete(len(self.classes_))
        with threadpool_limits(1, "blas"):
            self.features_ = FeatureMap.fit("raw", demonstrations.observations, settings=FeatureSettings())
            ridge = ridge_of(self.features_, NO_PENALTY, len(codes), self.space_)
            no_labels = np.zeros(len(demonstrations), dtype=int)
            design = self.features_.design(demonstrations.observations)
            problem = FitData(design, codes, demonstrations.offsets, self.space_, no_labels)
            pooled, outputs = SoftmaxPolicy.zero(self.space_.n, ridge).fit(problem, np.ones(len(codes)))
            settings = MixtureSettings(
                m_step="expert_only", max_iter=self.max_iter, tol=0.0, newton_iter=self.newton, cg_iter=200
            )
            result = run_em(problem, State(pooled, Complement(), prior), settings, outputs)
        self.policy_ = result.state.policy
        self.log_odds_: NDArray[np.float64] = result.posterior.log_odds
        self.expert_proba_: NDArray[np.float64] = expit(self.log_odds_)
        self.n_iter_ = len(result.history) - 1
        return self
