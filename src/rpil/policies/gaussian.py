"""A policy for continuous actions: linear, with the heavy tails of Student's distribution around it.

    a | s ~ t_nu( W^T phi(s), Sigma )

A density is unbounded, so that under a Gaussian one step far off would condemn a demonstration: the tails say that
such steps happen. Student's distribution is a Gaussian whose precision is Gamma-distributed, so its M-step is weighted
least squares, repeated (Lange, Little and Taylor 1989), in which nu is chosen by the likelihood itself (ECME, Liu and
Rubin 1994). All of it needs X^T W X, X^T W A and A^T W A only.

A box ends somewhere. Who pushes as hard as it allows may have meant more, so that a mean beyond the bound is as good as
one on it: errors at a bound count on one side only, as in censored regression (Tobin 1958). The M-step puts what was
meant, as far as the policy knows, in the place of what the box let through, which never lowers the likelihood of each
part alone; should it, through what errors of different parts have in common, the policy stays as it was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import gammaln

from rpil.passes import Array, Sums, blocks, linear
from rpil.problem import Problem
from rpil.spaces import Box

_FREEDOM = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 15.0, 30.0, 100.0])
"""Degrees of freedom to choose from: Cauchy's distribution to all but a Gaussian."""

_LEAST_SPREAD = 0.01
"""Of a dimension's box: a standard deviation that no policy goes much below. Who does exactly the same time and again,
as at the bounds of the box, would else be infinitely likely, and nothing but those steps would count."""

_START_FREEDOM = 5.0


