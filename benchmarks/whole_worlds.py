"""Clean sets of many kinds, and faults that any demonstration of them can be given; see `whole_set`."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from rpil.numerics.types import Array

Episodes = list[tuple[Array, Array]]
"""States (T, S) and actions (T, A); where a world has commands of positions, action i is that of state i."""


def half(name: str) -> str:
    """Which half a world, or kind, belongs to, by its name alone."""
    return ("chosen", "held out")[hashlib.sha256(name.encode()).digest()[-1] % 2]


def eased(n: int) -> Array:
    u = np.linspace(0, 1, n)
    return u**3 * (10 - 15 * u + 6 * u**2)


def through(points: Array, steps: Array) -> Array:
    """A smooth path through points (P, C), with so many steps between them."""
    parts = [p + eased(n)[:, None] * (q - p) for p, q, n in zip(points, points[1:], steps, strict=False)]
    return np.concatenate(parts)


def followed(command: Array, lag: int, gain: float, noise: float, rng: np.random.Generator) -> Array:
    """States that follow commands after `lag` steps, low-passed."""
    late = np.concatenate([command[:1].repeat(lag, 0), command[: len(command) - lag]])
    state, out = late[0], []
    for c in late:
        state = state + gain * (c - state)
        out.append(state)
    return np.array(out) + noise * rng.normal(size=command.shape)


def slow_targets(rng, n):
    """Joints that follow a slow target of their own."""
    middle, made = rng.normal(size=6), []
    for _ in range(n):
        s, phase, S, A = rng.normal(size=6), rng.uniform(0, 6, 6), [], []
        for t in range(200 + rng.integers(-20, 20)):
            a = s + 0.12 * (middle + 0.5 * np.sin(t / 25 + phase) - s) + 0.01 * rng.normal(size=6)
            S.append(s + 0.002 * rng.normal(size=6))
            A.append(a)
            s = 0.85 * a + 0.15 * s
        made.append((np.array(S), np.array(A)))
    return made


def _picks(rng, n, lag, noise, gain=0.7, side=None, tick=0.0, hands=1):
    made = []
    home, top, drop = np.array([0, -90, 80, 60, 0]), np.array([0, -20, 30, 40, 0]), np.array([40, 0, 10, 30, 20])
    for m in range(n):
        target = np.array([-30, 10, 15, 35, -10]) + rng.normal(size=5) * [15, 6, 6, 6, 12]
        via = top + (0 if side is None else side(m) * np.array([50, 0, 0, 0, 30]))
        points = np.array([home, via, target, target, drop + 4 * rng.normal(size=5), home]) + 0.3 * rng.normal(size=5)
        steps = rng.integers([20, 18, 6, 30, 25], [32, 28, 10, 42, 36])
        arm = through(points, steps)
        hand = np.interp(np.arange(len(arm)), np.cumsum([0, *steps]), [5, 40, 45, 12, 12, 5])
        command = np.c_[arm, hand] + 0.15 * rng.normal(size=(len(arm), 6))
        state = followed(command, lag, gain, noise, rng)
        state = np.round(state / tick) * tick if tick else state
        made.append((state, command))
    return made


def picks(rng, n):
    """Pick and place in degrees, by a leader arm."""
    return _picks(rng, n, 2, 0.2)


def ticks(rng, n):
    """The same with encoders of 4,096 steps a turn, and a lag of 4."""
    return _picks(rng, n, 4, 0.0, tick=360 / 4096)


def two_ways(rng, n):
    """Half of them go round the other way, one after the other."""
    return _picks(rng, n, 2, 0.2, side=lambda m: 1 if m < n / 2 else -1)


def two_hands(rng, n):
    """Two arms at once."""
    one, other = _picks(rng, n, 3, 0.1), _picks(rng, n, 3, 0.1)
    return [
        (np.c_[s[: len(u)], u[: len(s)]], np.c_[a[: len(b)], b[: len(a)]])
        for (s, a), (u, b) in zip(one, other, strict=True)
    ]


def teleoperation(rng, n):
    """A leader that wanders, and a follower with an error of a quarter of a degree, 1 to 5 steps later."""
    lag, made = int(rng.integers(1, 6)), []
    for _ in range(n):
        t = np.arange(rng.integers(250, 350))[:, None]
        waves = [rng.uniform(5, 30, 7) * np.sin(t / rng.uniform(15, 60, 7) + rng.uniform(0, 6, 7)) for _ in range(3)]
        leader = sum(waves) + np.linspace(-60, 60, 7)
        made.append((followed(leader, lag, 0.9, 0.25, rng), leader))
    return made


def holds(rng, n):
    """Reaches that stay at the goal until the end, with a small tremor; gravity pulls the arm one degree down."""
    made = []
    for _ in range(n):
        goal, begin = 40 * rng.normal(size=4), 40 * rng.normal(size=4)
        path = np.r_[through(np.array([begin, goal]), [rng.integers(60, 90)]), goal + np.zeros((8, 4))]
        command = path + 0.2 * rng.normal(size=path.shape)
        made.append((followed(command, 1, 0.5, 0.1, rng) - [0, 1, 0, 0], command))
    return made


def next_states(rng, n):
    """Simulated; the action is exactly the next state."""
    made = []
    for _ in range(n):
        t = np.arange(rng.integers(100, 150))[:, None]
        x = np.cumsum(0.05 * rng.normal(size=3)) + np.sin(t / rng.uniform(8, 20, 3) + rng.uniform(0, 6, 3))
        made.append((x[:-1], x[1:]))
    return made


def drives(rng, n):
    """Steering and throttle from speed, offset from the middle, heading and curvature."""
    made = []
    for _ in range(n):
        y, h, v, rows = rng.normal(), 0.1 * rng.normal(), 8.0, []
        for t in range(rng.integers(200, 300)):
            c = 0.3 * np.sin(t / 40 + len(made))
            steer = np.clip(-0.4 * y - 1.2 * h + c + 0.02 * rng.normal(), -1, 1)
            throttle = np.clip(0.5 + 0.2 * (10 - v) + 0.05 * rng.normal(), 0, 1)
            rows.append([v, y, h, c, steer, throttle])
            h, v = h + 0.1 * (steer - c), v + 0.1 * (4 * throttle - 0.2 * v)
            y += 0.1 * v * h
        made.append((np.array(rows)[:, :4], np.array(rows)[:, 4:]))
    return made


def velocities(rng, n):
    """A point in a maze: forces in [-1, 1], positions, speeds and a goal."""
    made = []
    for _ in range(n):
        x, v, goal, rows = rng.uniform(-8, 8, 2), np.zeros(2), rng.uniform(-8, 8, 2), []
        for _ in range(rng.integers(90, 130)):
            a = np.clip(goal - x - 2 * v + 0.1 * rng.normal(size=2), -1, 1)
            rows.append([*x, *v, *goal, *a])
            v = v + 0.2 * a
            x = x + 0.2 * v
        made.append((np.array(rows)[:, :6], np.array(rows)[:, 6:]))
    return made


def deltas(rng, n):
    """Changes of the hand's position, and a gripper of -1 and 1."""
    made = []
    for _ in range(n):
        points = np.array([[0, 0, 0.4], [*rng.uniform(-0.2, 0.2, 2), 0.1], [0.3, 0, 0.2], [0.3, 0, 0.35]])
        steps = rng.integers([25, 25, 12], [40, 40, 18])
        x = through(points, steps) + 0.0003 * rng.normal(size=(steps.sum(), 3))
        closed = (np.arange(len(x)) > steps[0]) & (np.arange(len(x)) < steps[:2].sum())
        width = followed(np.where(closed, 0.03, 0.08)[:, None], 1, 0.3, 0.0002, rng)
        made.append(
            (np.c_[x, width][:-1], np.c_[np.clip(20 * np.diff(x, axis=0), -1, 1), np.where(closed, -1, 1)[:-1]])
        )
    return made


