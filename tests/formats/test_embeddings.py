"""Numbers of the user's own for each step, joined on `index`."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from samples import OWNERS, lerobot

N = len(OWNERS)


@pytest.mark.parametrize("name", ["e.npz", "e.parquet"])
@pytest.mark.parametrize("on_disk", [False, True])
def test_they_become_observations_of_the_step_with_their_index(tmp_path, name, on_disk):
    root, rng = lerobot(tmp_path), np.random.default_rng(0)
    values, order = rng.normal(size=(N, 3)).astype(np.float32), rng.permutation(N + 4)
    values = np.concatenate([values, np.zeros((4, 3), np.float32)])  # of steps that are not in the data
    if name.endswith("npz"):
        np.savez(tmp_path / name, index=order, dino=values[order])
    else:
        pq.write_table(pa.table({"index": order, "dino": values[order].tolist()}), tmp_path / name)
    options = ColumnOptions(embeddings=str(tmp_path / name))
    recording = formats.read_recording(root, options, on_disk=on_disk)
    found = recording.demonstrations
    assert found.observation_names == recording.description.observations
    assert found.observation_names[-3:] == ("dino.0", "dino.1", "dino.2")
    np.testing.assert_array_equal(found.observations[:, -3:], values[:N])
    plain = rpil.read(root)
    np.testing.assert_array_equal(found.observations[:, :-3], plain.observations)
    assert found.ids == plain.ids
    if not on_disk:
        np.testing.assert_array_equal(rpil.read(root, embeddings=tmp_path / name).observations, found.observations)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"index": range(N - 1), "e": range(N - 1)}, f"1 steps are not in it, the first is {N - 1}"),
        ({"index": [0, *range(N)], "e": range(N + 1)}, "twice"),
        ({"index": range(N), "e": [np.nan] * N}, "missing"),
        ({"e": range(N)}, "needs a column 'index'"),
        ({"index": range(N)}, "others of numbers"),
        ({"index": range(N), "e": np.zeros((2, N))}, rf"e\.npz: 'e' has 2 rows, and 'index' has {N}"),
        ({"index": range(N), "e": np.zeros((3, N, 2))}, "'e' has 3 rows"),
        ({"index": np.arange(N) + 0.7, "e": range(N)}, r"e\.npz: 'index' needs one whole number in each row"),
        ({"index": [np.nan, *range(1, N)], "e": range(N)}, "one whole number"),
        ({"index": [np.inf, *range(1, N)], "e": range(N)}, "one whole number"),
        ({"index": np.zeros((N, 2)), "e": range(N)}, "one whole number"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path, columns, message):
    root, file = lerobot(tmp_path), tmp_path / "e.npz"
    np.savez(file, **{name: np.array(values) for name, values in columns.items()})
    with pytest.raises(DataError, match=message):
        rpil.read(root, embeddings=file)


def test_a_name_that_the_data_have_is_refused(tmp_path):
    root, file = lerobot(tmp_path), tmp_path / "e.npz"
    name = rpil.read(root).observation_names[0]
    np.savez(file, **{"index": np.arange(N), name: np.arange(N)})
    with pytest.raises(DataError, match=rf"e\.npz: lerobot has an observation '{name}' as well; give it another name"):
        rpil.read(root, embeddings=file)


@pytest.mark.parametrize("damage", [None, [1.0]])
def test_a_list_that_is_missing_or_short_is_not_left_out(tmp_path, damage):
    root, rows = lerobot(tmp_path), [[1.0, 2.0]] * (N - 1)
    table = pa.table({"index": range(N), "e": [damage, *rows], "other": range(N), "text": ["a"] * N})
    pq.write_table(table, tmp_path / "e.parquet")
    with pytest.raises(DataError, match=r"e\.parquet: column 'e' needs a list of as many numbers in each row"):
        rpil.read(root, embeddings=tmp_path / "e.parquet")
    pq.write_table(table.drop_columns(["e"]), tmp_path / "e.parquet")
    assert rpil.read(root, embeddings=tmp_path / "e.parquet").observation_names[-1] == "other"


def test_data_without_an_index_cannot_be_joined(tmp_path):
    np.savez(tmp_path / "e.npz", index=np.arange(4), e=np.arange(4))
    pq.write_table(
        pa.table({"episode": [0, 0, 1, 1], "x": np.arange(4.0), "action": np.arange(4.0)}), tmp_path / "t.parquet"
    )
    with pytest.raises(DataError, match="no column 'index'"):
        rpil.read(tmp_path / "t.parquet", embeddings=tmp_path / "e.npz")
    with pytest.raises(DataError, match="unknown extension"):
        rpil.read(tmp_path / "t.parquet", embeddings=tmp_path / "t.csv")
