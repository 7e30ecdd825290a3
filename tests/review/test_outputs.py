"""The files of a review that ends."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from rpil.data.errors import DataError
from rpil.formats import read_recording
from rpil.results.view import About
from rpil.review.outputs import write_beside


@pytest.fixture
def recording(data):
    return read_recording(data)


def test_files_beside_the_labels_and_the_command(audit, data, recording, tmp_path):
    (tmp_path / "my answers").mkdir()
    answered = audit.answered({0: "good", 1: "good", 2: "good", 3: "bad", 5: "bad"})
    about = About("", data, command=f"rpil audit {data} --observations x,v")
    lines = list(write_beside("my answers/labels.csv", data, answered, about, recording))
    kept = json.loads(Path("my answers/keep.json").read_text())
    good = [m for m, word in zip(audit.ids, answered.verdicts, strict=True) if word != "bad"]
    assert kept == {"episodes": good, "run": answered.run_id}
    table = Path("my answers/verdicts.csv").read_text().splitlines()
    assert len(table) == 25
    weights = pq.read_table("my answers/weights.parquet")
    assert weights["weight"].to_pylist() == pytest.approx(answered.step_weight.tolist())
    assert lines[0] == f"my answers/keep.json: {len(good)} of 24 demonstrations to keep."
    assert lines[3] == f"To judge again with these answers: {about.command} --labels 'my answers/labels.csv'"


def test_nothing_joins_the_data(audit, data, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    shutil.copy(data, folder)
    before = sorted(folder.iterdir())
    with pytest.raises(DataError, match="it would join the data"):
        list(write_beside(str(folder / "labels.csv"), str(folder), audit, About("", ""), read_recording(data)))
    assert sorted(folder.iterdir()) == before