def short_reaches(rng, n):
    """8 to 25 steps towards a goal; actions in [-1, 1]; the hand's position, its speed, and the goal."""
    made = []
    for _ in range(5 * n):
        x, v, goal, rows = 0.3 * rng.normal(size=3), np.zeros(3), 0.3 * rng.normal(size=3), []
        for _ in range(rng.integers(8, 26)):
            a = np.clip(6 * (goal - x) + 0.1 * rng.normal(size=3), -1, 1)
            rows.append([*x, *v, *goal, *a, 0.0])
            v = 0.04 * a
            x = x + v
        made.append((np.array(rows)[:, :9], np.array(rows)[:, 9:]))
    return made


def keys(rng, n):
    """Stop and go by keys, simulated without noise: a step of -1, 0 or 1 in two directions."""
    made = []
    for _ in range(n):
        a = np.repeat(rng.choice([-1.0, 0, 1], (14, 2), p=[0.3, 0.2, 0.5]), rng.integers(4, 14, 14), 0)
        x = rng.normal(size=2) + np.cumsum(np.r_[np.zeros((1, 2)), 0.1 * a[:-1]], 0)
        made.append((x, a))
    return made


def jerks(rng, n):
    """Fast waypoints with a hold at each, and a hand that snaps."""
    made = []
    for _ in range(n):
        points = rng.uniform(-1, 1, (9, 4))
        command = np.repeat(points, rng.integers(8, 22, 9), 0) + 0.003 * rng.normal(size=(1, 4))
        made.append((followed(command, 1, 0.35, 0.002, rng), command))
    return made


