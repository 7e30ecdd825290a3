import json
import pickle

import numpy as np
import pyarrow as pa
import pytest

import rpil
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.registry import find

INFO = '{"py/reduce": [{"py/function": "os.system"}, {"py/tuple": ["false"]}]}'
"""What jsonpickle would run if it decoded it."""


def trajectories(n=12, discrete=False):
    """Observations, actions and rewards of `n` trajectories of 1, 2, ... steps."""
    rng = np.random.default_rng(0)
    found = []
    for t in range(1, n + 1):
        acts = rng.integers(3, size=t) if discrete else rng.normal(size=(t, 2)).astype(np.float32)
        found.append((rng.normal(size=(t + 1, 3)).astype(np.float32), acts, np.ones(t)))
    return found


def write_folder(folder, given):
    """A data set as `datasets.Dataset.save_to_disk` writes it, in two files."""
    folder.mkdir()
    rows = {
        "obs": [obs.tolist() for obs, _, _ in given],
        "acts": [acts.tolist() for _, acts, _ in given],
        "infos": [[INFO] * len(acts) for _, acts, _ in given],
        "terminal": [True] * len(given),
        "rews": [rews.tolist() for _, _, rews in given],
    }
    schema = pa.table(rows).schema
    f32 = pa.list_(pa.float32())
    schema = schema.set(0, pa.field("obs", pa.list_(f32))).with_metadata({"huggingface": "{}"})
    table = pa.table(rows, schema=schema)
    names = [f"data-0000{k}-of-00002.arrow" for k in range(2)]
    for name, part in zip(names, (table.slice(0, 5), table.slice(5)), strict=True):
        with pa.ipc.new_stream(folder / name, schema) as stream:
            stream.write_table(part)
    state = {"_data_files": [{"filename": name} for name in names], "_fingerprint": "ab12", "_split": None}
    (folder / "state.json").write_text(json.dumps(state))
    (folder / "dataset_info.json").write_text(json.dumps({"features": {name: {} for name in rows}, "splits": {}}))
    return folder


def write_npz(path, given):
    """The older format; its infos are objects, which only a pickle can hold."""
    obs, acts, rews = (np.concatenate(parts) for parts in zip(*given, strict=True))
    infos = np.array([{"a": 1}] * len(acts))
    indices, terminal = np.cumsum([len(rews) for _, _, rews in given])[:-1], np.ones(len(given), bool)
    np.savez(path, obs=obs, acts=acts, rews=rews, infos=infos, indices=indices, terminal=terminal)
    return path


def check_equal(demonstrations, given):
    assert len(demonstrations) == len(given)
    for (seen, acted), (obs, acts, _) in zip(demonstrations, given, strict=True):
        np.testing.assert_array_equal(seen, obs[:-1])
        np.testing.assert_array_equal(acted, acts)


@pytest.mark.parametrize("discrete", [False, True])
def test_folder_of_imitation(tmp_path, discrete):
    given = trajectories(discrete=discrete)
    path = write_folder(tmp_path / "set", given)
    recording = formats.read_recording(path)
    assert recording.demonstrations.is_discrete == discrete
    check_equal(recording.demonstrations, given)
    assert recording.description.ignored["infos"].startswith("never decoded")

    find(path).keep(tmp_path / "kept", [7, 2])
    check_equal(rpil.read(tmp_path / "kept"), [given[2], given[7]])
    with pa.ipc.open_stream(tmp_path / "kept/data-00000-of-00001.arrow") as stream:
        table = stream.read_all()
    assert table["infos"][0].as_py() == [INFO] * 3
    assert table.schema.metadata == {b"huggingface": b"{}"}
    state = json.loads((tmp_path / "kept/state.json").read_text())
    assert state["_data_files"] == [{"filename": "data-00000-of-00001.arrow"}]
    assert state["_fingerprint"] != "ab12"


@pytest.mark.parametrize("discrete", [False, True])
def test_npz_of_imitation(tmp_path, discrete):
    given = trajectories(discrete=discrete)
    path = write_npz(tmp_path / "old.npz", given)
    check_equal(rpil.read(path), given)
    find(path).keep(tmp_path / "kept.npz", [11, 0])
    check_equal(rpil.read(tmp_path / "kept.npz"), [given[0], given[11]])
    with np.load(tmp_path / "kept.npz", allow_pickle=False) as kept:
        assert len(kept["infos"]) == len(kept["acts"]) == 13
        assert kept["indices"].tolist() == [1]
        assert kept["terminal"].shape == (2,)


class Harm:
    def __reduce__(self):
        return exec, ("raise SystemExit('it was unpickled')",)


def test_pickles_are_refused(tmp_path):
    path = tmp_path / "old.pkl"
    path.write_bytes(pickle.dumps(Harm()))
    with pytest.raises(DataError, match=r"a pickle .old\.pkl. is never opened; it can run any code: .* df\.to_parquet"):
        rpil.read(path)
    given = write_npz(tmp_path / "old.npz", trajectories(3))
    with np.load(given, allow_pickle=True) as arrays:
        np.savez(tmp_path / "bad.npz", **{**arrays, "obs": np.array([Harm()])})
    with pytest.raises(DataError, match=r"^bad\.npz: .*Python objects.*any code"):
        rpil.read(tmp_path / "bad.npz")


def test_damaged_imitation(tmp_path):
    given = trajectories(3)
    with np.load(write_npz(tmp_path / "old.npz", given), allow_pickle=True) as arrays:
        plain = {name: arrays[name] for name in ("obs", "acts", "indices", "terminal")}
    changes = [{"obs": plain["obs"][1:]}, {"indices": np.array([2.5, 3])}, {"indices": np.array([3, 1])}]
    for change, message in zip(changes, ("do not fit together", "must be whole", "do not fit together"), strict=True):
        np.savez(tmp_path / "bad.npz", **plain | change)
        with pytest.raises(DataError, match=message):
            rpil.read(tmp_path / "bad.npz")
    path = write_folder(tmp_path / "set", trajectories())
    (path / "data-00001-of-00002.arrow").unlink()
    with pytest.raises(DataError, match=r"^set: it is damaged or truncated"):
        rpil.read(path)


def test_observations_of_several_arrays_are_refused(tmp_path):
    path = write_folder(tmp_path / "set", trajectories(3))
    table = pa.table({"obs": [{"a": [1.0, 2.0]}], "acts": [[0]]})
    with pa.ipc.new_stream(path / "data-00000-of-00002.arrow", table.schema) as stream:
        stream.write_table(table)
    (path / "state.json").write_text(json.dumps({"_data_files": [{"filename": "data-00000-of-00002.arrow"}]}))
    with pytest.raises(DataError, match=r"^set: 'obs' holds struct<.*>, not a list of steps"):
        rpil.read(path)
