import json
import shutil
import zipfile

import numpy as np
import pytest

import rpil
from problems import refused
from rpil import formats

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
def test_zarr_is_read(tmp_path, zarr_format, zipped):
    path, arrays = write_buffer(tmp_path, zarr_format)
    if zipped:
        path = shutil.make_archive(str(path), "zip", path)
    recording = formats.read_recording(path)
    d = recording.demonstrations
    assert (d.ids, d.offsets.tolist()) == ((0, 1, 2), [0, *ENDS])
    np.testing.assert_array_equal(d.actions, arrays["action"])
    np.testing.assert_array_equal(d.observations, arrays["state"])
    assert recording.description.format == "Zarr replay buffer"
    assert set(recording.description.ignored) == {"img", "keypoint"}
    points = rpil.read(path, observations="keypoint")
    np.testing.assert_array_equal(points.observations, arrays["keypoint"].reshape(11, 4))


def test_zarr_without_data_or_of_another_length(tmp_path):
    path, _ = write_buffer(tmp_path, action=np.ones((10, 2)))
    with refused(r"buffer.zarr: meta/episode_ends must .* up to the 10 of the actions; write it again"):
        rpil.read(path)
    shutil.rmtree(path / "data")
    with refused(r"no array that can be read is in data \(nothing is there\); copy the data as well\.$"):
        rpil.read(path)


def test_hostile_zarr(tmp_path):
    path, _ = write_buffer(tmp_path)
    header = path / "meta/episode_ends/.zarray"
    about = json.loads(header.read_text())
    for change, message in (
        ({"shape": [10**15], "chunks": [10**15]}, "more memory than is free"),
        ({"dtype": "<f8"}, "must hold rising numbers of steps"),
        ({"dtype": "|O"}, "episode_ends: its header is damaged, or of an unknown format"),
        ({"compressor": {"id": "imagecodecs_jpegxl"}}, "there is no meta/episode_ends of numbers"),
    ):
        header.write_text(json.dumps({**about, **change}))
        with refused(message):
            rpil.read(path)
    header.write_text(json.dumps({**about}))
    (path / "meta/episode_ends/0").write_bytes(np.array([4, 10**15, 10**16]).tobytes())
    with refused(r"meta/episode_ends must hold rising .* up to the 11 of the actions"):
        rpil.read(path)
    (path / "meta/episode_ends/0").unlink()
    with refused(r"meta/episode_ends: 1 of its 1 chunks are not there; copy it again, "):
        rpil.read(path)


def test_a_zip_file_is_one_by_its_name(tmp_path):
    folder, _ = write_buffer(tmp_path)
    path = tmp_path / "buffer.zarr.ZIP"
    shutil.move(shutil.make_archive(str(tmp_path / "x"), "zip", folder), path)
    assert len(rpil.read(path)) == 3
    other = path.rename(tmp_path / "buffer.dat")
    with refused("unknown extension"):
        rpil.read(other)
    outside = shutil.make_archive(str(tmp_path / "outside"), "zip", tmp_path, "buffer.zarr")  # the folder itself
    with refused(r"outside\.zip: there is no meta/episode_ends of numbers at the top of it; pack what is in"):
        rpil.read(outside)
    damaged = tmp_path / "damaged.zarr.zip"
    damaged.write_bytes(other.read_bytes()[:-30])
    with refused(r"damaged\.zarr\.zip: no ZIP file, or a damaged one"):
        rpil.read(damaged)


def test_names_in_a_zip_file_that_lead_out_of_it_are_not_read(tmp_path):
    folder, _ = write_buffer(tmp_path)
    path = shutil.make_archive(str(folder), "zip", folder)
    with zipfile.ZipFile(path, "a") as archive:
        for name in ("data/../.zarray", "data/./.zarray", "data//.zarray", "data/a\\b/.zarray", "/data/c/.zarray"):
            archive.writestr(name, "{}")
    assert set(rpil.open(path).description.ignored) == {"img", "keypoint"}


@pytest.mark.filterwarnings("ignore:The codec `vlen-utf8`:UserWarning")  # zarr 3.1.0 says so where it writes texts
@pytest.mark.parametrize("zarr_format", [2, 3])
def test_groups_within_groups_texts_and_shards_are_read(tmp_path, zarr_format):
    path = write_buffer(tmp_path, zarr_format)[0]
    root = zarr.open_group(path)
    shards = {"chunks": (2, 1), "shards": (4, 1)} if zarr_format == 3 else {}
    root.create_array("data/obs/force", data=np.arange(11.0)[:, None], **shards)
    task = root.create_array("data/task", shape=(11,), dtype=np.dtypes.StringDType(), chunks=(11,))
    task[...] = np.repeat(["lift", "push", "lift"], np.diff(ENDS, prepend=0)).astype(np.dtypes.StringDType())
    recording = formats.read_recording(path)
    assert recording.description.observations == ("force",)
    np.testing.assert_array_equal(recording.demonstrations.observations, np.arange(11.0)[:, None])
    assert recording.tasks == {"0": "lift", "1": "push", "2": "lift"}
