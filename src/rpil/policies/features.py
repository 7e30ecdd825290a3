"""Feature maps phi(s): what the linear policy sees of an observation.

A map is fitted once, is frozen, and is a handful of arrays, so that it travels with a saved policy. Columns are centred
and scaled for the solver's sake; the ridge is expressed in the scale the user chose (see `FeatureMap.ridge`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.preprocessing import SplineTransformer

from rpil.data.archive import stored
from rpil.data.arrays import LARGEST
from rpil.data.errors import DataError
from rpil.data.spaces import Discrete, Space
from rpil.numerics.types import Array

KINDS = ("raw", "folded", "spline", "poly", "nystroem")
"""The kinds of maps."""

FEATURES = ("auto", *KINDS)
"""What the estimators accept; "auto" chooses among the kinds, see `rpil.policies.selection`."""

RIDGE_PER_STEP = 1e-5
"""The default ridge, for a step: strong enough to keep separable classes finite, too weak to bias a policy."""

N_LANDMARKS = 200
"""With which Nystroem compares, unless fewer are asked for."""

_N_KNOTS = 8
_MAX_POLY_COLUMNS = 2000
_KERNEL_WIDTH = 0.1

_MOST_COMPARED = 4096
"""Observations among which landmarks are chosen."""

_LEAST_UNLIKE = 1e-6
"""Of a kernel that is 1: what is explained but for that needs no more landmarks."""

_BLOCK_STEPS = 4096
"""Rows of a design matrix that are made at a time: what they are made of stays in cache."""

_NEAR = 4.0
"""Means, in standard deviations, that single precision subtracts with an error of 2e-7."""


@stored(
    renews=("F", "knots", "R"),
    knots="knots D",
    location="D",
    spread="D",
    center="F",
    scale="F",
    landmarks="R E",
    mixing="R R",
)
@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Observations (N, D) to a design matrix (N, F + 1) whose last column is the constant.

    Attributes
    ----------
    kind : {"raw", "folded", "spline", "poly", "nystroem"}
        The observation itself; the observation and its distance from the mean, so that a policy may treat both sides
        alike; a cubic B-spline basis of each observation (8 knots, linear beyond them); all products of up to two
        observations; the folded observation, and Nystroem's approximation of a Gaussian kernel on it.
    knots : (8, D) array
        Of the spline; (0, D) for the other kinds.
    location, spread : (D,) arrays
        What polynomials subtract and divide by before they multiply, and folding before it folds.
    center, scale : (F,) arrays
        What every column subtracts and divides by.
    landmarks : (R, 2 D) array
        Folded observations that Nystroem compares with; (0, 2 D) for the other kinds.
    mixing : (R, R) array
        What turns the similarities into features.
    ridge_per_step : float
        Of the default ridge.
    """

    kind: str
    knots: Array
    location: Array
    spread: Array
    center: Array
    scale: Array
    landmarks: Array
    mixing: Array
    ridge_per_step: float = RIDGE_PER_STEP

    @classmethod
    def fit(
        cls,
        kind: str,
        observations: NDArray[Any],
        weight: Array | None = None,
        ridge: float = RIDGE_PER_STEP,
        n_landmarks: int = N_LANDMARKS,
    ) -> FeatureMap:
        """Choose knots, landmarks, centres and scales from observations (N, D), the latter two with the `weight` (N,)
        of each. `n_landmarks` are drawn with a seed of their own: the same data, the same bits.

        Raises
        ------
        DataError
            If there is no such kind, or polynomials of so many observations would not fit in memory.
        """
        if kind not in KINDS:
            raise DataError(f"There are no features called {kind!r}; choose {', '.join(FEATURES)}.")
        n_columns = observations.shape[1]
        if kind == "poly" and n_columns * (n_columns + 3) // 2 > _MAX_POLY_COLUMNS:
            raise DataError(f"Polynomials of {n_columns} observations are too many; choose features raw or spline.")
        observations = np.asarray(observations, dtype=float)
        if np.abs(observations).max() > LARGEST:
            raise DataError(f"An observation is beyond {LARGEST:g}, where its square is no number; use larger units.")
        location, spread = _moments(observations, weight)
        knots = np.empty((0, n_columns))
        if kind == "spline":
            low, high = observations.min(axis=0), observations.max(axis=0)
            high = np.where(high > low, high, low + 1.0)  # a constant column still needs an interval
            knots = np.linspace(low, high, _N_KNOTS)
            for k in range(1, _N_KNOTS):  # distinct, where the interval is too narrow for the precision
                knots[k] = np.maximum(knots[k], np.nextafter(knots[k - 1], np.inf))
        landmarks, mixing = np.empty((0, 2 * n_columns)), np.empty((0, 0))
        if kind == "nystroem":
            landmarks, mixing = _nystroem(_fold((observations - location) / spread), n_landmarks)
        none = np.zeros(0)
        raw = cls(kind, knots, location, spread, none, none, landmarks, mixing)
        columns = raw._columns(observations)
        center, scale = _moments(columns, weight, unit=1.0 if kind in ("poly", "nystroem") else 0.0)
        if kind == "spline":  # they share one natural scale: a column that is rarely visited must stay rarely believed
            scale = np.ones_like(scale)
        return cls(kind, knots, location, spread, center, scale, landmarks, mixing, ridge)

    @property
    def n_columns(self) -> int:
        """Columns of the design matrix, F + 1."""
        return len(self.center) + 1

    def design(self, observations: NDArray[Any], single: bool = False) -> Array:
        """The design matrix, (N, F + 1), in single precision where asked."""
        # As it is read from disk, column by column, a piece stays: to transpose it takes longer than to read it.
        order: Any = "F" if observations.flags.f_contiguous else "C"
        out = np.empty((len(observations), self.n_columns), np.float32 if single else np.float64, order)
        out[:, -1] = 1.0
        made = self._single if single and observations.dtype == np.float32 and self._near_zero else self._double
        for start in range(0, len(observations), _BLOCK_STEPS):
            rows = slice(start, start + _BLOCK_STEPS)
            made(observations[rows], out[rows, :-1])
        return out

    @cached_property
    def _near_zero(self) -> bool:
        """Whether nothing is lost where single precision subtracts what columns vary around."""
        pairs = (self.center, self.scale), (self.location, self.spread)
        return self.kind in ("raw", "folded") and all((np.abs(c) <= _NEAR * s).all() for c, s in pairs)

    def _double(self, observations: NDArray[Any], out: Array) -> None:
        columns = self._columns(np.asarray(observations, dtype=float))
        out[:] = (columns - self.center) / self.scale

    def _single(self, observations: NDArray[Any], out: Array) -> None:
        """Raw and folded columns, all in single precision."""
        center, factor = self.center.astype(np.float32), (1 / self.scale).astype(np.float32)
        width = observations.shape[1]
        np.subtract(observations, center[:width], out=out[:, :width])
        if self.kind == "folded":
            folded = out[:, width:]
            np.subtract(observations, self.location.astype(np.float32), out=folded)
            folded *= (1 / self.spread).astype(np.float32)
            np.abs(folded, out=folded)
            folded -= center[width:]
        out *= factor

    def ridge(self, C: float | None, total_weight: float) -> Array:
        """Penalty on each squared coefficient of the design matrix, (F + 1,).

        With C it is what scikit-learn's `LogisticRegression` would take off on the unscaled columns; without, a
        penalty on the scaled columns that grows with the number of steps, so that neither units nor the amount of data
        change its meaning.
        """
        scaled = np.full(len(self.center), self.ridge_per_step * total_weight)
        return np.append(scaled if C is None else 1.0 / (C * self.scale**2), 0.0)

    def _columns(self, observations: Array) -> Array:
        if self.kind == "raw":
            return observations
        if self.kind == "spline":
            return self._splines.transform(observations)
        z = (observations - self.location) / self.spread
        if self.kind == "folded":
            return np.hstack([observations, np.abs(z)])
        if self.kind == "nystroem":
            folded = _fold(z)
            return np.hstack([folded, _similarity(folded, self.landmarks) @ self.mixing])
        i, j = np.triu_indices(z.shape[1])
        return np.hstack([z, z[:, i] * z[:, j]])

    @cached_property
    def _splines(self) -> SplineTransformer:
        return SplineTransformer(degree=3, knots=self.knots, extrapolation="linear").fit(self.knots)


