"""A current folder for each test, and files that all tests may read."""

import numpy as np
import pytest

import rpil
from asked import write
from command_line import ENV
from rpil import RPIL, formats
from small import FAST


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Files that all tests may read and none may change."""
    folder = tmp_path_factory.mktemp("cli")
    for name, kind in (("good", "corrupted"), ("shifted", "shift")):
        made = rpil.simulate(ENV, kind, n_good=6, n_bad=6, seed=1)
        order = np.argsort(-made.is_good, kind="stable")  # 0 to 5 are the good ones, so that tests can name them
        demonstrations = rpil.Demonstrations.from_episodes([made.episodes[m] for m in order], source=ENV)
        truth = {"is_good": made.is_good[order], "episode_return": made.returns[order]}
        formats.write(folder / f"{name}.parquet", demonstrations, truth)
    return folder


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    """Demonstrations of which some act at random, for tests that ask about them."""
    return write(tmp_path_factory.mktemp("asked") / "d.parquet")


@pytest.fixture(scope="session")
def audit(data):
    """Their audit."""
    return RPIL(settings=FAST).fit(formats.read(data, observations=["x", "v"])).audit_
