"""A current folder for each test, and files that all tests may read."""

from __future__ import annotations

import pytest

from command_line import ENV, ok


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Files that all tests may read and none may change."""
    folder = tmp_path_factory.mktemp("cli")
    for name, kind in (("good", "corrupted"), ("shifted", "shift")):
        n = ["--good", "6", "--bad", "6"]
        ok("simulate", "--env", ENV, "--kind", kind, *n, "-o", str(folder / f"{name}.parquet"), "--seed", "1")
    ok("fit", str(folder / "good.parquet"), "-o", str(folder / "policy"))
    return folder


@pytest.fixture(autouse=True)
def current_folder(tmp_path, monkeypatch):
    """A current folder for each test."""
    monkeypatch.chdir(tmp_path)
