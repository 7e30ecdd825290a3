"""Cubic B-splines of all columns at once, linear beyond their knots.

De Boor's recursion runs on blocks of observations, with the operations in the order that SciPy has them for one number,
so that the bits are the same. A policy at play is asked for a handful of rows at a time, where calls are what costs.
"""

from __future__ import annotations

import numpy as np

from rpil.passes import Array

_DEGREE = 3
_FOUR = np.arange(_DEGREE + 1)[:, None, None]
_BLOCK_ROWS = 1024
"""Observations in a block: its temporaries stay in cache."""


class CubicSplines:
    """The basis of cubic splines on even `knots` (Q, D): Q + 2 functions of each column.

    Beyond the outer knots every function follows its tangent there, so that a state far from the data keeps the trend
    and cannot explode. Source: Eilers & Marx 1996, "Flexible smoothing with B-splines and penalties", where
    outer knots are not repeated but go on at the same distance, as in scikit-learn's `SplineTransformer`.
    """

    def __init__(self, knots: Array) -> None:
        first, last = knots[1] - knots[0], knots[-1] - knots[-2]
        lower = np.linspace(knots[0] - _DEGREE * first, knots[0] - first, num=_DEGREE)
        upper = np.linspace(knots[-1] + last, knots[-1] + _DEGREE * last, num=_DEGREE)
        every = np.concatenate([lower, knots, upper])
        n_intervals = len(knots) - 1
        # What each interval needs, (.., Q - 1, D): three knots to its left and three to its right; the widths that the
        # recursion divides by; the slopes of its four functions, where it is an outer one.
        near = np.stack([every[k : k + n_intervals] for k in range(1, 2 * _DEGREE + 1)])
        widths = np.concatenate([near[_DEGREE : _DEGREE + j] - near[_DEGREE - j : _DEGREE] for j in (1, 2, 3)])
        widths[widths == 0.0] = np.inf  # an interval too narrow for the precision holds no observation
        self._table = np.concatenate([near, widths, np.zeros((_DEGREE + 1, *knots[1:].shape))])
        for interval, end in ((0, knots[0]), (-1, knots[-1])):
            self._table[-_DEGREE - 1 :, interval] = _slopes(end, self._table[:, interval])
        self._low, self._high, self._inner = knots[0], knots[-1], knots[1:-1, None]
        self._columns = np.arange(knots.shape[1])
        self._n_functions = n_intervals + _DEGREE

    def design(self, observations: Array) -> Array:
        """Every function at observations (N, D), the functions of a column side by side, (N, D (Q + 2))."""
        n_rows, n_columns = observations.shape
        out = np.zeros((n_rows, n_columns * self._n_functions))
        for start in range(0, n_rows, _BLOCK_ROWS):
            rows = observations[start : start + _BLOCK_ROWS]
            inside = np.minimum(np.maximum(rows, self._low), self._high)
            interval = (inside >= self._inner).sum(axis=0)
            table = self._table[:, interval, self._columns]
            value = _functions(inside, table)
            value += (rows - inside) * table[-_DEGREE - 1 :]
            first = interval + np.arange(rows.size).reshape(rows.shape) * self._n_functions
            out[start : start + _BLOCK_ROWS].reshape(-1)[first + _FOUR] = value
        return out


def _functions(x: Array, table: Array, degree: int = _DEGREE) -> Array:
    """The functions of a degree that are not zero at `x` (..., D), (degree + 1, ..., D)."""
    left, right = x - table[:_DEGREE], table[_DEGREE : 2 * _DEGREE] - x
    widths = table[2 * _DEGREE :]
    value = np.ones((1, *x.shape))
    for j in range(1, degree + 1):
        share, widths = value / widths[:j], widths[j:]
        value = np.zeros((j + 1, *x.shape))
        np.multiply(share, left[-j:], out=value[1:])
        value[:-1] += share * right[:j]
    return value


def _slopes(x: Array, table: Array) -> Array:
    """The slopes of the four functions at `x` (D,), (4, D)."""
    steepness = _DEGREE * _functions(x, table, _DEGREE - 1) / table[-2 * _DEGREE - 1 : -_DEGREE - 1]
    slopes = np.zeros((_DEGREE + 1, *x.shape))
    slopes[1:] = steepness
    slopes[:-1] -= steepness
    return slopes
