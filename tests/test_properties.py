"""Properties of every audit: what changes nothing of the demonstrations changes no word about them.

Sets are drawn by hypothesis: careful people beside careless ones or ones with another rule, in classes or numbers.
``RPIL_EXAMPLES=100`` draws more of them for each property than the few of every day.
"""

from __future__ import annotations

import os

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from small import small_rpil

pytest.importorskip("hypothesis", reason="hypothesis is not installed: pip install 'rpil[dev]'")
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.slow
PHASES = (Phase.explicit, Phase.generate)  # to shrink takes a hundred audits, and a seed is small already
N_EXAMPLES = int(os.environ.get("RPIL_EXAMPLES", "4"))
FEW = settings(
    max_examples=N_EXAMPLES, deadline=None, derandomize=True, phases=PHASES, suppress_health_check=list(HealthCheck)
)


class Drawn(tuple):
    """A set, which is told in a line where a property fails."""

    def __repr__(self) -> str:
        return f"<{self[3]} good of {self[2].max() + 1}, {self[1].dtype}, first {self[0][0, 0]:.6f}>"


@st.composite
def sets(draw, n_bad=st.integers(0, 5)):
    """Observations, actions and ids of some demonstrations, and the number of good ones, which come first."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    good, bad = draw(st.integers(8, 14)), draw(n_bad)
    lengths = rng.integers(20, 40, good + bad)
    ids = np.repeat(np.arange(good + bad), lengths)
    states = rng.normal(size=(len(ids), 3))
    rule = states @ rng.normal(size=3)
    wrong = rng.normal(size=len(ids)) if draw(st.booleans()) else -rule
    acted = np.where(ids < good, rule, wrong) + 0.1 * rng.normal(size=len(ids))
    actions = (acted > 0).astype(int) if draw(st.booleans()) else acted[:, None]
    return Drawn((states, actions, ids, good))


def words(data: rpil.Demonstrations) -> dict[object, str]:
    audit = rpil.audit(data)
    return dict(zip(audit.ids, audit.verdicts, strict=True)) | {"finding": audit.finding}


def made(states, actions, ids) -> rpil.Demonstrations:
    return rpil.Demonstrations.from_groups(states, actions, ids)


@FEW
@given(sets(), st.integers(0, 1000))
def test_order_and_names_of_demonstrations_change_no_word(drawn, seed):
    states, actions, ids, _ = drawn
    rng = np.random.default_rng(seed)
    order, names = rng.permutation(ids.max() + 1), rng.permutation(1000)
    rows = np.concatenate([np.flatnonzero(ids == m) for m in order])
    once = words(made(states, actions, ids))
    renamed = {"finding": once["finding"]} | {names[m]: once[m] for m in order}
    assert words(made(states[rows], actions[rows], names[ids[rows]])) == renamed


@FEW
@given(sets(), st.permutations(["shoulder", "elbow", "wrist", "hip", "knee"]), st.integers(1, 4))
def test_columns_and_files_change_no_word(tmp_path_factory, drawn, names, n_files):
    states, actions, ids, _ = drawn
    columns = {"episode": ids, **dict(zip("abc", states.T, strict=True)), "action": actions.reshape(-1)}
    folder, table = tmp_path_factory.mktemp("files"), pa.table(columns)
    pq.write_table(table, folder / "one.parquet")
    renamed = table.rename_columns(["episode", *names[:3], "action"])
    renamed = renamed.select(sorted(renamed.column_names, key=[*names, "action", "episode"].index))
    (folder / "many").mkdir()
    for k in range(n_files):
        pq.write_table(renamed.filter(ids * n_files // (ids.max() + 1) == k), folder / "many" / f"{names[k]}.parquet")
    assert words(folder / "many") == words(folder / "one.parquet")


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="distributed is not installed: pip install 'rpil[dask]'")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options) as local, distributed.Client(local, set_as_default=False) as client:
        yield client


@settings(FEW, max_examples=(N_EXAMPLES + 1) // 2)
@given(sets(), st.integers(0, 1000))
def test_memory_disk_and_a_cluster_change_no_word(tmp_path_factory, cluster, drawn, seed):
    """Of demonstrations that are many for the judge, which reads a sample."""
    states, actions, ids, _ = drawn
    moved = np.random.default_rng(seed).normal(scale=0.01, size=(12, *states.shape))
    more = np.concatenate([ids + k * (ids.max() + 1) for k in range(12)])
    data = made((states + moved).reshape(-1, 3), np.concatenate([actions] * 12), more)
    path = tmp_path_factory.mktemp("places") / "set.parquet"
    rpil.write(path, data)
    here = small_rpil().fit(data).audit_
    engines = None, rpil.DaskEngine(cluster)
    disk, there = (small_rpil(engine=engine).fit(rpil.open(path, on_disk=True)).audit_ for engine in engines)
    assert (here.finding, here.verdicts) == (disk.finding, disk.verdicts) == (there.finding, there.verdicts)


@FEW
@given(sets(), st.lists(st.sampled_from([0.001, 0.0254, 1.0, 57.3, 1000.0]), min_size=4, max_size=4))
def test_units_change_no_word(drawn, units):
    states, actions, ids, _ = drawn
    scaled = actions if actions.dtype == int else actions * units[3]
    assert words(made(states * units[:3] + np.multiply(units[:3], 5), scaled, ids)) == words(made(states, actions, ids))


@FEW
@given(sets())
def test_single_precision_changes_no_word(drawn):
    states, actions, ids, _ = drawn
    states = states.astype(np.float32)  # the same numbers, in either precision
    assert words(made(states, actions, ids)) == words(made(states.astype(float), actions, ids))


@FEW
@given(sets(n_bad=st.integers(1, 4)))
def test_doubling_all_turns_nothing(drawn):
    states, actions, ids, _ = drawn
    once, n = words(made(states, actions, ids)), ids.max() + 1
    twice = words(made(np.tile(states, (2, 1)), np.concatenate([actions, actions]), np.concatenate([ids, ids + n])))
    assert twice["finding"] == once["finding"]
    assert {m: twice[m] for m in range(n)} == {m: twice[m + n] for m in range(n)} == {m: once[m] for m in range(n)}


@FEW
@given(sets(n_bad=st.just(0)), st.integers(0, 1000))
def test_one_more_good_one_ranks_above_a_random_one(drawn, seed):
    states, actions, ids, good = drawn
    rng = np.random.default_rng(seed)
    last = np.flatnonzero(ids == good - 1)
    chance = rng.permutation(actions[last]) if actions.dtype == int else rng.normal(size=(len(last), 1)) * actions.std()
    rows = np.concatenate([np.arange(len(ids)), last])
    more = np.concatenate([ids, np.full(len(last), good)])
    audit = rpil.audit(made(states[rows] + 0.0, np.concatenate([actions, chance]), more))
    assert audit.log_odds[good] <= audit.log_odds[good - 1]
