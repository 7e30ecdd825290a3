"""Files that a table names are looked for beside it, and nowhere else."""

from __future__ import annotations

import json

import pyarrow as pa
import pytest

import rpil
from rpil.formats.named_files import in_table


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "images").mkdir()
    for k in range(10):
        (tmp_path / "images" / f"{k}.jpg").write_bytes(b"" if k in (3, 4, 5) else b"x")
    return tmp_path


def said(names, folder):
    return [defect.sentence for defect in in_table(pa.table({"x": range(len(names)), "image": names}), folder)]


@pytest.mark.parametrize("form", ["{}.jpg", "images/{}.jpg", "C:\\data\\images\\{}.jpg", "/elsewhere/{}.jpg"])
def test_empty_and_missing_files_are_named_by_their_rows(folder, form):
    names = [form.format(k) for k in range(12)]
    assert said(names, folder) == [
        "3 of the 12 files that it names are empty: rows 3-5, 3.jpg to 5.jpg; leave these steps out",
        "2 of the 12 files that it names are not there: rows 10-11, 10.jpg to 11.jpg; leave these steps out",
    ]


def test_sound_files_other_texts_and_files_that_were_left_elsewhere_say_nothing(folder):
    assert said([f"{k}.jpg" for k in (0, 1, 2)], folder) == []
    assert said(["pour", "stack", "wipe"], folder) == []
    assert said([f"{k}.png" for k in range(4)], folder) == []
    assert said([], folder) == []


def test_no_path_and_no_link_out_of_the_folder_is_followed(folder):
    inside = folder / "set"
    inside.mkdir()
    (inside / "images").symlink_to(folder / "images")
    assert said(["../images/3.jpg", "../images/4.jpg"], inside) == []
    assert said(["images/3.jpg", "images/0.jpg"], inside) == []


def test_a_tub_whose_steps_cannot_be_read_is_told_of_its_pictures(folder):
    lines = [{"cam/image_array": f"{k}.jpg", "user/angle": 0.1 * k, "user/mode": "user"} for k in range(10)]
    (folder / "catalog_0.catalog").write_text("\n".join(map(json.dumps, lines)))
    report = rpil.check(folder)
    assert [(fault.rule, fault.grade) for fault in report.findings] == [("named files", "broken")]
    assert "no column holds" in report.not_checked["spike"]
    (folder / "images" / "3.jpg").write_bytes(b"x")
    (folder / "images" / "4.jpg").write_bytes(b"x")
    (folder / "images" / "5.jpg").write_bytes(b"x")
    with pytest.raises(rpil.DataError, match="no column holds"):
        rpil.check(folder)


def test_pictures_that_a_csv_names_are_looked_for(folder):
    rows = [f"{k // 3},{k / 10},{k / 7},images/{k}.jpg" for k in range(9)]
    (folder / "log.csv").write_text("\n".join(["episode,observation.x,action,picture", *rows]))
    report = rpil.check(folder / "log.csv")
    assert [(one.rule, one.sentence.partition(": ")[0]) for one in report.findings if one.id == ""] == [
        ("named files", "picture")
    ]
    with pytest.raises(rpil.DataError, match="folders of LeRobot"):
        rpil.check(folder / "log.csv", video=True)
