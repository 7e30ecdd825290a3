"""Whether LeRobot and robomimic open what ``rpil keep`` and ``--annotate`` write, and rpil what other tools write.

``python tools/real_readers.py`` makes an environment for each of them, lets it write data sets (of robomimic, the
tests do), keeps two of three demonstrations here, and has the tool read the new files: demonstrations, steps and
actions must be those that rpil says. LeRobot also opens what ``rpil audit --annotate`` writes, by an
``episode_filter``; all that it reads of a step, with decoded pictures, must be as before. ``--files`` names more data
to keep. Of Minari and Donkeycar rpil reads the actions that the tool itself reads.

The environments are in a temporary folder, or stay in the one that ``--environments`` names and are used again. LeRobot
0.6.1 needs Python 3.12, from PATH, pyenv or ``--python312``. On Linux its torch (below 2.12) is a CUDA build on PyPI,
without which no module of its data sets is imported: 5.5 GB on the disk, and 4 minutes; where pip finds a CPU build
(``PIP_EXTRA_INDEX_URL``) it is 1 GB. The others take 3.1 GB, with torch 2.13.0 where a CPU build of it is at hand.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rpil

TESTS = Path(__file__).resolve().parents[1] / "tests"
ROWS = """
import json, sys
import numpy as np
from pathlib import Path
lengths, rng = (9, 12, 7), np.random.default_rng(0)
seen = [rng.normal(size=(n + 1, 3)).astype(np.float32) for n in lengths]
done = [rng.normal(size=(n, 2)).astype(np.float32) for n in lengths]
where, actions = sys.argv[1], []
"""
"""Begins the programs, which have a path as their argument: three demonstrations, and the actions that are read."""

TELL = "print(json.dumps([np.asarray(one, float).tolist() for one in actions]))"


class Tool(NamedTuple):
    """What is installed, by one call of pip each; programs that write and that read, which is none where rpil reads the
    `data` that are written; and the Python that it needs."""

    needs: tuple[str, ...]
    write: str
    read: str = ""
    data: str = ""
    python: str = f"3.{sys.version_info.minor}"


TOOLS = {
    "lerobot": Tool(
        ("lerobot[dataset]==0.6.1",),
        """
from lerobot.datasets.lerobot_dataset import LeRobotDataset
kinds = {"action": 2, "observation.state": 3}
features = {name: {"dtype": "float32", "shape": (n,), "names": None} for name, n in kinds.items()}
shape = {"shape": (96, 128, 3), "names": ["height", "width", "channels"]}
features["observation.images.front"] = {"dtype": "video", **shape}

def record(data, numbers):
    for m in numbers:
        for k in range(lengths[m]):
            row = {"action": done[m][k], "observation.state": seen[m][k], "task": ("lift", "push")[m % 2]}
            for name in [name for name in data.features if "images" in name]:
                row[name] = np.kron(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), np.ones((16, 16, 1), np.uint8))
            data.add_frame(row)
        data.save_episode()
    data.finalize()

about = {"repo_id": "local/sample", "fps": 20, "features": features, "use_videos": True}
record(LeRobotDataset.create(root=where + "/lerobot", **about), range(3))
# A file for each episode, a camera without videos, and a second day.
features["observation.images.wrist"] = {"dtype": "image", **shape}
small = {"data_files_size_in_mb": 1e-3, "video_files_size_in_mb": 1e-3}
record(LeRobotDataset.create(root=where + "/small-files", **about, **small), range(2))
record(LeRobotDataset.resume("local/sample", root=where + "/small-files"), [2])
""",
        """
from lerobot.datasets.lerobot_dataset import LeRobotDataset
known = {name for one in LeRobotDataset("local/kept", root=where).meta.episodes for name in one}
wanted = (lambda episode: not episode["rpil/rejected_by"]) if "rpil/rejected_by" in known else None
data = LeRobotDataset("local/kept", root=where, video_backend="pyav", episode_filter=wanted)
rows = [data[k] for k in range(len(data))]  # all pictures are decoded
numbers = np.array([int(row["episode_index"]) for row in rows])
there = sorted(set(numbers.tolist()))
if wanted is None:
    assert [*range(data.meta.total_episodes)] == there and data.meta.total_frames == len(rows)
before = LeRobotDataset("local/all", root=sys.argv[2], video_backend="pyav")
for m, was in zip(there, json.loads(sys.argv[3])):
    own = [row for row, number in zip(rows, numbers) if number == m]
    assert [int(row["frame_index"]) for row in own] == list(range(len(own)))
    first = before.meta.episodes[was]["dataset_from_index"]
    for k, row in enumerate(own):
        same = {name: np.array_equal(value, row[name]) for name, value in before[first + k].items()}
        assert not {name for name in same if not same[name]} - {"index", "episode_index"}, (m, k, same)
    actions.append([row[next(name for name in row if name.startswith("action"))].numpy() for row in own])
