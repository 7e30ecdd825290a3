import os

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from problems import refused_file
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.formats.table import first_rows, kinds_of

SUFFIXES = [".parquet", ".csv", ".npz"]
NASTY = [[0.1, -0.0], [np.nextafter(1, 2), 5e-324], [1e308, -1 / 3], [0.0, 2.0**60], [np.pi, 1e-17]]


def demonstrations(dtype=np.float64, **changes):
    with np.errstate(over="ignore", under="ignore"):
        observations = np.clip(NASTY, -1e38, 1e38).astype(dtype) if dtype == np.float32 else np.array(NASTY)
    arguments = {"actions": [1, 0, 2, 1, 0], "offsets": [0, 2, 5], "ids": ["b,\"'é", "a"]} | changes
    return Demonstrations(observations, **arguments)


def same(one, other, dtype=None):
    assert (one.ids, one.observation_names) == (other.ids, other.observation_names)
    np.testing.assert_array_equal(one.offsets, other.offsets)
    for a, b in ((one.observations, other.observations), (one.actions, other.actions)):
        a = a.astype(dtype) if dtype and a.dtype == np.float32 else a
        assert (a.shape, a.dtype.kind) == (b.shape, b.dtype.kind)
        assert a.dtype == b.dtype or a.dtype.kind == "U"
        assert a.tolist() == b.tolist()
        if a.dtype.kind == "f":
            assert a.tobytes() == b.tobytes()  # -0.0 is 0.0 to ==


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"ids": [7, -3], "observation_names": ["x pos", "v"]},
        {"actions": ["left", "right", "a,b", 'q"', "left"]},
        {"actions": np.array([[0.5, 1], [1, 2], [0.1, -0.0], [1, 1], [2, 2]])},
        {"actions": np.array([[0.5, 1], [1, 2], [0.1, -0.0], [1, 1], [2, 2]], dtype=np.float32)},
        {"actions": np.ones((5, 1))},
    ],
)
def test_round_trip(tmp_path, suffix, dtype, changes):
    path = tmp_path / f"x{suffix}"
    original = demonstrations(dtype, **changes)
    formats.write(path, original, truth={"is_good": [1, 0], "anything": [0.5, 0.25], "who": ["p", "q"]})
    back = formats.read(str(path))
    same(original, back, dtype=np.float64 if suffix == ".csv" else None)
    assert (back.source, os.listdir(tmp_path)) == (path.name, [path.name])


def write_table(path, **columns):
    table = columns.pop("table", None) or pa.table(columns)
    (pq.write_table if path.suffix == ".parquet" else pa.csv.write_csv)(table, path)
    return path


def columns(**changes):
    good = {"episode_index": [3, 1, 3], "obs_x": [1.0, 2.0, 3.0], "obs_y": [4, 5, 6], "action": [0, 1, 2]}
    return {name: values for name, values in (good | changes).items() if values is not None}


@pytest.fixture(params=[".parquet", ".csv"])
def path(request, tmp_path):
    return tmp_path / f"x{request.param}"


def test_csv_ids_are_numbers_only_where_that_loses_nothing(tmp_path):
    path = write_table(tmp_path / "x.csv", **columns(episode_index=["01", "1", "01"], action=["1.0", "2", "1e0"]))
    d = formats.read(path)
    assert d.ids == ("01", "1")
    assert d.actions.tolist() == [1, 1, 2]
    large = [str(2**63), str(2**63 + 1), "1"]  # the same float
    for texts, are in ((large, str), (["-0", "1", "2"], str), (["0", "-1", str(1 - 2**63)], int)):
        assert formats.read(write_table(path, **columns(episode_index=texts))).ids == tuple(map(are, texts))


@pytest.mark.parametrize("kind", [pa.list_(pa.float32()), pa.large_list(pa.float32()), pa.list_(pa.float32(), 2)])
def test_list_columns_as_in_lerobot(tmp_path, kind):
    table = pa.table(
        {
            "observation.state": pa.array([[1, 2], [3, 4], [5, 6]], type=kind),
            "action": pa.array([[0.5, 1], [2, 3], [4, 5]], type=kind),
            **{name: [0, 1, 2] for name in ("timestamp", "frame_index", "index", "task_index")},
            "episode_index": [0, 0, 1],
            "next.done": [False, True, True],
        }
    )
    d = formats.read(write_table(tmp_path / "x.parquet", table=pa.concat_tables([table, table.slice(2)])))
    assert d.observations.tolist() == [[1, 2], [3, 4], [5, 6], [5, 6]]
    assert d.observations.dtype == d.actions.dtype == np.float32
    assert d.actions.tolist() == [[0.5, 1], [2, 3], [4, 5], [4, 5]]
    assert d.observation_names == ("state.0", "state.1")
    formats.write(tmp_path / "y.parquet", d)
    same(d, formats.read(tmp_path / "y.parquet"))


