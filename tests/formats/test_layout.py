"""Which arrays columns make: names, widths, types."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from problems import refused
from rpil.data.errors import DataError
from rpil.formats.columns import Columns
from rpil.formats.layout import Layout

SINGLE = pa.list_(pa.float32())
STATE = pa.array([[1, 2], [3, 4]], SINGLE)


def layout(action, *observations, joints=None):
    names = tuple(f"obs.{k}" for k in range(len(observations)))
    table = pa.table({"action": action, **dict(zip(names, observations, strict=True))})
    return table, Layout.of(table, Columns("episode", ("action",), names, True), joints or {})


@pytest.mark.parametrize(
    ("action", "dtype", "n_parts"),
    [
        (pa.array([0, 1]), np.int64, 0),
        (pa.array(["left", "right"]), np.str_, 0),
        (pa.array([0.5, 1], pa.float32()), np.float32, 0),  # all steps decide whether these are classes
        (pa.array([[0], [1]]), np.int64, 0),
        (pa.array([[0.5], [1.0]]), np.float64, 1),
        (STATE, np.float32, 2),
    ],
)
def test_actions_by_type(action, dtype, n_parts):
    found = layout(action, STATE)[1]
    assert (found.action, found.n_parts) == (np.dtype(dtype), n_parts)


def test_a_list_has_a_name_for_each_number_and_missing_first_lists_are_passed_over():
    missing = pa.array([None, [5, 6]], SINGLE)
    found = layout(STATE, missing, pa.array([1.0, 2.0]), joints={"obs.0": ["a", "b"]})[1]
    assert found.names == {"obs.0": ("0.a", "0.b"), "obs.1": ("1",), "action": ("action.0", "action.1")}
    assert found.observation == np.float64 != layout(STATE, STATE)[1].observation


def test_lists_of_another_length_and_texts_are_named():
    found = layout(STATE, STATE)[1]
    longer, _ = layout(STATE, pa.array([[1, 2, 3], [4, 5, 6]], SINGLE))
    words, _ = layout(STATE, pa.array(["1", "fast"]))
    for table, message in ((longer, "holds 3 numbers, not 2"), (words, "row 1: column 'obs.0' holds text .'fast'")):
        with pytest.raises(DataError, match=message):
            found.fill(*found.empty(2), table, lambda row: f"row {row}")


NUMBERS = np.random.default_rng(0).normal(size=(40, 10))
EVERY = ("arm.0", "arm.1", "arm.2", "arm.3", "z", "actions.0", "actions.1", "actions.2")


def recorded(path, on_disk, **options):
    """A recording with lists of numbers, read with these options, and its numbers by name."""
    lists = {"observation.arm": NUMBERS[:, :4], "actions": NUMBERS[:, 5:8], "rewards": NUMBERS[:, 8:]}
    columns = {name: pa.array(block.tolist()) for name, block in lists.items()}
    rows = pa.table({"episode": np.repeat(range(4), 10), **columns, "observation.z": NUMBERS[:, 4]})
    pq.write_table(rows, path / "a.parquet")
    found = rpil.open(path / "a.parquet", on_disk=on_disk, **options)
    steps = found.demonstrations.select(slice(None))
    names = *steps.observation_names, *steps.action_names
    values = np.concatenate([steps.observations, steps.actions], axis=1)
    assert (*found.describe().observations, *found.describe().actions) == names
    return found, dict(zip(names, values.T, strict=True))


@pytest.mark.parametrize("on_disk", [False, True])
@pytest.mark.parametrize(
    ("options", "read"),
    [
        ({}, EVERY),
        ({"exclude": "arm.1"}, ("arm.0", "arm.2", "arm.3", "z", *EVERY[5:])),
        ({"exclude": "observation.arm.[12]"}, ("arm.0", "arm.3", "z", *EVERY[5:])),
        ({"exclude": ["ARM.0", "actions.*2", "z"]}, ("arm.1", "arm.2", "arm.3", "actions.0", "actions.1")),
        ({"exclude": "*.0"}, ("arm.1", "arm.2", "arm.3", "z", "actions.1", "actions.2")),
        ({"exclude": "a*.3,observation.z"}, ("arm.0", "arm.1", "arm.2", *EVERY[5:])),
        ({"exclude": "arm.*"}, ("z", *EVERY[5:])),
        ({"exclude": "arm"}, ("z", *EVERY[5:])),
        ({"observations": "arm.3,arm.0"}, ("arm.0", "arm.3", *EVERY[5:])),
        ({"observations": "*.3"}, ("arm.3", *EVERY[5:])),
        ({"observations": "z"}, ("z", *EVERY[5:])),
        ({"action": "actions.1"}, (*EVERY[:5], "actions.1")),
        ({"action": "actions.[02]", "exclude": "arm.*"}, ("z", "actions.0", "actions.2")),
        ({"action": "*.2", "observations": "z"}, ("z", "actions.2")),
    ],
    ids=str,
)
def test_every_name_that_is_printed_can_be_named(tmp_path, options, read, on_disk):
    found, values = recorded(tmp_path, on_disk, **options)
    assert tuple(values) == read
    whole = dict(zip(EVERY, NUMBERS.T, strict=False))
    for name, numbers in values.items():
        np.testing.assert_array_equal(numbers, whole[name])
        assert found.describe().ranges[name] == (numbers.min(), numbers.max())
    assert {*found.describe().ranges} == {*read}
    left_out = {name for name in EVERY if name not in read and "." in name}
    ignored = {name.removeprefix("observation.") for name in found.describe().ignored}
    assert all(name in ignored or name.split(".")[0] in ignored for name in left_out)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"exclude": "arm.9"}, "a.parquet: no column, nor a number in one, is called 'arm.9'.*found 'arm.3'"),
        ({"exclude": "arm.1,colour"}, "is called 'colour'"),
        ({"observations": "arm.9"}, "is called 'arm.9'"),
        ({"observations": "colour"}, "no column is called 'colour'; correct observations"),
        ({"action": "arms.1"}, "no column is called 'arms.1'; correct action"),
        ({"exclude": "actions.*"}, "leaves nothing of the action"),
        ({"exclude": "arm.*,z"}, "leaves nothing of the observations"),
    ],
)
def test_names_of_nothing_are_refused(tmp_path, options, message):
    with refused(message):
        recorded(tmp_path, False, **options)


def test_one_number_of_a_list_of_whole_numbers_is_an_amount(tmp_path):
    rows = {"episode": np.repeat(range(4), 10), "x": NUMBERS[:, 0], "action": [[k % 2, 7] for k in range(40)]}
    found = rpil.open(pa.table(rows), action="action.0").demonstrations
    assert found.actions.ravel().tolist() == [k % 2 for k in range(40)]


def test_what_is_missing_in_numbers_that_are_not_read_is_no_fault():
    lists = [[np.nan if k == 5 else 1.0, float(k)] for k in range(40)]
    rows = pa.table({"episode": np.repeat(range(4), 10), "obs": lists, "action": NUMBERS[:, 0]})
    assert rpil.open(rows, skip_bad=True).set_aside == (0,)
    found = rpil.open(rows, skip_bad=True, exclude="obs.0")
    assert (found.set_aside, found.describe().missing) == ((), {})
    np.testing.assert_array_equal(found.demonstrations.observations.ravel(), range(40))
