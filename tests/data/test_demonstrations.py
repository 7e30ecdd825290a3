import numpy as np
import pytest

from problems import refused
from rpil.data.demonstrations import Demonstrations

X = np.arange(10.0).reshape(5, 2)
Y = np.array([0, 1, 1, 0, 2])


def small(**changes):
    arguments = {"observations": X, "actions": Y, "offsets": [0, 2, 5], "ids": ["a", "b"], "source": "x.npz"} | changes
    return Demonstrations(**arguments)


def refusal(match, call, *arguments, **keywords):
    """Assert that the call raises a DataError of one sentence matching `match`."""
    with refused(match) as caught:
        call(*arguments, **keywords)
    return str(caught.value)


def test_properties():
    d = small()
    assert (len(d), d.n_demonstrations, d.n_steps, d.n_observations) == (2, 2, 5, 2)
    assert (d.lengths.tolist(), d.groups.tolist()) == ([2, 3], [0, 0, 1, 1, 1])
    assert d.is_discrete
    assert d.observation_names == ("0", "1")
    assert "2 demonstrations, 5 steps, 2 observations, discrete" in repr(d)
    many = Demonstrations(np.zeros((25518, 1)), np.zeros(25518), [0, 25518])
    assert "1 demonstration, 25,518 steps, 1 observation," in repr(many)
    assert (small(ids=None).ids, small(ids=np.array([7, 3])).ids) == ((0, 1), (7, 3))
    assert type(small(ids=np.array([7, 3])).ids[0]) is int


def test_a_position_is_an_episode():
    d = small()
    for episode in (d[1], d[-1], d[np.int64(1)], [*d][1]):
        observations, actions = episode
        assert (observations.tolist(), actions.tolist()) == (X[2:].tolist(), [1, 0, 2])
    with pytest.raises(IndexError):
        d[2]
    refusal(r"x.npz: \[slice.*\] takes one position; use select", d.__getitem__, slice(5))


