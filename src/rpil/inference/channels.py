"""Channels: numbers that describe a demonstration, from which answers learn (`rpil.inference.answers`).

The first is agreement, the log-odds by which demonstrations are ranked without answers. The others are facts: they say
nothing about quality until an answer does. Facts beyond motion are `components`.
"""

from __future__ import annotations

from functools import reduce
from itertools import pairwise

import numpy as np
from scipy.linalg import eigh
from scipy.special import ndtri

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.settings import ChannelSettings
from rpil.numerics.regression import ErrorSettings, mean_ranks, medians, student_log_densities
from rpil.numerics.types import Array, Float

CHANNELS = (
    "agreement",
    "gain",
    "length",
    "smoothness",
    "short path",
)
"""Names of the channels; of each, more is more of what the name says. The gain is that over all actions."""

BLOCK_ROWS, BLOCK_COLUMNS = 4_096, 4
"""Steps whose moves are computed together, and columns that are summarised together."""


def spread_of(data: FitData) -> Float[Array, " F"]:
    """Standard deviation of the features, 1 where it is 0: the unit of a move."""
    # Column by column, so that no copy in double precision is made.
    spread = np.array([column.std(dtype=float) for column in data.features.T])
    return np.where(spread > 0, spread, 1.0)


def channels(
    data: FitData, log_ratio: Float[Array, " N"], actions: Float[Array, "N A"], spread: Float[Array, " F"]
) -> Float[Array, "M C"]:
    """The channels of M demonstrations after agreement, in the order of `CHANNELS`.

    `log_ratio` is log pi - log q of each step; `actions` are scaled, or indicators of discrete actions; `spread` is
    that of the features (`spread_of`).
    """
    inside = np.ones(len(actions), dtype=bool)
    inside[data.offsets[1:] - 1] = False  # the last step of a demonstration moves nowhere
    changes = np.append(np.abs(np.diff(actions, axis=0)).sum(axis=1), 0.0) * inside
    columns = [
        data.mean_steps(log_ratio),
        np.log(data.lengths),
        -data.sum_steps(changes) / np.maximum(data.lengths - 1, 1),
        -data.sum_steps(_moves(data.features, spread) * inside),
    ]
    return np.stack(columns, axis=1)


def columns_of(
    log_odds: Float[Array, " M"], others: Float[Array, "M C"], seen: Float[Array, "M K"], score: Float[Array, " M"]
) -> Float[Array, "M D"]:
    """The columns from which answers learn: the ranking, spaced as the scores are; normal scores of the other channels;
    components `seen`; and the log-odds of the upper group. `arcsinh` draws large values nearer, and keeps their order.
    """
    return np.column_stack([spaced(log_odds, score), normal_scores(others), seen, np.arcsinh(log_odds)])


def spaced(ranking: Float[Array, " M"], score: Float[Array, " M"]) -> Float[Array, " M"]:
    """Arcsinh of the scores, sorted as the `ranking` is, from their median, in median absolute deviations times 1.48;
    these count as a tenth of the standard deviation at least, because half of the scores may be nearly the same."""
    away = np.sort(score) - np.median(score)
    size = max(1.4826 * np.median(np.abs(away)), 0.1 * away.std()) or 1.0
    return np.asarray(np.interp(mean_ranks(ranking), np.arange(1, len(away) + 1), np.arcsinh(away / size)))


def components(summaries: Float[Array, "M S"], settings: ChannelSettings) -> Float[Array, "M K"]:
    """The first principal components of the normal scores of summaries of M demonstrations, in standard deviations of
    the first one; the largest loading of each is positive. The summaries are overwritten: of large data they are large.
    """
    scores = normal_scores(summaries, out=summaries)
    n = min(settings.n_components, min(scores.shape) - 1)
    if n < 1 or not scores.any():
        return np.empty((len(scores), 0))
    # By the smaller of the two matrices of products, in blocks in double precision: the same bits in every run.
    is_tall = len(scores) >= scores.shape[1]
    longer = scores if is_tall else scores.T
    parts = [longer[begin : begin + BLOCK_ROWS] for begin in range(0, len(longer), BLOCK_ROWS)]
    products = reduce(np.add, (part.T.astype(float) @ part for part in parts))
    values, vectors = eigh(products, subset_by_index=(len(products) - n, len(products) - 1))
    size, others = np.sqrt(np.maximum(values, 0.0)), np.concatenate([part @ vectors for part in parts])
    scaled, loadings = (others, vectors) if is_tall else (vectors * size, others)
    kept = np.flatnonzero(size > 1e-6 * size[-1])[::-1]
    largest = np.take_along_axis(loadings, np.abs(loadings).argmax(axis=0)[None], axis=0)[0]
    return np.asarray((scaled * np.sign(largest))[:, kept] * np.sqrt(len(scores)) / size[-1])