@dataclass(frozen=True)
class IdentityMap:
    """Observations as they are, for policies that make their own features of them."""

    kind: str = "the policy's own"

    def design(self, observations: NDArray[Any], single: bool = False) -> Array:
        """The observations, (N, D)."""
        return np.asarray(observations, dtype=float)


def _fold(z: Array) -> Array:
    return np.hstack([z, np.abs(z)])


def _nystroem(folded: Array, n_landmarks: int) -> tuple[Array, Array]:
    """Landmarks (R, 2 D) and mixing (R, R), the inverse root of their similarities (Williams and Seeger 2001)."""
    landmarks = _landmarks(folded, n_landmarks)
    values, vectors = np.linalg.eigh(_similarity(landmarks, landmarks))
    return landmarks, (vectors / np.sqrt(np.maximum(values, _LEAST_UNLIKE**2))) @ vectors.T


def _landmarks(folded: Array, n_landmarks: int) -> Array:
    """Up to `n_landmarks` of the rows (N, 2 D), each drawn with the probability that the ones before it do not explain
    it: randomly pivoted Cholesky (Chen, Epperly, Tropp and Webber 2024).

    Drawn evenly, most would stand where an expert stands still, and hardly any where he does something.
    """
    rng = np.random.default_rng(0)
    if len(folded) > _MOST_COMPARED:
        folded = folded[np.sort(rng.choice(len(folded), _MOST_COMPARED, replace=False))]
    unexplained = np.ones(len(folded))
    factor = np.zeros((len(folded), min(n_landmarks, len(folded))))
    chosen: list[int] = []
    for k in range(factor.shape[1]):
        pivot = int(rng.choice(len(folded), p=unexplained / unexplained.sum()))
        chosen.append(pivot)
        column = _similarity(folded, folded[pivot : pivot + 1])[:, 0] - factor[:, :k] @ factor[pivot, :k]
        factor[:, k] = column / np.sqrt(column[pivot])
        unexplained = np.maximum(unexplained - factor[:, k] ** 2, 0.0)
        if unexplained.mean() < _LEAST_UNLIKE:
            break
    return folded[chosen]


