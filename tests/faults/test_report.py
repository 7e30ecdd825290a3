"""The report of what is found: as a frame, a file, and text."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import rpil
from recordings import changed, demonstrations, recording
from rpil.data.errors import DataError
from rpil.faults.report import FaultReport
from rpil.faults.rule import Fault, in_words

CLEAN = recording()


def jumping():
    """A frame of demonstrations at 20 steps a second; in the sixth a column jumps."""
    lengths = [len(x) for x, _ in CLEAN]
    x = CLEAN[5][0]
    later = x + np.where(np.arange(len(x)) >= 80, 20.0, 0.0)[:, None] * [0, 1, 0]
    rows = [np.column_stack(pair) for pair in changed(CLEAN, 5, observations=later)]
    columns = [*(f"observation.{name}" for name in "xyz"), "action.0", "action.1", "action.2"]
    frame = pd.DataFrame(np.concatenate(rows), columns=columns)
    frame.insert(0, "episode", np.repeat(np.arange(len(rows)), lengths))
    frame.insert(1, "timestamp", np.concatenate([np.arange(n) / 20 for n in lengths]))
    return frame


def test_a_file_a_frame_and_a_recording_are_checked_alike_and_the_report_is_a_frame_a_file_and_text(tmp_path):
    frame, path = jumping(), tmp_path / "drive.csv"
    frame.to_csv(path, index=False)
    found = [rpil.check(data).findings for data in (frame, path, str(path), rpil.open(path))]
    assert found[0] == found[1] == found[2] == found[3]
    (jump,) = found[0]
    assert (jump.rule, jump.id, jump.last, jump.column) == ("jump", 5, 80, "y")
    assert jump.sentence.startswith("y jumps by ")
    assert " at 4.0 s (usual: up to " in jump.sentence
    chosen = rpil.check(path, id="episode", observations=["observation.x"], action="action.*")
    assert chosen.findings == ()
    with pytest.raises(DataError, match="has no columns to choose"):
        rpil.check(demonstrations(CLEAN), id="episode")
    report = rpil.check(frame)
    frame = report.to_frame()
    assert frame.columns.tolist()[:5] == ["number", "grade", "rule", "id", "first"]
    assert (frame["rule"].tolist(), frame["id"].tolist()) == (["jump"], ["5"])
    for name in ("a.csv", "a.parquet", "a.json"):
        report.write(tmp_path / name)
    read = pd.read_csv(tmp_path / "a.csv"), pq.read_table(tmp_path / "a.parquet").to_pandas()
    rows = json.loads((tmp_path / "a.json").read_text())
    assert read[0]["sentence"][0] == read[1]["sentence"][0] == rows[0]["sentence"] == frame["sentence"][0]
    with pytest.raises(DataError, match="findings"):
        report.write(tmp_path / "a.txt")
    assert repr(report).startswith("1 recording fault found in 1 of 12 demonstrations")
    assert "  5: y jumps" in repr(report)
    assert rpil.check(demonstrations(CLEAN)).to_frame().shape[0] == 0


@pytest.mark.parametrize(("n", "n_lines"), [(4, 1), (7, 1), (8, 2)])
def test_what_more_than_a_quarter_has_is_one_line(n, n_lines):
    found = [Fault("spike", m, 0, 0, "x", 1.0, 0.5, 2.0, "leaps") for m in range(2)]
    assert len(FaultReport(found, {}, {}, {}, {}, n, 99, ids=tuple(range(n))).lines) == n_lines


def test_which_demonstrations_in_words():
    tasks = {"task": {"0": "lift", "2": "lift", "3": "turn"}}
    said = [in_words(names, range(4), tasks) for names in ((2, 3), (1, 2), (1, 3), (0, 2))]
    ends = ", from 2 on", ", 1 to 2", " (1, 3)", ", those of the task 'lift'"
    assert said == [f"2 of 4 demonstrations{end}" for end in ends]


def test_a_line_of_many_says_whose_numbers_it_has():
    """Unless all have the same."""

    def line_of(lengths):
        idle = [
            tuple(np.insert(values, [0] * n, values[0], axis=0) for values in one)
            for one, n in zip(CLEAN, lengths, strict=True)
        ]
        report = rpil.check(demonstrations(idle))
        (line,) = (one for one in report.lines if one.rule == "idle head")
        return line.sentence

    assert ", the worst in 7: nothing moves" in line_of([40 + 30 * (m == 7) for m in range(12)])
    assert "the worst in" not in line_of([40] * 12)
