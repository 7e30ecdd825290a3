"""Columns that are chosen by their names, in memory and on disk, and files of a folder that do not fit together."""

import pickle
from itertools import chain, pairwise

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from problems import make, make_continuous, refused
from rpil.data.demonstrations import Demonstrations
from rpil.formats import table as flat
from rpil.formats.table import part_names


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """Hundreds of rows fill a batch."""
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 130)


def demonstrations(continuous=False):
    """120 demonstrations of 20 to 60 steps."""
    toy = (make_continuous if continuous else make)("random", 0, n_good=80, n_bad=40, steps=(20, 60))
    return Demonstrations(toy.observations, toy.actions, toy.offsets)


def written(folder, continuous=False):
    """Three files with the rows of `demonstrations`, which cut some of them."""
    folder.mkdir()
    table = flat.from_demonstrations(demonstrations(continuous), {})
    bounds = np.linspace(0, len(table), 4).astype(int)
    for k, (begin, end) in enumerate(pairwise(bounds)):
        pq.write_table(table.slice(begin, end - begin), folder / f"{k}.parquet", row_group_size=333)
    return folder


@pytest.mark.parametrize("continuous", [False, True])
def test_blocks_of_shards_that_are_sent_are_those_in_memory(tmp_path, continuous):
    data = rpil.open(written(tmp_path / "many", continuous), on_disk=True).demonstrations
    sent = [pickle.dumps(shard) for shard in data.shards(4, 700)]
    assert max(map(len, sent)) < 4000
    blocks = chain(*map(pickle.loads, sent))
    for ours, theirs in zip(blocks, chain(*demonstrations(continuous).shards(4, 700)), strict=True):
        assert ours.first == theirs.first
        for name in ("observations", "actions", "offsets"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_files_with_other_columns_or_of_another_kind_are_refused(tmp_path):
    table = flat.from_demonstrations(demonstrations(), {})
    folder = written(tmp_path / "many")
    names = [name.replace("observation.1", "observation.x") for name in table.column_names]
    pq.write_table(table.rename_columns(names), folder / "3.parquet")
    which = "without 'observation.1' and with 'observation.x'"
    with refused(rf"3.parquet: its columns are not those of 0.parquet .{which}.; .* take it out"):
        rpil.open(folder, on_disk=True)
    (folder / "3.parquet").write_bytes(b"PAR1 this is none PAR1")
    with refused(r"^many: damaged, .*: 3\.parquet; .* skip_bad=True\.$"):
        rpil.open(folder, on_disk=True)
    (tmp_path / "empty").mkdir()
    with refused(r"no \.parquet or \.csv file is there"):
        rpil.open(tmp_path / "empty", on_disk=True)


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
    assert (*found.description.observations, *found.description.actions) == names
    return found, dict(zip(names, values.T, strict=True))


@pytest.mark.parametrize("on_disk", [False, True])
@pytest.mark.parametrize(
    ("options", "read"),
    [
        ({}, EVERY),
        ({"exclude": "observation.arm.[12]"}, ("arm.0", "arm.3", "z", *EVERY[5:])),
        ({"exclude": ["ARM.0", "actions.*2", "z"]}, ("arm.1", "arm.2", "arm.3", "actions.0", "actions.1")),
        ({"exclude": "a*.3,observation.z"}, ("arm.0", "arm.1", "arm.2", *EVERY[5:])),
        ({"exclude": "arm.*"}, ("z", *EVERY[5:])),
        ({"observations": "arm.3,arm.0"}, ("arm.3", "arm.0", *EVERY[5:])),
        ({"observations": "*.3"}, ("arm.3", *EVERY[5:])),
        ({"action": "actions.1"}, (*EVERY[:5], "actions.1")),
        ({"action": "actions.[02]", "exclude": "arm.*"}, ("z", "actions.0", "actions.2")),
    ],
    ids=str,
)
def test_every_name_that_is_printed_can_be_named(tmp_path, options, read, on_disk):
    found, values = recorded(tmp_path, on_disk, **options)
    assert tuple(values) == read
    whole = dict(zip(EVERY, NUMBERS.T, strict=False))
    for name, numbers in values.items():
        np.testing.assert_array_equal(numbers, whole[name])
        assert found.description.ranges[name] == (numbers.min(), numbers.max())
    assert {*found.description.ranges} == {*read}
    left_out = {name for name in EVERY if name not in read and "." in name}
    ignored = {name.removeprefix("observation.") for name in found.description.ignored}
    assert all(name in ignored or name.split(".")[0] in ignored for name in left_out)


def test_what_is_missing_in_numbers_that_are_not_read_is_no_fault():
    lists = [[np.nan if k == 5 else 1.0, float(k)] for k in range(40)]
    rows = pa.table({"episode": np.repeat(range(4), 10), "obs": lists, "action": NUMBERS[:, 0]})
    assert rpil.open(rows, skip_bad=True).set_aside == (0,)
    found = rpil.open(rows, skip_bad=True, exclude="obs.0")
    assert (found.set_aside, found.description.missing) == ((), {})
    np.testing.assert_array_equal(found.demonstrations.observations.ravel(), range(40))


@pytest.mark.parametrize("names", [("a", "a", "b"), ("a", "b"), ("a", "b", "c", "c")])
def test_names_that_are_not_one_for_each_number_are_not_used(names):
    assert part_names("obs", 3, names) == ("obs.0", "obs.1", "obs.2")
