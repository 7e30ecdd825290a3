"""Which column holds what: by name and type, and as the user says."""

import time
from pathlib import Path

import pytest

from rpil.data.errors import DataError
from rpil.data.text import quoted
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions

BASE = ["episode", "x", "v", "action"]


def found(names, kinds=None, **options):
    return find_columns(dict.fromkeys(names, "number") | (kinds or {}), "a.csv", ColumnOptions(**options))


def test_spellings_of_the_demonstration():
    for name in ("episode_index", "Episode", "ep", "eps_id", "trajectoryId", "demo_id", "Rollout", "Épisode"):
        assert found([name, "x", "action"]).episode == name


@pytest.mark.parametrize(
    ("columns", "actions", "one"),
    [
        *(([name], (name,), True) for name in ("action", "Actions", "act", "a")),
        *((names, tuple(names), False) for names in (["a0", "a1"], ["cmd_vel", "cmd_turn"])),
        (["action.x", "action.y", "action_mask"], ("action.x", "action.y"), False),
        (["action", "action_logprob", "action_0"], ("action",), True),
    ],
)
def test_spellings_of_the_action(columns, actions, one):
    columns = found(["episode", "x", *columns])
    assert (columns.actions, columns.one_action, columns.observations) == (actions, one, ("x",))


NOT_OBSERVED = [
    *("reward", "rew", "next.reward", "cum_reward", "return", "success", "is_success", "score", "done", "truncated"),
    *("t", "time", "timestamp", "stamp_ns", "header.stamp", "step", "frame", "index", "Unnamed: 0", "", "next_x"),
    *("task", "task_index", "operator", "episode_length", "weight", "label", "is_good", "expert", "is_expert", "good"),
    *("fail", "failed", "outcome", "skill_level", "advantage", "q_value", "récompense.reward"),
]


def test_what_is_no_observation_unless_it_is_named():
    for name in NOT_OBSERVED:
        assert name not in found([*BASE, name]).observations
        assert found([*BASE, name], observations=[name]).observations == (name,)


def test_every_column_has_a_role_or_a_reason():
    kinds = {"note": "text", "image": "nested", "blank": "empty"}
    columns = found([*BASE, "step", "time", *kinds, "reward", "session", "rate"], kinds, exclude="ra*")
    assert (columns.observations, columns.orders) == (("x", "v"), ("step", "time"))
    reasons = {"note": "text", "image": "images or nested values", "blank": "no values", "session": "another id"}
    assert columns.ignored == reasons | {"reward": "reward, end or verdict", "rate": "excluded as asked"}
    columns = found(["episode", "obs_x", "height", "action"])  # a prefix leaves out the others
    assert columns.observations == ("obs_x",)
    assert columns.ignored["height"] == "not named as an observation, as obs_x is"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"id": "run"}, "no column is called 'run'; correct id= .found 'episode'"),
        ({"action": "acton"}, "no column is called 'acton'; correct action= .found 'action'"),
        ({"operator": "who"}, r"'who'; correct operator=, or give a CSV file \(id,demonstrator\) .found"),
        ({"order": "*"}, "'\\*' names 'episode', 'x', 'v', 'action'; name one column with order="),
        ({"outcome": "x,v"}, "'x,v' names 'x', 'v'; name one column with outcome="),
        ({"id": ["episode", "run"]}, r"id= is \['episode', 'run'\]; give one name, as text"),
        ({"id": [*range(99)]}, r"id= is \[0, 1, 2.*, 1; give one name, as text"),
        ({"operator": Path("who.csv")}, r"operator= is PosixPath\('who.csv'\); give one name, as text"),
        ({"exclude": ["x", "v"]}, "no column holds observations: name them observation.*"),
        ({"action": "v", "observations": "x,v"}, "'v' is part of the action already; take it out of observations="),
        ({"id": "episode", "observations": "*"}, "'episode' is the id already; take it out of observations="),
    ],
)
def test_a_wrong_name_is_refused_with_the_likely_ones(options, message):
    with pytest.raises(DataError, match=message):
        found(BASE, **options)


def test_names_may_be_patterns_a_text_with_commas_or_in_another_case():
    names = ["episode", "joint 1", "joint 2", "x,y", "Force", "action"]
    assert found(names, observations="joint*").observations == ("joint 1", "joint 2")
    assert found(names, observations="x,y").observations == ("x,y",)
    assert found(names, observations="force, joint_1").observations == ("Force", "joint 1")


@pytest.mark.parametrize("other", ["session", "operator", "task"])
def test_other_ids_may_be_needed_to_tell_demonstrations_apart(other):
    assert found([*BASE, other]).parts == (other,)
    named_by_user = found([*BASE, other], id="episode")
    assert (named_by_user.parts, named_by_user.observations) == ((), ("x", "v"))


def test_forty_thousand_columns_take_seconds():
    names = ["episode", "action", *(f"joint_{k}" for k in range(40_000))]
    start = time.process_time()
    assert len(found(names, exclude="joint_1*").observations) == 28_889
    assert time.process_time() - start < 1.6  # 0.4 seconds on an idle machine; the time was quadratic once


def test_long_names_are_cut_in_messages():
    assert quoted(["a", 3, "b" * 38, "b" * 39]) == f"'a', 3, '{'b' * 38}', '{'b' * 39}...'"
    assert (len(quoted(["x" * 10_000] * 100)) < 600, quoted(["a.b"] * 13).count("a.b")) == (True, 12)
    with pytest.raises(DataError) as caught:
        found(["episode", "x" * 10_000], observations="x*")
    assert len(str(caught.value)) < 300
