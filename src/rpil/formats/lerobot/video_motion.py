"""Whether a picture moves when the joints do: a video that is late, or that of another episode.

The change of each block of the picture predicts how fast each joint moves, by a ridge regression on the other episodes.
In an episode that is right, prediction and speed agree best at the lag that is usual in the camera.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping

import numpy as np
from scipy.ndimage import uniform_filter1d

from rpil.formats.format import Defect
from rpil.numerics.types import Array

BLOCKS = 8  # of the picture, in each direction
RATE = 15.0  # times a second at which motion is kept, at least: it is that of one, two or more frames
SMOOTH, SLOW = 0.2, 1.2  # seconds: faster changes of the motion are noise, slower ones are alike in all episodes
LAG, NEAR = 2.0, 0.15  # seconds: the longest lag that is tried, and what is near the usual one
LEAST_SPEED = 0.1  # of a joint, in its standard deviations, below which it is at rest
LEAST_MOVING = 6  # episodes, to know what is usual
KNOWN_SHARE = 0.7  # of them, whose own joints must agree best with the picture: else it does not show which they are
NEIGHBOURS = 100  # episodes, from which a video may be
LOW, CLEAR = 0.5, 0.7
"""Shares of the usual agreement: where it is below the first at the usual lag, another lag or episode is named that has
the second, and more than any wrong one has in the episodes that are right."""


def frames_a_step(fps: float) -> int:
    """Frames over which a step of motion goes."""
    return max(1, int(fps / RATE))


def changes(pictures: Array, fps: float) -> Array:
    """How much each block changes from frame to frame, of pictures (F, R, C), by steps of motion, (T, BLOCKS²)."""
    change = np.abs(np.diff(pictures.astype(np.float32), axis=0))
    for axis in (1, 2):
        edges = np.arange(BLOCKS) * change.shape[axis] // BLOCKS
        change = np.add.reduceat(change, edges, axis=axis) * (BLOCKS / change.shape[axis])
    return np.log1p(_by_step(change.reshape(len(change), -1), fps))


def speeds(states: Mapping[int, Array], fps: float) -> dict[int, Array]:
    """How fast each of the D joints moves, by steps of motion, (T, D), of states (N, D) of episodes without NaN."""
    moves = {m: np.abs(np.diff(state, axis=0)) for m, state in states.items() if np.isfinite(state).all()}
    if not moves:
        return {}
    scale = np.sqrt(np.mean(np.concatenate([*moves.values()]) ** 2, axis=0))
    return {m: np.log(LEAST_SPEED + _by_step(move[:, scale > 0] / scale[scale > 0], fps)) for m, move in moves.items()}


def _by_step(values: Array, fps: float) -> Array:
    """Means of values of frames, (F, K), over each step of motion, (T, K)."""
    size = frames_a_step(fps)
    n = len(values) // size
    means: Array = values[: n * size].reshape(n, size, values.shape[1]).mean(axis=1)
    return means


def find_late_or_other(
    camera: str, changes: Mapping[int, Array], speeds: Mapping[int, Array], fps: float
) -> Iterator[Defect]:
    """Episodes whose picture moves with the joints at an unusual time, or with those of another episode.

    An episode is right where the picture agrees more with its own joints than with those of any other. A `UserWarning`
    says where most are not, so that nothing can be known.
    """
    rate = fps / frames_a_step(fps)
    most, near, far = (round(seconds * rate) for seconds in (LAG, NEAR, 2 * SMOOTH))
    seen = {m: one for m, one in changes.items() if m in speeds and min(len(one), len(speeds[m])) > 2 * most}
    if len(seen) < LEAST_MOVING:
        return
    joints = _alike({m: speeds[m] for m in seen}, rate)
    predicted, lags = _predictions(_alike(seen, rate), joints), np.arange(-most, most + 1)
    curves = {m: _agreement(predicted[m], joints[m], range(-most, most + 1)) for m in seen}
    usual = round(np.median([lags[np.argmax(curve)] for curve in curves.values()]))
    around = range(max(usual - near, -most), min(usual + near, most) + 1)
    own = {m: curve[np.isin(lags, around)].max() for m, curve in curves.items()}
    shifted = {m: np.where(abs(lags - usual) >= far, curve, -1.0) for m, curve in curves.items()}
    others = {m: _best_other(m, predicted[m], joints, around) for m in seen}
    low, clear = LOW * np.median([*own.values()]), CLEAR * np.median([*own.values()])
    right = [m for m in seen if own[m] > max(low, others[m][0])]
    if len(right) < KNOWN_SHARE * len(seen):
        why = "its picture does not show clearly how the joints move"
        warnings.warn(f"{camera}: {why}, so whether a video is late or of another episode is unknown.", stacklevel=1)
        return
    least_shifted = max(clear, *(shifted[m].max() for m in right))
    least_other = max(clear, *(others[m][0] for m in right))
    for m in [m for m in seen if own[m] < low]:
        agreement, other = others[m]
        if shifted[m].max() > max(least_shifted, agreement):
            lag = lags[np.argmax(shifted[m])] - usual
            said = f"{camera} moves {abs(lag) / rate:.2f} s {'after' if lag > 0 else 'before'} the joints"
            yield Defect("video time", str(m), f"{said}; perhaps its frames are shifted")
        elif agreement > least_other:
            said = f"{camera} moves as the joints of episode {other}; perhaps it is of that episode"
            yield Defect("other video", str(m), said)


def _best_other(m: int, predicted: Array, joints: Mapping[int, Array], around: range) -> tuple[float, int]:
    """The most that the picture of episode m agrees with the joints of another one, and which that is."""
    near = sorted((n for n in joints if n != m), key=lambda n: abs(n - m))[:NEIGHBOURS]
    return max((float(_agreement(predicted, joints[n], around).max()), n) for n in near)


def _alike(values: Mapping[int, Array], rate: float) -> dict[int, Array]:
    """Motion without what is fast or slow, each column in units of its root mean square over all episodes."""
    fast, slow = (max(1, round(seconds * rate)) for seconds in (SMOOTH, SLOW))
    found = {m: uniform_filter1d(one, fast, axis=0) - uniform_filter1d(one, slow, axis=0) for m, one in values.items()}
    scale = np.sqrt(np.mean([np.mean(one**2, axis=0) for one in found.values()], axis=0))
    return {m: one / np.where(scale > 0, scale, 1.0) for m, one in found.items()}


def _predictions(changes: Mapping[int, Array], speeds: Mapping[int, Array]) -> dict[int, Array]:
    """The speeds of the joints of each episode by the picture, from a regression on all the others."""
    lengths = {m: min(len(one), len(speeds[m])) for m, one in changes.items()}
    gram = {m: changes[m][:n].T @ changes[m][:n] for m, n in lengths.items()}
    cross = {m: changes[m][:n].T @ speeds[m][:n] for m, n in lengths.items()}
    all_gram, all_cross = sum(gram.values()), sum(cross.values())
    found = {}
    for m, one in changes.items():
        rest = all_gram - gram[m]
        ridge = np.trace(rest) / len(rest) + np.finfo(np.float32).tiny
        found[m] = one @ np.linalg.solve(rest + ridge * np.eye(len(rest)), all_cross - cross[m])
    return found


def _agreement(one: Array, other: Array, lags: range) -> Array:
    """Correlations of two motions, (T, D), where the first is that many steps later, (L,)."""
    n = min(len(one), len(other))
    found = []
    for lag in lags:
        a, b = one[max(lag, 0) : n + min(lag, 0)], other[max(-lag, 0) : n - max(lag, 0)]
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        found.append(np.sum(a * b) / max(np.linalg.norm(a) * np.linalg.norm(b), np.finfo(np.float32).tiny))
    return np.array(found)
