"""A small valid file or folder of every format that is read: `SAMPLES`, functions of an empty folder, by name."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import rpil
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array

LENGTHS = (4, 6, 5)
OWNERS = np.repeat(np.arange(len(LENGTHS)), LENGTHS)
_RNG = np.random.default_rng(0)
STATES, MOVES = _RNG.normal(size=(len(OWNERS), 2)), _RNG.normal(size=(len(OWNERS), 2))
FRAMES = np.concatenate([np.arange(n) for n in LENGTHS])


def demonstrations(continuous: bool = True) -> Demonstrations:
    return Demonstrations.from_groups(STATES, MOVES if continuous else OWNERS % 2 + FRAMES % 2, OWNERS)


def assert_same(found: Demonstrations, expected: Demonstrations) -> None:
    """The demonstrations are equal, with the types of their numbers and the names of their observations."""
    assert (found.ids, found.observation_names) == (expected.ids, expected.observation_names)
    for name in ("observations", "actions", "offsets"):
        assert getattr(found, name).dtype == getattr(expected, name).dtype
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def assert_same_on_disk(path: Path) -> None:
    """What is left on disk is described as what is read into memory, and is the same."""
    on_disk, memory = rpil.open(path, on_disk=True), rpil.open(path, on_disk=False)
    assert isinstance(on_disk.demonstrations, rpil.Dataset)
    assert on_disk.description == memory.description
    found = on_disk.demonstrations.select(slice(None))
    assert_same(found, memory.demonstrations)
    assert memory.demonstrations.action_names in ((), found.action_names)  # NPZ has none
    np.testing.assert_array_equal(on_disk.times().timestamps, memory.times().timestamps)
    assert on_disk.tasks == memory.tasks


def table(**others: object) -> pa.Table:
    """A row for each step, with lists of numbers and a text."""
    columns = {"observation.state": STATES.tolist(), "action": MOVES.tolist(), "episode_index": OWNERS}
    times = {"frame_index": FRAMES, "timestamp": FRAMES / 30, "index": np.arange(len(OWNERS))}
    return pa.table({**columns, **times, **others})


def written(name: str, continuous: bool = True) -> Callable[[Path], Path]:
    """A maker of a file of this name, by `formats.write`."""

    def make(folder: Path) -> Path:
        formats.write(folder / name, demonstrations(continuous))
        return folder / name

    return make


def _text_table(name: str, separator: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        names = ["episode_index", "frame_index", "x", "operator", "action"]
        rows = [[f'"é{OWNERS[n]}"', n, STATES[n, 0], '"Ann, B"', MOVES[n, 0]] for n in range(len(OWNERS))]
        lines = (separator.join(map(str, row)) for row in rows)
        (folder / name).write_text("\n".join([separator.join(names), *lines, ""]), encoding="utf-8")
        return folder / name

    return make


def parquet_lists(folder: Path) -> Path:
    """Lists, and text, in small row groups, with pyarrow's defaults."""
    pq.write_table(table(operator=[f"é{m}" for m in OWNERS]), folder / "lists.parquet", row_group_size=7)
    return folder / "lists.parquet"


def parquet_folder(folder: Path) -> Path:
    path = folder / "many"
    path.mkdir()
    for m in range(len(LENGTHS)):
        pq.write_table(table().filter(pa.array(m == OWNERS)), path / f"{m}.parquet")
    return path


def csv_folder(folder: Path) -> Path:
    path = folder / "texts"
    path.mkdir()
    for m in range(len(LENGTHS)):
        rows = [f"{x},{a}\n" for x, a in zip(STATES[m == OWNERS, 0], MOVES[m == OWNERS, 0], strict=True)]
        (path / f"{m}.csv").write_text("".join(["x,action\n", *rows]))
    return path


def json_lines(folder: Path) -> Path:
    """An object for each step, with an object and a list in it."""
    rows = zip(OWNERS.tolist(), FRAMES.tolist(), STATES.tolist(), MOVES.tolist(), strict=True)
    steps = (
        {"episode_index": m, "frame_index": k, "observation": {"x": x, "y": y}, "action": a} for m, k, (x, y), a in rows
    )
    (folder / "steps.jsonl").write_text("".join(f"{json.dumps(step)}\n" for step in steps))
    return folder / "steps.jsonl"


