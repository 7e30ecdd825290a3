"""Good and bad demonstrations of an environment, made from one seed."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.numerics.types import Array
from rpil.simulation.corruptions import CORRUPTIONS, KINDS, RANDOM
from rpil.simulation.environments import actions_of, make
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import RandomPolicy, record


@dataclass(frozen=True, eq=False)
class Simulation:
    """M simulated demonstrations, good and bad in random order."""

    episodes: list[tuple[Array, Array]]
    """Observations (n, D) and actions, (n,) or (n, A), of each."""
    is_good: NDArray[np.int64]
    """1 for the expert's own demonstrations, 0 for the bad ones, (M,)."""
    returns: NDArray[np.float64]
    """Undiscounted return of the episode as it was played, (M,): of the expert for all kinds but "random"."""


def simulate(env_id: str, kind: str, *, n_good: int, n_bad: int, seed: int) -> Simulation:
    """Record the closed-form expert of an environment, and corrupt some of the demonstrations.

    The good episodes depend on neither `kind` nor `n_bad`, and for every kind but "random" the same episodes are
    corrupted: results for two kinds with one seed differ by the kind alone. Good and bad are in random order, because
    data in order of quality would answer what is asked of them; the good among themselves keep their order.

    Parameters
    ----------
    env_id : str
        An environment with an expert in `rpil.simulation.experts`.
    kind : str
        One of `rpil.simulation.corruptions.KINDS`.
    n_good, n_bad : int
        Numbers of good and of bad demonstrations, 0 or more.
    seed : int
        Determines all demonstrations.

    Returns
    -------
    Simulation

    Raises
    ------
    DataError
        If the environment has no expert, the kind is unknown or there is nothing to simulate.
    """
    if kind not in KINDS:
        raise DataError(f"There is no kind of bad demonstration {kind!r}: choose one of {', '.join(KINDS)}.")
    if n_good < 0 or n_bad < 0 or n_good + n_bad == 0:
        raise DataError(f"n_good = {n_good} and n_bad = {n_bad} make no demonstrations: ask for at least one in all.")
    driver = expert(env_id)
    with closing(make(env_id)) as env:
        space = actions_of(env)
    assert space is not None
    seeds = np.random.SeedSequence(seed).generate_state(5).tolist()
    good_seed, bad_seed, policy_seed, corruption_seed, order_seed = seeds

    good = record(driver, env_id, n_episodes=n_good, seed=good_seed)
    bad_driver = RandomPolicy(space, policy_seed) if kind == RANDOM else driver
    bad = record(bad_driver, env_id, n_episodes=n_bad, seed=bad_seed)
    episodes = [(episode.observations, episode.actions) for episode in [*good, *bad]]
    if kind != RANDOM:
        # One generator per episode: the first bad demonstrations do not depend on `n_bad`.
        streams = np.random.default_rng(corruption_seed).spawn(n_bad)
        episodes[n_good:] = [
            CORRUPTIONS[kind](*episode, space, rng) for episode, rng in zip(episodes[n_good:], streams, strict=True)
        ]
    is_good = np.random.default_rng(order_seed).permutation(np.repeat([1, 0], [n_good, n_bad]))
    order = np.argsort(np.argsort(-is_good, kind="stable"))  # the good, and the bad, among themselves as recorded
    return Simulation(
        episodes=[episodes[m] for m in order.tolist()],
        is_good=is_good,
        returns=np.array([episode.rewards.sum() for episode in [*good, *bad]])[order],
    )
