"""A linear policy for continuous actions, with Student's t distribution around its mean.

Under a Gaussian one step far from the mean would decide about its demonstration; heavy tails bound what a step can
cost. Student's distribution is a Gaussian whose precision is Gamma-distributed, so that the M-step is weighted least
squares, repeated (Lange, Little and Taylor 1989), and nu is chosen by the likelihood itself (ECME, Liu and Rubin 1994).
Both need sums over steps only.

Actions are bounded by a box. Where an action equals a bound and the mean lies beyond it, the residual is multiplied by
a small factor: a soft form of censored regression (Tobin 1958), in which it would not count at all. With such errors
every part of an action has a Hessian of its own, and the objective has kinks: a Newton step that lowers it is halved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dposv
from scipy.special import gammaln

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.numerics.blocks import Sums, blocks, linear
from rpil.numerics.newton import CurvatureHistory, Preconditioner
from rpil.numerics.types import Array, Float

BOUND_FACTOR = 0.03
"""Factor of an error beyond a bound: above 0, so that no mean goes to infinity. Chosen by hand, not tuned. It is part
of the density, the same for all saved policies."""


DEGREES_OF_FREEDOM, START_DEGREES = (1.0, 2.0, 3.0, 5.0, 8.0, 15.0, 30.0, 100.0), 5.0
"""Values of nu to choose from, from Cauchy's distribution to almost a Gaussian, and nu before the fit. This, and all
that follows, was chosen by hand, not tuned."""
MIN_SPREAD = 0.01
"""Lower bound, in widths of the box, of the standard deviation of a part of the actions: actions that repeat exactly,
as at the bounds, would have an infinite density, and no other step would count. Also the distance from a bound within
which an action is at the bound."""
MAX_HALVINGS = 12
"""Halvings of a step after which it is given up."""
MIN_GAIN = 5e-6
"""Gain of the objective, in nats a step, at which a fit in memory stops, whatever is asked: on trusted steps of
recorded data the means of the median set were within 5e-4 standard deviations of those at a fifth of it."""


@stored(weights="F+1 A", cholesky="A A", ridge="F+1", least="A", low="A", high="A")
@dataclass(frozen=True, eq=False)
class StudentPolicy:
    """a | s ~ t_nu( W^T phi(s), Sigma ), for a design matrix whose last column is the constant."""

    weights: Float[Array, "D A"]
    """Coefficients W."""
    cholesky: Float[Array, "A A"]
    """Lower factor of the scale matrix Sigma."""
    freedom: float
    """nu."""
    ridge: Float[Array, " D"]
    """Penalty on the squares of each feature's coefficients, in units of Sigma; 0 for the constant."""
    least: Float[Array, " A"]
    """Its square is added to the sum of squared errors of each part, so that Sigma is never zero."""
    low: Float[Array, " A"]
    high: Float[Array, " A"]
    """Actions beyond which a part is at its bound; infinite without bounds."""

    @classmethod
    def zero(cls, box: Box, ridge: Float[Array, " D"], n_steps: float) -> StudentPolicy:
        """The middle of the box with the variance of a uniform draw; `n_steps` is the total weight of the steps that
        the policy will be fitted to."""
        width = box.high - box.low
        edge = MIN_SPREAD * width
        weights = np.zeros((len(ridge), len(width)))
        weights[-1] = 0.5 * (box.low + box.high)
        spread, nu, least = np.diag(width / np.sqrt(12.0)), START_DEGREES, edge * np.sqrt(n_steps)
        return cls(weights, spread, nu, ridge, least, box.low + edge, box.high - edge)

    @classmethod
    def of_errors(cls, box: Box, n_steps: float) -> StudentPolicy:
        """The distribution of the errors of another model's means: one constant feature, without bounds."""
        infinite = np.full(len(box.low), np.inf)
        return replace(cls.zero(box, np.zeros(1), n_steps), low=-infinite, high=infinite)

    def outputs(self, features: Float[Array, "N D"]) -> Float[Array, "N A"]:
        """The means."""
        return linear(features, self.weights)

    def log_prob(self, outputs: Float[Array, "N A"], actions: Float[Array, "N A"]) -> Float[Array, " N"]:
        """log pi(a_n|s_n) in nats: a density within the bounds, the likelihood of censored errors at one."""
        return self._log_density(self._distance(self._errors(outputs, actions)[0]), self.freedom)

    def fit(
        self,
        data: FitData,
        weight: Float[Array, " N"],
        soft_targets: Float[Array, "N K"] | None = None,
        *,
        tol: float = 1e-6,
        max_iter: int = 100,
        max_cg: int = 0,
    ) -> tuple[StudentPolicy, Float[Array, "N A"]]:
        """Weighted least squares until the objective gains less than `tol` nats a step, or less than `MIN_GAIN`;
        unchanged without weight.

        Adversaries of continuous actions have no `soft_targets`, and no step needs conjugate gradients.
        """
        total = weight.sum()
        if not total > 0.0:
            return self, self.outputs(data.features)
        data = replace(data, actions=np.asfortranarray(data.actions))  # as outputs are: else each sum is strided
        fitted = _Fitted.at(self, self.outputs(data.features), data.actions, weight)
        for _ in range(max_iter):
            before, fitted = fitted, self._iterate(data, fitted, weight)
            if fitted.objective - before.objective <= max(tol, MIN_GAIN) * total:
                break
        return fitted.policy, fitted.outputs

    def with_temperature(self, temperature: float) -> StudentPolicy:
        """The policy unchanged: Sigma and nu were fitted."""
        return self

    def penalty(self) -> float:
        """Penalty that the ridge and the least spread subtract from the log-likelihood."""
        root = np.vstack([np.sqrt(self.ridge)[:, None] * self.weights, np.diag(self.least)])
        return float(0.5 * self._distance(root).sum())

    def with_preconditioner(
        self, data: FitData, weight: Float[Array, " N"], ridge: Float[Array, " D"], factor: float
    ) -> tuple[StudentPolicy, None]:
        """The policy for `factor` times as many steps; its Hessian is in the sums."""
        return replace(self, ridge=ridge, least=self.least * np.sqrt(factor)), None

    def collect_suff_stats(self, features: Array, actions: Array, weight: Array) -> tuple[Array, Sums]:
        """log pi of the actions taken, and the sums of `_weighted_sums`, R^T W R for the errors R, the log-likelihood
        of every nu, the total weight, and the number of errors beyond a bound."""
        outputs = self.outputs(features)
        errors, beyond = self._errors(outputs, actions)
        distance = self._distance(errors)
        robust = self._robust_weight(distance, weight)
        sums = _weighted_sums(features, errors, beyond, robust, self._precision)
        more = (errors.T * robust) @ errors, self._log_likelihoods(distance, weight), weight.sum(), beyond.sum()
        return self.log_prob(outputs, actions), (*sums, *more)

    def m_step(
        self, statistics: Sums, radius: float, preconditioner: Preconditioner | None, history: CurvatureHistory
    ) -> tuple[StudentPolicy, CurvatureHistory]:
        """One step of weighted least squares, no entry above `radius` standard deviations; the history as it is.

        nu is the best for the errors before the step, unless `radius` is finite. The objective cannot fall while no
        action is at a bound.
        """
        grams, slope, scatter, likelihoods, total, n_beyond = statistics
        if not total > 0.0:
            return self, history
        step = self._step(grams, slope, bool(n_beyond > 0))
        spread = np.sqrt((self.cholesky**2).sum(axis=1))
        step *= min(1.0, radius / max(np.abs(step / spread).max(), 1e-300))
        if not n_beyond:  # else Sigma follows one step later
            cross = slope @ self.cholesky @ self.cholesky.T
            scatter = scatter - step.T @ cross - cross.T @ step + step.T @ grams[0] @ step
        policy = self._moved(self.weights + step, scatter, total)
        return policy if radius < np.inf else policy._with_best_freedom(likelihoods), history

    def gradient_norm(self, statistics: Sums) -> float:
        """Largest entry of the gradient of the penalised log-likelihood, in standard deviations; or what a better Sigma
        or nu would gain, in nats, where that is more."""
        _, slope, scatter, likelihoods, total, _ = statistics
        if not total > 0.0:
            return 0.0
        spread = np.sqrt((self.cholesky**2).sum(axis=1))
        covariance = self.cholesky @ self.cholesky.T
        steepest = np.abs((slope @ covariance - self.ridge[:, None] * self.weights) / spread).max()
        half = solve_triangular(self.cholesky, self._penalised(scatter, self.weights), lower=True)
        excess = solve_triangular(self.cholesky, half.T, lower=True) / total - np.eye(len(scatter))
        nearest = np.argmin(np.abs(np.array(DEGREES_OF_FREEDOM) - self.freedom))
        better_freedom = likelihoods.max() - likelihoods[int(nearest)]
        return float(max(steepest, 0.25 * total * (excess**2).sum(), better_freedom))

    @staticmethod
    def _iterate(data: FitData, last: _Fitted, weight: Array) -> _Fitted:
        """The policy after one step of weighted least squares, then Sigma, its best multiple, and nu."""
        policy, features = last.policy, data.features
        robust = policy._robust_weight(last.distance, weight)
        grams, slope = _weighted_sums(features, last.errors, last.beyond, robust, policy._precision)
        step = policy._step(grams, slope, bool(last.beyond.any()))
        moved = policy._shortened(step, linear(features, step), data.actions, last, weight)
        errors, robust = moved.errors, policy._robust_weight(moved.distance, weight)
        policy = policy._moved(moved.policy.weights, (errors.T * robust) @ errors, weight.sum())
        policy, distance = policy._scaled(policy._distance(errors), weight)
        likelihoods = policy._log_likelihoods(distance, weight)
        policy = policy._with_best_freedom(likelihoods)
        objective = float(likelihoods.max()) - policy.penalty()
        return _Fitted(policy, moved.outputs, errors, moved.beyond, distance, objective)

    def _scaled(self, distance: Array, weight: Array) -> tuple[StudentPolicy, Array]:
        """The policy with the best multiple of Sigma, and the distances under it: with small nu Sigma alone would grow
        for many iterations (parameter expansion, Liu, Rubin and Wu 1998)."""
        nu, n_parts, penalty, size = self.freedom, len(self.cholesky), 2.0 * self.penalty(), 1.0
        for _ in range(4):  # Newton's method on the logarithm of the multiple, in which the objective is concave
            share = distance / (size * nu + distance)
            slope = (nu + n_parts) * (weight @ share) + penalty / size - n_parts * weight.sum()
            curvature = (nu + n_parts) * (weight @ (share * (1.0 - share))) + penalty / size
            size *= np.exp(np.clip(slope / curvature, -1.0, 1.0))
        return replace(self, cholesky=np.sqrt(size) * self.cholesky), distance / size

    def _moved(self, weights: Array, scatter: Array, total: float) -> StudentPolicy:
        """The policy with these coefficients, and Sigma of the errors with the sums of squares `scatter` (A, A)."""
        return replace(self, weights=weights, cholesky=np.linalg.cholesky(self._penalised(scatter, weights) / total))

    def _penalised(self, scatter: Array, weights: Array) -> Array:
        return np.asarray(scatter + (weights.T * self.ridge) @ weights + np.diag(self.least**2))

    def _with_best_freedom(self, likelihoods: Array) -> StudentPolicy:
        return replace(self, freedom=DEGREES_OF_FREEDOM[int(np.argmax(likelihoods))])

    def _log_likelihoods(self, distance: Array, weight: Array) -> Array:
        """Log-likelihood of the weighted steps under every nu to choose from."""
        return np.array([weight @ self._log_density(distance, nu) for nu in DEGREES_OF_FREEDOM])

    def _step(self, grams: Array, slope: Array, kinked: bool) -> Array:
        """The Newton step: with the Hessian of each part where errors are beyond a bound, else one Hessian for all."""
        ridge = np.diag(self.ridge)
        slope = slope - (self.ridge[:, None] * self.weights) @ self._precision
        steps = slope @ self.cholesky @ self.cholesky.T
        if not kinked:
            return _solve(grams[0] + ridge, steps)
        return np.column_stack([_solve(gram + ridge, part) for gram, part in zip(grams, steps.T, strict=True)])

    def _shortened(self, step: Array, change: Array, actions: Array, last: _Fitted, weight: Array) -> _Fitted:
        """The policy after the longest of 1, 1/2, 1/4 .. times the step, by which outputs `change`, that does not lower
        the objective; the last one without any."""
        for length in 0.5 ** np.arange(MAX_HALVINGS):
            moved = replace(self, weights=self.weights + length * step)
            trial = _Fitted.at(moved, last.outputs + length * change, actions, weight)
            if trial.objective >= last.objective:
                return trial
        return last

    def _errors(self, outputs: Array, actions: Array) -> tuple[Array, Array]:
        """Errors of the means, and which are beyond a bound, (N, A) each: there the action is at the bound and the mean
        beyond the action, and the error is multiplied by `BOUND_FACTOR`."""
        errors = actions - outputs
        beyond = ((actions >= self.high) & (errors <= 0.0)) | ((actions <= self.low) & (errors >= 0.0))
        return np.multiply(errors, BOUND_FACTOR, out=errors, where=beyond), beyond

    def _robust_weight(self, distance: Array, weight: Array) -> Array:
        """Weights (N,) times the expected precision (nu + A) / (nu + distance) of each step."""
        return np.asarray(weight * (self.freedom + len(self.cholesky)) / (self.freedom + distance))

    @property
    def _precision(self) -> Array:
        return np.asarray(cho_solve((self.cholesky, True), np.eye(len(self.cholesky))))

    def _distance(self, errors: Array) -> Array:
        """Squared Mahalanobis distances of rows, (N, A) -> (N,)."""
        standard = errors @ solve_triangular(self.cholesky, np.eye(len(self.cholesky)), lower=True).T
        return np.asarray(np.einsum("na,na->n", standard, standard))

    def _log_density(self, distance: Array, freedom: float) -> Array:
        dimension = len(self.cholesky)
        constant = gammaln(0.5 * (freedom + dimension)) - gammaln(0.5 * freedom)
        constant -= 0.5 * dimension * np.log(freedom * np.pi) + np.log(np.diag(self.cholesky)).sum()
        return np.asarray(constant - 0.5 * (freedom + dimension) * np.log1p(distance / freedom))


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A policy during a fit, and what it says of the steps."""

    policy: StudentPolicy
    outputs: Array
    errors: Array
    beyond: Array
    distance: Array
    objective: float

    @classmethod
    def at(cls, policy: StudentPolicy, outputs: Array, actions: Array, weight: Array) -> _Fitted:
        errors, beyond = policy._errors(outputs, actions)
        distance = policy._distance(errors)
        objective = float(weight @ policy._log_density(distance, policy.freedom)) - policy.penalty()
        return cls(policy, outputs, errors, beyond, distance, objective)


def _weighted_sums(
    features: Array, errors: Array, beyond: Array, weight: Array, precision: Array
) -> tuple[Array, Array]:
    """X^T W X of every part, whose errors `beyond` a bound count `BOUND_FACTOR`^2 times, (A, D, D), and X^T W R P with
    that factor, (D, A), in one reading of X."""
    n_parts, width = errors.shape[1], features.shape[1]
    grams, slope = np.zeros((n_parts, width, width)), np.zeros((width, n_parts))
    residual = weight[:, None] * (precision @ errors.T).T
    np.multiply(residual, BOUND_FACTOR, out=residual, where=beyond)
    for block in blocks(features):
        rows, weights, some = features[block], weight[block], beyond[block].any(axis=0)
        slope += rows.T @ residual[block].astype(features.dtype, copy=False)
        shared = _gram(rows, weights)
        grams[~some] += shared
        for part in np.flatnonzero(some):
            grams[part] += _with_beyond(shared, rows, weights, beyond[block, part])
    return grams, slope


def _with_beyond(shared: Array, rows: Array, weight: Array, beyond: Array) -> Array:
    """X^T W X where rows `beyond` a bound count `BOUND_FACTOR`^2 times, from `shared`, in which they count once, and
    the rows of the rarer sort alone."""
    factor = BOUND_FACTOR**2
    if 2 * np.count_nonzero(beyond) <= len(beyond):
        return shared - (1.0 - factor) * _gram(rows[beyond], weight[beyond])
    return factor * shared + (1.0 - factor) * _gram(rows[~beyond], weight[~beyond])


def _gram(rows: Array, weight: Array) -> Array:
    """X^T W X."""
    return np.asarray((rows * weight[:, None]).astype(rows.dtype, copy=False).T @ rows)


def _solve(matrix: Array, right: Array) -> Array:
    """The solution, or least squares where the columns are dependent and the ridge does not make up for it."""
    _, solution, failed = dposv(matrix, right)
    return np.asarray(np.linalg.lstsq(matrix, right)[0] if failed else solution)
