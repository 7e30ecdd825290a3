"""What leaving out would lose: named where one demonstration alone goes there, and hardly ever where all are alike."""

import re

import numpy as np
import pytest

import rpil
from rpil.data.demonstrations import Demonstrations
from rpil.results.choice import lost_places

NAMES = ("hand", "obs.3", "speed")


def reaches(starts, rng, goal=1.0):
    """One demonstration for each start, (M, 2), from there to the goal, with a third observation that is noise."""
    episodes = []
    for start in starts:
        share = np.linspace(0, 1, 40)[:, None]
        path = start + share * (goal - np.asarray(start)) + 0.01 * rng.normal(size=(40, 2))
        episodes.append((np.hstack([path, rng.normal(size=(40, 1))]), rng.integers(2, size=40)))
    return Demonstrations.from_episodes(episodes, observation_names=NAMES)


def test_states_that_nobody_else_reaches_are_named_where_the_start_is_usual():
    rng = np.random.default_rng(2)
    usual = reaches(rng.uniform([-0.5, -0.5], [0.5, 0.4], size=(25, 2)), rng)
    detour = usual[4][0].copy()
    detour[5:, 0] -= 6
    episodes = [*usual, (detour, usual[4][1])]
    (found,) = lost_places(Demonstrations.from_episodes(episodes, observation_names=NAMES), range(25))
    lowest = min(observations[:, 0].min() for observations, _ in usual)
    assert found == f"No kept demonstration reaches hand below {np.floor(lowest * 100) / 100:.2f}; 25 does."


def test_three_kept_ones_say_what_is_usual():
    made = Demonstrations.from_episodes([(np.full((9, 1), x), np.zeros(9, int)) for x in (0.0, 1.0, 2.0, 99.0)])
    assert lost_places(made, range(3)) == ("No kept demonstration starts with observation 0 above 2.0; 3 does.",)
    assert lost_places(made, range(2)) == ()


def test_data_on_disk_lose_the_same_if_they_fit_in_memory(tmp_path, monkeypatch):
    rng = np.random.default_rng(2)
    made = reaches([*rng.uniform([-0.5, -0.5], [0.5, 0.4], size=(25, 2)), (90.0, 0.0)], rng)
    rpil.write(tmp_path / "a.parquet", made)
    on_disk = rpil.open(tmp_path / "a.parquet", on_disk=True).demonstrations
    assert lost_places(on_disk, range(25)) == lost_places(made, range(25)) != ()
    monkeypatch.setattr("rpil.data.memory.free_memory", lambda: 1000.0)
    assert lost_places(on_disk, range(25)) == ()


def test_a_hole_within_all_ranges_is_named_without_an_observation():
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    starts = [*(9 * np.column_stack([np.cos(angle), np.sin(angle)])), [0.0, 0.0]]
    episodes = [(np.tile(start, (5, 1)) + 0.01 * rng.normal(size=(5, 2)), np.zeros(5, int)) for start in starts]
    found = lost_places(Demonstrations.from_episodes(episodes), range(60))
    assert found == ("No kept demonstration starts near the start of 60.",)


@pytest.mark.parametrize(("n", "width", "n_left_out"), [(30, 6, 25), (12, 2, 4)])
def test_demonstrations_that_are_alike_hardly_ever_lose_a_place(n, width, n_left_out):
    alarms = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        episodes = []
        for _ in range(n):
            x = rng.normal(size=(int(rng.integers(30, 80)), width))
            for t in range(1, len(x)):
                x[t] = 0.95 * x[t - 1] + 0.3 * x[t]
            episodes.append((x, np.zeros(len(x), int)))
        alarms += bool(lost_places(Demonstrations.from_episodes(episodes), rng.permutation(n)[n_left_out:].tolist()))
    assert alarms <= 1


@pytest.mark.parametrize(
    ("scale", "offset", "kind"), [(1, 0, np.float64), (10, 1234.4, np.float32), (0.1, 5e6, np.float64)]
)
def test_no_kept_one_is_beyond_the_bound_and_each_that_is_named_is(scale, offset, kind):
    rng = np.random.default_rng(10)
    starts = [*rng.normal(size=40), 30.0, 300.0, -30.0]  # the farther one needs fewer digits
    walks = (offset + scale * (start + rng.normal(size=(20, 1))) for start in starts)
    episodes = [(walk.astype(kind), np.zeros(20, int)) for walk in walks]
    first = [float(observations[0, 0]) for observations, _ in episodes]
    found = lost_places(Demonstrations.from_episodes(episodes), range(40))
    parts = [re.search(r"(above|below) (\S+); (.+) do", sentence).groups() for sentence in found]
    assert sorted((side, who) for side, _, who in parts) == [("above", "40 and 41"), ("below", "42")]
    for side, bound, who in parts:
        sign = 1 if side == "above" else -1
        assert all(sign * value <= sign * float(bound) for value in first[:40])
        assert all(sign * first[int(name)] > sign * float(bound) for name in who.split(" and "))
