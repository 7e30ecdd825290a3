import pytest

import rpil
from problems import refused
from rpil.formats.registry import find
from samples import assert_same_on_disk, lerobot


@pytest.mark.parametrize("name", ["out.csv", "out.hdf5", "out.zip"])
def test_a_folder_is_no_file(tmp_path, name):
    source = find(lerobot(tmp_path))
    with refused("the data are a folder, so name a folder"):
        source.keep(tmp_path / name, ["0"])
    (tmp_path / "notes").touch()
    with refused("notes: it is there already; give the path of a new folder"):
        source.check_output(tmp_path / "notes")  # before any work


@pytest.mark.parametrize("address", ["s3://KEY:HIDDEN@bucket/data", "https://a.org/x.csv?token=HIDDEN", "hf://a/b/c"])
def test_addresses_are_not_read_and_their_secrets_not_shown(address):
    with refused(rf"^{address.partition('://')[0]}://\.\.\.: addresses are not read; download the"):
        find(address)


PACKAGE = """
import pyarrow as pa
def steps(path):
    for m, line in enumerate(path.read_text().split()):
        x = [float(letter) for letter in line]
        yield pa.table({"episode": [m] * len(x), "observation": x, "action": x, "note": ["?"] * len(x)})
"""


def test_another_package_adds_a_format(tmp_path, monkeypatch):
    (tmp_path / "walks-1.dist-info").mkdir()
    (tmp_path / "walks-1.dist-info" / "METADATA").write_text("Name: walks\nVersion: 1\n")
    (tmp_path / "walks-1.dist-info" / "entry_points.txt").write_text("[rpil.formats]\n.walk = walks:steps\n")
    (tmp_path / "walks.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "a.walk").write_text("1234 5678 9012")
    assert_same_on_disk(tmp_path / "a.walk")
    recording = rpil.open(tmp_path / "a.walk", only="1-2")
    assert recording.demonstrations.observations[:, 0].tolist() == [5, 6, 7, 8, 9, 0, 1, 2]
    assert recording.description.format == ".walk"
    assert isinstance(rpil.open(tmp_path / "a.walk", memory="100").demonstrations, rpil.Dataset)
    recording.keep(["2"], tmp_path / "ids.txt")
    assert (tmp_path / "ids.txt").read_text() == "2\n"
    (tmp_path / "b.walk").write_text("12 x")
    with refused(r"b\.walk: .*could not convert"):
        rpil.open(tmp_path / "b.walk")
