import json
from itertools import pairwise

import numpy as np
import pytest

import rpil
import samples
from rpil.data.errors import DataError
from rpil.formats.registry import find


@pytest.fixture
def tub(tmp_path):
    return samples.donkeycar(tmp_path)


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def records_of(tub):
    return [record for file in sorted(tub.glob("*.catalog")) for record in lines_of(file)]


def rewrite(tub, change):
    """Change every record of a tub, and the manifest by the numbers of these records."""
    for file in tub.glob("*.catalog"):
        file.write_text("".join(f"{json.dumps(change(record))}\n" for record in lines_of(file)))


def test_demonstrations_are_the_stretches_between_deleted_records(tub):
    d = rpil.read(tub)
    assert d.ids == ("0-4", "7-13", "20-25")
    assert d.lengths.tolist() == [4, 6, 5]
    commands = {record["_index"]: (record["user/angle"], record["user/throttle"]) for record in records_of(tub)}
    steps = [k for part in (range(1, 5), range(8, 14), range(21, 26)) for k in part]
    np.testing.assert_array_equal(d.actions, [commands[k] for k in steps])
    np.testing.assert_array_equal(d.observations, [commands[k - 1] for k in steps])
    assert d.observation_names == ("last user/angle", "last user/throttle")
    assert any("Only images say" in note for note in rpil.open(tub).describe().notes)


def test_a_session_ends_a_demonstration(tub):
    rewrite(tub, lambda record: record | {"_session_id": "a" if record["_index"] < 10 else "b"})
    assert rpil.read(tub).ids == ("0-4", "7-9", "10-13", "20-25")
    assert rpil.open(tub, session="session_id").facts.sessions == ("a", "a", "b", "b")


def test_numbers_of_sensors_are_observations(tub):
    rewrite(tub, lambda record: record | {"enc/speed": record["_index"] / 10})
    lines = lines_of(tub / "manifest.json")
    lines[0].append("enc/speed")
    lines[1].append("float")
    (tub / "manifest.json").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    d = rpil.read(tub)
    assert d.observation_names == ("enc/speed",)
    np.testing.assert_allclose(d.observations[:4, 0], [0.1, 0.2, 0.3, 0.4])


def test_kept_tubs_hold_the_records_and_images_of_the_kept_alone(tub, tmp_path):
    find(tub).keep(tmp_path / "kept", ["20-25", "0-4"])
    kept = tmp_path / "kept"
    numbers = [*range(5), *range(20, 26)]
    assert [record for record in records_of(tub) if record["_index"] in numbers] == records_of(kept)
    assert sorted(file.name for file in (kept / "images").iterdir()) == sorted(f"{k}.jpg" for k in numbers)
    manifest = lines_of(kept / "manifest.json")
    assert manifest[:4] == lines_of(tub / "manifest.json")[:4]
    assert manifest[4]["deleted_indexes"] == []
    assert manifest[4]["current_index"] == 30  # new records are not numbered as old ones
    ends = np.cumsum([0, *lines_of(kept / "catalog_0.catalog_manifest")[0]["line_lengths"]])
    content = (kept / "catalog_0.catalog").read_bytes()
    assert [json.loads(content[a:b])["_index"] for a, b in pairwise(ends)] == numbers


def test_names_of_images_lead_nowhere_else(tub, tmp_path):
    (tmp_path / "secret").write_text("x")
    rewrite(tub, lambda record: record | {"cam/image_array": "../../secret"})
    find(tub).keep(tmp_path / "kept", ["0-4"])
    assert not [*(tmp_path / "kept" / "images").iterdir()]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record: record | {"user/angle": "left"}, "'user/angle' is not a number"),
        (lambda record: record | {"_index": "one"}, "a record has no number"),
        (lambda record: record | {"_index": 0}, "numbers of its records do not rise"),
        (lambda record: [record], "no tub of Donkeycar, or a damaged one"),
    ],
)
def test_records_of_another_form_are_named(tub, change, message):
    rewrite(tub, change)
    with pytest.raises(DataError, match=message):
        rpil.read(tub)


def test_catalogs_of_another_length_are_refused(tub):
    (tub / "catalog_1.catalog_manifest").write_text('{"line_lengths": [1, 2]}')
    with pytest.raises(DataError, match=r"it holds 15 records, and catalog_1.catalog_manifest says 2"):
        rpil.read(tub)


def test_numbers_for_the_images_are_joined_by_the_number_of_the_record(tub, tmp_path):
    np.savez(tmp_path / "seen.npz", index=np.arange(30), brightness=np.arange(30) / 10)
    d = rpil.read(tub, embeddings=tmp_path / "seen.npz")
    assert d.observation_names[-1] == "brightness"
    np.testing.assert_allclose(d.observations[:5, -1], [0.1, 0.2, 0.3, 0.4, 0.8])