""",
        python="3.12",
    ),
    "robomimic": Tool(
        ("--no-deps robomimic==0.3.0", "torch==2.13.0 h5py tqdm psutil termcolor imageio matplotlib"),
        "",
        """
import h5py
from robomimic.utils.dataset import SequenceDataset
with h5py.File(where) as file:
    group = next(iter(file["data"].values()))["obs"]
    keys = [name for name in group if isinstance(group[name], h5py.Dataset)]
    stated = {name: int(one.attrs["num_samples"]) for name, one in file["data"].items()}
how = {"hdf5_cache_mode": "all", "hdf5_use_swmr": False, "load_next_obs": False}
data = SequenceDataset(where, obs_keys=keys, dataset_keys=("actions",), **how)
for name in data.demos:
    first, n = data._demo_id_to_start_indices[name], data._demo_id_to_demo_length[name]
    actions.append([data[first + k]["actions"][0] for k in range(n)])
    assert n == stated[name]
""",
    ),
    "minari": Tool(
        ("minari[hdf5]==0.5.4", "pillow"),
        """
import os
os.environ["MINARI_DATASETS_PATH"] = where
import minari
from gymnasium.spaces import Box
from minari.data_collector import EpisodeBuffer
buffers = []
for m, (x, u) in enumerate(zip(seen, done)):
    ends = [*[False] * (len(u) - 1), True]
    flags = {"rewards": [0.0] * len(u), "terminations": ends, "truncations": ends, "infos": {}}
    buffers.append(EpisodeBuffer(id=m, observations=x, actions=u, **flags))
spaces = (Box(-9, 9, (n,), np.float32) for n in (3, 2))
about = dict.fromkeys(("author", "author_email", "code_permalink", "algorithm_name", "description"), "x")
about |= dict(zip(("observation_space", "action_space"), spaces))
minari.create_dataset_from_buffers("sample-v0", buffers, data_format="hdf5", **about)
actions = [episode.actions for episode in minari.load_dataset("sample-v0").iterate_episodes()]
""",
        data="sample-v0/data/main_data.hdf5",
    ),
    "donkeycar": Tool(
        ("--no-deps donkeycar==5.3.0", "numpy<2 pillow pyfiglet pandas requests psutil progress prettytable pyyaml"),
        """
from donkeycar.parts.tub_v2 import Tub
for x, u in zip(seen, done):  # each is a session
    tub = Tub(where + "/tub", ["user/angle", "user/throttle", "enc/speed"], ["float"] * 3, max_catalog_len=10)
    for k in range(len(u)):
        tub.write_record({"user/angle": u[k, 0], "user/throttle": u[k, 1], "enc/speed": x[k, 0]})
    tub.delete_records({tub.manifest.current_index - 2})
    tub.close()
records = [*Tub(where + "/tub", read_only=True)]
for session in sorted({record["_session_id"] for record in records}):
    own = [record for record in records if record["_session_id"] == session]
    actions.append([(record["user/angle"], record["user/throttle"]) for record in own])