@dataclass(frozen=True, eq=False)
class StudentPolicy:
    """A linear policy with Student's distribution over a design matrix whose last column is the constant.

    Attributes
    ----------
    weights : (D, A) array
        Coefficients, the intercepts in the last row.
    cholesky : (A, A) array
        Lower factor of the scale matrix Sigma.
    freedom : float
        nu.
    ridge : (D,) array
        Penalty on the squares of each feature's coefficients, in units of Sigma; 0 for the constant.
    least : (A,) array
        What is added to the sums of squares of each dimension, as its root.
    low, high : (A,) arrays
        Actions that are as far as the box allows, or further; infinite where the box does not matter.
    """

    weights: Array
    cholesky: Array
    freedom: float
    ridge: Array
    least: Array
    low: Array
    high: Array

    @classmethod
    def zero(cls, box: Box, ridge: Array, n_steps: float) -> StudentPolicy:
        """The middle of the box, and very unsure of it; to be fitted to steps with a weight of `n_steps` together."""
        width = box.high - box.low
        edge = _LEAST_SPREAD * width
        weights = np.zeros((len(ridge), len(width)))
        weights[-1] = 0.5 * (box.low + box.high)
        spread = np.diag(width / np.sqrt(12.0))
        return cls(weights, spread, _START_FREEDOM, ridge, edge * np.sqrt(n_steps), box.low + edge, box.high - edge)

    @classmethod
    def of_errors(cls, box: Box, n_steps: float) -> StudentPolicy:
        """Of what somebody else's means leave over: from one constant feature, without bounds."""
        nowhere = np.full(len(box.low), np.inf)
        return replace(cls.zero(box, np.zeros(1), n_steps), low=-nowhere, high=nowhere)

    def outputs(self, features: Array) -> Array:
        """The means, (N, A)."""
        return linear(features, self.weights)

    def log_prob(self, outputs: Array, actions: Array) -> Array:
        """log pi(a_n|s_n), a density, (N,)."""
        return self._log_density(self._distance(self._errors(outputs, actions)), self.freedom)

    def learn(
        self,
        problem: Problem,
        weight: Array,
        lesson: Array | None = None,
        *,
        tol: float = 1e-6,
        max_iter: int = 100,
        max_cg: int = 0,
    ) -> tuple[StudentPolicy, Array]:
        """Weighted least squares until the objective gains less than `tol` nats a step."""
        features, actions = problem.features, problem.actions
        total = weight.sum()
        policy, outputs = self, self.outputs(features)
        if not total > 0.0:  # nothing to learn from, so nothing to forget
            return policy, outputs
        objective = weight @ policy.log_prob(outputs, actions) - policy.penalty()
        for _ in range(max_iter):
            better, said = policy._improved(features, actions, outputs, weight)
            gain = weight @ better.log_prob(said, actions) - better.penalty() - objective
            if gain < 0.0:
                break
            policy, outputs, objective = better, said, objective + gain
            if gain <= tol * total:
                break
        return policy, outputs

    def tempered(self, temperature: float) -> StudentPolicy:
        """The same: how sure it is was fitted, too."""
        return self

    def penalty(self) -> float:
        """What the ridge and the least spread take off the log-likelihood."""
        root = np.vstack([np.sqrt(self.ridge)[:, None] * self.weights, np.diag(self.least)])
        return float(0.5 * self._distance(root).sum())

    def primed(
        self, problem: Problem, weight: Array, ridge: Array, factor: float, remembers: bool = False
    ) -> StudentPolicy:
        """The same for `factor` times as many steps."""
        return replace(self, ridge=ridge, least=self.least * np.sqrt(factor))

    def like(self, primed: StudentPolicy) -> StudentPolicy:
        """The same."""
        return self

    @property
    def experienced(self) -> bool:
        """It learns nothing of Hessians."""
        return False

    def at(self, other: StudentPolicy) -> StudentPolicy:
        """What another one does, regularised as this one is."""
        return replace(self, weights=other.weights, cholesky=other.cholesky, freedom=other.freedom)

    def statistics(self, problem: Problem, outputs: Array, weight: Array, lesson: Array | None = None) -> Sums:
        """X^T W X, X^T W R and R^T W R for the residuals R, the likelihood of every nu, and the sum of the weights."""
        residual = self._errors(outputs, problem.actions)
        distance = self._distance(residual)
        trust = weight * (self.freedom + residual.shape[1]) / (self.freedom + distance)
        likelihood = np.array([weight @ self._log_density(distance, freedom) for freedom in _FREEDOM])
        moments = _moments(problem.features, residual, trust)
        return (*moments, (residual.T * trust) @ residual, likelihood, weight.sum())

    def unseen(self, problem: Problem, outputs: Array, weight: Array, lesson: Array | None = None) -> Array:
        """The outputs as they are: so few coefficients remember no demonstration among so many."""
        return outputs

    def study(self, problem: Problem, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, (N,), and the statistics."""
        outputs = self.outputs(problem.features)
        return self.log_prob(outputs, problem.actions), self.statistics(problem, outputs, weight)

    def improved(self, statistics: Sums, radius: float = np.inf) -> StudentPolicy:
        """One step of weighted least squares; nu is the best for what was there before it, unless `radius` is finite:
        the rest cannot go down."""
        moments, cross, scatter, likelihood, total = statistics
        if not total > 0.0:
            return self
        step = _solve(moments + np.diag(self.ridge), cross - self.ridge[:, None] * self.weights)
        weights = self.weights + step
        scatter = scatter - step.T @ cross - cross.T @ step + step.T @ moments @ step
        scatter += (weights.T * self.ridge) @ weights + np.diag(self.least**2)
        freedom = float(_FREEDOM[int(np.argmax(likelihood))]) if radius == np.inf else self.freedom
        return replace(self, weights=weights, cholesky=np.linalg.cholesky(scatter / total), freedom=freedom)

    def slope(self, statistics: Sums) -> float:
        """Largest entry of the gradient of the penalised log-likelihood, in units of the spread; or what a better
        Sigma or nu would gain, in nats, where that is more."""
        _, cross, scatter, likelihood, total = statistics
        if not total > 0.0:
            return 0.0
        spread = np.sqrt((self.cholesky**2).sum(axis=1))
        steepest = np.abs((cross - self.ridge[:, None] * self.weights) / spread).max()
        scatter = scatter + (self.weights.T * self.ridge) @ self.weights + np.diag(self.least**2)
        half = solve_triangular(self.cholesky, scatter, lower=True)
        excess = solve_triangular(self.cholesky, half.T, lower=True) / total - np.eye(len(scatter))
        surer = likelihood.max() - likelihood[int(np.argmin(np.abs(_FREEDOM - self.freedom)))]
        return float(max(steepest, 0.25 * total * (excess**2).sum(), surer))

    def _improved(self, features: Array, actions: Array, outputs: Array, weight: Array) -> tuple[StudentPolicy, Array]:
        dimension = actions.shape[1]
        errors = self._errors(outputs, actions)
        trust = weight * (self.freedom + dimension) / (self.freedom + self._distance(errors))
        moments, cross = _moments(features, outputs + errors, trust)
        weights = _solve(moments + np.diag(self.ridge), cross)
        outputs = linear(features, weights)
        residual = self._errors(outputs, actions)
        scatter = (residual.T * trust) @ residual + (weights.T * self.ridge) @ weights + np.diag(self.least**2)
        policy = replace(self, weights=weights, cholesky=np.linalg.cholesky(scatter / weight.sum()))
        distance = policy._distance(residual)
        likelihood = [weight @ policy._log_density(distance, freedom) for freedom in _FREEDOM]
        return replace(policy, freedom=float(_FREEDOM[int(np.argmax(likelihood))])), outputs

    def _errors(self, outputs: Array, actions: Array) -> Array:
        """What means fall short of, (N, A): nothing beyond a bound that the action has reached."""
        errors = actions - outputs
        np.maximum(errors, 0.0, out=errors, where=actions >= self.high)
        np.minimum(errors, 0.0, out=errors, where=actions <= self.low)
        return errors

    def _distance(self, residual: Array) -> Array:
        """Squared Mahalanobis distances of rows, (N, A) -> (N,)."""
        standard = solve_triangular(self.cholesky, residual.T, lower=True)
        return np.einsum("an,an->n", standard, standard)

    def _log_density(self, distance: Array, freedom: float) -> Array:
        dimension = len(self.cholesky)
        constant = gammaln(0.5 * (freedom + dimension)) - gammaln(0.5 * freedom)
        constant -= 0.5 * dimension * np.log(freedom * np.pi) + np.log(np.diag(self.cholesky)).sum()
        return constant - 0.5 * (freedom + dimension) * np.log1p(distance / freedom)


def _moments(features: Array, actions: Array, weight: Array) -> tuple[Array, Array]:
    """X^T W X and X^T W A, in one reading of X."""
    moments = np.zeros((features.shape[1], features.shape[1]))
    cross = np.zeros((features.shape[1], actions.shape[1]))
    for block in blocks(features):
        rows = features[block]
        weighted = (rows * weight[block, None]).astype(features.dtype, copy=False)
        moments += weighted.T @ rows
        cross += weighted.T @ actions[block].astype(features.dtype, copy=False)
    return moments, cross


def _solve(matrix: Array, right: Array) -> Array:
    """Least squares where the columns hold less than the ridge can make up for."""
    try:
        solution: Array = cho_solve(cho_factor(matrix), right)
    except np.linalg.LinAlgError:
        solution = np.linalg.lstsq(matrix, right)[0]
    return solution
