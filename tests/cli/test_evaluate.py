"""``rpil evaluate``: saved policies and the user's own, returns and successes, Gymnasium and Meta-World."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from command_line import ENV, ok, refused
from rpil.cli.evaluate import loaded
from rpil.data.errors import DataError
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import OneByOne, rollout

OWN = """
import gymnasium
import numpy as np

from rpil.simulation.experts import expert

RULE = expert("MountainCar-v0")


class Climb(gymnasium.Env):
    '''Go up by 1; an episode succeeds from 3 on, and ends after 5 steps. Every other seed begins below.'''

    observation_space = gymnasium.spaces.Box(-9, 9, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.n, self.at = 0, -4.0 if seed % 2 else 0.0
        return np.array([self.at], np.float32), {}

    def step(self, action):
        self.n, self.at = self.n + 1, self.at + float(action[0])
        return np.array([self.at], np.float32), 1.0, False, self.n == 5, {"is_success": self.at == 3}


gymnasium.register("own/Climb-v0", Climb)


class Remembers:
    '''Fails where the steps of two episodes are mixed.'''

    def __init__(self):
        self.seen = []

    def reset(self):
        self.seen = []

    def __call__(self, observation):
        assert observation.shape == (1,)
        assert not self.seen or observation[0] == self.seen[-1] + 1
        self.seen.append(observation[0])
        return [1.0]


def load():
    return lambda observation: RULE.predict(observation[None])[0]


def rows():
    return RULE


def up():
    return Remembers()


def half():
    return lambda observation: 0.5


def number():
    return 3


def needy(path):
    return RULE
"""


BOOM = """
def load():
    raise RuntimeError("no weights.")


def act():
    return lambda observation: 1 / 0


class Again:
    def reset(self):
        raise KeyError("plan")

    def __call__(self, observation):
        return 0


def again():
    return Again()


class Rows:
    def predict(self, observations):
        raise ValueError


def rows():
    return Rows()
"""


@pytest.fixture(autouse=True)
def own():
    Path("mine.py").write_text(OWN)


def test_an_own_policy_is_played_as_a_saved_one_is():
    wanted = rollout(expert(ENV), ENV, n_episodes=4, seed=3).returns
    for function in ("load", "rows"):
        found = json.loads(
            ok("evaluate", f"mine.py:{function}", "--env", ENV, "--episodes", 4, "--seed", 3, "--json").stdout
        )
        assert list(found) == ["mean", "ci95", "returns"]  # Mountain Car does not report success
        np.testing.assert_array_equal(found["returns"], wanted)


def test_successes_of_an_own_policy_in_an_own_environment():
    arguments = ["evaluate", "mine.py:up", "--env", "own/Climb-v0", "--episodes", 20]
    found = json.loads(ok(*arguments, "--json").stdout)
    seeds = np.random.SeedSequence(0).generate_state(20)
    assert found["success"] == (seeds % 2 == 0).tolist()  # also where an episode goes on after its success
    n = sum(found["success"])
    assert 0 < n < 20
    assert found["success_rate"] == n / 20
    wilson = stats.binomtest(n, 20).proportion_ci(method="wilson")
    np.testing.assert_allclose(found["success_ci95"], (wilson.low, wilson.high))
    assert found["median_steps_to_success"] == 3
    assert found["mean"] == 5
    first, second = ok(*arguments).stdout.splitlines()
    assert first == "Mean return 5.0 (95 % interval 5.0 to 5.0) over 20 episodes of own/Climb-v0."
    percents = rf"{5 * n} % \(95 % interval {100 * wilson.low:.0f} to {100 * wilson.high:.0f} %\)"
    assert re.fullmatch(rf"Success in {n} of 20 episodes: {percents}, after a median of 3 steps\.", second)


def test_an_own_file_may_import_its_neighbours_and_leaves_the_path_as_it_was():
    Path("folder").mkdir()
    Path("folder/neighbour_of_mine.py").write_text("import mine_too\n")
    Path("folder/mine_too.py").write_text("ACTION = 1\n")
    Path("folder/m.py").write_text(
        "import neighbour_of_mine as n\n\ndef f():\n    return lambda o: n.mine_too.ACTION\n"
    )
    before = list(sys.path)
    assert "in one episode" in ok("evaluate", "folder/m.py:f", "--env", ENV, "--episodes", 1).stdout
    assert sys.path == before
    assert sorted(path.name for path in Path("folder").iterdir()) == ["m.py", "mine_too.py", "neighbour_of_mine.py"]


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("yours.py:load", "yours.py: there is no such file"),
        ("mine.py:save", "mine.py: it has no function 'save'"),
        ("mine.py:RULE", "mine.py: it has no function 'RULE'"),
        ("mine.py:needy", "mine.py: needy needs arguments"),
        ("mine.py:number", r"mine.py: number\(\) returned int; return a function"),
        ("broken.py:load", r"broken.py: it cannot be imported \(ModuleNotFoundError: No module named 'no_such'\)"),
        ("mine.py", "mine.py: name the function in it that returns a policy, as mine.py:FUNCTION"),
        ("boom.py:load", r"boom.py: load\(\) failed \(RuntimeError: no weights\); call it in Python"),
        ("boom.py:act", r"boom.py: the function that act\(\) returned failed \(ZeroDivisionError: division by zero\)"),
        ("boom.py:again", r"boom.py: the function that again\(\) returned failed \(KeyError: 'plan'\)"),
        ("boom.py:rows", r"boom.py: predict of what rows\(\) returned failed \(ValueError\)"),
        ("mine.py:half", "one action 0 to 2"),
    ],
)
def test_what_is_no_policy_is_refused(policy, words):
    Path("broken.py").write_text("import no_such\n")
    Path("boom.py").write_text(BOOM)
    refused(words, "evaluate", policy, "--env", ENV)


def test_what_the_policy_raised_is_the_cause_of_the_sentence():
    Path("boom.py").write_text(BOOM)
    with loaded("boom.py:act") as policy, pytest.raises(DataError) as error:
        policy.predict(np.zeros((1, 2)))
    assert isinstance(error.value.__cause__, ZeroDivisionError)


def test_an_own_policy_keeps_what_it_knows_of_itself():
    Path("short.py").write_text(
        f"from rpil.simulation.experts import expert\n\ndef rows():\n    return expert({ENV!r})\n"
    )
    with loaded("short.py:rows") as policy:
        assert not isinstance(policy, OneByOne)
        np.testing.assert_array_equal(policy.classes_, expert(ENV).classes_)


def test_a_saved_policy_may_have_such_a_name(folder):
    Path("mine.py:load").write_bytes((folder / "policy").read_bytes())
    Path("mine.py").unlink()
    assert "Mean return" in ok("evaluate", "mine.py:load", "--env", ENV, "--episodes", 2).stdout


def test_meta_world_without_its_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "metaworld.env_dict", None)
    for env in ("metaworld:reach-v3", "Meta-World/reach-v3"):
        refused(r"install it with pip install 'rpil\[value\]'", "evaluate", "mine.py:rows", "--env", env)


SCRIPTED = """
import warnings

from metaworld.policies import ENV_POLICY_MAP


def load():
    warnings.simplefilter("ignore")  # scripts say that they ask for more than 1
    return ENV_POLICY_MAP["reach-v3"]().get_action
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_meta_world():
    pytest.importorskip("metaworld", reason="Meta-World is not installed: pip install 'rpil[value]'")
    Path("script.py").write_text(SCRIPTED)
    runs = [ok("evaluate", "script.py:load", "--env", "metaworld:reach-v3", "--episodes", 2, "--json") for _ in "ab"]
    found = json.loads(runs[0].stdout)
    assert found["success"] == [True, True]
    assert 10 < found["median_steps_to_success"] < 100
    assert found["returns"][0] != found["returns"][1]  # each episode has its own goal
    assert runs[0].stdout == runs[1].stdout  # which the seed draws
    refused("Meta-World has no task 'fly-v3'", "evaluate", "script.py:load", "--env", "Meta-World/fly-v3")
