"""Steps that are cut when demonstrations are kept: what else the formats say of these."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.ipc
import pyarrow.parquet as pq
import pytest

import rpil
import samples
from samples import FRAMES, LENGTHS, MOVES, OWNERS, STATES

IS_LAST = np.isin(np.arange(len(OWNERS)), np.cumsum(LENGTHS) - 1)
TRIMS = {0: (1, 3), 2: (0, 4)}
IS_KEPT = np.concatenate([np.isin(np.arange(n), np.arange(*TRIMS.get(m, (0, n)))) for m, n in enumerate(LENGTHS)])
NEW_LAST = np.cumsum([2, 6, 4]) - 1


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.parquet"])
@pytest.mark.parametrize("is_shuffled", [False, True])
def test_steps_of_a_table_are_counted_as_they_are_read(tmp_path, name, is_shuffled, monkeypatch):
    monkeypatch.setattr("rpil.formats.parquet.BATCH_ROWS", 5)
    columns = {"episode_index": OWNERS, "frame_index": FRAMES, "x": STATES[:, 0], "action": MOVES[:, 0]}
    table = pa.table(columns | {"next.done": IS_LAST, "note": [f"n, {row}" for row in range(len(OWNERS))]})
    rows = np.random.default_rng(0).permutation(len(OWNERS)) if is_shuffled else np.arange(len(OWNERS))
    path, output = tmp_path / name, tmp_path / f"kept{name[1:]}"
    if name == "a.parquet":
        pq.write_table(table.take(rows), path)
    else:
        lines = [
            ",".join(f'"{one}"' if isinstance(one, str) else str(one) for one in row.values())
            for row in table.take(rows).to_pylist()
        ]
        text = "# recorded on Monday\n" + "\n".join([",".join(table.column_names), *lines])
        path.write_bytes(text.encode() if name == "a.csv" else samples.gzip.compress(text.encode()))
    rpil.open(path).keep([0, 1, 2], output, TRIMS)
    found = rpil.open(output)
    ids = [*dict.fromkeys(OWNERS[rows].tolist())]
    assert {*found.ids} == {*ids}
    order = np.concatenate([np.flatnonzero(IS_KEPT & (m == OWNERS)) for m in found.ids])
    np.testing.assert_array_equal(found.demonstrations.observations[:, 0], STATES[order, 0])
    np.testing.assert_array_equal(found.demonstrations.actions[:, 0], MOVES[order, 0])
    kept = pq.read_table(output).to_pylist() if name == "a.parquet" else samples_of(output)
    by_step = {(int(row["episode_index"]), int(row["frame_index"])): row for row in kept}
    assert len(by_step) == len(kept) == IS_KEPT.sum()
    done = sorted(step for step, row in by_step.items() if str(row["next.done"]) == "True")
    assert done == [(0, 2), (1, 5), (2, 3)]
    for (m, frame), row in by_step.items():
        assert row["note"] == f"n, {np.flatnonzero((m == OWNERS) & (frame == FRAMES))[0]}"


def samples_of(path) -> list[dict[str, str]]:
    """The rows of a text table below its comment."""
    import csv
    import gzip

    with (gzip.open if path.suffix == ".gz" else open)(path, "rt", newline="") as text:
        assert next(text) == "# recorded on Monday\n"
        return [*csv.DictReader(text)]


def test_a_group_of_hdf5_says_how_many_steps_it_has(tmp_path):
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    import hdf5_files

    path, output = hdf5_files.robomimic(tmp_path / "a.hdf5", extra=1), tmp_path / "kept.hdf5"
    with h5py.File(path, "r+") as file:
        file["data/demo_2/dones"][-1] = 1
        file["data/demo_2/obs"].attrs["camera"] = "front"
    rpil.open(path).keep(["demo_0", "demo_2"], output, {"demo_2": (2, 8), "demo_10": (0, 3)})
    with h5py.File(path) as old, h5py.File(output) as new:
        demo, before = new["data/demo_2"], old["data/demo_2"]
        assert {**demo.attrs} == {**before.attrs, "num_samples": 6}
        assert (new["data"].attrs["total"], demo["obs"].attrs["camera"]) == (16, "front")
        assert demo["dones"][:].tolist() == [0] * 5 + [1]
        for name in ("actions", "states", "next_obs/gripper"):
            np.testing.assert_array_equal(demo[name], before[name][2:8])
        for name in ("gripper", "agentview_image"):  # of which one comes after the last action
            np.testing.assert_array_equal(demo["obs"][name], before["obs"][name][2:9])
        np.testing.assert_array_equal(demo["initial_state/root_pose"], before["initial_state/root_pose"])


def test_marks_of_zarr_are_moved(tmp_path):
    zarr = pytest.importorskip("zarr", reason="needs the extra zarr")
    path = samples.zarr(2, False)(tmp_path)
    zarr.open_group(path).create_array("data/terminals", data=IS_LAST, chunks=(1,))
    rpil.open(path).keep([0, 1, 2], tmp_path / "kept.zarr", TRIMS)
    new = zarr.open_group(tmp_path / "kept.zarr", mode="r")
    assert new["meta/episode_ends"][:].tolist() == (NEW_LAST + 1).tolist()
    assert np.flatnonzero(new["data/terminals"][:]).tolist() == NEW_LAST.tolist()


def test_trims_of_unknown_demonstrations_are_refused_and_of_others_ignored(tmp_path):
    path = samples.written("a.csv")(tmp_path)
    with pytest.raises(rpil.DataError, match="no demonstration is called '7'"):
        rpil.open(path).keep([0], tmp_path / "b.csv", {7: (0, 1)})
    rpil.open(path, only=[0, 1]).keep([0], tmp_path / "b.csv", {1: (0, 1), 2: (0, 1)})
    assert (tmp_path / "b.csv").read_bytes().splitlines() == path.read_bytes().splitlines()[: 1 + LENGTHS[0]]
