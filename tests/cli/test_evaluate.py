"""``rpil evaluate``: returns and successes, Gymnasium and Meta-World."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy import stats

from command_line import refused
from rpil.cli.evaluate import sentences, values
from rpil.simulation.rollouts import OneByOne, Returns, rollout


def test_successes_in_words_and_numbers():
    played = Returns.of(np.full(20, 5.0), np.array([3, 0] * 6 + [0] * 8))
    wilson = stats.binomtest(6, 20).proportion_ci(method="wilson")
    printed = values(played)
    assert printed["success"] == [True, False] * 6 + [False] * 8
    assert (printed["mean"], printed["success_rate"], printed["median_steps_to_success"]) == (5, 6 / 20, 3)
    np.testing.assert_allclose(printed["success_ci95"], (wilson.low, wilson.high))
    assert list(sentences(played, "Climb")) == [
        "Mean return 5.0 (95 % interval 5.0 to 5.0) over 20 episodes of Climb.",
        f"Success in 6 of 20 episodes: 30 % (95 % interval {100 * wilson.low:.0f} to {100 * wilson.high:.0f} %), "
        "after a median of 3 steps.",
    ]
    never = Returns.of(np.zeros(2), np.zeros(2, dtype=int))
    assert "after" not in list(sentences(never, "Climb"))[1]
    unknown = Returns.of(np.zeros(2), None)
    assert list(values(unknown)) == ["mean", "ci95", "returns"]
    assert len(list(sentences(unknown, "Climb"))) == 1


def test_meta_world_without_its_package_names_the_extra(monkeypatch, folder):
    monkeypatch.setitem(sys.modules, "metaworld.env_dict", None)
    for env in ("metaworld:reach-v3", "Meta-World/reach-v3"):
        refused(r"install it with pip install 'rpil\[value\]'", "evaluate", folder / "policy", "--env", env)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_meta_world(folder):
    policies = pytest.importorskip("metaworld.policies", reason="needs pip install 'rpil[value]'")
    scripted = policies.ENV_POLICY_MAP["reach-v3"]().get_action
    runs = [rollout(OneByOne(scripted), "metaworld:reach-v3", n_episodes=2, seed=0) for _ in "ab"]
    assert runs[0].success.tolist() == [True, True]
    assert 10 < runs[0].median_steps < 100
    assert runs[0].returns[0] != runs[0].returns[1]  # each episode has its own goal
    np.testing.assert_array_equal(runs[0].returns, runs[1].returns)  # which the seed draws
    refused("Meta-World has no task 'fly-v3'", "evaluate", folder / "policy", "--env", "Meta-World/fly-v3")
