"""The data of one fit, by demonstration."""

import numpy as np
import pandas as pd
import pytest

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import Demonstrators, FitData, group_by_demonstrator, in_order
from rpil.data.spaces import Discrete

DATA = FitData(
    features=np.arange(12.0).reshape(6, 2),
    actions=np.array([0, 1, 2, 0, 1, 2]),
    offsets=np.array([0, 1, 3, 6]),
    space=Discrete(3),
    labels=np.array([1, 0, -1]),
)


def test_selected_demonstrations_keep_their_steps_and_labels():
    chosen = DATA.select(np.array([2, 0]))
    np.testing.assert_array_equal(chosen.offsets, [0, 3, 4])
    np.testing.assert_array_equal(chosen.features, DATA.features[[3, 4, 5, 0]])
    np.testing.assert_array_equal(chosen.actions, [0, 1, 2, 0])
    np.testing.assert_array_equal(chosen.labels, [-1, 1])


GIVEN = Demonstrations(np.ones((3, 1)), [0, 1, 0], [0, 1, 2, 3], ids=["a", "b", "c"], source="x.npz")


def test_demonstrators_inform_only_where_two_or_more_gave_two_or_more():
    for names, reason in (("aaaa", "One demonstrator, 'a', gave all"), ("abcd", "No demonstrator gave two")):
        assert not Demonstrators.from_names(names).informative
        assert reason in Demonstrators.from_names(names).note
    assert (Demonstrators.from_names("aab").informative, Demonstrators().note) == (True, "")
    assert not Demonstrators.from_names([None] * 4).informative  # unknown demonstrators are not one and the same
    assert Demonstrators.from_names(["a", None, "a", None]).index.tolist() == [0, 1, 0, 2]


def test_demonstrators_are_grouped_by_id_or_in_order():
    """A series of pandas names ids, unless its index counts and the ids do not."""
    series = pd.Series([7, "Ann", "Ann"], ["b", "c", "a"]), pd.Series(["Ann", 7, "Ann"])
    for given in ({"a": "Ann", "c": "Ann", "b": 7}, ["Ann", 7, "Ann"], np.array(["Ann", "7", "Ann"]), *series):
        assert group_by_demonstrator(given, GIVEN).index.tolist() == [0, 1, 0]
    assert in_order(pd.Series([*"abc"]), [2, 0, 1], "x", "it") == [*"cab"]  # by id, as groupby of a frame writes them
    assert group_by_demonstrator({"a": "Ann", "c": "Ann"}, GIVEN).names == ("Ann", None)
    assert not group_by_demonstrator(None, GIVEN).informative
    with pytest.warns(UserWarning, match=r"x\.npz: One demonstrator, 'Ann', gave all"):
        group_by_demonstrator(["Ann"] * 3, GIVEN)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (pd.Series("Ann", [*"dad"]), "no demonstration is called 'd'; the ids are"),
        (pd.Series("Ann", [*"abcc"]), "a demonstration has two values; correct the demonstrators"),
        (["Ann", "\ud800", "Bob"], "demonstration 'b': the demonstrator must be .* characters of Unicode"),
        (["Ann"], r"shape \(1,\); give one for each of the 3"),
    ],
)
def test_unknown_ids_and_other_counts_are_refused(given, message):
    with pytest.raises(DataError, match=message):
        group_by_demonstrator(given, GIVEN)
