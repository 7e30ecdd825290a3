"""Archives of models: their members, and the same archive with other members."""

import io
import json
import zipfile

import numpy as np

import problems
from rpil import Demonstrations, load
from rpil.simulation.simulate import simulate

LOST = "do not belong together"


def mountain_car():
    """Four good and four corrupted demonstrations with ids and names that are no ASCII."""
    made = simulate("MountainCar-v0", "corrupted", n_good=4, n_bad=4, seed=0)
    return Demonstrations.from_episodes(
        made.episodes, ids=[f"é{m}" for m in range(8)], observation_names=["x", "v"], source="mc"
    )


def members(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewrite(path, changes=(), header=None):
    """Write the archive again with other members (None: without), and with the header changed in place."""
    content = members(path) | dict(changes)
    if header is not None:
        tree = json.loads(content["header.json"])
        header(tree)
        content["header.json"] = json.dumps(tree).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, part in content.items():
            if part is not None:
                archive.writestr(name, part)


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def refused(path, match):
    """Loading fails with one sentence that names the file and the remedy."""
    with problems.refused(match) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    assert ";" in str(caught.value)
