"""Arms with planted idle rows: an operator stalls in the middle of what they do, and goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.demonstrations import Demonstrations

N_SETS, N_EPISODES = 30, 12
SLOW = 1.0
"""Degrees a second of the fastest joint: whether slower rows are idle is not clear, but while a gripper closes."""


@dataclass(frozen=True)
class World:
    """A set, the rows that were planted, in which nothing moves, and others in which hardly anything moves."""

    data: Demonstrations
    idle: np.ndarray
    unclear: np.ndarray


def world(seed: int, plants: bool = True) -> World:
    """One of `N_SETS` sets: rates of 10 to 60 Hz, noise of 0 to .15 degrees, delta or absolute actions, a gripper or
    none. Some motions are slow; a gripper that closes makes the arm wait."""
    rng = np.random.default_rng([51, seed])
    fps, noise = int(rng.choice([10, 15, 20, 30, 50, 60])), float(rng.choice([0.0, 0.02, 0.05, 0.1, 0.15]))
    if seed == 0:
        fps, noise = 60, 0.15
    has_gripper, is_delta, joints = bool(seed % 2), bool(seed // 2 % 2), int(rng.integers(4, 8))
    hand = 0.0 if seed % 3 else 0.05  # degrees of noise of a leader arm
    lag, records_gripper = int(rng.integers(1, 4)), bool(seed % 4 == 1)
    places = rng.uniform(-60, 60, (5, joints))
    episodes, idle, unclear = [], [], []
    for _ in range(N_EPISODES):
        plan, closes = _plan(rng, places + rng.normal(0, 3, places.shape), fps, has_gripper)
        clock = np.arange(len(plan), dtype=float)
        if plants:
            at = int(rng.integers(fps // 2, len(plan) - 8))
            while closes[max(at - fps, 0) : at + fps].any():  # nobody stalls while the gripper closes
                at = int(rng.integers(fps // 2, len(plan) - 8))
            clock = np.insert(clock, at, np.full(int(rng.integers(7, 61)) + lag, at - 1.0))
        row = clock.astype(int)
        late = np.maximum(np.arange(len(row)) - lag, 0)
        target, follower = plan[row], plan[row[late]]
        command = target + hand * rng.normal(size=target.shape)
        stalls = np.append(False, row[1:] == row[:-1])
        rests = np.append(False, row[late][1:] == row[late][:-1])
        rests[: lag + 1] = False
        idle.append(stalls & rests)
        speed = np.abs(np.diff(follower, axis=0, prepend=follower[:1])).max(axis=1) * fps
        waits = np.convolve(closes[row] & ~stalls, np.ones(fps // 2))[: len(row)] > 0
        unclear.append(~idle[-1] & (speed < SLOW) & ~waits)
        state = follower + noise * rng.normal(size=follower.shape)
        action = np.diff(command, axis=0, prepend=command[:1]) if is_delta else command
        if has_gripper:
            closed = np.cumsum(closes)[row] % 2
            action = np.column_stack([action, closed])
            if records_gripper:
                width = np.convolve(closed, np.full(fps // 3, 1 / (fps // 3)))[: len(closed)]
                state = np.column_stack([state, 80 * (1 - width) + 0.05 * rng.normal(size=len(width))])
        episodes.append((state, action))
    return World(Demonstrations.from_episodes(episodes), np.concatenate(idle), np.concatenate(unclear))


def _plan(rng, places, fps, has_gripper):
    """Positions of the arm, and the rows in which the gripper changes; it waits there for .4 s or so."""
    rows, closes, here = [places[:1]], [False], places[0]
    for k, place in enumerate(places[1:], 1):
        is_slow = k == 2  # 3 to 6 degrees a second, as one inserts a peg
        place = here + (place - here) / np.abs(place - here).max() * 5.0 if is_slow else place
        seconds = rng.uniform(0.8, 1.5) if is_slow else rng.uniform(1.0, 2.5)
        share = np.linspace(0, 1, max(int(seconds * fps), 5) + 1)[1:, None]
        smooth = share if is_slow else share**3 * (10 - 15 * share + 6 * share**2)
        rows.append(here + smooth * (place - here))
        closes += [False] * len(share)
        here = place
        if has_gripper and k in (2, 4):
            wait = int(fps * rng.uniform(0.3, 0.5))
            rows.append(np.repeat(here[None], wait, axis=0))
            closes += [True] + [False] * (wait - 1)
    return np.concatenate(rows), np.array(closes)
