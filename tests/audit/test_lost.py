"""What leaving out would lose: named where one demonstration alone goes there, and hardly ever where all are alike."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.audit.lost import lost_places
from rpil.data.demonstrations import Demonstrations

NAMES = ("hand", "obs.3", "speed")


def reaches(starts, rng, goal=1.0):
    """One demonstration for each start, (M, 2), from there to the goal, with a third observation that is noise."""
    episodes = []
    for start in starts:
        share = np.linspace(0, 1, 40)[:, None]
        path = start + share * (goal - np.asarray(start)) + 0.01 * rng.normal(size=(40, 2))
        episodes.append((np.hstack([path, rng.normal(size=(40, 1))]), rng.integers(2, size=40)))
    return Demonstrations.from_episodes(episodes, observation_names=NAMES)


def usual_starts(n, rng):
    return rng.uniform([-0.5, -0.5], [0.5, 0.4], size=(n, 2))


def test_the_only_one_that_starts_somewhere_is_named_with_its_observation():
    rng = np.random.default_rng(0)
    starts = np.vstack([usual_starts(30, rng), [[0.0, 4.0]]])
    demonstrations = reaches(starts, rng)
    highest = max(demonstrations.episode(m)[0][0, 1] for m in range(30) if m not in (3, 5))
    kept = [m for m in range(30) if m not in (3, 5)]
    assert lost_places(demonstrations, kept) == (f"Without 30 no demonstration starts with obs.3 above {highest:.3g}.",)
    assert lost_places(demonstrations, [*kept, 30]) == ()


def test_several_that_start_there_share_a_sentence_and_one_that_is_kept_is_enough():
    rng = np.random.default_rng(1)
    starts = np.vstack([usual_starts(30, rng), [[-5.0, 0.0], [-5.2, 0.1], [-4.9, -0.1]]])
    demonstrations = reaches(starts, rng)
    (found,) = lost_places(demonstrations, range(30))
    assert found.startswith("Without 30, 31 and 32 no demonstration starts with hand below -0.")
    assert lost_places(demonstrations, range(31)) == ()


def test_states_that_nobody_else_reaches_are_named_where_the_start_is_usual():
    rng = np.random.default_rng(2)
    usual = reaches(usual_starts(25, rng), rng)
    detour = usual.episode(4)[0].copy()
    detour[5:, 0] -= 6
    episodes = [*usual, (detour, usual.episode(4)[1])]
    (found,) = lost_places(Demonstrations.from_episodes(episodes, observation_names=NAMES), range(25))
    lowest = min(observations[:, 0].min() for observations, _ in usual)
    assert found == f"Without 25 no demonstration reaches hand below {lowest:.3g}."


def test_a_hole_within_all_ranges_is_named_without_an_observation():
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    starts = [*(9 * np.column_stack([np.cos(angle), np.sin(angle)])), [0.0, 0.0]]
    episodes = [(np.tile(start, (5, 1)) + 0.01 * rng.normal(size=(5, 2)), np.zeros(5, int)) for start in starts]
    found = lost_places(Demonstrations.from_episodes(episodes), range(60))
    assert found == ("Without 60 no demonstration starts near there.",)


def test_columns_without_a_name_are_called_observations():
    rng = np.random.default_rng(4)
    starts = [*rng.normal(size=(20, 1)), [50.0]]
    episodes = [(start + rng.normal(size=(30, 1)), np.zeros(30, int)) for start in starts]
    (found,) = lost_places(Demonstrations.from_episodes(episodes), range(20))
    assert found.startswith("Without 20 no demonstration starts with observation 0 above ")


@pytest.mark.parametrize(("n", "width", "n_left_out"), [(30, 6, 10), (30, 6, 25), (100, 4, 10), (12, 2, 4)])
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


def test_units_change_nothing():
    rng = np.random.default_rng(5)
    demonstrations = reaches(np.vstack([usual_starts(20, rng), [[0.0, 4.0]], usual_starts(5, rng)]), rng)
    millimetres = [(observations * [1000, 1, 0.001], actions) for observations, actions in demonstrations]
    changed = Demonstrations.from_episodes(millimetres, observation_names=NAMES)
    assert lost_places(changed, range(20)) == lost_places(demonstrations, range(20)) != ()


def test_more_states_than_are_compared():
    rng = np.random.default_rng(6)
    starts = np.vstack([usual_starts(300, rng), [[0.0, 9.0]]])
    (found,) = lost_places(reaches(starts, rng), range(300))  # 12,000 states
    assert found.startswith("Without 300 no demonstration starts with obs.3 above 0.")


def test_equal_starts_and_columns_that_never_change_are_no_place():
    rng = np.random.default_rng(7)
    episodes = [(np.hstack([np.arange(20)[:, None], np.ones((20, 1))]), rng.integers(2, size=20)) for _ in range(8)]
    assert lost_places(Demonstrations.from_episodes(episodes), range(5)) == ()


def test_nothing_is_said_where_nothing_is_left_out_or_too_few_are_kept():
    rng = np.random.default_rng(8)
    demonstrations = reaches(np.vstack([usual_starts(5, rng), [[0.0, 40.0]]]), rng)
    assert lost_places(demonstrations, range(6)) == ()
    assert lost_places(demonstrations, range(2)) == ()
    assert lost_places(demonstrations, []) == ()


def test_ids_are_compared_as_text_and_many_are_cut_short():
    rng = np.random.default_rng(9)
    starts = np.vstack([usual_starts(30, rng), np.array([[0.0, 9.0]]) + 0.1 * rng.normal(size=(8, 2))])
    (found,) = lost_places(reaches(starts, rng), [str(m) for m in range(30)])
    assert found.startswith("Without 30, 31, 32, 33, 34 and 3 more no demonstration starts with obs.3 above 0.")
