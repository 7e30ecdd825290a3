"""An audit of demonstrations of which some act at random, and a current folder for each test."""

from __future__ import annotations

import pytest

from asked import write
from rpil import RPIL, read
from small import FAST


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    return write(tmp_path_factory.mktemp("review") / "d.parquet")


@pytest.fixture(scope="session")
def audit(data):
    return RPIL(settings=FAST).fit(read(data, observations=["x", "v"])).audit_


@pytest.fixture(autouse=True)
def current_folder(tmp_path, monkeypatch):
    """A current folder for each test."""
    monkeypatch.chdir(tmp_path)
