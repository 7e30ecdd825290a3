"""A policy for continuous actions: linear, with the heavy tails of Student's distribution around it.

    a | s ~ t_nu( W^T phi(s), Sigma )

A density is unbounded, so that under a Gaussian one step far off would condemn a demonstration: the tails say that
such steps happen. Student's distribution is a Gaussian whose precision is Gamma-distributed, so its M-step is weighted
least squares, repeated (Lange, Little and Taylor 1989), in which nu is chosen by the likelihood itself (ECME, Liu and
Rubin 1994). All of it needs sums over steps only.

A box ends somewhere. A demonstrator at a bound may have meant more, so that a mean beyond the bound is nearly as
good as one on it: errors at a bound count on one side, as in censored regression (Tobin 1958), and hardly on the
other. Steps beyond say next to nothing then, so that every part of an action has least squares of its own: a Newton
step for a function with such kinks, shortened where it leads too far.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import gammaln

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.numerics.blocks import Sums, blocks, linear
from rpil.numerics.types import Array

_FREEDOM = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 15.0, 30.0, 100.0])
"""Degrees of freedom to choose from: Cauchy's distribution to all but a Gaussian."""

_LEAST_SPREAD = 0.01
"""Of a dimension's box: a standard deviation that no policy goes much below. Actions that are exactly
the same time and again, as at the bounds of the box, would else be infinitely likely, and no other step would count."""

_START_FREEDOM = 5.0

_BEYOND = 0.03
"""What counts of an error beyond a bound, so that no mean runs away from what was done."""

_HALVINGS = 12
"""Times that a step is shortened before it is given up."""


