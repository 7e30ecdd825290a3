"""Data sets of the Hub by their short names: what is called so is downloaded, and nothing else is asked for."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

import rpil
from command_line import ok
from rpil.data.errors import DataError
from samples import lerobot


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The names that a client of the Hub, which has one data set, was asked for."""
    monkeypatch.chdir(tmp_path)
    names, there = [], lerobot(tmp_path)

    def snapshot_download(name, *, repo_type, allow_patterns):
        assert repo_type == "dataset"
        assert not any("videos" in pattern for pattern in allow_patterns)
        names.append(name)
        if name != "robots/reach":
            raise RuntimeError("404, not found")
        return str(there)

    client = ModuleType("huggingface_hub")
    client.snapshot_download = snapshot_download
    monkeypatch.setitem(sys.modules, "huggingface_hub", client)
    return names


def test_a_name_is_downloaded(asked):
    assert "3 demonstrations, 15 steps" in ok("info", "robots/reach").stdout
    assert asked == ["robots/reach"]


def test_what_the_hub_does_not_have_is_one_sentence(asked):
    with pytest.raises(DataError, match=r"the Hub did not give it \(RuntimeError: 404, not found\); try again"):
        rpil.read("robots/nothing")


@pytest.mark.parametrize("path", ["nothing.csv", "meta/nothing", "a/b/c", "../x", "lerobot"])
def test_a_path_is_not_asked_for(path, asked, tmp_path):
    (tmp_path / "meta").mkdir(exist_ok=True)
    if path == "lerobot":
        assert len(rpil.read(path)) == 3
    else:
        with pytest.raises(DataError, match="there is no such file or folder"):
            rpil.read(path)
    assert asked == []


def test_without_the_client_the_remedy_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(DataError, match=r"pip install 'rpil\[hub\]'"):
        rpil.read("lerobot/pusht")
