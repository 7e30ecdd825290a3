import json
import os
import warnings

import numpy as np
import pytest

import rpil
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.registry import find

pytest.importorskip("h5py", reason="needs the extra hdf5")
minari = pytest.importorskip("minari", reason="needs minari")
spaces = pytest.importorskip("gymnasium").spaces

OBSERVATIONS = spaces.Dict(
    pos=spaces.Box(-1, 1, (2,)),
    pair=spaces.Tuple((spaces.Discrete(3), spaces.Box(0, 9, (1,)))),
    img=spaces.Box(0, 255, (32, 32, 3), np.uint8),
    mission=spaces.Text(10),
)
ACTIONS = {
    "discrete": spaces.Discrete(3),
    "box": spaces.Box(-1, 1, (2,)),
    "dict": spaces.Dict(a=spaces.Box(-1, 1, (1,)), b=spaces.Box(-1, 1, (2,))),
}


def sampled(space, n):
    """`n` samples, as Minari keeps them."""
    if isinstance(space, spaces.Dict):
        return {name: sampled(part, n) for name, part in space.items()}
    if isinstance(space, spaces.Tuple):
        return tuple(sampled(part, n) for part in space)
    samples = [space.sample() for _ in range(n)]
    return samples if isinstance(space, spaces.Text) else np.array(samples)


def write(tmp_path, data_format, action_space, lengths=range(1, 13)):
    """The folder of a data set of episodes of these `lengths`, and its episodes."""
    folder = tmp_path / "set-v0"
    folder.mkdir()
    OBSERVATIONS.seed(0)
    action_space.seed(0)
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    storage = MinariStorage.new(
        folder / "data", observation_space=OBSERVATIONS, action_space=action_space, data_format=data_format
    )
    episodes = [
        EpisodeBuffer(
            observations=sampled(OBSERVATIONS, n + 1),
            actions=sampled(action_space, n),
            rewards=np.ones(n),
            terminations=np.zeros(n, bool),
            truncations=np.arange(n) == n - 1,
            infos={"secret": np.zeros((n + 1, 2))},
        )
        for n in lengths
    ]
    storage.update_metadata({"dataset_id": "set-v0", "minari_version": minari.__version__})
    storage.update_episodes(episodes)
    return folder, episodes


@pytest.fixture(autouse=True)
def no_warnings_of_others():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def stacked(part, rows):
    """Numbers of nested spaces side by side, as (rows, D)."""
    parts = part.values() if isinstance(part, dict) else part if isinstance(part, tuple) else None
    return np.reshape(part[:rows], (rows, -1)) if parts is None else np.hstack([stacked(p, rows) for p in parts])


@pytest.mark.parametrize("action_space", ACTIONS)
@pytest.mark.parametrize("data_format", ["hdf5", "arrow", "parquet"])
def test_minari_read_and_kept(tmp_path, data_format, action_space):
    output = tmp_path / "kept-v0"
    path, episodes = write(tmp_path, data_format, ACTIONS[action_space])
    recording = formats.read_recording(path)
    d, about = recording.demonstrations, recording.description
    assert d.ids == tuple(range(12))  # episode_2 before episode_10
    assert d.lengths.tolist() == list(range(1, 13))
    assert d.is_discrete == (action_space == "discrete")
    assert any("after" in note for note in about.notes)
    assert {"observations/img", "observations/mission", "rewards"} <= about.ignored.keys()
    assert not any("secret" in name for name in about.ignored)
    for m, episode in enumerate(episodes):
        seen, acted = d.episode(m)
        pos = [d.observation_names.index(f"pos.{k}") for k in range(2)]
        np.testing.assert_array_equal(seen[:, pos], episode.observations["pos"][:-1])
        pair = [d.observation_names.index(f"pair/{k}") for k in range(2)]
        np.testing.assert_array_equal(seen[:, pair], stacked(episode.observations["pair"], m + 1))
        np.testing.assert_array_equal(np.reshape(acted, (m + 1, -1)), stacked(episode.actions, m + 1))

    find(path).keep(output, [11, 2])
    kept = minari.MinariDataset(output / "data")
    assert (kept.total_episodes, kept.total_steps) == (2, 15)
    for episode, i in zip(kept.iterate_episodes(), (2, 11), strict=True):
        np.testing.assert_array_equal(episode.observations["pos"], episodes[i].observations["pos"])
        np.testing.assert_array_equal(stacked(episode.actions, i + 1), stacked(episodes[i].actions, i + 1))
        assert len(episode.infos["secret"]) == i + 2
    assert rpil.read(output).ids == (0, 1)
    assert len(rpil.read(path / "data")) == 12  # its other paths name the same data set


