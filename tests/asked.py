"""Demonstrations about which questions are asked."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import rpil
from rpil.data.id_values import parse_answers, read_answer_rows

N_STEPS, BAD, MANY = 40, {3, 5, 8, 9}, 12


def write(name, n=24, ids=None, bad=BAD, seed=1, **columns):
    """Demonstrations of a controller at 10 steps a second, but for the `bad` ones, which act at random; they are called
    `ids`, by default 0 to n - 1."""
    rng = np.random.default_rng(seed)
    owner = np.repeat(np.arange(n), N_STEPS)
    x, v = rng.normal(size=(2, len(owner)))
    action = np.where(np.isin(owner, list(bad)), rng.uniform(-1, 1, len(x)), np.tanh(2 * x - v))
    columns = {"timestamp": np.tile(np.arange(N_STEPS) * 0.1, n), **columns}
    named = owner if ids is None else np.array(ids)[owner]
    table = {"episode_index": named, "x": x, "v": v, "action": action + 0.1 * rng.normal(size=len(x)), **columns}
    pq.write_table(pa.table(table), name)
    return str(name)


def read_answers(path):
    """Labels and pairs of a file of answers."""
    return parse_answers(read_answer_rows(path), Path(path).name)


def with_jumps(name, faulty, n=MANY):
    """Demonstrations that all follow one policy; a column of the `faulty` ones leaps once by far."""
    rng = np.random.default_rng(0)
    states = np.cumsum(rng.normal(0, 0.05, (n, 80, 2)), axis=1)
    actions = states @ [1.0, -0.5] + rng.normal(0, 0.02, (n, 80))
    states[sorted(faulty), 40:, 0] += 20
    steps = states.reshape(-1, 2), actions.reshape(-1, 1), np.repeat(range(n), 80)
    rpil.write(name, rpil.Demonstrations.from_groups(*steps))
    return name