def _similarity(folded: Array, landmarks: Array) -> Array:
    from sklearn.metrics.pairwise import rbf_kernel

    similarity: Array = rbf_kernel(folded, landmarks, gamma=_gamma(folded))
    return similarity


def _gamma(folded: Array) -> float:
    return _KERNEL_WIDTH / folded.shape[1]


def _moments(columns: Array, weight: Array | None, unit: float = 0.0) -> tuple[Array, Array]:
    """Mean and standard deviation of each column, the latter 1 where the column is constant up to rounding, which is
    relative to its mean, or to `unit` if that is larger."""
    mean = np.average(columns, axis=0, weights=weight)
    spread = np.sqrt(np.average((columns - mean) ** 2, axis=0, weights=weight))
    return mean, np.where(spread > 1e-12 * np.maximum(np.abs(mean), unit), spread, 1.0)


def ridge_of(features: FeatureMap, C: float | None, total_weight: float, space: Space) -> Array:
    """Penalty on each column: with two actions scikit-learn penalises the difference of the two columns once, which is
    twice the penalty on each."""
    if C is not None and not C > 0:
        raise DataError(f"C={C!r} must be a positive number.")
    ridge = features.ridge(C, total_weight)
    return 2.0 * ridge if C is not None and space == Discrete(2) else ridge