def test_minari_with_as_many_observations_as_actions(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "main_data.hdf5", "w") as file:
        for k in range(3):
            file[f"episode_{k}/observations"] = np.arange(8.0).reshape(4, 2)
            file[f"episode_{k}/actions"] = np.arange(4) % 2
            file[f"episode_{k}/rewards"] = np.ones(4)
    d = rpil.read(tmp_path / "main_data.hdf5")
    assert d.lengths.tolist() == [4, 4, 4]
    assert d.is_discrete


@pytest.mark.parametrize("data_format", ["hdf5", "arrow"])
def test_minari_episodes_without_steps_are_left_out(tmp_path, data_format):
    path, _ = write(tmp_path, data_format, ACTIONS["discrete"], lengths=(3, 2, 4))
    if data_format == "hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path / "data/main_data.hdf5", "a") as file:
            del file["episode_1/actions"]
            file["episode_1/actions"] = np.zeros(0, int)
    else:
        pa = pytest.importorskip("pyarrow")
        file = path / "data/1/part-0.arrow"
        table = pa.ipc.open_file(file).read_all()
        with pa.ipc.new_file(file, table.schema) as stream:
            stream.write_table(table.slice(0, 1))
    recording = formats.read_recording(path)
    assert recording.demonstrations.ids == (0, 2)
    assert "Left out, because they have no steps: 1." in recording.description.notes


def test_minari_with_wrong_metadata(tmp_path):
    path, _ = write(tmp_path, "arrow", ACTIONS["box"])
    (path / "data/3/metadata.json").write_text(json.dumps({"total_steps": "many"}))
    (path / "data/4/metadata.json").unlink()
    about = json.loads((path / "data/metadata.json").read_text())
    (path / "data/metadata.json").write_text(
        json.dumps({**about, "action_space": 7, "env_spec": '{"id": "\\u001b[2J"}'})
    )
    recording = formats.read_recording(path)
    assert recording.demonstrations.lengths.tolist() == list(range(1, 13))
    assert recording.description.notes[0].isprintable()
    find(path).keep(tmp_path / "kept", [3, 4])
    assert json.loads((tmp_path / "kept/data/metadata.json").read_text())["total_steps"] == 9


@pytest.mark.parametrize(("content", "why"), [("", "metadata.json"), ("{", "metadata.json"), ("{}", "data_format")])
def test_minari_whose_metadata_are_damaged_is_no_folder_of_tables(tmp_path, content, why):
    path, _ = write(tmp_path, "arrow", ACTIONS["box"])
    (path / "data/metadata.json").write_text(content)
    if not content:
        os.truncate(path / "data/metadata.json", 2**30)  # takes no place on disk
        why = "metadata.json: it is longer than 16 MiB"
    for use in (rpil.read, lambda path: find(path).keep(tmp_path / "kept", [0])):
        with pytest.raises(DataError, match=why):
            use(path)
    assert not (tmp_path / "kept").exists()


def test_minari_in_python():
    from minari.dataset.episode_data import EpisodeData

    episodes = [EpisodeData(m, np.ones((4, 2)), np.arange(3) % 2, *(np.zeros(3),) * 3, None) for m in range(3)]
    assert rpil.read(iter(episodes)).lengths.tolist() == [3, 3, 3]


@pytest.mark.parametrize("place", ["data/0/extra", "0/extra"])
def test_a_link_in_an_episode_is_not_published(tmp_path, place):
    """Nor where an empty folder ``data`` is put beside the episodes."""
    secret = tmp_path / "home"
    secret.mkdir()
    path, _ = write(tmp_path, "arrow", ACTIONS["discrete"], lengths=(3, 2, 4))
    if place.startswith("0"):
        for file in list((path / "data").iterdir()):
            file.rename(path / file.name)
    (path / place).symlink_to(secret)
    with pytest.raises(DataError):
        find(path).keep(tmp_path / "kept", [0])
    assert not (tmp_path / "kept").exists()
