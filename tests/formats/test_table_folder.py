"""Folders: Parquet files come before text tables, and an empty folder is refused."""

import pytest

from problems import refused
from rpil import formats
from rpil.data.errors import DataError
from samples import lerobot


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("drive_0.mcap", r"a recording of ROS or MCAP \(drive_0.mcap\) is never opened.*choose one rate"),
        ("drive.xlsx", r"a workbook \(drive.xlsx\) .*; export its table as CSV or Parquet"),
        ("drive.csv.gz", r"a packed table \(drive.csv.gz\) is never opened; unpack it with gunzip"),
        ("f.pickle", r"a pickle \(f.pickle\) is never opened; it can run any code: write a frame with df\.to_parq"),
        ("data-0.arrow", r"a file of Arrow \(data-0.arrow\) is never opened; load it in Python, as with imitation"),
        ("kuka-train.tfrecord-00000-of-00002", "a data set of RLDS or TFDS .* with openx2lerobot"),
    ],
)
def test_what_is_to_be_converted_first_is_named_with_the_way(tmp_path, name, message):
    (tmp_path / name).write_bytes(b"x")
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(DataError, match=message):
            formats.read_recording(path)


@pytest.mark.parametrize(
    ("given", "file"), [("set", "main_data.hdf5"), ("set", "0/part-0.arrow"), ("set/data", "0/part-0.parquet")]
)
def test_a_folder_of_minari_is_refused_with_the_way_to_go(tmp_path, given, file):
    data = tmp_path / "set" / "data"
    (data / "0").mkdir(parents=True)
    (data / "metadata.json").write_text('{"data_format": "parquet", "total_episodes": 1}')
    (data / file).write_bytes(b"PAR1")
    with pytest.raises(
        DataError, match=r"is a data set of Minari; read it in Python, by rpil\.read\(minari\."
    ) as error:
        formats.read_recording(tmp_path / given)
    assert str(error.value).endswith(f"or give its file {data / file}.") == (file == "main_data.hdf5")


def test_a_folder_of_lerobot_within_is_named(tmp_path):
    lerobot(tmp_path / "sets" / "me")
    for folder in (tmp_path / "sets", tmp_path / "sets" / "me"):
        with pytest.raises(DataError, match=r"in it is a folder of LeRobot, which is read alone; give .*lerobot"):
            formats.read_recording(folder)
    meta = next(folder.glob("*/meta"))
    with pytest.raises(DataError, match=rf"meta: it describes a folder of LeRobot; give that one, {meta.parent}"):
        formats.read_recording(meta)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_each_file_is_a_demonstration_where_no_column_names_one(tmp_path, suffix):
    columns = {"file": ["a.png", "b.png"], "obs": [0.0, 0.5], "action": [0.5, 1.5]}
    for name in ("one/1", "one/2", "two/1"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        formats.write_columns(tmp_path / f"{name}{suffix}", columns, "steps")
    assert formats.read(tmp_path).ids == ("one/1", "one/2", "two/1")
    (tmp_path / "one").rename(tmp_path / "episode=1")  # files of one partition are no demonstrations
    if suffix == ".parquet":
        with refused("no column says which demonstration"):
            formats.read(tmp_path)


def test_text_beside_tables_is_left_out_and_named(tmp_path):
    table = "step,x,action\n" + "".join(f"{k},{k * k},{k % 2}\n" for k in range(6))
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text(table)
    assert formats.read_recording(tmp_path).ids == ("a", "b")
    for name in ("c.csv", "d.csv"):
        (tmp_path / name).write_text(table)
    (tmp_path / "labels.csv").write_text("id,label\na,good\n")
    (tmp_path / "intrinsics.npz").write_bytes(b"x")
    recording = formats.read_recording(tmp_path)
    assert recording.ids == ("c", "d")
    beside = dict.fromkeys(("a.txt", "b.txt", "labels.csv", "intrinsics.npz"), "not read beside text tables")
    assert beside.items() <= recording.description.ignored.items()