def three_tasks(rng, n):
    """Three tasks at three places, one after the other."""
    made = []
    for m in range(n):
        place = np.array([[40, 0, 20], [-30, 30, 10], [0, 60, -20]][3 * m // n]) + 4 * rng.normal(size=3)
        path = through(np.array([[0, -50, 40], place, [0, -50, 40]]), rng.integers(50, 70, 2))
        hand = np.repeat([1.0, -1.0], [len(path) // 2, len(path) - len(path) // 2])
        command = np.c_[path, hand] + np.r_[0.2, 0.2, 0.2, 0] * rng.normal(size=(len(path), 4))
        made.append(
            (np.c_[followed(command[:, :3], 2, 0.7, 0.1, rng), followed(command[:, 3:], 2, 0.3, 0.01, rng)], command)
        )
    return made


def scaled(rng, n):
    """Pick and place whose actions are the commands divided by 60."""
    return [(s, a / 60) for s, a in _picks(rng, n, 2, 0.2)]


def wheels(rng, n):
    """Two wheels are given speeds towards a point; position, heading as sine and cosine, and their speeds."""
    made = []
    for _ in range(n):
        x, heading, speed, goal, rows = rng.normal(size=2), rng.uniform(-3, 3), np.zeros(2), 4 * rng.normal(size=2), []
        for _ in range(rng.integers(100, 220)):
            to = goal - x
            off = (np.arctan2(to[1], to[0]) - heading + np.pi) % (2 * np.pi) - np.pi
            a = (
                min(1, np.hypot(*to))
                + 0.3 * np.clip(2 * off, -1.5, 1.5) * np.array([-1, 1])
                + 0.03 * rng.normal(size=2)
            )
            rows.append([*x, np.cos(heading), np.sin(heading), *speed, *to, *a])
            speed = speed + 0.5 * (a - speed)
            heading += 0.1 * (speed[1] - speed[0]) / 0.6
            x = x + 0.1 * speed.mean() * np.array([np.cos(heading), np.sin(heading)])
        made.append((np.array(rows)[:, :8], np.array(rows)[:, 8:]))
    return made


def gaits(rng, n):
    """Twelve joints of legs in a rhythm of their own, and their speeds."""
    made, phase = [], np.arange(12) % 4 * np.pi / 2
    for _ in range(n):
        t = np.arange(rng.integers(250, 400))[:, None]
        a = 0.3 * np.sin(0.25 * rng.uniform(0.8, 1.2) * t + rng.uniform(0, 6) + phase) + 0.02 * rng.normal(
            size=(len(t), 12)
        )
        s = followed(a, 1, 0.5, 0.005, rng)
        made.append((np.c_[s, 50 * np.gradient(s, axis=0)], a))
    return made


def dead_zones(rng, n):
    """Speeds by a stick that is exactly 0 near its middle."""
    made = []
    for _ in range(n):
        t = np.arange(rng.integers(200, 320))[:, None]
        stick = sum(
            rng.uniform(0.2, 0.6, 4) * np.sin(t / rng.uniform(10, 40, 4) + rng.uniform(0, 6, 4)) for _ in range(2)
        )
        a = np.where(np.abs(stick) < 0.15, 0, np.clip(stick - 0.15 * np.sign(stick), -1, 1))
        x = 0.1 * rng.normal(size=4) + np.cumsum(np.r_[np.zeros((1, 4)), 0.02 * a[:-1]], 0)
        made.append((x + 0.0005 * rng.normal(size=x.shape), a))
    return made


def operators(rng, n):
    """Three people, one after the other: one slower, one with another bend, all with hands that tremble differently."""
    made = []
    for m in range(n):
        k = 3 * m // n
        points = np.array([[0, -90, 80, 60], [-30, 10, 15, 35], [40, 0, 10, 30], [0, -90, 80, 60]])
        points = points + [[1], [8], [5], [1]] * rng.normal(size=(4, 4))
        path = through(points, (rng.integers(40, 60, 3) * (1, 1.3, 0.75)[k]).astype(int))
        bend = np.sin(np.pi * np.linspace(0, 1, len(path)))[:, None] * np.array([0, 8, -5, 4]) * (0, 1, -1)[k]
        command = path + bend + (0.2, 0.4, 0.1)[k] * rng.normal(size=path.shape)
        made.append((followed(command, 2, 0.7, 0.1, rng), command))
    return made


WORLDS: dict[str, Callable[[np.random.Generator, int], Episodes]] = {
    f.__name__: f
    for f in (
        *(slow_targets, picks, ticks, two_ways, two_hands, teleoperation, holds, next_states, drives, velocities),
        *(deltas, short_reaches, keys, jerks, three_tasks, scaled, wheels, gaits, dead_zones, operators),
    )
}


def place(s: Array, rng: np.random.Generator) -> int:
    return int(rng.integers(len(s) // 4, len(s) // 2))


def commands(s: Array, a: Array) -> bool:
    """Whether actions are commands of the first states, in their unit."""
    k = min(s.shape[1], a.shape[1])
    if len(s) < 50 or k < 3:
        return False
    near = [np.corrcoef(s[:, c], a[:, c])[0, 1] > 0.7 and a[:, c].std() > 0.2 * s[:, c].std() for c in range(k)]
    return bool(np.mean(near) >= 0.5)


def stuck(s, a, rng):
    t, c = place(s, rng), int(rng.integers(s.shape[1]))
    s[t : t + len(s) // 3, c] = s[t, c]
    return (s, a)


def all_frozen(s, a, rng):
    t = 16 if len(s) > 40 else 4
    s[t:] = s[t]
    return (s, a)


def spike(s, a, rng):
    t, c = place(s, rng), int(rng.integers(3))
    s[t, c] += 4 * s[:, c].std() + 10 * np.abs(np.diff(s[:, c])).max()
    return (s, a)


def repeated_rows(s, a, rng):
    t = place(s, rng)
    return tuple(np.r_[v[:t], np.repeat(v[t : t + 1], 25, 0), v[t:]] for v in (s, a))


def dropped_rows(s, a, rng):
    t = place(s, rng)
    return tuple(np.delete(v, slice(t, t + 15), 0) for v in (s, a))


def late_actions(s, a, rng):
    return (s, np.r_[a[:1].repeat(7, 0), a[:-7]])


def idle_tail(s, a, rng):
    n, noise = len(s) // 3, np.abs(np.diff(s, n=3, axis=0))
    rest = s[-1:].repeat(n, 0) + np.median(noise, 0) / 3 * rng.normal(size=(n, s.shape[1]))
    return (np.r_[s, rest], np.r_[a, a[-1:].repeat(n, 0)])


def idle_head(s, a, rng):
    n, noise = len(s) // 4, np.abs(np.diff(s, n=3, axis=0))
    rest = s[:1].repeat(n, 0) + np.median(noise, 0) / 3 * rng.normal(size=(n, s.shape[1]))
    return (np.r_[rest, s], np.r_[a[:1].repeat(n, 0), a])


def pause(s, a, rng):
    n, t, noise = len(s) // 3, place(s, rng), np.abs(np.diff(s, n=3, axis=0))
    rest = s[t : t + 1].repeat(n, 0) + np.median(noise, 0) / 3 * rng.normal(size=(n, s.shape[1]))
    return (np.r_[s[:t], rest, s[t:]], np.r_[a[:t], a[t : t + 1].repeat(n, 0), a[t:]])


def swapped_actions(s, a, rng):
    a[:, [0, 1]] = a[:, [1, 0]]
    return (s, a)


def swapped_states(s, a, rng):
    s[:, [1, 2]] = s[:, [2, 1]]
    return (s, a)


def swapped_both(s, a, rng):
    s[:, [1, 2]], a[:, [1, 2]] = s[:, [2, 1]], a[:, [2, 1]]
    return (s, a)


def offset_state(s, a, rng):
    s[:, 2] += 1.5 * np.std(s[:, 2])
    return (s, a)


def offset_action(s, a, rng):
    a[:, 1] -= 1.5 * np.std(a[:, 1])
    return (s, a)


def turned_action(s, a, rng):
    a[:, 1] *= -1
    return (s, a)


def turned_state(s, a, rng):
    s[:, 0] *= -1
    return (s, a)


def radians(s, a, rng):
    s[:, 1] /= 57.29578
    return (s, a)


def action_is_state(s, a, rng):
    k = min(s.shape[1], a.shape[1])
    a[:, :k] = s[:, :k]
    return (s, a)


def wraps(s, a, rng):
    k = 1
    unit = 360 if np.abs(s[:, k]).max() > 10 else 2 * np.pi
    for v in (s, a):
        v[:, k] = (v[:, k] - np.median(s[:, k]) + unit) % unit - unit / 2
    return (s, a)


def constant_action(s, a, rng):
    a[:, -1] = 12.5
    return s, a


def zeros(s, a, rng):
    s[:, :2] = a[:, :2] = 0
    return (s, a)


def moved_both(s, a, rng):
    """State and action of a joint, together."""
    off = 60 if np.abs(s[:, 1]).max() > 10 else 3
    s[:, 1] += off
    a[:, 1] += off
    return s, a


def radians_both(s, a, rng):
    return s / 57.29578, a / 57.29578


def stopped_action(s, a, rng):
    """One action stays from a step on while its state goes on."""
    a[len(a) // 3 :, 1] = a[len(a) // 3, 1]
    return s, a


def other_range(s, a, rng):
    """What is in [-1, 1], and touches it, is stretched."""
    if not (np.abs(a).max() == 1 and np.abs(a[:, 0]).max() == 1):
        return None
    return s, 2.5 * a


def other_hand(s, a, rng):
    """A hand with the values 0 and 2."""
    if set(np.unique(a[:, -1])) != {-1.0, 1.0}:
        return None
    a[:, -1] += 1
    return s, a


KINDS = {
    f.__name__: f
    for f in (
        *(stuck, all_frozen, spike, repeated_rows, dropped_rows, late_actions, idle_tail, idle_head, pause),
        *(swapped_actions, swapped_states, swapped_both, offset_state, offset_action, turned_action, turned_state),
        *(radians, action_is_state, wraps, constant_action, zeros, other_range, other_hand),
        *(moved_both, radians_both, stopped_action),
    )
}

ANYWHERE = ("constant_action", "other_range", "other_hand")
"""Kinds that need no commands of positions."""
