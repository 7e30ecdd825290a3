"""Episodes as Gymnasium, Minari and imitation give them are read as the same demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from problems import refused
from rpil.data.demonstrations import Demonstrations

T = 4
X = np.arange(15.0).reshape(5, 3)  # with the observation after the last action
Y = np.array([0, 1, 1, 0])


@dataclass
class DictObs:
    """As imitation's: entries by name, but no mapping."""

    _d: dict[str, np.ndarray]

    def items(self):
        return self._d.items()

    def __len__(self):
        return len(next(iter(self._d.values())))


@pytest.mark.parametrize(
    "episode",
    [
        (X[:T], Y),
        (X, Y),
        (tuple(X), tuple(Y)),
        {"observations": X, "actions": Y, "rewards": np.ones(4)},
        {"obs": X, "acts": Y},
        SimpleNamespace(observations=X, actions=Y, infos={}),
        SimpleNamespace(obs=X, acts=Y, terminal=True),
    ],
)
def test_forms_of_an_episode(episode):
    d = Demonstrations.from_episodes([episode, (X[:2], Y[:2])], ids=["a", "b"])
    assert d.observations.tolist() == [*X[:T].tolist(), *X[:2].tolist()]
    assert d.actions.tolist() == [*Y.tolist(), *Y[:2].tolist()]
    assert (d.ids, d.lengths.tolist(), d.observation_names) == (("a", "b"), [4, 2], ("0", "1", "2"))


NAMES = ("qpos.0", "qpos.1", "qpos.2", "goal.at", "goal.near")


@pytest.mark.parametrize(
    ("observations", "names"),
    [
        ({"qpos": X, "goal": {"at": X[:, :1], "near": np.array([True, False, True, True, False])}}, NAMES),
        (DictObs({"a": X, "b": np.c_[X[:, 0], [1, 0, 1, 1, 0]]}), ("a.0", "a.1", "a.2", "b.0", "b.1")),
    ],
)
def test_parts_of_observations_become_named_columns(observations, names):
    for episode in ((observations, Y), SimpleNamespace(obs=observations, acts=Y)):
        d = Demonstrations.from_episodes([episode])
        assert d.observation_names == names
        np.testing.assert_array_equal(d.observations, np.c_[X, X[:, 0], [1, 0, 1, 1, 0]][:T])
    named = Demonstrations.from_episodes([episode], observation_names=[*"abcde"])
    assert named.observation_names == tuple("abcde")


@pytest.mark.parametrize(
    ("episode", "message"),
    [
        (({"mission": ["go"] * 5, "x": X}, Y), "demonstration 1: observation 'mission' is text; leave it out"),
        (({"graph": [object()] * 5, "x": X}, Y), "demonstration 1: observation 'graph' must be"),
        (({"a": X, "b": X[:3]}, Y), "demonstration 1: observation 'b' has 3 steps, not 5"),
        (({}, Y), "demonstration 1: 0 observations but 4 actions|there are no observations"),
        ((X, Y), "demonstration 1: its names differ"),
        (([{"a": X[0]}, {"a": X[0]}], Y[:2]), "observations must be a rectangular array of numbers .* as many values"),
        (((X, X[:, :1]), Y), "observations must be a rectangular array .*, or, of an episode, a dict of arrays"),
        ({"observation": 1, "action": 0}, "no steps; give arrays with a row for each, or leave it out"),
        (None, "one pair"),
        ([{"observation": x, "action": 0} for x in X[:2]], "one pair"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(episode, message):
    with refused(message):
        Demonstrations.from_episodes([({"a": X}, Y), episode])
