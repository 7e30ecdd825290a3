"""Lines of JSON: an object for each step or for each demonstration, folders of them, and tubs of Donkeycar."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rpil
from command_line import ok, refused
from rpil.data.errors import DataError

RNG = np.random.default_rng(0)
LENGTHS = (4, 6, 5)
STATES = [RNG.normal(size=(n, 2)).tolist() for n in LENGTHS]
MOVES = [RNG.normal(size=n).tolist() for n in LENGTHS]


def write(path, values):
    path.write_text("".join(f"{json.dumps(value)}\n" for value in values))
    return path


def lists(states, moves):
    return {"task": "go", "observations": states, "actions": moves}


def steps(states, moves):
    return {"steps": [{"observation": {"x": x, "y": y}, "action": a} for (x, y), a in zip(states, moves, strict=True)]}


def columns(states, moves):
    return {"x": [x for x, _ in states], "y": [y for _, y in states], "action": moves}


@pytest.mark.parametrize("form", [lists, steps, columns])
def test_a_line_may_hold_a_demonstration(form, tmp_path):
    path = write(tmp_path / "a.jsonl", map(form, STATES, MOVES))
    found = rpil.read(path)
    assert found.ids == (0, 1, 2)
    assert found.lengths.tolist() == [*LENGTHS]
    np.testing.assert_array_equal(found.observations, np.concatenate(STATES))
    np.testing.assert_array_equal(found.actions.ravel(), np.concatenate(MOVES))
    named = write(tmp_path / "b.jsonl", ({"episode_id": f"e{m}", **form(STATES[m], MOVES[m])} for m in range(3)))
    assert rpil.read(named).ids == ("e0", "e1", "e2")
    assert rpil.open(path).tasks == (dict.fromkeys("012", "go") if form is lists else {})


def test_demonstrations_in_lines_are_given_back_as_steps(tmp_path):
    path = write(tmp_path / "a.jsonl", map(lists, STATES, MOVES))
    rpil.open(path).keep([1], tmp_path / "b.jsonl", {1: (1, 5)})
    kept = rpil.read(tmp_path / "b.jsonl")
    np.testing.assert_array_equal(kept.observations, STATES[1][1:5])


def test_a_list_in_a_step_is_no_demonstration(tmp_path):
    rows = [{"episode": k // 5, "image": [[1, 2]] * 3, "x": k / 7, "action": [k / 3, 1.0]} for k in range(10)]
    recording = rpil.open(write(tmp_path / "a.jsonl", rows))
    assert recording.demonstrations.lengths.tolist() == [5, 5]
    assert recording.description.ignored == {"image": "images or nested values"}


def test_each_file_of_a_folder_is_a_demonstration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "meta").mkdir(parents=True)
    for m in (0, 1, 10):
        rows = [{"x": x, "action": a} for (x, _), a in zip(STATES[m % 3], MOVES[m % 3], strict=True)]
        write(tmp_path / "runs" / f"run_{m}.jsonl", rows)
    write(tmp_path / "runs" / "meta" / "notes.jsonl", [{"of": "all"}])
    (tmp_path / "runs" / "README.txt").write_text("a,b\n1,2\n")
    (tmp_path / "runs" / "labels.csv").write_text("id,label\nrun_0,good\n")  # of rpil label
    assert rpil.read("runs").ids == ("run_0", "run_1", "run_10")
    (tmp_path / "runs" / "more").mkdir()
    write(tmp_path / "runs" / "more" / "run_0.jsonl", rows)
    assert rpil.read("runs").ids == ("more/run_0", "run_0", "run_1", "run_10")
    refused(
        "keep writes no folder of JSON lines; first run rpil convert runs -o ALL.parquet", "keep", "runs", "-o", "new"
    )


@pytest.mark.parametrize(
    "text", ['{"x": 1, "action": 2}\n{"x": ', "[1, 2]\n", '{"x": 1}\n{"x": "a"}\n', "[" * 9999, '{"x": [{"y": []}]}\n']
)
def test_what_is_damaged_is_one_sentence(text, tmp_path):
    (tmp_path / "a.jsonl").write_text(text)
    with pytest.raises(DataError, match=r"^a\.jsonl[:,] .*\.$"):
        rpil.read(tmp_path / "a.jsonl")


def test_a_file_that_does_not_fit_in_memory_is_refused(tmp_path):
    path = write(tmp_path / "a.jsonl", ({"episode": 0, "x": k, "action": k} for k in range(1000)))
    with pytest.raises(DataError, match="to read it would take"):
        rpil.read(path, memory="10kB")


@pytest.fixture
def tub(tmp_path, monkeypatch):
    """Two catalogs of a session with one pause, of which two records were deleted."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data" / "tub_1"
    folder.mkdir(parents=True)
    (tmp_path / "data" / "catalog_0.catalog").touch()
    records = [
        {
            "_index": k,
            "_session_id": "24-04-22_0",
            "_timestamp_ms": 1_713_837_246_793 + 50 * k + 5000 * (k > 12),
            "cam/image_array": f"{k}_cam_image_array_.jpg",
            "user/angle": k / 20,
            "user/mode": "user",
            "user/throttle": 0.5,
        }
        for k in range(20)
    ]
    write(folder / "catalog_2.catalog", records[:8])
    write(folder / "catalog_10.catalog", records[8:])
    manifest = [["cam/image_array"], ["image_array"], {}, {"paths": []}, {"deleted_indexes": [3, 9]}]
    write(folder / "manifest.json", manifest)
    return folder


def test_a_tub_is_read_without_what_was_deleted_and_ends_at_pauses(tub):
    done = ok("info", "data/tub_1", "--split-gap", "1")
    assert "Donkeycar tub, 2 files; 2 demonstrations, 18 steps" in done.stdout
    assert "Guess: action user/angle, user/throttle" in done.stderr
    recording = rpil.open(tub, action="user/angle,user/throttle", split_gap=1)
    assert recording.demonstrations.ids == ("24-04-22_0-0", "24-04-22_0-1")
    assert recording.demonstrations.observation_names == ("last_angle", "last_throttle")
    angles = [k / 20 for k in range(20) if k not in (3, 9)]
    np.testing.assert_array_equal(recording.demonstrations.actions[:, 0], angles)
    np.testing.assert_array_equal(recording.demonstrations.observations[:, 0], [0.0, *angles[:-1]])


def test_the_folder_of_a_car_names_what_it_needs(tub):
    assert "--split-gap 1 ends them at pauses of a second" in ok("info", ".").stdout
    (tub / "catalog_10.catalog").unlink()
    write(
        tub / "catalog_2.catalog",
        [{"_index": 0, "_session_id": "a", "speed": 1.5, "user/angle": 0.5, "user/throttle": 1}],
    )
    assert rpil.open(tub, action="user/angle,user/throttle").demonstrations.observation_names == ("speed",)
