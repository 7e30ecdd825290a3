"""Names from data are shown as they are, but for characters that cannot be seen."""

import csv
import itertools
import sys

import numpy as np
import pyarrow as pa
import pytest

import rpil
from rpil import formats
from rpil.data.text import (
    counted,
    data_frame,
    duration,
    each_text,
    for_others,
    from_cell,
    listed,
    moment,
    printable,
    to_cell,
)
from rpil.formats.registry import find
from rpil.formats.table import is_number


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        (7, "7"),
        ("naïve 漢字", "naïve 漢字"),
        ("two\nlines\tand a tab", r"two\nlines\tand a tab"),
        ("\x1b[31mred", r"\x1b[31mred"),
        ("right \u202e left", r"right \u202e left"),
        ("half \ud800", r"half \ud800"),
    ],
)
def test_invisible_characters_are_escaped(name, shown):
    assert printable(name) == shown
    printable(name).encode("utf-8")


def test_five_names_are_listed_and_the_others_counted():
    assert listed(["a"]) == "a"
    assert listed([1, "b\x1b", 3]) == r"1, b\x1b and 3"
    assert listed(range(1005)) == "0, 1, 2, 3, 4 and 1,000 more"
    assert listed(["a", ""], last=", ") == "a, no name"
    assert (counted(1, "step"), counted(2_000, "step")) == ("1 step", "2,000 steps")


def test_times_are_seconds_where_these_are_known():
    assert [duration(n, 0.05) for n in (1, 19, 20, 995)] == ["0.05 s", "0.95 s", "1.0 s", "49.8 s"]
    assert [duration(n, None) for n in (1, 12.4)] == ["1 step", "12 steps"]
    assert [moment(995, seconds) for seconds in (0.05, None)] == ["49.8 s", "step 995"]


def test_no_home_folder_is_named(monkeypatch):
    monkeypatch.setenv("HOME", "/srv/ann")
    for text, shown in (
        ("rpil audit /srv/ann/work/d.csv --id '/srv/ann/a b.csv'", "rpil audit ~/work/d.csv --id '~/a b.csv'"),
        ("/srv/ann", "~"),
        ("/srv/anna/d.csv", "/srv/anna/d.csv"),  # of another folder
        ("file:///srv/ann/work/d.csv", "file://~/work/d.csv"),
        ("/home/bob/d.csv /Users/bob/d.csv", ".../d.csv .../d.csv"),
        ("/mnt/sets/d.csv ../d.csv s3://home/bob/d.csv", "/mnt/sets/d.csv ../d.csv s3://home/bob/d.csv"),
    ):
        assert for_others(text) == shown
    monkeypatch.setenv("HOME", "/")
    assert for_others("rpil audit /mnt/e.csv 1 / 2") == "rpil audit /mnt/e.csv 1 / 2"


FORMULAS = ["=cmd|'/C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "＝1", "-", "'=1"]
DANGER = tuple("=+-@\t\r\n＝＋－＠")
PLAIN = ["", "a", "0", "-5", "+5", "-.5e-3", "1-2", "it's", "'quoted'", "''", "a=b", " =1"]


def test_cells_are_told_from_formulas_and_come_back():
    alphabet = ["", "'", "=", "+", "-", "1", ".", "e", "a", "\t", "\n", " "]
    texts = {"".join(signs) for signs in itertools.product(alphabet, repeat=4)} | {*FORMULAS, *PLAIN}
    for text in texts:
        cell = to_cell(text)
        assert from_cell(cell) == text
        if cell.startswith(DANGER):
            float(cell)  # or it fails
        assert cell in (text, f"'{text}")
    assert len({to_cell(text) for text in texts}) == len(texts)
    assert [to_cell(text) for text in PLAIN] == PLAIN
    assert [to_cell(text) for text in FORMULAS] == [f"'{text}" for text in FORMULAS]
    assert [to_cell(value) for value in (-5, -0.5, None)] == [-5, -0.5, None]


def test_columns_are_changed_as_cells_are():
    column = pa.chunked_array([["=1", "a", None], ["=1", "'b"]])
    assert each_text(to_cell, column).to_pylist() == ["'=1", "a", None, "'=1", "'b"]
    assert each_text(from_cell, each_text(to_cell, column)).equals(column)
    for other in (pa.chunked_array([[-1, 2]]), pa.chunked_array([[-0.5]]), pa.chunked_array([["a"]])):
        assert each_text(to_cell, other).equals(other)


def demonstrations(ids):
    rng, owner = np.random.default_rng(0), np.repeat(np.array(ids), 4)
    return rpil.Demonstrations.from_groups(rng.normal(size=(len(owner), 2)), np.arange(len(owner)) % 3, owner)


@pytest.mark.parametrize("actions", [None, ["+", "-up", "=A1"]])
def test_tables_come_back(tmp_path, actions):
    data = demonstrations(FORMULAS)
    if actions:
        data = rpil.Demonstrations(data.observations, np.array(actions)[data.actions], data.offsets, data.ids)
    formats.write(tmp_path / "a.csv", data, {"operator": ["@Ann"] * len(data)})
    with open(tmp_path / "a.csv", newline="", encoding="utf-8") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [cell for cell in cells if cell.startswith(DANGER) and not is_number(cell)]
    recording = formats.read_recording(tmp_path / "a.csv")
    assert recording.demonstrations.ids == tuple(FORMULAS)
    np.testing.assert_array_equal(recording.demonstrations.actions, data.actions)
    assert set(recording.description.operators) == {"@Ann"}
    find(tmp_path / "a.csv").keep(tmp_path / "b.csv", FORMULAS[:2])
    assert formats.read(tmp_path / "b.csv").ids == tuple(FORMULAS[:2])
    kept = (tmp_path / "b.csv").read_text().splitlines()
    assert {*kept} <= {*(tmp_path / "a.csv").read_text().splitlines()}  # the user's own lines


@pytest.mark.parametrize("missing", [False, True])
def test_a_frame_holds_the_columns(missing, monkeypatch):
    """Of pandas where it is installed."""
    pandas = pytest.importorskip("pandas")
    if missing:
        monkeypatch.setitem(sys.modules, "pandas", None)
    frame = data_frame({"id": ["a", "b"], "score": (1.5, -2.0)})
    assert isinstance(frame, pa.Table if missing else pandas.DataFrame)
    table = pa.table(frame)
    assert {name: table[name].to_pylist() for name in table.column_names} == {"id": ["a", "b"], "score": [1.5, -2.0]}
