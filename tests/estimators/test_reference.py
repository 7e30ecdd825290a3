"""Good demonstrations beside those to judge: one set of data, if both have the same observations and actions."""

from __future__ import annotations

import numpy as np
import pytest

from problems import refused
from rpil import Demonstrations
from rpil.estimators.within_tasks import with_reference

RNG = np.random.default_rng(0)


def some(n, ids=None, names=("x", "v"), actions=1, source="a.csv", action_names=()):
    episodes = [(RNG.normal(size=(5, len(names))), RNG.normal(size=(5, actions))) for _ in range(n)]
    made = Demonstrations.from_episodes(episodes, ids, observation_names=names, source=source)
    return Demonstrations(
        made.observations, made.actions, made.offsets, made.ids, names, source, action_names=action_names
    )


def test_reference_comes_last_and_no_ids_clash():
    for ids in (None, ["0", "reference 0", "reference 2 0"]):
        one, other = some(3, ids), some(2, source="good.csv")
        both = with_reference(one, other)
        assert both.ids[:3] == tuple(map(str, one.ids))
        assert len(set(both.ids)) == 5
        for m in range(5):
            expected = one[m] if m < 3 else other[m - 3]
            for found, value in zip(both[m], expected, strict=True):
                np.testing.assert_array_equal(found, value)


def test_columns_in_another_order_are_matched_by_name():
    one, other = some(2), some(2, names=("v", "x"))
    both = with_reference(one, other)
    assert both.observation_names == ("x", "v")
    np.testing.assert_array_equal(both[2][0], other[0][0][:, ::-1])


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (some(2, names=("x",), source="b.csv"), "lacks 'v'"),
        (some(2, names=("x", "v", "w"), source="b.csv"), "has 'w' too"),
        (some(2, actions=2, source="b.csv"), "2 continuous numbers, and those of a.csv are 1 continuous"),
        (some(2, action_names=("grip",), source="b.csv"), "grip"),
        (
            Demonstrations.from_episodes(
                [(np.ones((4, 2)), np.arange(4) % 2)] * 2, observation_names=("x", "v"), source="b.csv"
            ),
            "discrete",
        ),
    ],
)
def test_other_observations_or_actions_are_refused(other, words):
    with refused(rf"^b\.csv.*{words}"):
        with_reference(some(2), other)
