import json
import os
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import rpil
from rpil import formats
from rpil.data.errors import DataError
from rpil.formats.registry import find

zarr = pytest.importorskip("zarr", minversion="3", reason="needs the extra zarr")
numcodecs = pytest.importorskip("numcodecs")

ENDS = np.array([4, 9, 11])


def write_buffer(tmp_path, zarr_format=2, action=None):
    """A replay buffer of 3 demonstrations and 11 steps, and its arrays; of images no codec is installed."""
    folder = tmp_path / "buffer.zarr"
    root = zarr.create_group(folder, zarr_format=zarr_format)
    arrays = {
        "action": np.arange(22, dtype=np.float32).reshape(11, 2) if action is None else action,
        "state": np.arange(33.0).reshape(11, 3),
        "keypoint": np.arange(44.0).reshape(11, 2, 2),
    }
    for name, values in arrays.items():
        root.create_array(f"data/{name}", data=values, chunks=(3, *values.shape[1:]))
    images = np.repeat(np.arange(11, dtype=np.uint8), 48).reshape(11, 4, 4, 3)
    codec = numcodecs.Zlib() if zarr_format == 2 else "auto"
    root.create_array("data/img", data=images, chunks=(1, 4, 4, 3), compressors=codec)
    root.create_array("meta/episode_ends", data=ENDS, compressors=None)
    header = folder / "data/img/.zarray"
    if header.exists():
        header.write_text(json.dumps({**json.loads(header.read_text()), "compressor": {"id": "imagecodecs_jpegxl"}}))
    return folder, arrays


@pytest.mark.parametrize("zarr_format", [2, 3])
@pytest.mark.parametrize("zipped", [False, True])
def test_zarr_read_and_kept(tmp_path, zarr_format, zipped):
    output = tmp_path / "kept.zarr"
    path, arrays = write_buffer(tmp_path, zarr_format)
    if zipped:
        path, output = shutil.make_archive(str(path), "zip", path), tmp_path / "kept.zarr.zip"
    recording = formats.read_recording(path)
    d = recording.demonstrations
    assert d.ids == (0, 1, 2)
    assert d.offsets.tolist() == [0, *ENDS]
    np.testing.assert_array_equal(d.actions, arrays["action"])
    np.testing.assert_array_equal(d.observations, arrays["state"])
    assert recording.description.format == "Zarr replay buffer"
    assert set(recording.description.ignored) == {"img", "keypoint"}
    points = rpil.read(path, observations="keypoint")
    np.testing.assert_array_equal(points.observations, arrays["keypoint"].reshape(11, 4))

    find(path).keep(output, [2, 0])
    kept = formats.read_recording(output).demonstrations
    rows = [0, 1, 2, 3, 9, 10]
    np.testing.assert_array_equal(kept.observations, arrays["state"][rows])
    assert kept.lengths.tolist() == [4, 2]
    if zipped:
        shutil.unpack_archive(output, tmp_path / "open")
        output = tmp_path / "open"
    header = output / "data/img/.zarray"
    if header.exists():  # as it was, but for its length
        assert json.loads(header.read_text())["shape"] == [6, 4, 4, 3]
        header.write_text(json.dumps({**json.loads(header.read_text()), "compressor": {"id": "zlib", "level": 1}}))
    group = zarr.open_group(output, mode="r")
    np.testing.assert_array_equal(group["data/img"][:, 0, 0, 0], rows)
    assert group["data/action"].chunks == (3, 2)
    assert group["meta/episode_ends"][:].tolist() == [4, 6]


def test_zarr_without_data_or_of_another_length(tmp_path):
    path, _ = write_buffer(tmp_path, action=np.ones((10, 2)))
    with pytest.raises(DataError, match=r"buffer.zarr: data/action has the shape \(10, 2\), but .* ends at 11 steps"):
        rpil.read(path)
    shutil.rmtree(path / "data")
    with pytest.raises(DataError, match=r"3 demonstrations and 11 steps, but no array .*; copy the data as well\.$"):
        rpil.read(path)


def test_hostile_zarr(tmp_path):
    path, _ = write_buffer(tmp_path)
    header = path / "meta/episode_ends/.zarray"
    about = json.loads(header.read_text())
    for change, message in (
        ({"shape": [10**15], "chunks": [10**15]}, "more memory than is free"),
        ({"dtype": "<f8"}, "must hold rising numbers of steps"),
        ({"dtype": "|O"}, "episode_ends .* the type '.O', which is not read"),
        ({"shape": "x"}, "header is damaged"),
        ({"compressor": {"id": "imagecodecs_jpegxl"}}, "meta/episode_ends must hold rising numbers"),
    ):
        header.write_text(json.dumps({**about, **change}))
        with pytest.raises(DataError, match=message):
            rpil.read(path)
    header.write_text(json.dumps({**about}))
    (path / "meta/episode_ends/0").write_bytes(np.array([4, 10**15, 10**16]).tobytes())
    with pytest.raises(DataError, match=r"data/action has the shape .*, but .* ends at 10,000,000,000,000,000 steps"):
        rpil.read(path)
    (path / "meta/episode_ends/0").unlink()
    with pytest.raises(DataError, match=r"meta/episode_ends: 1 of its 1 chunks are not there; copy it again\.$"):
        rpil.read(path)


@pytest.mark.parametrize("place", ["data/img/4.0.0.0", "data/action/1.0", "data/key"])
def test_a_chunk_that_is_a_link_out_of_the_store_is_not_published(tmp_path, place):
    secret = tmp_path / "key"
    path, _ = write_buffer(tmp_path)
    secret.write_bytes(bytes(24))
    (path / place).unlink(missing_ok=True)
    (path / place).symlink_to(secret)
    for use in (rpil.read, lambda path: find(path).keep(tmp_path / "kept.zarr", [1])):
        with pytest.raises(DataError, match=f"{place}: it is a link that leads out"):
            use(path)
    assert not (tmp_path / "kept.zarr").exists()


