"""What is said of a file, the order of its rows, and the numbers that the file gives them."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.formats import read_recording, write_weights
from rpil.formats.columns import ColumnOptions

M, T = 6, 30
N = M * T
STATE = np.random.default_rng(0).normal(size=(N, 2)).astype(np.float32)
TABLE = pa.table(
    {
        "episode_index": np.repeat(np.arange(M), T),
        "frame_index": np.tile(np.arange(T), M),
        "index": np.arange(N),
        "timestamp": np.tile(np.arange(T) / 10, M),
        "observation.state": list(STATE),
        "observation.image": [{"bytes": b""}] * N,
        "operator": np.repeat(["Ann", "Bob"], N // 2),
        "task_index": np.zeros(N, int),
        "next.reward": np.ones(N),
        "action": np.arange(N) % 3,
    }
)


@pytest.fixture
def folder(tmp_path):
    """A data set as LeRobot writes it."""
    (tmp_path / "set" / "data" / "chunk-000").mkdir(parents=True)
    (tmp_path / "set" / "meta").mkdir()
    pq.write_table(TABLE, tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet")
    pq.write_table(pa.table({"task_index": [0], "task": ["push"]}), tmp_path / "set" / "meta" / "tasks.parquet")
    features = {"observation.state": {"shape": [2], "names": ["hip.pos", "knee.pos"]}, "front": {"dtype": "video"}}
    info = {"codebase_version": "v3.0", "fps": 20, "features": features}
    (tmp_path / "set" / "meta" / "info.json").write_text(json.dumps(info))
    return tmp_path / "set"


@pytest.mark.parametrize("on_disk", [False, True])
def test_description_of_a_data_set_of_lerobot(folder, on_disk):
    said = read_recording(folder, on_disk=on_disk).description
    assert (said.format, said.demonstrations, said.steps) == ("LeRobot v3.0", M, N)
    assert (said.seconds, said.fps, said.tasks) == (9.0, 20.0, ("push",))
    assert said.observations == ("state.hip.pos", "state.knee.pos")
    assert (said.actions, said.action_kind) == (("action",), "discrete")
    assert (said.id_column, said.order_column, said.operators) == ("episode_index", "frame_index", ("Ann", "Bob"))
    why = {"observation.image": "images or nested values", "next.reward": "reward, end or verdict", "front": "video"}
    assert why == {name: said.ignored[name] for name in why}
    json.dumps(said.to_dict())


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_rows_are_sorted_by_their_column_and_weights_find_them(tmp_path, suffix):
    table = TABLE.drop_columns(["observation.image", "observation.state"]).append_column(
        "x", [STATE[:, 0].astype(float)]
    )
    table = table.take(np.random.default_rng(1).permutation(N))
    (pq.write_table if suffix == ".parquet" else pa.csv.write_csv)(table, tmp_path / f"a{suffix}")
    recording = read_recording(tmp_path / f"a{suffix}")
    d = recording.demonstrations
    assert "sorted by frame_index" in recording.description.order
    weight = np.arange(N, dtype=float)
    each = np.zeros(M)
    write_weights(tmp_path / "w.parquet", d.ids, d.offsets, weight, each, each, recording.step_columns)
    weights = pq.read_table(tmp_path / "w.parquet")
    assert set(weights.column_names[:4]) == {"episode_index", "step_index", "index", "frame_index"}
    x_of_index = dict(zip(weights["index"].to_pylist(), d.observations[:, 0].tolist(), strict=True))
    assert x_of_index == dict(zip(range(N), STATE[:, 0].tolist(), strict=True))
    assert weights["frame_index"].to_pylist() == weights["step_index"].to_pylist()


KINDS = {
    "few": (np.arange(200) % 10, "discrete"),
    "many with ten steps each": (np.arange(1000) % 100, "discrete"),
    "many in few steps": (np.arange(500) % 100, "continuous"),
    "pulses": (np.random.default_rng(0).integers(1000, 2000, 5000), "continuous"),
}


@pytest.mark.parametrize("case", KINDS)
@pytest.mark.parametrize("kind", [int, float])
def test_whole_numbers_are_classes_where_they_are_few(tmp_path, case, kind):
    values, wanted = KINDS[case]
    values, steps = values.astype(kind), np.array([0, 1, len(values)])
    ones = np.ones((len(values), 1))
    assert Demonstrations(ones, values, steps).action_kind == wanted
    columns = {"episode": np.sign(np.arange(len(values))), "x": ones[:, 0], "action": values}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    for on_disk in (False, True):
        recording = read_recording(tmp_path / "a.parquet", on_disk=on_disk)
        assert recording.description.action_kind == wanted
        assert recording.demonstrations.is_discrete == (wanted == "discrete")
        for asked in ("discrete", "continuous"):
            options = ColumnOptions(action_kind=asked)
            d = read_recording(tmp_path / "a.parquet", options, on_disk=on_disk).demonstrations
            assert d.is_discrete == (asked == "discrete")


@pytest.mark.parametrize(
    ("given", "read"),
    [
        (("left.joint_1.pos", "actions.grip"), ("action.left.joint_1.pos", "action.grip")),
        (("cmd_x", "mode_type"), ("action.0", "action.1")),  # a column called type would not be read
        (("index", "x"), ("action.0", "action.1")),  # action.index would be the whole action
    ],
)
@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_names_of_actions_are_written_where_they_are_read_back(tmp_path, suffix, given, read):
    actions = np.arange(10.0).reshape(5, 2) / 3
    data = Demonstrations(np.ones((5, 1)), actions, [0, 2, 5], action_names=given)
    formats.write(tmp_path / f"a{suffix}", data)
    back = formats.read(tmp_path / f"a{suffix}")
    assert back.action_names == read
    np.testing.assert_array_equal(back.actions, actions)