""",
        data="tub",
    ),
}


def environment(name: str, folder: Path, python: str) -> Path:
    """The Python of the environment of a tool, which is made where it is not there yet."""
    made = folder / name / "bin" / "python"
    if not (folder / name / "complete").is_file():
        subprocess.run([python, "-m", "venv", "--clear", folder / name], check=True)
        install = [made, "-m", "pip", "install", "--quiet", "--quiet", "--no-cache-dir", "--disable-pip-version-check"]
        for packages in TOOLS[name].needs:
            subprocess.run([*install, *packages.split()], check=True)
        (folder / name / "complete").touch()
    return made


def interpreter(version: str, given: str | None) -> str:
    """A Python of this version: the one that is given, this one, one on PATH, or of pyenv."""
    of_pyenv = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    here = sys.executable if version == f"3.{sys.version_info.minor}" else None
    found = given or here or (of_pyenv and str(of_pyenv[-1])) or shutil.which(f"python{version}")
    if not found:
        sys.exit(f"Python {version} is not at hand; give its path with --python312.")
    return str(found)


def run(python: Path, program: str, *arguments: str | Path) -> str:
    """What a program prints of a path, and of what else it is given."""
    done = subprocess.run([python, "-W", "ignore", "-c", ROWS + program, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["it ended without a word"])[-1][:90])
    return done.stdout


def samples(name: str, python: Path, folder: Path) -> Iterator[Path]:
    """What the tool itself writes; of robomimic, which has no writer, a file that the tests write."""
    folder.mkdir()
    if name == "robomimic":
        sys.path.insert(0, str(TESTS))
        import hdf5_files

        yield hdf5_files.robomimic(folder / "robomimic.hdf5")
        return
    run(python, TOOLS[name].write, folder)
    yield from sorted(folder.glob("*"))


def of_tool(name: str, path: Path) -> bool:
    """Whether the tool reads the format of the file or folder at a path."""
    said = rpil.open(path).description.format.lower()
    return name in said and not said.startswith("lerobot v2")  # which LeRobot 0.6.1 converts first


def check(python: Path, name: str, path: Path, folder: Path) -> Iterator[tuple[object, ...]]:
    """Keep demonstrations, and have the tool read them: a row of the table for each."""
    recording = rpil.open(path)
    whole, output = recording.demonstrations.select(slice(None)), folder / path.name
    ids = [*whole.ids[:1], *whole.ids[2:]]
    ends = zip(whole.ids, whole.offsets[:-1].tolist(), whole.lengths.tolist(), strict=True)
    wanted = [np.asarray(whole.actions[a : a + n], float) for m, a, n in ends if m in ids]
    recording.keep(ids, output)
    yield name, "keep", path.name, *read_as(python, name, output, wanted, path, json.dumps(ids))
    if name == "lerobot":
        labels = folder / "labels.csv"
        labels.write_text("id,label\n" + "".join(f"{m},{'good' if m in ids else 'bad'}\n" for m in whole.ids))
        audit = [sys.executable, "-m", "rpil", "audit", path, "--labels", labels, "--annotate", output]
        subprocess.run(audit, check=True, capture_output=True)
        yield name, "audit --annotate", path.name, *read_as(python, name, output, wanted, path, json.dumps(ids))


def read_as(
    python: Path, name: str, output: Path, wanted: list[np.ndarray], source: Path, ids: str
) -> tuple[object, ...]:
    """How many demonstrations and steps the tool reads, and whether they are those `wanted`; the output is removed."""
    try:
        return compared(json.loads(run(python, TOOLS[name].read + TELL, output, source, ids).splitlines()[-1]), wanted)
    except RuntimeError as error:
        return "-", "-", str(error)
    finally:
        shutil.rmtree(output) if output.is_dir() else output.unlink()


def check_writer(python: Path, name: str, folder: Path) -> tuple[object, ...]:
    """Read here what the tool writes: a row of the table."""
    folder.mkdir()
    wanted = json.loads(run(python, TOOLS[name].write + TELL, folder).splitlines()[-1])
    read = rpil.read(folder / TOOLS[name].data)
    return name, "read", TOOLS[name].data, *compared([actions for _, actions in read], wanted)


def compared(found: Sequence[object], wanted: Sequence[object]) -> tuple[object, ...]:
    """How many demonstrations and steps there are, and whether their actions are those that are `wanted`."""
    same = len(found) == len(wanted) and all(map(is_same, found, wanted))
    return len(found), sum(map(len, found)), "ok" if same else "other actions"


def is_same(found: object, wanted: object) -> bool:
    """Whether actions are the same, in single precision, as which robomimic reads them."""
    return np.array_equal(np.asarray(found, np.float32), np.asarray(wanted, np.float32))


def main() -> None:
    """Print a line for each tool and file, and end with 1 where one is not read as it should be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tools", nargs="*", metavar="TOOL", help=f"of {', '.join(TOOLS)}; by default all")
    parser.add_argument("--files", nargs="*", type=Path, default=[], help="data to keep as well")
    parser.add_argument("--environments", type=Path, help="a folder whose environments are used again")
    parser.add_argument("--python312", help="a Python 3.12, for LeRobot")
    given = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as name:
        temporary = Path(name)
        for tool in given.tools or TOOLS:
            needed = TOOLS[tool].python
            python = environment(
                tool,
                given.environments or temporary,
                interpreter(needed, given.python312 if needed == "3.12" else None),
            )
            version = re.findall(r"==(\S+)", TOOLS[tool].needs[0])[0]
            place, kept = temporary / f"{tool}-samples", temporary / f"{tool}-kept"
            kept.mkdir()
            if TOOLS[tool].read:
                paths = [*samples(tool, python, place), *(p for p in given.files if of_tool(tool, p))]
                rows = (row for path in paths for row in check(python, tool, path, kept))
            else:
                rows = iter([check_writer(python, tool, place)])
            for one, *row in rows:
                failed |= row[-1] != "ok"
                print(f"{one} {version}".ljust(18), "  ".join(str(cell).ljust(16) for cell in row), flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
