"""``rpil audit --ranges``: rows to keep, by ids as trainers want them; tables of segments; rows that are called bad."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import ok, refused
from idle_worlds import world
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from rpil.segments.ranges import KINDS, Segments, cut_out, keys_of, segment_columns, subtask_columns

IDS = ("plain", "a, b", 'say "x"', "é\u2028z", "=1+1", "__proto__")


@pytest.fixture
def data():
    made = world(4)
    some = made.data.select(range(len(IDS)))
    states, actions = some.observations.T, some.actions.T
    names = np.repeat(IDS, some.lengths)
    with open("a.csv", "w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        heads = [*(f"observation.{k}" for k in range(len(states))), *(f"action.{k}" for k in range(len(actions)))]
        rows.writerow(["episode", "folder", "file", "time", *heads])
        files = [(f"/data/{m % 2}", f"{m // 2}.h5") for m in np.repeat(range(len(IDS)), some.lengths)]
        files = [(*of, k / 10 + k % 3 / 100) for k, of in enumerate(files)]
        rows.writerows([m, *own, *row] for m, own, *row in zip(names, files, *states, *actions, strict=True))
    return rpil.read("a.csv"), made.idle[: some.n_steps]


def ranges(*options):
    ok("audit", "a.csv", "--quiet", "--ranges", "keep.json", *options)
    return json.loads(Path("keep.json").read_text(encoding="utf-8"))


def rows_of(given, demonstrations):
    rows = np.zeros(demonstrations.n_steps, dtype=bool)
    for name, begin in zip(demonstrations.ids, demonstrations.offsets.tolist(), strict=False):
        for start, end in given.get(str(name), []):
            rows[begin + start : begin + end] = True
    return rows


def test_all_rows_are_kept_unless_something_is_asked(data):
    demonstrations, idle = data
    lengths = dict(zip(IDS, demonstrations.lengths.tolist(), strict=True))
    assert ranges() == {m: [[0, n]] for m, n in lengths.items()}
    without = ranges("--idle", "drop")
    np.testing.assert_array_equal(rows_of(without, demonstrations), ~idle)
    audit = rpil.audit("a.csv")
    assert {m: [*map(list, own)] for m, own in audit.ranges(rpil.idle_rows(demonstrations)).items()} == without
    openpi = ranges("--idle", "openpi")
    np.testing.assert_array_equal(rows_of(openpi, demonstrations), ~rpil.idle_rows(demonstrations, "openpi"))


def test_rows_and_demonstrations_that_are_bad_are_left_out(data):
    demonstrations, _ = data
    with open("labels.csv", "w", newline="", encoding="utf-8") as stream:
        answers = [("a, b", 5, 20, "bad"), ("a, b", 30, 40, "bad"), ("=1+1", 0, 9, "good"), ("é\u2028z", "", "", "bad")]
        csv.writer(stream).writerows([("id", "start", "end", "label"), *answers])
    files = "--segments", "s.parquet", "--weights", "w.csv", "--keep", "k.json"
    found, n = ranges("--labels", "labels.csv", *files), int(demonstrations.lengths[1])
    assert "é\u2028z" not in found
    assert found["a, b"] == [[0, 5], [20, 30], [40, n]]
    assert found["=1+1"] == [[0, int(demonstrations.lengths[4])]]
    weights = pyarrow.csv.read_csv("w.csv")["weight"].to_numpy()
    assert np.flatnonzero(weights[slice(*demonstrations.offsets[1:3])] == 0).tolist() == [*range(5, 20), *range(30, 40)]
    assert re.search(r"^\d+ to look at\.$", ok("audit", "a.csv", "--segments", "s.csv").stdout, re.MULTILINE)
    rows = pq.read_table("s.parquet").to_pylist()
    assert {*rows[0]} >= {"id", "start", "end", "kind", "score", "reason"}
    assert {row["kind"] for row in rows} <= {*KINDS}
    for name, n in zip(IDS, demonstrations.lengths.tolist(), strict=True):
        own = [row for row in rows if row["id"] == name]
        assert [row["start"] for row in own] + [n] == [0] + [row["end"] for row in own]


def test_keys_are_what_a_trainer_wants(data):
    keys = [f"/data/{m % 2}--{m // 2}.h5" for m in range(len(IDS))]
    assert [*ranges("--ranges-id", "{folder}--{file}")] == keys
    named = [f"x {name}" for name in IDS]
    assert [*ranges("--ranges-id", "x {id}")] == [*ranges("--ranges-id", "x {episode}")] == named
    for pattern in ("{folder}", "one", "{", "{}", "{id!r:>99999999}", "{id.__class__}"):
        with pytest.raises(DataError, match=r"--ranges-id|two have the key|no column is called"):
            keys_of(pattern, IDS, "a.csv", ColumnOptions())
    refused("two have the key", "audit", "a.csv", "--quiet", "--ranges", "r.json", "--ranges-id", "one")
    assert keys_of("{id}", [1, 2], "a.csv", ColumnOptions()) == ["1", "2"]


def test_what_cannot_be_is_refused_before_any_work(data):
    refused("give --ranges", "audit", "a.csv", "--idle", "drop")
    refused("give --ranges", "audit", "a.csv", "--ranges-id", "{id}-")
    refused("drop", "audit", "a.csv", "--ranges", "r.json", "--idle", "all")
    refused(r"\.json", "audit", "a.csv", "--ranges", "r.csv")
    refused(r"a\.csv", "audit", "a.csv", "--segments", "a.csv")
    for rows, match in (
        ("id,label,start,end\nplain,bad,5,4\n", "labels.csv, demonstration 'plain', rows 5 to 4"),
        ("id,label,start,end\nnobody,bad,1,4\n", "no demonstration is called 'nobody'"),
        ("id,Start,End,label\nplain,0,4,bad\n", "call the columns of rows start and end"),
        ("id,from,to,label\nplain,0,4,bad\n", "call the columns of rows start and end"),
    ):
        Path("labels.csv").write_text(rows)
        refused(match, "audit", "a.csv", "--labels", "labels.csv")


def test_ranges_of_an_audit_need_rows_of_it(data):
    demonstrations, _ = data
    audit = rpil.audit("a.csv")
    for wrong in (np.zeros(3, dtype=bool), np.zeros(demonstrations.n_steps), [True]):
        with pytest.raises(DataError, match="True or False for each of the"):
            audit.ranges(wrong)
    with pytest.raises(DataError, match=r"No demonstration is called .* ids 'plain', .*, '=1\+1', \.\.\.\.$"):
        audit.ranges(kept=["nobody"])
    everything = np.ones(demonstrations.n_steps, dtype=bool)
    assert audit.ranges(everything, ["plain"]) == {"plain": []}
    with pytest.raises(DataError, match="not the demonstrations of the audit"):
        audit.segments(demonstrations.select([0, 1]))


def test_segments_are_found_within_tasks_and_sorted():
    made = world(5)
    data, tasks = made.data, {str(m): "ab"[m % 2] for m in range(len(made.data))}
    data = data.select(range(7))
    audit = rpil.audit(data, labels={(3, 0, 9): "bad", (4, 2, 9): "good"})
    tasks["6"] = "a task of one"
    found = audit.segments(data, tasks)
    for m, n in enumerate(data.lengths.tolist()):
        own = found.demonstration == m
        assert found.start[own].tolist() == [0, *found.end[own][:-1].tolist()]
        assert found.end[own][-1] == n
    assert (np.diff(found.demonstration) >= 0).all()
    assert len(found.reason) == len(found.start)
    alone = audit.segments(data)
    assert {*alone.kind.tolist()} >= {0, 1}


def test_a_table_of_segments_has_seconds_where_the_rate_is_known():
    found = Segments(
        np.array([0, 0, 1]), np.array([0, 5, 0]), np.array([5, 9, 3]), np.array([0, 1, 4], dtype=np.int8),
        np.array([-1.5, np.nan, np.inf]), ["it slips", "", ""],
    )  # fmt: skip
    assert segment_columns(found, ("x", "y"), 10.0) == {
        "id": ["x", "x", "y"], "start": [0, 5, 0], "end": [5, 9, 3], "seconds": [0.5, 0.4, 0.3],
        "kind": ["act", "idle", "repeated"], "score": [-1.5, None, None], "reason": ["it slips", "", ""],
    }  # fmt: skip
    assert "seconds" not in segment_columns(found, ("x", "y"), None)
    assert subtask_columns(found, ("x", "y", "z"))["rpil_subtask_end_frames"] == {"x": [4, 8], "y": [2], "z": []}


def test_rows_to_keep_become_demonstrations_of_their_own(data):
    demonstrations, _ = data
    given = {"a, b": [[3, 9], [20, 31]], "plain": [[0, 5]]}
    Path("keep.json").write_text(json.dumps(given), encoding="utf-8")
    ok("convert", "a.csv", "--ranges", "keep.json", "-o", "b.parquet", "--quiet")
    found = rpil.read("b.parquet")
    assert found.ids == ("a, b/0", "a, b/1", "plain/0")
    assert found.lengths.tolist() == [6, 11, 5]
    begin = demonstrations.offsets[IDS.index("a, b")]
    observations, actions = found[1]
    np.testing.assert_array_equal(observations, demonstrations.observations[begin + 20 : begin + 31])
    np.testing.assert_array_equal(actions, demonstrations.actions[begin + 20 : begin + 31])
    before, after = (rpil.open(name).times().timestamps for name in ("a.csv", "b.parquet"))
    np.testing.assert_allclose(np.diff(after[6:17]), np.diff(before[begin + 20 : begin + 31]))


REFUSED = [
    ({"plain": [[0, 10**9]]}, r"keep.json: demonstration 'plain' has \d+ rows, and \[0, 1000000000\] is no range"),
    *(({"plain": own}, "no range of them") for own in ([[-1, 4]], [[4, 4]], [[0.5, 4]], [[True, 4]], [[np.nan, 4]], 3)),
    ({"other": [[0, 4]]}, "no demonstration is called 'other'"),
    ({"plain": [[0, 4]], "other": []}, "no demonstration is called 'other'"),
    ([[0, 4]], "is no range"),
    ({"plain": []}, "keeps no rows"),
    ({}, "keeps no rows"),
    *((text, "keep.json: it cannot be read as JSON") for text in ("a,b", '{"plain": [[0, 4]', "[" * 100_000)),
    ('{"plain": [[0, 4]], "plain": [[5, 9]]}', "it names 'plain' twice"),
]


def test_other_ranges_are_refused_with_file_and_remedy(data):
    for given, match in REFUSED:
        Path("keep.json").write_text(given if isinstance(given, str) else json.dumps(given), encoding="utf-8")
        with pytest.raises(DataError, match=match):
            cut_out(data[0], "keep.json")
    refused(match, "convert", "a.csv", "--ranges", "keep.json", "-o", "b.parquet")
    assert not Path("b.parquet").exists()


def test_a_new_answer_about_the_same_rows_replaces_an_old_one_and_not_all_may_be_bad(data):
    demonstrations, _ = data
    audit = rpil.audit(demonstrations, labels={("plain", 0, 5): "bad"})
    turned = audit.answered({("plain", 0, 5): "good"})
    assert audit.ranges(kept=["plain"])["plain"][0][0] == 5
    assert turned.ranges(kept=["plain"])["plain"][0][0] == 0
    with pytest.raises(DataError, match="rows 0 to 5 of 'plain' have the other label"):
        audit.answered({("plain", 3, 8): "good"})
    marks = {(name, 0, int(n)): "bad" for name, n in zip(demonstrations.ids, demonstrations.lengths, strict=True)}
    with pytest.raises(DataError, match="every row is called bad"):
        rpil.RPIL().fit(rpil.open("a.csv"), labels=marks)
