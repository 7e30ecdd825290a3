"""Feature maps phi(s) from observations to the columns of the design matrix.

A map is fitted once, is frozen, and holds a handful of arrays, so that it is saved with a policy. Columns are centred
and scaled for the solver; the ridge is expressed in the scale the user chose (see `ridge_of`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rpil.data.archive import settings_record, stored
from rpil.data.arrays import check_squares
from rpil.data.errors import DataError
from rpil.data.spaces import Discrete, Space
from rpil.numerics.regression import robust_scale
from rpil.numerics.types import Array, Float, Int, Num

FEATURE_KINDS = ("raw", "folded", "nystroem")
"""The kinds of feature maps, among which "auto" chooses, see `rpil.policies.selection`."""

DESIGN_BLOCK_ROWS = 1024
"""Rows of a design matrix that are computed at a time, so that intermediate arrays stay in cache."""

SINGLE_MAX_CENTER = 4.0
"""Means, in standard deviations, that single precision subtracts with an error of 2e-7."""


@settings_record(landmark_tol="(0, 1)", bound="(0, inf)")
class FeatureSettings:
    """How a `FeatureMap` is fitted. Unless stated otherwise, values were chosen by hand, not tuned."""

    ridge_per_step: float = 1e-5
    """The default ridge, a step: strong enough to keep separable classes finite, too weak to bias a policy."""
    n_landmarks: int = 200
    """Landmarks of Nystroem's approximation, at most."""
    max_candidates: int = 4_096
    """Observations among which landmarks are drawn, at most."""
    landmark_tol: float = 1e-6
    """Mean of the unexplained part of the kernel, which is 1 at first, at which no more landmarks are drawn; also the
    root of the smallest eigenvalue of the kernel of the landmarks."""
    kernel_width: float = 0.1
    """gamma of the Gaussian kernel exp(-gamma |z - z'|^2), times the number of columns of z."""
    bound: float = 8.0
    """Spreads from the location at which a robust map cuts observations off."""