@pytest.mark.slow
def test_a_zip_file_leaves_nothing_beside_it(tmp_path):
    output = tmp_path / "out" / "kept.zarr.zip"
    path, _ = write_buffer(tmp_path)
    path = shutil.make_archive(str(path), "zip", path)
    output.parent.mkdir()
    script = "import os, sys; from rpil.formats import zarr; from rpil.formats.registry import find\n"
    script += "zarr._create = lambda *_: os.kill(os.getpid(), 9)\n"
    script += "find(sys.argv[1]).keep(sys.argv[2], [1])"
    subprocess.run([sys.executable, "-c", script, path, output], check=False)
    assert all(name.startswith(".kept.zarr.") for name in os.listdir(output.parent))
    find(path).keep(output, [1])
    assert os.listdir(output.parent) == [output.name]


@pytest.mark.parametrize("action", [None, np.arange(11.0)[:, None]])
def test_demonstrations_without_a_chunk_are_named(tmp_path, action):
    path, _ = write_buffer(tmp_path, action=action)
    (path / "data/action/3.0").unlink()  # steps 9 and 10
    with pytest.raises(DataError, match=r"data/action: 1 of its 4 chunks .* demonstrations 2, .*write_empty_chunks"):
        rpil.read(path)
    with pytest.raises(DataError, match=r"data/action: 1 of its 4 chunks"):
        find(path).keep(tmp_path / "kept", [0, 2])
    assert [file.name for file in tmp_path.iterdir()] == ["buffer.zarr"]


def test_chunks_of_columns_that_are_not_read_may_be_missing(tmp_path):
    path, _ = write_buffer(tmp_path)
    root = zarr.open_group(path)
    root.create_array("data/reward", data=np.arange(11.0) // 9, chunks=(3,))  # zarr leaves chunks of zeros out
    assert len(rpil.read(path)) == 3
    find(path).keep(tmp_path / "kept.zarr", [0, 2])
    assert zarr.open_group(tmp_path / "kept.zarr")["data/reward"][:].tolist() == [0, 0, 0, 0, 1, 1]
    (path / "data/keypoint/3.0.0").unlink()  # which may hold anything
    with pytest.raises(DataError, match="data/keypoint: 1 of its 4 chunks"):
        find(path).keep(tmp_path / "no.zarr", [0, 2])


def test_a_zip_file_is_one_by_its_name(tmp_path):
    folder, _ = write_buffer(tmp_path)
    path = tmp_path / "buffer.zarr.ZIP"
    shutil.move(shutil.make_archive(str(tmp_path / "x"), "zip", folder), path)
    assert len(rpil.read(path)) == 3
    with pytest.raises(DataError, match=r"kept\.zarr.* \.ZIP"):
        find(path).keep(tmp_path / "kept.zarr", [0])
    other = path.rename(tmp_path / "buffer.dat")
    with pytest.raises(DataError, match="unknown extension"):
        rpil.read(other)
    outside = shutil.make_archive(str(tmp_path / "outside"), "zip", tmp_path, "buffer.zarr")  # the folder itself
    with pytest.raises(DataError, match=r"outside\.zip: it holds .buffer\.zarr/. and no meta/episode_ends at its top"):
        rpil.read(outside)
    damaged = tmp_path / "damaged.zarr.zip"
    damaged.write_bytes(other.read_bytes()[:-30])
    with pytest.raises(DataError, match=r"damaged\.zarr\.zip: no ZIP file, or a damaged one"):
        rpil.read(damaged)


def test_names_in_a_zip_file_that_lead_out_of_it_are_not_read(tmp_path):
    folder, _ = write_buffer(tmp_path)
    path = shutil.make_archive(str(folder), "zip", folder)
    with zipfile.ZipFile(path, "a") as archive:
        for name in ("data/../.zarray", "data/./.zarray", "data//.zarray", "data/a\\b/.zarray", "/data/c/.zarray"):
            archive.writestr(name, "{}")
    find(path).keep(tmp_path / "kept.zarr.zip", [0])
    assert set(rpil.open(tmp_path / "kept.zarr.zip").description.ignored) == {"img", "keypoint"}


@pytest.mark.parametrize("zarr_format", [2, 3])
def test_groups_within_groups_are_read_and_all_that_is_said_is_kept(tmp_path, zarr_format):
    path, output = write_buffer(tmp_path, zarr_format)[0], tmp_path / "kept.zarr"
    root = zarr.open_group(path)
    root.create_array("data/obs/force", data=np.arange(11.0)[:, None])
    root.create_array("meta/task", data=np.arange(3) + 7)
    root.create_array("meta/zeros", data=np.zeros(3))  # of which zarr writes no chunk
    root.create_array("meta/hz", data=np.array([10.0, 20.0]))
    root.attrs["made by"], root["data/obs"].attrs["unit"] = "us", "N"
    assert formats.read_recording(path).description.observations == ("force",)
    find(path).keep(output, [1, 2])
    kept = zarr.open_group(output)
    assert (kept.attrs["made by"], kept["data/obs"].attrs["unit"]) == ("us", "N")
    np.testing.assert_array_equal(kept["data/obs/force"][:, 0], np.arange(ENDS[0], 11))
    np.testing.assert_array_equal(kept["meta/task"], [8, 9])
    np.testing.assert_array_equal(kept["meta/zeros"], [0, 0])
    np.testing.assert_array_equal(kept["meta/hz"], [10, 20])