@stored(weights="F+1 A", cholesky="A A", ridge="F+1", least="A", low="A", high="A")
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
        """log pi(a_n|s_n), (N,): a density within the bounds; at one, no more than the likelihood of `_errors`."""
        return self._log_density(self._distance(self._errors(outputs, actions)[0]), self.freedom)

    def fit(
        self,
        data: FitData,
        weight: Array,
        soft_targets: Array | None = None,
        *,
        tol: float = 1e-6,
        max_iter: int = 100,
        max_cg: int = 0,
    ) -> tuple[StudentPolicy, Array]:
        """Weighted least squares until the objective gains less than `tol` nats a step."""
        features, actions = data.features, data.actions
        total = weight.sum()
        policy, outputs = self, self.outputs(features)
        if not total > 0.0:  # nothing to learn from, so nothing to forget
            return policy, outputs
        objective = weight @ policy.log_prob(outputs, actions) - policy.penalty()
        for _ in range(max_iter):
            policy, outputs = policy._improved(features, actions, outputs, weight)
            before, objective = objective, weight @ policy.log_prob(outputs, actions) - policy.penalty()
            if objective - before <= tol * total:
                break
        return policy, outputs

    def with_temperature(self, temperature: float) -> StudentPolicy:
        """The same: how sure it is was fitted, too."""
        return self

    def penalty(self) -> float:
        """What the ridge and the least spread take off the log-likelihood."""
        root = np.vstack([np.sqrt(self.ridge)[:, None] * self.weights, np.diag(self.least)])
        return float(0.5 * self._distance(root).sum())

    def with_preconditioner(
        self, data: FitData, weight: Array, ridge: Array, factor: float
    ) -> tuple[StudentPolicy, None]:
        """The same for `factor` times as many steps; what it needs of a Hessian is in the sums."""
        return replace(self, ridge=ridge, least=self.least * np.sqrt(factor)), None

    def collect_suff_stats(self, data: FitData, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, (N,), and sums: X^T W X of every part and the slope, see `_least_squares`,
        R^T W R for the errors R, the likelihood of every nu, the weights, and how many errors count for less."""
        outputs = self.outputs(data.features)
        errors, counts = self._errors(outputs, data.actions)
        distance = self._distance(errors)
        trust = self._trust(distance, weight)
        likelihood = np.array([weight @ self._log_density(distance, freedom) for freedom in _FREEDOM])
        sums = _least_squares(data.features, errors, counts, trust, self._precision)
        spread = (errors.T * trust) @ errors, likelihood, weight.sum(), (counts < 1.0).sum()
        return self.log_prob(outputs, data.actions), (*sums, *spread)

    def m_step(self, statistics: Sums, radius: float, hessian: None, path: Array) -> tuple[StudentPolicy, Array]:
        """One step of weighted least squares, no entry longer than `radius` spreads; nu is the best for what was there
        before, unless `radius` is finite. No such step goes down while no action is at a bound."""
        moments, slope, scatter, likelihood, total, beyond = statistics
        if not total > 0.0:
            return self, path
        step = self._step(moments, slope, beyond > 0)
        spread = np.sqrt((self.cholesky**2).sum(axis=1))
        step *= min(1.0, radius / max(np.abs(step / spread).max(), 1e-300))
        weights = self.weights + step
        if not beyond:  # else the spread follows, a step later
            cross = slope @ self.cholesky @ self.cholesky.T
            scatter = scatter - step.T @ cross - cross.T @ step + step.T @ moments[0] @ step
        scatter = scatter + (weights.T * self.ridge) @ weights + np.diag(self.least**2)
        freedom = float(_FREEDOM[int(np.argmax(likelihood))]) if radius == np.inf else self.freedom
        return replace(self, weights=weights, cholesky=np.linalg.cholesky(scatter / total), freedom=freedom), path

    def gradient_norm(self, statistics: Sums) -> float:
        """Largest entry of the gradient of the penalised log-likelihood, in units of the spread; or what a better
        Sigma or nu would gain, in nats, where that is more."""
        _, slope, scatter, likelihood, total, _ = statistics
        if not total > 0.0:
            return 0.0
        spread = np.sqrt((self.cholesky**2).sum(axis=1))
        covariance = self.cholesky @ self.cholesky.T
        steepest = np.abs((slope @ covariance - self.ridge[:, None] * self.weights) / spread).max()
        scatter = scatter + (self.weights.T * self.ridge) @ self.weights + np.diag(self.least**2)
        half = solve_triangular(self.cholesky, scatter, lower=True)
        excess = solve_triangular(self.cholesky, half.T, lower=True) / total - np.eye(len(scatter))
        surer = likelihood.max() - likelihood[int(np.argmin(np.abs(_FREEDOM - self.freedom)))]
        return float(max(steepest, 0.25 * total * (excess**2).sum(), surer))

    def _improved(self, features: Array, actions: Array, outputs: Array, weight: Array) -> tuple[StudentPolicy, Array]:
        errors, counts = self._errors(outputs, actions)
        trust = self._trust(self._distance(errors), weight)
        moments, slope = _least_squares(features, errors, counts, trust, self._precision)
        step = self._step(moments, slope, kinked := bool((counts < 1.0).any()))
        said = linear(features, step)
        length = self._length(step, said, actions, outputs, weight) if kinked else 1.0
        weights, outputs = self.weights + length * step, outputs + length * said
        errors, _ = self._errors(outputs, actions)
        if kinked:  # the step was measured by the likelihood itself, so what each error counts is that of now
            trust = self._trust(self._distance(errors), weight)
        scatter = (errors.T * trust) @ errors + (weights.T * self.ridge) @ weights + np.diag(self.least**2)
        policy = replace(self, weights=weights, cholesky=np.linalg.cholesky(scatter / weight.sum()))
        distance = policy._distance(errors)
        likelihood = [weight @ policy._log_density(distance, freedom) for freedom in _FREEDOM]
        return replace(policy, freedom=float(_FREEDOM[int(np.argmax(likelihood))])), outputs

    def _step(self, moments: Array, slope: Array, kinked: bool) -> Array:
        """Newton's, with the Hessian of every part alone where some errors count for less, and else of all together."""
        ridge, precision = np.diag(self.ridge), self._precision
        slope = slope - (self.ridge[:, None] * self.weights) @ precision
        if not kinked:
            return _solve(moments[0] + ridge, slope @ self.cholesky @ self.cholesky.T)
        parts = zip(moments, slope.T, np.diag(precision), strict=True)
        return np.column_stack([_solve(of + ridge, towards / sure) for of, towards, sure in parts])

    def _length(self, step: Array, said: Array, actions: Array, outputs: Array, weight: Array) -> float:
        """Of a step, which changes what is `said`, so that the objective does not fall: outputs move on a line."""

        def value(length: float) -> float:
            moved = replace(self, weights=self.weights + length * step)
            return float(weight @ moved.log_prob(outputs + length * said, actions) - moved.penalty())

        here = value(0.0)
        lengths = 0.5 ** np.arange(_HALVINGS)
        return next((float(length) for length in lengths if value(length) >= here), 0.0)

    def _errors(self, outputs: Array, actions: Array) -> tuple[Array, Array]:
        """What means are off by, (N, A), as far as it counts, and how far that is, (N, A): all of it, or `_BEYOND`
        where the action has reached a bound and the mean lies beyond."""
        beyond = ((actions >= self.high) & (outputs >= actions)) | ((actions <= self.low) & (outputs <= actions))
        counts = np.where(beyond, _BEYOND, 1.0)
        return counts * (actions - outputs), counts

    def _trust(self, distance: Array, weight: Array) -> Array:
        dimension = len(self.cholesky)
        return weight * (self.freedom + dimension) / (self.freedom + distance)

    @property
    def _precision(self) -> Array:
        inverse: Array = cho_solve((self.cholesky, True), np.eye(len(self.cholesky)))
        return inverse

    def _distance(self, residual: Array) -> Array:
        """Squared Mahalanobis distances of rows, (N, A) -> (N,)."""
        standard = solve_triangular(self.cholesky, residual.T, lower=True)
        return np.einsum("an,an->n", standard, standard)

    def _log_density(self, distance: Array, freedom: float) -> Array:
        dimension = len(self.cholesky)
        constant = gammaln(0.5 * (freedom + dimension)) - gammaln(0.5 * freedom)
        constant -= 0.5 * dimension * np.log(freedom * np.pi) + np.log(np.diag(self.cholesky)).sum()
        return constant - 0.5 * (freedom + dimension) * np.log1p(distance / freedom)


def _least_squares(
    features: Array, errors: Array, counts: Array, weight: Array, precision: Array
) -> tuple[Array, Array]:
    """X^T W X for every part, as far as its errors count, (A, D, D), and X^T W R P, (D, A), in one reading of X."""
    n_parts, width = errors.shape[1], features.shape[1]
    moments, slope = np.zeros((n_parts, width, width)), np.zeros((width, n_parts))
    towards = weight[:, None] * (errors @ precision) * counts
    for block in blocks(features):
        rows, some, every = features[block], counts[block], weight[block]
        slope += rows.T @ towards[block].astype(features.dtype, copy=False)
        whole: Array = np.all(some == 1.0, axis=0)
        shared = _moments(rows, every) if whole.any() else None
        for part in range(n_parts):
            moments[part] += shared if whole[part] else _moments(rows, every * some[:, part] ** 2)
    return moments, slope


def _moments(rows: Array, weight: Array) -> Array:
    """X^T W X."""
    product: Array = (rows * weight[:, None]).astype(rows.dtype, copy=False).T @ rows
    return product


def _solve(matrix: Array, right: Array) -> Array:
    """Least squares where the columns hold less than the ridge can make up for."""
    try:
        solution: Array = cho_solve(cho_factor(matrix), right)
    except np.linalg.LinAlgError:
        solution = np.linalg.lstsq(matrix, right)[0]
    return solution
