"""Files that are not what a user takes them for: each is one sentence that names what is wrong and the way to go."""

from __future__ import annotations

import pickle
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import ok, refused
from rpil.data.errors import DataError

RNG = np.random.default_rng(0)
N = 240


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def table(name, columns):
    """A CSV file of these columns."""
    rows = zip(*(map(str, values) for values in columns.values()), strict=True)
    name.parent.mkdir(exist_ok=True)
    name.write_text("\n".join([",".join(columns), *(",".join(row) for row in rows)]) + "\n")
    return name


def numbers():
    return [f"{x:.3f}" for x in RNG.normal(size=N)]


def drive(**changes):
    trips = {"trip": np.arange(N) // 20, "time": np.arange(N) / 20}
    return trips | {"speed": numbers(), "steer": numbers(), "pedal": numbers()} | changes


@pytest.mark.parametrize("names", ["episode,step,x,action", "a,b,c", "episode,action"])
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_names_without_rows_are_said_to_have_none(names, suffix, tmp_path):
    path = tmp_path / f"a.{suffix}"
    path.write_text(f"{names}\n")
    if suffix == "parquet":
        pq.write_table(pa.table({name: pa.array([], pa.float64()) for name in names.split(",")}), path)
    refused("it has no rows" if suffix == "csv" else "it has no rows|no demonstrations; give|no column", "info", path)


def test_one_id_in_all_rows_is_named(tmp_path):
    path = table(tmp_path / "P01.csv", drive(trip=["P01"] * N))
    refused("all steps are of demonstration 'P01', and one demonstration alone", "audit", path)


@pytest.mark.parametrize("name", ["frame.pkl", "frame.pickle"])
def test_a_pickle_is_named_and_never_opened(name, tmp_path):
    (tmp_path / name).write_bytes(pickle.dumps({"episode": [1, 2]}))
    refused(
        r"a pickle .* is never opened; it can run any code: write a frame with df\.to_parquet", "info", tmp_path / name
    )
    (tmp_path / "folder").mkdir()
    (tmp_path / name).rename(tmp_path / "folder" / name)
    refused(rf"a pickle .{name}. is never opened", "info", tmp_path / "folder")


@pytest.mark.parametrize("inside", ["drive.csv", "drives/1.parquet"])
def test_a_zip_file_of_a_table_is_to_be_unpacked(inside, tmp_path):
    with zipfile.ZipFile(tmp_path / "drive.zip", "w") as archive:
        archive.writestr(inside, "episode,x,action\n0,1,2\n")
    refused(r"drive\.zip: there is no meta/episode_ends .*, or unpack the file", "info", tmp_path / "drive.zip")


def test_ids_of_many_digits_are_told_apart(tmp_path):
    ids = [f"12345678901234567890123{m:03d}" for m in np.arange(N) // 20]
    path = table(tmp_path / "a.csv", drive(trip=ids))
    for words in ((), ("--id", "trip", "--action", "steer,pedal")):
        assert "12 demonstrations" in ok("info", path, *words).stdout
    assert rpil.read(path, id="trip", action=["steer", "pedal"]).ids == tuple(dict.fromkeys(ids))


@pytest.mark.parametrize("texts", [("1 0", "0 1"), ("left, up", "0.5 up"), ("1.5 s", "v1.2")])
def test_other_texts_are_classes(texts, tmp_path):
    given = {
        "episode": np.arange(N) // 20,
        "x": numbers(),
        "action": [f'"{texts[k]}"' for k in RNG.integers(2, size=N)],
    }
    assert "Action: action; discrete: 2 different texts" in ok("info", table(tmp_path / "a.csv", given)).stdout


GERMAN = {"trip": "versuch", "time": "zeit", "speed": "geschwindigkeit", "steer": "lenkung", "pedal": "winkel"}


def test_headers_in_another_language_are_a_question(tmp_path):
    path = table(tmp_path / "a.csv", {GERMAN[name]: values for name, values in drive().items()})
    columns = ", ".join(map(repr, GERMAN.values()))
    refused(f"no column says which demonstration a row is from: .* --id .found {columns}", "info", path)
    named = ["info", path, "--id", "versuch"]
    refused(f"no column holds the action: .* name the columns with --action .found {columns}", *named)
    assert "12 demonstrations" in ok(*named, "--action", "lenkung,winkel").stdout


def test_a_second_head_is_named(tmp_path):
    path = table(tmp_path / "a.csv", drive(id=np.arange(N) // 20, action=np.arange(N) % 7 / 3))
    head, *rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join([head, *rows[:30], head, *rows[30:]]))
    refused(r"a\.csv, line 32: it repeats the names of the columns, .*; correct it", "info", path)


def test_many_texts_as_actions_name_the_option_of_the_command(tmp_path):
    path = table(tmp_path / "a.csv", drive(id=np.arange(N) // 20, action=[f"a{k}" for k in range(N)]))
    refused(r"too many to compare; .* give --action-kind discrete\.$", "audit", path)
    with pytest.raises(DataError, match=r"give action_kind= discrete\.$"):
        rpil.read(path)