@stored(renews=("F", "R"), folds="D", location="D", spread="D", center="F", scale="F", landmarks="R E", mixing="R R")
@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Observations (N, D) to a design matrix (N, F + 1) whose last column is the constant."""

    kind: str
    """One of `FEATURE_KINDS`, in order: the observation; the observation and its distance from the mean, so that a
    policy may treat both sides equally; these two, and Nystroem's approximation of a Gaussian kernel on them."""
    folds: Float[Array, " D"]
    """1 of a column with more than two values, whose distance from the mean is a column, too; else 0."""
    location: Float[Array, " D"]
    spread: Float[Array, " D"]
    """Mean and standard deviation by which observations are standardised before they are folded; of a robust map those
    of `rpil.numerics.regression.robust_scale`."""
    center: Float[Array, " F"]
    scale: Float[Array, " F"]
    """The same of every column, by which it is standardised."""
    landmarks: Float[Array, "R E"]
    """Folded observations with which Nystroem compares; (0, E) for the other kinds."""
    mixing: Float[Array, "R R"]
    """Matrix that turns the similarities to the landmarks into features."""
    ridge_per_step: float
    """The default ridge, a step."""
    kernel_width: float
    """Width of Nystroem's kernel, see `FeatureSettings`."""
    bound: float | None
    """Spreads from the location at which observations are cut off; None where they are not."""

    @classmethod
    def fit(
        cls,
        kind: str,
        observations: Num[Array, "N D"],
        weight: Float[Array, " N"] | None = None,
        ridge: float | None = None,
        *,
        offsets: Int[Array, " M1"] | None = None,
        settings: FeatureSettings,
    ) -> FeatureMap:
        """Choose landmarks, centres and scales, the latter two from weighted observations.

        Landmarks are drawn with a seed of their own: the same data give the same bits.

        Parameters
        ----------
        weight : (N,) array, optional
            Weights of the observations; 1 by default.
        ridge : float, optional
            Ridge a step, in the place of ``settings.ridge_per_step``.
        offsets : (M + 1,) array, optional
            Bounds of the demonstrations. With them the map is robust: no single demonstration, however far off, changes
            how the others are seen. Weights are then not used.

        Raises
        ------
        DataError
            If there is no such kind, or an observation cannot be squared.
        """
        if kind not in FEATURE_KINDS:
            raise DataError(f"There are no features called {kind!r}; choose {', '.join(('auto', *FEATURE_KINDS))}.")
        observations = np.asarray(observations, dtype=float)
        check_squares([observations.min(axis=0), observations.max(axis=0)], "Observation")
        bound = None if offsets is None else settings.bound
        location, spread = _location_and_spread(observations, weight, offsets)
        if bound is not None:
            observations = _cut_off(observations, location, spread, bound)
        # Whether what is not the first value of a column has two values.
        are_more = [(own != own[:1]).any() for column in observations.T for own in [column[column != column[0]]]]
        folds = np.array(are_more, dtype=float)
        landmarks, mixing = np.empty((0, len(folds) + int(folds.sum()))), np.empty((0, 0))
        if kind == "nystroem":
            landmarks = _landmarks(_fold((observations - location) / spread, folds), settings)
            values, vectors = np.linalg.eigh(_similarity(landmarks, landmarks, settings.kernel_width))
            # The inverse root of the similarities of landmarks (Williams and Seeger 2001).
            mixing = (vectors / np.sqrt(np.maximum(values, settings.landmark_tol**2))) @ vectors.T
        none = np.zeros(0)
        ridge = settings.ridge_per_step if ridge is None else ridge
        unscaled = cls(
            kind, folds, location, spread, none, none, landmarks, mixing, ridge, settings.kernel_width, bound
        )
        columns = unscaled._columns(observations)
        center, scale = _location_and_spread(columns, weight, offsets, unit=1.0 if kind == "nystroem" else 0.0)
        return replace(unscaled, center=center, scale=scale)

    @property
    def n_columns(self) -> int:
        """Columns of the design matrix, F + 1."""
        return len(self.center) + 1

    def design(self, observations: Num[Array, "N D"], single: bool = False) -> Float[Array, "N F"]:
        """The design matrix, in single precision if `single`."""
        # A block that was read from disk column by column keeps that order: to transpose it takes longer than to read.
        order: Literal["F", "C"] = "F" if observations.flags.f_contiguous else "C"
        out = np.empty((len(observations), self.n_columns), np.float32 if single else np.float64, order)
        out[:, -1] = 1.0
        pairs = (self.center, self.scale), (self.location, self.spread)
        is_near_zero = all((np.abs(c) <= SINGLE_MAX_CENTER * s).all() for c, s in pairs)
        is_single = single and observations.dtype == np.float32 and self.kind != "nystroem" and is_near_zero
        for start in range(0, len(observations), DESIGN_BLOCK_ROWS):
            block = observations[start : start + DESIGN_BLOCK_ROWS]
            if self.bound is not None:
                block = _cut_off(block, self.location, self.spread, self.bound)
            columns = self._columns(block if is_single else block.astype(float))
            out[start : start + DESIGN_BLOCK_ROWS, :-1] = _standardised(columns, self.center, self.scale)
        return out

    def _columns(self, observations: Array) -> Array:
        if self.kind == "raw":
            return observations
        z = _standardised(observations, self.location, self.spread)
        if self.kind == "folded":
            return np.hstack([observations, np.abs(z[:, self.folds > 0])])
        folded = _fold(z, self.folds)
        return np.hstack([folded, _similarity(folded, self.landmarks, self.kernel_width) @ self.mixing])


def _standardised(values: Array, center: Array, scale: Array) -> Array:
    """(values - center) / scale in the precision of the values; a single one is multiplied, which is faster."""
    if values.dtype == np.float32:
        return np.asarray((values - center.astype(np.float32)) * (1 / scale).astype(np.float32))
    return np.asarray((values - center) / scale)


