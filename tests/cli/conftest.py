"""A current folder for each test, and files that all tests may read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from asked import write
from command_line import ENV, ok
from rpil import RPIL, formats
from small import FAST


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Files that all tests may read and none may change."""
    folder = tmp_path_factory.mktemp("cli")
    for name, kind in (("good", "corrupted"), ("shifted", "shift")):
        n = ["--good", "6", "--bad", "6"]
        path = folder / f"{name}.parquet"
        ok("simulate", "--env", ENV, "--kind", kind, *n, "-o", str(path), "--seed", "1")
        good_first(path)
    ok("fit", str(folder / "good.parquet"), "-o", str(folder / "policy"))
    return folder


def good_first(path):
    """Write demonstrations 0 to 5 again as the good ones, so that tests can name them."""
    demonstrations = formats.read(path)
    table = pq.read_table(path)
    truth = {name: np.array(table[name])[demonstrations.offsets[:-1]] for name in ("is_good", "episode_return")}
    order = np.argsort(-truth["is_good"], kind="stable")
    made = replace(demonstrations.select(order), ids=tuple(range(len(order))))
    formats.write(path, made, {name: values[order] for name, values in truth.items()})


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    """Demonstrations of which some act at random, for tests that ask about them."""
    return write(tmp_path_factory.mktemp("asked") / "d.parquet")


@pytest.fixture(scope="session")
def audit(data):
    """Their audit."""
    return RPIL(settings=FAST).fit(formats.read(data, observations=["x", "v"])).audit_


@pytest.fixture(autouse=True)
def current_folder(tmp_path, monkeypatch):
    """A current folder for each test."""
    monkeypatch.chdir(tmp_path)
