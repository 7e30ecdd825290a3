"""Data sets of the Hub: an address is downloaded, and no path is sent there."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import pytest

import rpil
from command_line import ok, refused
from rpil.data.errors import DataError, MissingExtraError
from samples import lerobot


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The names that a client of the Hub, which has one data set, was asked for."""
    monkeypatch.chdir(tmp_path)
    names, there = [], lerobot(tmp_path)

    class HfApi:
        def dataset_info(self, name, files_metadata):
            assert files_metadata
            files = ("meta/info.json", 2e6), ("data/chunk-000/file-000.parquet", 1e6), ("videos/front/a.mp4", 9e9)
            return SimpleNamespace(siblings=[SimpleNamespace(rfilename=path, size=size) for path, size in files])

    def snapshot_download(name, *, repo_type, allow_patterns):
        assert repo_type == "dataset"
        assert not any("videos" in pattern for pattern in allow_patterns)
        names.append(name)
        if name != "robots/reach":
            raise type(name.partition("/")[2], (RuntimeError,), {})("404, not found")
        return str(there)

    client = ModuleType("huggingface_hub")
    client.snapshot_download, client.HfApi = snapshot_download, HfApi
    monkeypatch.setitem(sys.modules, "huggingface_hub", client)
    return names


ADDRESS = "hf://datasets/robots/reach"


def test_an_address_is_downloaded_after_its_size_is_said(asked, caplog):
    assert "3 demonstrations, 15 steps" in ok("info", ADDRESS).stdout
    assert asked == ["robots/reach"]
    assert caplog.messages == [f"{ADDRESS}: downloads 3.0 MB."]


def test_what_the_hub_does_not_give_is_one_sentence(asked):
    said = r"the Hub did not give it \(Nothing: 404, not found\); check the name and the network"
    with pytest.raises(DataError, match=f"Nothing: .*{said}"):
        rpil.read("hf://datasets/robots/Nothing")


@pytest.mark.parametrize(
    "path", ["robots/reach", "logs/customer-secret", "data/run.csv", "nothing.csv", "meta/nothing"]
)
def test_no_path_is_sent_to_the_hub(path, asked, tmp_path):
    (tmp_path / "meta").mkdir(exist_ok=True)
    is_name = "/" in path and not path.startswith("meta")
    told = refused("there is no such file or folder", "info", path)
    assert (f"give hf://datasets/{path} if it is a data set of the Hub." in told) == is_name
    assert asked == []


def test_without_the_client_the_remedy_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(MissingExtraError, match=r"hf://datasets/lerobot/pusht: .* pip install 'rpil\[hub\]'"):
        rpil.read("hf://datasets/lerobot/pusht")