def lerobot(folder: Path) -> Path:
    """LeRobot's layout of version 3.0, without videos."""
    path = folder / "lerobot"
    for name in ("data/chunk-000", "meta/episodes/chunk-000"):
        (path / name).mkdir(parents=True)
    features = {
        name: {"dtype": "float64", "shape": [2], "names": ["a", "b"]} for name in ("observation.state", "action")
    }
    features |= {name: {"dtype": "int64", "shape": [1]} for name in ("episode_index", "index", "task_index")}
    info = {"codebase_version": "v3.0", "fps": 30, "total_episodes": len(LENGTHS), "features": features}
    (path / "meta" / "info.json").write_text(json.dumps(info | {"chunks_size": 1000, "total_frames": len(OWNERS)}))
    (path / "meta" / "stats.json").write_text(json.dumps({"action": {"min": [0.0, 0.0]}}))
    pq.write_table(pa.table({"task_index": [0], "task": ["lift"]}), path / "meta" / "tasks.parquet")
    pq.write_table(table(task_index=0 * OWNERS), path / "data/chunk-000/file-000.parquet")
    ends = np.cumsum(LENGTHS)
    rows = {"episode_index": range(len(LENGTHS)), "length": LENGTHS, "dataset_from_index": ends - LENGTHS}
    rows |= {"dataset_to_index": ends, "stats/action/min": [[0.0, 0.0]] * len(ends)}
    rows |= {"stats/action/count": [[n] for n in LENGTHS]}
    pq.write_table(pa.table(rows), path / "meta/episodes/chunk-000/file-000.parquet")
    return path


def stacked(values: Array, n_rows: int = max(LENGTHS)) -> Array:
    """(M, n_rows, ...), filled up with zeros."""
    found = np.zeros((len(LENGTHS), n_rows, *values.shape[1:]))
    for m, n in enumerate(LENGTHS):
        found[m, :n] = values[m == OWNERS]
    return found


def stacked_npz(folder: Path) -> Path:
    """A first index for each demonstration, and zeros after its last step."""
    np.savez(folder / "stacked.npz", obs=stacked(STATES), acts=stacked(MOVES), lengths=np.array(LENGTHS))
    return folder / "stacked.npz"


def npz_folder(folder: Path) -> Path:
    """A folder for each demonstration, with one more observation than actions, an image and a text beside it."""
    path = folder / "episodes"
    for m, n in enumerate(LENGTHS):
        (path / str(m)).mkdir(parents=True)
        seen = {"obs_state": _RNG.normal(size=(n + 1, 2)), "obs_rgb": np.zeros((n + 1, 2, 2, 3), np.uint8)}
        np.savez(path / str(m) / "trajectory.npz", **seen, actions=MOVES[m == OWNERS], success=np.array([m < 2]))
        (path / str(m) / "meta.json").write_text(json.dumps({"instruction": "lift", "seed": 3, "success": m < 2}))
    return path


def _hdf5(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        import hdf5_files

        path = folder / (name if name == "aloha" else f"{name}.hdf5")
        return getattr(hdf5_files, name)(path)  # type: ignore[no-any-return]

    return make


def zarr(zarr_format: int, zipped: bool) -> Callable[[Path], Path]:
    """A maker of a replay buffer, as a folder or in a ZIP file."""

    def make(folder: Path) -> Path:
        import zarr

        path = folder / f"buffer{zarr_format}.zarr"
        root = zarr.create_group(path, zarr_format=zarr_format)
        for name, values in {"action": MOVES, "state": STATES}.items():
            root.create_array(f"data/{name}", data=values, chunks=(4, 2))
        root.create_array("meta/episode_ends", data=np.cumsum(LENGTHS))
        return Path(shutil.make_archive(str(path), "zip", path)) if zipped else path

    return make


SAMPLES: dict[str, Callable[[Path], Path]] = {
    "CSV": written("a.csv"),
    "CSV of discrete actions": written("b.csv", continuous=False),
    "CSV, semicolons": _text_table("c.csv", ";"),
    "TSV": _text_table("d.tsv", "\t"),
    "folder of CSV": csv_folder,
    "JSON lines": json_lines,
    "NPZ": written("f.npz"),
    "NPZ, stacked": stacked_npz,
    "Parquet": written("g.parquet"),
    "Parquet of lists": parquet_lists,
    "folder of Parquet": parquet_folder,
    "LeRobot": lerobot,
    "folder of NPZ": npz_folder,
}
if find_spec("h5py"):
    SAMPLES |= {name: _hdf5(name) for name in ("robomimic", "d4rl", "aloha")}
if find_spec("zarr"):
    for _format in (2, 3):
        SAMPLES |= {f"Zarr {_format}": zarr(_format, False), f"Zarr {_format}, ZIP": zarr(_format, True)}