def test_other_parquet_types(tmp_path):
    table = pa.table(
        {
            "episode_index": pa.array(["b", "a", "b"]).dictionary_encode(),
            "observation": pa.array([[1], [2], [3]], type=pa.list_(pa.int8())),
            "observation_2": [True, False, True],
            "observation_3": pa.array([1, 2, 3]).cast(pa.decimal128(20, 1)),
            "observation_4": pa.array([0.5, 1.5, 2.5], pa.float32()),
            "action": pa.array([[0], [1], [2]]),
        }
    )
    d = formats.read(write_table(tmp_path / "x.parquet", table=table))
    assert d.ids == ("b", "a")
    assert d.observations.tolist() == [[1, 1, 1, 0.5], [3, 1, 3, 2.5], [2, 0, 2, 1.5]]
    assert (d.observations.dtype, d.actions.tolist()) == (np.float64, [0, 2, 1])


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"obs_y": ["1", "n/a?", "3"]}, "demonstration 1, row 2: column 'obs_y' holds text ('n/a\\?'), not numbers"),
        ({"obs_y": [1.0, None, 3.0]}, "demonstration 1, row 2: column 'obs_y' has no value"),
        ({"action": [0, None, 1]}, "demonstration 1, row 2: column 'action' has no value"),
        ({"episode_index": [1, None, 2]}, "row 2: column 'episode_index' has no value"),
        ({"obs_x": [pa.scalar(0).cast(pa.timestamp("s"))] * 3}, "column 'obs_x' holds timestamp"),
    ],
)
def test_bad_tables(path, changes, match):
    match = match.replace("(", r"\(").replace(")", r"\)")
    refused_file(match, formats.read, write_table(path, **columns(**changes)))


def test_repeated_columns(path):
    table = pa.table([[1, 1], [2, 3], [4, 5], [0, 1]], names=["episode_index", "obs_x", "obs_x", "action"])
    refused_file("column 'obs_x' appears twice", formats.read, write_table(path, table=table))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"obs_x": [[1.0, 2.0], [1.0], [1.0, 2.0]]}, "demonstration 1, row 2: column 'obs_x.0' has no value"),
        ({"obs_x": [[1.0, 2.0], None, [1.0, 2.0]]}, "demonstration 1, row 2: column 'obs_x.0' has no value"),
        ({"obs_x": pa.array([[]] * 3, pa.list_(pa.float64())), "obs_y": None}, "'obs_x' .nested.*; nested ones are"),
        ({"obs_x": [[[1.0]]] * 3, "obs_y": None}, "no column holds observations: .*; nested ones .* pass the rows to"),
        ({"action": [[[1.0]]] * 3}, "no column holds the action: .*'action' .nested..; nested ones are no"),
        ({"episode_index": [1.0, np.nan, 1.0]}, "fill in the missing"),
        ({"episode_index": [[1], [2], [3]]}, "no column says which demonstration"),
    ],
)
def test_bad_parquet_tables(tmp_path, changes, match):
    refused_file(match, formats.read, write_table(tmp_path / "x.parquet", **columns(**changes)))


def test_observations_that_are_nested_are_noted_where_other_columns_are_read(tmp_path):
    path = write_table(tmp_path / "x.parquet", **columns(obs_x=[{"a": [1.0]}] * 3, obs_y=None, speed=[1.0, 2.0, 3.0]))
    said = "No observation of obs_x is read, because of images or nested values; other columns are, instead."
    assert formats.open(path).description.notes == (said,)


def npz(path, **changes):
    arrays = {"observations": np.ones((3, 2)), "actions": [0, 1, 0], "episode_ids": [0, 0, 1], "rewards": [1, 2, 3]}
    np.savez(path, **{name: values for name, values in (arrays | changes).items() if values is not None})
    return path


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"actions": np.array([0, 1, None], dtype=object)}, "never unpickled .* numpy.asarray"),
        ({"episode_ids": None}, "nothing says where demonstrations begin .* or one called episode_index"),
        ({"observations": None, "episode_ids": None}, "name the array of observations with observations="),
        ({"actions": [0, 1]}, r"episode_ids has the shape \(3,\) for 2 actions; give one id for each"),
        ({"actions": None}, "no column holds the action: name it action, .*'episode_ids', 'rewards'"),
    ],
)
def test_bad_npz(tmp_path, changes, match):
    refused_file(match, formats.read, npz(tmp_path / "x.npz", **changes))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_bad_truth(tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    for name in ("action_noise", "observation.x", "episode_index", "actions", "step_index"):
        refused_file("would be taken for data", formats.write, path, demonstrations(), {name: [0, 1]})
    refused_file("one value for each of 2", formats.write, path, demonstrations(), {"is_good": [0]})
    assert not path.exists()


def test_texts_of_which_half_are_numbers_are_mixed_and_pairs_are_found_at_their_first_rows():
    for texts, kind in ((["1", "x"], "mixed"), (["1", "x", "y"], "text"), (["1", "1", "x", "y"], "text")):
        assert kinds_of(pa.table({"a": texts})) == {"a": kind}
    rng = np.random.default_rng(0)
    for n in (2, 5):
        group, codes = rng.integers(0, n, 60), rng.integers(-1, n, 60)  # -1 is no value
        pairs = [*zip(group.tolist(), codes.tolist(), strict=True)]
        assert first_rows(group, codes).tolist() == [k for k, pair in enumerate(pairs) if pair not in pairs[:k]]