def test_arrays_are_read_only_and_the_callers_stay_writable():
    x = X.copy()
    d = small(observations=x)
    for array in (d.observations, d.actions, d.offsets, d[0][0]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    x[0] = 0
    with pytest.raises(AttributeError):
        d.ids = ()


def test_float32_is_kept_everything_else_is_float64():
    assert small(observations=X.astype(np.float32)).observations.dtype == np.float32
    for kind in (np.float16, int, bool, object):
        assert small(observations=X.astype(kind)).observations.dtype == np.float64
    assert small(observations=np.asfortranarray(X)).observations.flags.c_contiguous


@pytest.mark.parametrize(
    ("actions", "expected"),
    [
        ([0.0, 1.0, 1.0, 0.0, 2.0], np.array([0, 1, 1, 0, 2])),
        (np.array([[0], [1], [1], [0], [2]], dtype=np.uint8), np.array([0, 1, 1, 0, 2])),
        ([True, False, True, True, True], np.array([1, 0, 1, 1, 1])),
        (["l", "r", "right", "l", "l"], np.array(["l", "r", "right", "l", "l"])),
        (np.array(["l", "r", "right", "l", "l"], dtype=object), np.array(["l", "r", "right", "l", "l"])),
        ([0.5, 1, 1, 0, 2], np.array([[0.5], [1], [1], [0], [2]])),
        (np.ones((5, 2), dtype=np.float32), np.ones((5, 2), dtype=np.float32)),
        (np.ones((5, 1)), np.ones((5, 1))),
    ],
)
def test_actions(actions, expected):
    d = small(actions=actions)
    assert d.actions.dtype == expected.dtype
    np.testing.assert_array_equal(d.actions, expected)
    assert d.is_discrete == (expected.ndim == 1)
    assert d.select([1]).is_discrete == d.is_discrete


def test_from_groups_keeps_the_order_within_a_group():
    d = Demonstrations.from_groups(X, Y, ["z", "a", "z", "a", "z"])
    assert d.ids == ("z", "a")
    assert d.observations[:, 0].tolist() == [0, 4, 8, 2, 6]
    assert (d.actions.tolist(), d.offsets.tolist()) == ([0, 1, 2, 1, 0], [0, 3, 5])
    assert Demonstrations.from_groups(X, Y, [9.0, 9.0, 4.0, 4.0, 4.0]).ids == (9, 4)
    assert np.shares_memory(Demonstrations.from_groups(X, Y, [9, 9, 4, 4, 4]).observations, X)


def test_select():
    d = small(observation_names=["u", "v"])
    back = d.select([1, 0])
    assert back.ids == ("b", "a")
    assert back.observations[:, 0].tolist() == [4, 6, 8, 0, 2]
    assert back.actions.tolist() == [1, 0, 2, 0, 1]
    assert back.offsets.tolist() == [0, 3, 5]
    assert back.observation_names == ("u", "v")
    assert back.source == "x.npz"
    assert d.select([False, True]).ids == d.select(1).ids == d.select(slice(1, None)).ids == ("b",)
    refusal("x.npz: there are no demonstrations", d.select, [])
    refusal("'a' appears twice", d.select, [0, 0])


def changed(array, row, column, value):
    array = np.array(array, dtype=float)
    array[row, column] = value
    return array


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        (
            {"observations": changed(X, 3, 1, np.nan)},
            r"x.npz, demonstration 'b', step 1: observation '1' is nan; repair",
        ),
        ({"actions": changed(np.ones((5, 2)), 4, 1, np.inf)}, "demonstration 'b', step 2: action 1 is inf"),
        ({"actions": [0, 1, np.nan, 1, 1]}, "demonstration 'b', step 0: action 0 is nan"),
        ({"offsets": [0, 0, 5]}, "x.npz, demonstration 'a': it has no steps; leave it out"),
        ({"offsets": [0, 3, 2, 5], "ids": None}, "offsets must increase from 0 to the number of steps, 5"),
        ({"offsets": [0.0, 2.0, 5.0]}, "offsets must be a list of whole numbers; give"),
        ({"offsets": [0]}, "there are no demonstrations"),
        ({"actions": Y[:4]}, "5 observations but 4 actions"),
        ({"observations": X.astype(str)}, "observations hold text, not numbers"),
        ({"observations": X[:, 0]}, r"x.npz: observations must be \(N, D\), not \(5,\); .*reshape\(-1, 1\)"),
        ({"observations": X.reshape(5, 2, 1)}, r"flatten each one"),
        ({"observations": [[1, 2], [3]]}, "rectangular"),
        ({"observations": X.astype(complex)}, "not complex128"),
        ({"observations": {"position": X}}, "rectangular"),
        ({"actions": np.array(["a", 1, "b", "c", "d"], dtype=object)}, "mix text with numbers"),
        ({"actions": np.zeros((5, 2), dtype=int)}, "combinations, as numpy.unique.actions, axis=0"),
        ({"actions": np.ones((5, 2, 2))}, "neither .N,. discrete nor .N, A. floats"),
        ({"actions": np.full(5, 2**63, dtype=np.uint64)}, "renumber"),
        ({"actions": ["a", "a\0", "b", "b", "b"]}, "actions hold the character NUL"),
        *(
            ({"actions": [first, second, 0, 0, 0]}, "actions hold whole numbers of over 64 bits")
            for first, second in ((2**63, -1), (2**70, 2**70 + 1))
        ),
        *(
            ({"ids": ["a", name]}, "the id of demonstration number 1 must be .* 1 to 1,000 characters of Unicode")
            for name in ("a\0", "", "b" * 1001, "\ud800")
        ),
        ({"ids": [0, 10**5000]}, "the id of demonstration number 1 must be a whole number of 64 bits"),
        ({"observation_names": np.array("uv")}, r"must be a list, not of shape \(\); name each"),
        ({"ids": ["a", "a"]}, "demonstration 'a' appears twice"),
        ({"ids": [0.5, 1]}, "all whole numbers or all text; convert them"),
        ({"ids": ["a"]}, "1 ids for 2 demonstrations"),
        ({"action_kind": "classes"}, "the actions are whole numbers, which cannot be classes; leave out"),
        ({"observation_names": ["u"]}, "name each of the 2"),
        ({"observation_names": ["u", "u"]}, "no two alike"),
    ],
)
def test_bad_arrays(changes, match):
    assert refusal(match, small, **changes).startswith("x.npz")


@pytest.mark.parametrize(
    ("second", "match"),
    [
        ((X, Y[:3]), r"demonstration 'b': 5 observations but 3 actions; .* after the last action has none"),
        ((X[:0], Y[:0]), "demonstration 'b': it has no steps"),
        ((X[:, 0], Y), r"demonstration 'b': observations must be \(N, D\)"),
        ((X[:, :1], Y), "demonstration 'b': its observations differ in width"),
        ((X, list("abcde")), "demonstration 'b': its actions differ"),
        ((X, np.ones((5, 2))), "demonstration 'b': its actions differ"),
        ((changed(X, 2, 0, np.nan), Y), "demonstration 'b', step 2: observation '0' is nan"),
        ((X, Y, Y), "one pair"),
    ],
)
def test_bad_episodes(second, match):
    refusal(match, Demonstrations.from_episodes, [(X, Y), second], ids=["a", "b"])


@pytest.mark.parametrize(
    ("X", "y", "groups", "match"),
    [
        (X, Y, [0, 0, 1], "one row per step"), (X, Y[:3], [0, 0, 1, 1, 1], "one row per step"),
        (X, Y, [0, 0, 1, 1, np.nan], "fill in the missing"), (X, Y, [0, 0, 1, 1, 0.5], "whole numbers or text"),
        (X, Y, np.array(["a", None, "a", "a", "a"], dtype=object), "mix text"), ([], [], [], "no demonstrations"),
    ],
)  # fmt: skip
def test_bad_groups(X, y, groups, match):
    refusal(match, Demonstrations.from_groups, X, y, groups)
