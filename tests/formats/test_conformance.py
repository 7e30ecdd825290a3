"""What every format must do, with each sample of `tests/samples.py`: a new format passes it by a sample there."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rpil
import samples
from problems import refused
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from rpil.formats.registry import find, known_formats
from samples import SAMPLES, assert_same, assert_same_on_disk

LISTED = {*("NPZ, stacked", "folder of CSV", "folder of Parquet", "folder of NPZ", "d4rl", "aloha")}
LISTED |= {name for name in SAMPLES if name.startswith("Zarr")}
"""Samples of which `keep` writes the list of ids alone."""

RATES = {"LeRobot": 30, "Parquet of lists": 30, "folder of Parquet": 30, "robomimic": 20}


@pytest.fixture(params=SAMPLES)
def name(request) -> str:
    Path("data").mkdir()
    return request.param


@pytest.fixture
def path(name) -> Path:
    return SAMPLES[name](Path("data").absolute())


def output_for(path: Path, stem: str = "kept") -> Path:
    """An output of the kind of the data, or a list where none is written."""
    if find(path).unkept():
        return Path(f"{stem}.json")
    return Path(stem + "".join(path.suffixes)) if path.is_file() else Path(stem)


def everything() -> dict[str, bytes | None]:
    return {str(file): file.read_bytes() if file.is_file() else None for file in Path().rglob("*")}


def is_sentence(error: Exception) -> bool:
    text = str(error)
    return text.endswith(".") and "\n" not in text and ". " not in text and len(text) < 600


def test_every_format_has_a_sample(tmp_path):
    pytest.importorskip("h5py")
    pytest.importorskip("zarr")
    found = set()
    for name, make in SAMPLES.items():
        (tmp_path / name).mkdir()
        found.add(find(make(tmp_path / name)).format.name)
    assert found == {one.name for one in known_formats()}


def test_no_format_claims_what_is_another_s(path):
    claimed = [one.name for one in known_formats() if one.claims(path)]  # none refuses what is not its own
    assert claimed[0] == find(path).format.name
    # Those that are told by their extensions say too little to be the first.
    assert {*claimed[1:]} <= {"a folder of tables"}


@pytest.mark.parametrize("content", [b"", b"\x00\x01", b"PK\x03\x04", b"\x89HDF\r\n\x1a\n", b"PAR1", b"{}", b"a,b\n"])
def test_what_is_in_no_format_is_refused(tmp_path, content):
    for suffix in (".bin", *(suffix for one in known_formats() for suffix in one.suffixes)):
        (tmp_path / f"a{suffix}").write_bytes(content)
        with pytest.raises(DataError) as caught:
            rpil.read(tmp_path / f"a{suffix}")
        assert is_sentence(caught.value)


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in LISTED], indirect=True)
def test_what_is_kept_is_read_as_it_was(name, path):
    before, output = rpil.open(path, on_disk=False), output_for(path)
    contents = everything()
    ids = before.demonstrations.ids
    assert len(ids) == 3
    before.keep([ids[2], str(ids[0])], output)  # in any order, and as text
    assert {**everything(), **contents} == everything()  # the data are as they were
    after = rpil.open(output, on_disk=False)
    assert re.sub(r"\d+ files", "", after.description.format) == re.sub(r"\d+ files", "", before.description.format)
    assert {*after.description.ignored} == {*before.description.ignored}
    expected, found = before.demonstrations.select([0, 2]), after.demonstrations
    np.testing.assert_array_equal(found.observations, expected.observations)
    np.testing.assert_array_equal(found.actions, expected.actions)
    np.testing.assert_array_equal(found.offsets, expected.offsets)
    assert [*map(str, found.ids)] == [str(m).replace("2", "1") if name == "LeRobot" else str(m) for m in expected.ids]
    for what in ("observations", "actions", "action_kind", "task_column", "operator_column", "order"):
        assert getattr(after.description, what) == getattr(before.description, what), what
    said, still = ([said.tasks.get(str(m), "") for m in of.ids] for said, of in ((before, expected), (after, found)))
    assert said == still == [{"LeRobot": "lift", "robomimic": "Lift", "folder of NPZ": "lift"}.get(name, "")] * 2
    assert [who for _, who in after.operators] == [who for m, who in before.operators if m in map(str, expected.ids)]
    assert (before.description.fps, after.description.fps) == pytest.approx([RATES.get(name)] * 2)
    if before.times().timestamps is not None:
        times = np.split(before.times().timestamps, np.cumsum(before.demonstrations.lengths)[:-1])
        np.testing.assert_allclose(after.times().timestamps, np.concatenate([times[0], times[2]]))


def test_the_list_of_ids_is_written_of_every_format(name, path):
    recording, contents = rpil.open(path, on_disk=False), everything()
    ids = recording.ids
    for output in ("ids.json", "ids.txt"):
        recording.keep([ids[2], str(ids[0])], output)  # in any order, and as text
    assert {**everything(), **contents} == everything()  # the data are as they were
    assert json.loads(Path("ids.json").read_text()) == {"episodes": [ids[0], ids[2]]}
    assert Path("ids.txt").read_text() == f"{ids[0]}\n{ids[2]}\n"
    if name in LISTED:
        for output in ("kept", f"kept{path.suffix}", "kept.csv"):
            with refused(r"keep writes no .*; write the list with -o ids\.json, or a tab"):
                recording.keep([ids[0]], output)
    assert bool(find(path).unkept()) == (name in LISTED)


def test_what_stays_on_disk_is_what_is_in_memory(path, monkeypatch):
    """In several batches of rows."""
    for module in ("steps", "step_arrays"):
        monkeypatch.setattr(f"rpil.formats.{module}.BATCH_ROWS", 7)
    assert_same_on_disk(path)


@pytest.mark.parametrize("on_disk", [False, True])
def test_what_cannot_be_kept_leaves_nothing(path, on_disk):
    recording = rpil.open(path, on_disk=on_disk)
    ids = recording.demonstrations.ids
    Path("there").mkdir()
    before = everything()
    for wanted, output, message in (
        ([ids[0], "no such one"], output_for(path), "no demonstration is called 'no such one'"),
        ([], output_for(path), "no demonstration is to be kept"),
        ([ids[0]], path, "it is the data themselves"),
        ([ids[0]], path / "inside", "it is the data themselves, or in them"),
        ([ids[0]], Path("there"), "it is there already"),
        ([ids[0]], Path("no/folder") / output_for(path), "there is no folder"),
    ):
        with pytest.raises(DataError, match=message) as caught:
            recording.keep(wanted, output)
        assert is_sentence(caught.value)
        assert everything() == before


def error_of(use: Callable[[], object]) -> DataError | None:
    """The `DataError` in which a call ends."""
    try:
        use()
    except DataError as error:
        return error
    return None


def test_a_truncated_file_is_one_sentence(name, path):
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    largest = max(sorted(files), key=lambda file: file.stat().st_size)
    content, output, whole = largest.read_bytes(), output_for(path), rpil.read(path)
    is_text = {".csv", ".tsv", ".jsonl"} & {path.suffix, largest.suffix}  # whose last lines may be lost unseen
    for share in np.arange(10) / 10:
        largest.write_bytes(content[: int(share * len(content))])
        error = error_of(lambda: rpil.read(path))
        assert is_sentence(error) if error else is_text or np.array_equal(rpil.read(path).actions, whole.actions)
        error = error_of(lambda: find(path).keep(output, [0]))
        assert is_sentence(error) if error else output.suffix == ".json" or rpil.read(output).ids  # of other files
        assert not [file for file in Path().iterdir() if file.name not in ("data", output.name)]
        shutil.rmtree(output, ignore_errors=True)
        output.unlink(missing_ok=True)


MADE_FIRST = {"aloha": 2}
"""The demonstration that a sample draws first, where that is not the first one."""


class Holed:
    """Random numbers of which the very first is missing."""

    first = np.nan

    def normal(self, size):
        values = np.random.Generator(np.random.PCG64(0)).normal(size=size)
        values.flat[0] += self.first
        self.first = 0.0
        return values


@pytest.fixture
def holed(name, tmp_path, monkeypatch) -> Path:
    """The sample, where values of the first demonstration are missing."""
    numbers = Holed()
    with monkeypatch.context() as patch:
        for array in ("STATES", "MOVES"):
            values = getattr(samples, array).copy()
            values[0] = np.nan
            patch.setattr(samples, array, values)
        patch.setattr(samples, "_RNG", numbers)
        patch.setattr(np.random, "default_rng", lambda seed: numbers)
        patch.setattr("rpil.data.arrays.check_finite", lambda *_: None)  # which refuses it
        return SAMPLES[name](tmp_path / "data")


def test_a_missing_value_is_named_with_its_demonstration(name, holed):
    opened = rpil.open(holed, on_disk=False)
    assert opened.description.missing
    with pytest.raises(DataError, match="demonstration ") as caught:
        opened.demonstrations  # noqa: B018
    assert is_sentence(caught.value)
    found = [finding for finding in rpil.check(opened).findings if finding.rule == "missing values"]
    assert [one.id for one in found] == [opened.load(ColumnOptions(allow_missing=True)).ids[MADE_FIRST.get(name, 0)]]


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_demonstration_with_missing_values_is_set_aside(name, holed, on_disk):
    opened = rpil.open(holed, on_disk=on_disk, skip_bad=True)
    bad = opened.ids[MADE_FIRST.get(name, 0)]
    assert opened.set_aside == (bad,)
    found = opened.demonstrations.select(slice(None))
    assert found.ids == tuple(m for m in opened.ids if m != bad)
    assert np.isfinite(found.observations).all()
    assert not opened.description.missing
    assert opened.description.notes[-1].startswith(f"Set aside: {bad}, because")
    assert not [finding for finding in rpil.check(opened).findings if finding.rule == "missing values"]


@pytest.mark.parametrize("on_disk", [False, True])
def test_chosen_demonstrations_are_as_in_the_whole(path, on_disk):
    whole = rpil.open(path, on_disk=on_disk)
    ids = whole.demonstrations.ids
    chosen = rpil.open(path, on_disk=on_disk, only=[ids[2], str(ids[0])])
    without = rpil.open(path, on_disk=on_disk, without=str(ids[1]))
    assert chosen.description == without.description
    assert {*chosen.description.ignored} == {*whole.description.ignored}
    expected, found = whole.demonstrations.select([0, 2]), chosen.demonstrations.select(slice(None))
    assert_same(found, expected)
    assert chosen.ids == ids
    assert chosen.tasks == {str(m): whole.tasks[str(m)] for m in expected.ids if str(m) in whole.tasks}
    assert chosen.operators == [pair for pair in whole.operators if pair[0] in map(str, expected.ids)]
    lengths = whole.demonstrations.lengths
    rows = np.repeat([True, False, True], lengths)
    for of, times in ((chosen, chosen.times()), (without, without.times())):
        assert {*times.frames} <= {*of.demonstrations.ids}
        if times.timestamps is not None:
            np.testing.assert_array_equal(times.timestamps, whole.times().timestamps[rows])
    own, every = chosen.step_columns(slice(1, found.n_steps)), whole.step_columns(slice(0, len(rows)))
    for column in own.column_names:
        steps = np.arange(1, len(rows) + 1) if every is None else every[column].to_numpy()
        np.testing.assert_array_equal(own[column].to_numpy(), steps[rows][1:])
    if whole.facts.order is not None:
        np.testing.assert_array_equal(np.argsort(chosen.facts.order), np.argsort(whole.facts.order[[0, 2]]))
    blocks = [block for shard in chosen.demonstrations.shards(2, 4) for block in shard]
    np.testing.assert_array_equal(np.concatenate([block.observations for block in blocks]), expected.observations)