def _fold(z: Array, folds: Array) -> Array:
    return np.hstack([z, np.abs(z[:, folds > 0])])


def _landmarks(folded: Array, settings: FeatureSettings) -> Array:
    """Landmarks among the rows (N, E), each drawn with the probability that the earlier ones do not explain it:
    randomly pivoted Cholesky (Chen, Epperly, Tropp and Webber 2024).

    Uniform draws would be mostly where an expert stands still.
    """
    rng = np.random.default_rng(0)
    if len(folded) > settings.max_candidates:
        folded = folded[np.sort(rng.choice(len(folded), settings.max_candidates, replace=False))]
    unexplained = np.ones(len(folded))
    factor = np.zeros((len(folded), min(settings.n_landmarks, len(folded))))
    chosen: list[int] = []
    for k in range(factor.shape[1]):
        pivot = int(rng.choice(len(folded), p=unexplained / unexplained.sum()))
        chosen.append(pivot)
        column = _similarity(folded, folded[pivot : pivot + 1], settings.kernel_width)[:, 0]
        column -= factor[:, :k] @ factor[pivot, :k]
        factor[:, k] = column / np.sqrt(column[pivot])
        unexplained = np.maximum(unexplained - factor[:, k] ** 2, 0.0)
        if unexplained.mean() < settings.landmark_tol:
            break
    return folded[chosen]


def _similarity(folded: Array, landmarks: Array, width: float) -> Array:
    """exp(-gamma |z - z'|^2) of all rows with all landmarks, where gamma is the `width` for each column."""
    squares = [np.einsum("ij,ij->i", rows, rows) for rows in (folded, landmarks)]
    distance = -2 * (folded @ landmarks.T) + squares[0][:, None] + squares[1]
    if folded is landmarks:
        np.fill_diagonal(distance, 0.0)  # but for rounding
    return np.asarray(np.exp(np.maximum(distance, 0.0) * (-width / folded.shape[1])))


def _cut_off(observations: Array, location: Array, spread: Array, bound: float) -> Array:
    """Observations at most `bound` spreads from their location, in their own precision if they are no integers."""
    dtype = observations.dtype if observations.dtype.kind == "f" else np.dtype(float)
    low, high = ((location + sign * bound * spread).astype(dtype) for sign in (-1, 1))
    return np.clip(observations, low, high)


def _location_and_spread(
    columns: Array, weight: Array | None, offsets: Array | None, unit: float = 0.0
) -> tuple[Array, Array]:
    """Mean and standard deviation of each column, or their robust counterparts by demonstrations; the latter is 1 where
    the column is constant up to rounding, which is relative to its location, or to `unit` if that is larger."""
    if offsets is not None:
        location, spread = robust_scale(columns, offsets)
    else:
        location = np.average(columns, axis=0, weights=weight)
        spread = np.sqrt(np.average((columns - location) ** 2, axis=0, weights=weight))
    return location, np.where(spread > 1e-12 * np.maximum(np.abs(location), unit), spread, 1.0)


def ridge_of(features: FeatureMap, C: float | None, total_weight: float, space: Space) -> Float[Array, " F"]:
    """Penalty on each squared coefficient of the design matrix.

    With C, the penalty of scikit-learn's `LogisticRegression` on the unscaled columns; without, a penalty on the scaled
    columns that grows with the number of steps, so that neither units nor the amount of data change its meaning. With
    two actions scikit-learn penalises the difference of the two columns of coefficients once, which is twice the
    penalty on each.
    """
    if C is None:
        return np.append(np.full(len(features.center), features.ridge_per_step * total_weight), 0.0)
    if not C > 0:
        raise DataError(f"C={C!r} must be a positive number.")
    ridge = np.append(1.0 / (C * features.scale**2), 0.0)
    return 2.0 * ridge if isinstance(space, Discrete) and space.n == 2 else ridge
