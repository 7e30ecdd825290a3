"""How many planted faults of videos `rpil check --video` finds, and how many videos it accuses that are right.

Each kind is planted into a fifth of the episodes of four made sets, and of folders of LeRobot that are given, of which
at most `--episodes` are used; videos are encoded again. Measured on three public sets of GitHub:
WangzyNicole/Bimanual-Cloth-Manipulation at 4c2af680cb06 (two cameras), YifanTian07/G1-policy-train at d1d3bb45f16a, and
yipiandanxinxiangyangkai/open_50 at 6fbd82859730, whose folder `video` has to be called `videos`.

    python benchmarks/video_faults.py [FOLDER ...]
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.formats.format import Shot
from rpil.formats.lerobot.checked_folder import find_defects, find_shots
from rpil.numerics.types import Array

FPS, SECONDS, SIZE, EPISODES = 20, 8, (96, 128), 10  # of a made set
SHARE, SEED = 0.2, 0
OPTIONS = {"g": "2", "crf": "30"}  # of LeRobot
Frames = list[Array]


def frozen(own: Frames) -> Frames:
    begin = len(own) * 2 // 5
    return own[:begin] + [own[begin]] * (len(own) - begin)


KINDS: dict[str, tuple[str, Callable[[Frames], Frames]]] = {
    "frozen": ("frozen picture", frozen),
    "black": ("black frames", lambda own: [0 * one if 20 <= k < 50 else one for k, one in enumerate(own)]),
}


def joints(rng: np.random.Generator) -> Array:
    """Two joints that go from place to place and wait there, (N, 2)."""
    times, n = np.arange(SECONDS * FPS), 7
    ends = np.sort(rng.uniform(0, len(times), (2, n)), axis=1)
    steps = 1 / (1 + np.exp(-(times[:, None] - ends[:, None]) / rng.uniform(1, 4, (2, 1, n))))
    return np.sum(steps * rng.uniform(-0.6, 0.6, (2, 1, n)), axis=2).T


def frames_of(kind: str, state: Array, seed: int) -> Frames:
    """Pictures of an arm by a fixed camera, or by one that moves with the hand, with the noise of a sensor."""
    rng, scene = np.random.default_rng(seed), np.random.default_rng(9)
    room = np.kron(scene.uniform(40, 200, (24, 32)), np.ones((8, 8)))  # twice the picture in each direction
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    found = []
    for a, b in state:
        top, left = 48 + (16 * np.array([a, b]) if kind == "hand" else np.zeros(2)).clip(-47, 47)
        picture = room[round(top) :, round(left) :][: SIZE[0], : SIZE[1]].copy()
        if kind in ("moving", "dark"):
            for length, angle in ((30, a), (60, a + b)):
                y, x = 90 - length * np.cos(angle), 64 + length * np.sin(angle)
                picture[(rows - y) ** 2 + (columns - x) ** 2 < 12**2] = 250
        picture = (0.15 if kind == "dark" else 1.0) * picture + rng.normal(0, 1, SIZE)
        found.append(np.repeat(picture.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2))
    return found


def write_video(path: Path, frames: Frames, fps: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000), options=OPTIONS)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for one in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(one))))
        file.mux(stream.encode())


def write_set(root: Path, kind: str) -> Path:
    """A folder of version 2.1 with one camera."""
    rng, camera = np.random.default_rng(SEED), "observation.images.front"
    features = {
        camera: {"dtype": "video", "shape": [*SIZE, 3]},
        "observation.state": {"dtype": "float32", "shape": [2]},
    }
    info = {"codebase_version": "v2.1", "fps": FPS, "features": features, "chunks_size": 1000}
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info))
    (root / "meta" / "episodes_stats.jsonl").write_text("")
    lines = []
    for m in range(EPISODES):
        state = joints(rng)
        n, name = len(state), f"episode_{m:06d}"
        columns = {"observation.state": state.tolist(), "action": state.tolist(), "timestamp": np.arange(n) / FPS}
        columns |= {"episode_index": np.full(n, m), "frame_index": np.arange(n), "index": m * n + np.arange(n)}
        (root / "data" / "chunk-000").mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.table(columns), root / "data" / "chunk-000" / f"{name}.parquet")
        place = root / "videos" / "chunk-000" / camera / f"{name}.mp4"
        write_video(place, frames_of(kind, state, m), FPS)
        lines.append(json.dumps({"episode_index": m, "length": n, "tasks": ["move"]}))
    (root / "meta" / "episodes.jsonl").write_text("\n".join(lines) + "\n")
    return root


def decode(shot: Shot) -> Frames:
    """The frames of an episode that has a file of its own."""
    with av.open(str(shot.path)) as file:
        return [one.to_ndarray(format="rgb24") for one in file.decode(video=0)][: shot.n_rows]


def measure(name: str, root: Path, n_episodes: int) -> None:
    """Print a line for each kind: the planted that are found by name, those found at all, and others accused."""
    fps = json.loads((root / "meta" / "info.json").read_text())["fps"]
    shots = [shot for shot in find_shots(root) if shot.path.is_file()]
    for shot in [shot for shot in shots if shot.episode >= n_episodes]:
        shot.path.unlink()
    shots = [shot for shot in shots if shot.path.is_file()]
    before = findings(root)
    print(f"{name}: {len(shots)} videos; found before a fault is planted: {sorted(before) or 'nothing'}", flush=True)
    for kind, (rule, change) in KINDS.items():
        kept = {shot: shot.path.read_bytes() for shot in planted(shots)}
        for shot in kept:
            write_video(shot.path, change(decode(shot)), fps)
        found = findings(root) - before
        places = {(shot.camera, str(shot.episode)) for shot in kept}
        named = sum((rule, *place) in found for place in places)
        seen = sum(any(one[1:] == place for one in found) for place in places)
        false = sorted(one for one in found if one[1:] not in places)
        print(
            f"  {kind:<16} {named} of {len(places)} named, {seen} found, {len(false)} false {false or ''}", flush=True
        )
        for shot, content in kept.items():
            shot.path.write_bytes(content)


def planted(shots: Sequence[Shot]) -> list[Shot]:
    """A fifth of the videos of each camera."""
    rng, found = np.random.default_rng(SEED), list[Shot]()
    for camera in sorted({shot.camera for shot in shots}):
        own = [shot for shot in shots if shot.camera == camera]
        found += [own[k] for k in rng.choice(len(own), max(1, round(SHARE * len(own))), replace=False)]
    return found


def findings(root: Path) -> set[tuple[str, str, str]]:
    """Rules, cameras and episodes of what is found in pictures."""
    rules = {rule for rule, _ in KINDS.values()}
    return {
        (one.what, one.sentence.split(" ", 1)[0], one.place) for one in find_defects(root, True) if one.what in rules
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--episodes", type=int, default=25, help="of each folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        for kind in ("moving", "still", "hand", "dark"):
            measure(f"made, {kind}", write_set(Path(place) / kind, kind), EPISODES)
        for folder in options.folders:
            copy = Path(place) / folder.name
            shutil.copytree(folder, copy)
            measure(folder.name, copy, options.episodes)


if __name__ == "__main__":
    main()
