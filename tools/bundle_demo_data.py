"""Make the demonstrations of `rpil demo`, and of a picture: ``python tools/bundle_demo_data.py SHARED_DATA_FOLDER``.

The same folder and versions give the same files, byte for byte. Truth about each demonstration travels in the files
under names that `rpil.read` never looks at.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.formats import read, write
from rpil.simulation.simulate import simulate

SEED = 0
LANDER = ("x", "y", "x speed", "y speed", "angle", "angular speed", "left leg", "right leg")


def overcooked(shared: Path, out: Path) -> None:
    """The MIT-licensed cramped_room trials, observations and actions untouched, without what only scorers elsewhere
    need."""
    source = shared / "overcooked_cramped_room.npz"
    names = json.loads(source.with_suffix(".json").read_text(encoding="utf-8"))["feature_names"]
    demonstrations = replace(read(source), observation_names=tuple(names))
    with np.load(source, allow_pickle=False) as stored:
        truth = {name: stored[name] for name in ("episode_quality", "is_good")}
    write(out / source.name, demonstrations, truth)


def lunarlander(out: Path) -> None:
    """10 expert and 10 corrupted demonstrations in random order, so that order tells nothing."""
    made = simulate("LunarLander-v3", "corrupted", n_good=10, n_bad=10, seed=SEED)
    order = np.argsort(-made.is_good, kind="stable")[np.random.default_rng(SEED).permutation(len(made.episodes))]
    demonstrations = Demonstrations.from_episodes([made.episodes[m] for m in order], observation_names=LANDER)
    write(out / "lunarlander_corrupted.npz", demonstrations, {"is_good": made.is_good[order]})


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shared", type=Path, help="folder that holds overcooked_cramped_room.npz and .json")
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help="checkout to write to")
    arguments = parser.parse_args()
    overcooked(arguments.shared, arguments.root / "src" / "rpil" / "cli" / "bundled")
    lunarlander(arguments.root / "docs")


if __name__ == "__main__":
    main()