def summaries(data: FitData, actions: Float[Array, "N A"]) -> Float[Array, "M S"]:
    """Mean, deviation, first, last and mean change of every column of states and actions within each demonstration."""
    parts, firsts = list[Array](), np.flatnonzero(np.diff(data.offsets[:-1] // BLOCK_ROWS, prepend=-1)).tolist()
    places = [(each, n) for each in (data.features, actions) for n in range(0, each.shape[1], BLOCK_COLUMNS)]
    for m, n in pairwise([*firsts, data.n_demonstrations]):  # of whole demonstrations, so few that they stay in cache
        steps, offsets, columns = slice(*data.offsets[[m, n]]), data.offsets[m : n + 1] - data.offsets[m], list[Array]()
        begins, ends, lengths = offsets[:-1], offsets[1:] - 1, np.diff(offsets)
        for values, begin in places:
            block = np.array(values[steps, begin : begin + BLOCK_COLUMNS].T, dtype=float, order="C")  # summed fast
            mean, changes = np.add.reduceat(block, begins, axis=1) / lengths, np.empty_like(block)
            np.abs(np.subtract(block[:, 1:], block[:, :-1], out=changes[:, :-1]), out=changes[:, :-1])
            changes[:, ends] = 0.0
            first, last, change = block[:, begins], block[:, ends], np.add.reduceat(changes, begins, axis=1)
            block -= np.repeat(mean, lengths, axis=1)
            spread = np.sqrt(np.add.reduceat(np.square(block, out=block), begins, axis=1) / lengths)
            columns += [mean, spread, first, last, change / np.maximum(lengths - 1, 1)]
        parts.append(np.concatenate(columns))
    return np.concatenate(parts, axis=1).T


def normal_scores(values: Float[Array, "M C"], out: Float[Array, "M C"] | None = None) -> Float[Array, "M C"]:
    """For each column the normal quantiles of the ranks; ties have the same, and a constant column is 0."""
    out = np.empty(values.shape) if out is None else out
    for column, scores in zip(values.T, out.T, strict=True):
        scores[:] = ndtri((mean_ranks(column) - 0.5) / len(values))
    return out


def _moves(features: Array, spread: Array) -> Array:
    """Distance of each step to the next, in standard deviations."""
    moves = np.zeros(len(features))
    for begin in range(0, len(features) - 1, BLOCK_ROWS):  # because a design matrix may be large
        steps = np.diff(features[begin : begin + BLOCK_ROWS + 1], axis=0) / spread
        moves[begin : begin + len(steps)] = np.sqrt(np.einsum("nf,nf->n", steps, steps))
    return moves


def own_log_prob(data: FitData, actions: Float[Array, "N A"], errors: ErrorSettings) -> Float[Array, " M"]:
    """Mean log-probability of the actions of each demonstration under its own distribution, whatever the state."""
    if isinstance(data.space, Discrete):
        counts = data.sum_steps(actions)
        shares = (counts + 1.0) / (counts + 1.0).sum(axis=1, keepdims=True)
        return np.asarray((counts * np.log(shares)).sum(axis=1) / data.lengths)
    own = np.empty(data.n_demonstrations)
    for length in np.unique(data.lengths):  # together, because many calls for few steps each take longest
        members = np.flatnonzero(data.lengths == length)
        parts = actions[data.offsets[members][:, None] + np.arange(length)].transpose(0, 2, 1)
        away = parts - medians(parts)[..., None]
        scale = 1.35 * medians(np.abs(away)) + errors.min_scale
        own[members] = student_log_densities(away, scale[..., None], errors).sum(axis=(1, 2)) / length
    return own
