"""Which demonstrations are read: by their ids, and without those in which values are missing."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from problems import refused

N, T = 6, 8


def table(ids=range(N), **columns) -> pa.Table:
    x = np.random.default_rng(0).normal(size=(N * T, 2))
    steps = {"episode_index": np.repeat(list(ids), T), "observation.x": x[:, 0], "action": x[:, 1]}
    return pa.table(steps | columns)


@pytest.fixture(params=[False, True])
def read(request, tmp_path):
    """Opens a table, in memory or on disk in row groups that demonstrations share."""

    def opened(rows: pa.Table, **options):
        pq.write_table(rows, tmp_path / "a.parquet", row_group_size=11)
        return rpil.open(tmp_path / "a.parquet", on_disk=request.param, **options)

    return opened


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"only": "0-2,5"}, [0, 1, 2, 5]), ({"only": (" 4 , 1 ",)}, [1, 4]), ({"only": range(2)}, [0, 1]),
        ({"without": np.int64(0)}, [1, 2, 3, 4, 5]), ({"only": np.flatnonzero([0, 1, 1])}, [1, 2]),
        ({"without": "3,0"}, [1, 2, 4, 5]), ({"only": "4-1", "without": 2}, [1, 3, 4]),
    ],
)  # fmt: skip
def test_ids_and_ranges(read, options, expected):
    opened = read(table(), **options)
    assert (list(opened.demonstrations.ids), opened.ids) == (expected, tuple(range(N)))
    assert opened.description.demonstrations == len(expected)


def test_a_range_takes_the_ids_between_its_ends_and_an_id_may_look_like_one_or_like_a_list(read):
    assert read(table([1, 30, 4, 20, 9, 10]), only="4-20").demonstrations.ids == (4, 20, 9, 10)
    assert read(table(["01", "30", "4", "20", "9", "x"]), only="01-9").demonstrations.ids == ("01", "4", "9")
    names = ["1-3", "1", "2", "3", "a,b", "a"]
    assert read(table(names), only="1-3").demonstrations.ids == ("1-3",)
    assert read(table(names), without=["a,b", "1,2"]).demonstrations.ids == ("1-3", "3", "a")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"only": "7"}, "no demonstration is called '7'; .* correct only="),
        ({"without": "0,x"}, "no demonstration is called 'x'; .* correct without="),
        ({"only": "4-99999999999"}, "no demonstration is called '99999999999'"),
        ({"only": "1", "without": [1]}, "leave no demonstration"),
    ],
)
def test_ids_that_are_not_there_are_refused(read, options, message):
    with refused(message):
        read(table(), **options)


def holed(kind: str) -> pa.Table:
    """A table in which demonstrations 1 and 4 have faults of a kind."""
    x = np.random.default_rng(1).normal(size=N * T)
    rows = {T + 3, 4 * T}
    if kind in ("nan", "inf"):
        return table(**{"observation.x": np.where(np.isin(np.arange(N * T), [*rows]), float(kind), x)})
    if kind == "action":
        return table(action=np.where(np.isin(np.arange(N * T), [*rows]), np.nan, x))
    if kind == "null of whole numbers":
        return table(**{"observation.n": pa.array([None if k in rows else k % 5 for k in range(N * T)], pa.int64())})
    if kind == "null of classes":
        return table(action=pa.array([None if k in rows else "ab"[k % 2] for k in range(N * T)]))
    faulty = {"null list": None, "short list": [1.0], "nan in list": [np.nan, 1.0]}[kind]
    lists = [faulty if k in rows else [x[k], -x[k]] for k in range(N * T)]
    return table(**{"observation.x": pa.array(lists, pa.list_(pa.float64()))})


KINDS = ("inf", "action", "null of whole numbers", "null of classes", "null list", "short list", "nan in list")


@pytest.mark.parametrize("kind", KINDS)
def test_demonstrations_with_missing_values_are_set_aside(read, kind):
    opened = read(holed(kind), skip_bad=True)
    assert opened.set_aside == (1, 4)
    found = opened.demonstrations.select(slice(None))
    assert found.ids == (0, 2, 3, 5)
    assert np.isfinite(found.observations).all()
    assert opened.description.notes == ("Set aside: 1, 4, because a value is missing or infinite.",)
    with refused():
        read(holed(kind)).demonstrations.select(slice(None))


def test_only_those_that_are_read_are_set_aside(read):
    opened = read(holed("nan"), skip_bad=True, only="0-3")
    assert (opened.demonstrations.ids, opened.set_aside) == ((0, 2, 3), (1,))
    asked = "4 of 6 demonstrations are read, as asked."
    assert opened.description.notes == (asked, "Set aside: 1, because a value is missing or infinite.")
    assert read(holed("nan"), skip_bad=True, without=[1, 4]).set_aside == ()
    with refused("in every demonstration a value is missing"):
        read(holed("nan"), skip_bad=True, only="1,4")


def test_what_is_read_into_memory_alone_warns_of_those_set_aside(tmp_path):
    pq.write_table(holed("nan"), tmp_path / "a.parquet")
    with pytest.warns(UserWarning, match=r"a\.parquet: Set aside: 1, 4, because"):
        assert rpil.read(tmp_path / "a.parquet", skip_bad=True).ids == (0, 2, 3, 5)
    with pytest.warns(UserWarning, match="Set aside"):
        assert rpil.read(holed("nan"), skip_bad=True, without="5").ids == (0, 2, 3)
    assert rpil.open(tmp_path / "a.parquet", without="0", skip_bad=True, on_disk=True).demonstrations.ids == (2, 3, 5)


def test_what_follows_from_the_steps_follows_those_that_are_read(read):
    """Actions of few values are discrete; the ranges and the tasks are those of what is read."""
    rows = table(action=np.repeat([0, 1, 0, 1, 500, 0], T), task=np.repeat(list("aabbcc"), T))
    described = read(rows, without="4").description
    assert (described.action_kind, described.tasks) == ("discrete", ("a", "b", "c"))
    assert read(rows, only="0,1").description.tasks == ("a",)
    x = rows["observation.x"].to_numpy()[:T]
    assert read(rows, only="0").description.ranges["x"] == (x.min(), x.max())
    assert read(rows, only="0,1", outcome="length").facts.outcomes[0].tolist() == [T, T]
