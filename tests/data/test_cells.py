"""Text that a spreadsheet would compute is no formula in the tables that are written, and comes back as it was."""

import csv
import itertools

import numpy as np
import pyarrow as pa
import pytest

import rpil
from rpil import formats
from rpil.data.cells import each_text, from_cell, to_cell
from rpil.formats import write_weights
from rpil.formats.csv import write_tables
from rpil.formats.registry import find
from rpil.results.choice import read_verdicts

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


def cells(path):
    with open(path, newline="", encoding="utf-8") as file:
        return [cell for row in csv.reader(file) for cell in row]


def demonstrations(ids):
    rng, owner = np.random.default_rng(0), np.repeat(np.array(ids), 4)
    return rpil.Demonstrations.from_groups(rng.normal(size=(len(owner), 2)), np.arange(len(owner)) % 3, owner)


@pytest.mark.parametrize("actions", [None, ["+", "-up", "=A1"]])
def test_tables_come_back(tmp_path, actions):
    data = demonstrations(FORMULAS)
    if actions:
        data = rpil.Demonstrations(data.observations, np.array(actions)[data.actions], data.offsets, data.ids)
    formats.write(tmp_path / "a.csv", data, {"operator": ["@Ann"] * len(data)})
    assert not [cell for cell in cells(tmp_path / "a.csv") if cell.startswith(DANGER) and not _is_number(cell)]
    recording = formats.read_recording(tmp_path / "a.csv")
    assert recording.demonstrations.ids == tuple(FORMULAS)
    np.testing.assert_array_equal(recording.demonstrations.actions, data.actions)
    assert set(recording.description.operators) == {"@Ann"}
    find(tmp_path / "a.csv").keep(tmp_path / "b.csv", FORMULAS[:2])
    assert formats.read(tmp_path / "b.csv").ids == tuple(FORMULAS[:2])
    kept = (tmp_path / "b.csv").read_text().splitlines()
    assert {*kept} <= {*(tmp_path / "a.csv").read_text().splitlines()}  # the user's own lines


def _is_number(text):
    try:
        return bool(float(text)) or True
    except ValueError:
        return False


def test_names_of_columns_are_no_formulas(tmp_path):
    write_tables(tmp_path / "a.csv", iter([pa.table({"=t": [1.5], "-x": ["@b"]})]))
    assert cells(tmp_path / "a.csv") == ["'=t", "'-x", "1.5", "'@b"]
    one = np.ones(4)
    columns = lambda steps: pa.table({"=order": np.arange(4)[steps]})  # noqa: E731
    write_weights(tmp_path / "w.csv", ["+a", "b"], np.array([0, 2, 4]), one, one[:2], one[:2], columns)
    assert "'=order" in cells(tmp_path / "w.csv")
    assert "'+a" in cells(tmp_path / "w.csv")


@pytest.mark.parametrize("quoted", [False, True])
def test_labels_and_verdicts_name_such_ids(tmp_path, quoted):
    ids = [f"'{name}" for name in FORMULAS] if quoted else FORMULAS[:4]
    for name, header in (("labels.csv", "label"), ("verdicts.csv", "verdict")):
        with (tmp_path / name).open("w", newline="") as file:
            csv.writer(file).writerows([["id", header], *([one, "expert"] for one in ids)])
    assert [*formats.read_labels(tmp_path / "labels.csv")] == FORMULAS[: len(ids)]
    assert read_verdicts(tmp_path / "verdicts.csv")["id"] == FORMULAS[: len(ids)]
