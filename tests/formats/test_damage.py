"""Damaged lines and files: named without --skip-bad, and with it skipped; what is kept are records of the source."""

import json
import random
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lerobot_folders
import rpil
from command_line import ok, refused, write_lines
from rpil.data.errors import DataError


def table(n=8, length=6, head="episode_index,observation.x,action,note"):
    rng = random.Random(0)
    rows = [f"{m},{rng.random():.4f},{rng.randint(0, 1)},ok" for m in range(n) for _ in range(length)]
    return [head, *rows]


@pytest.mark.parametrize(
    "damage",
    [
        lambda lines: lines.__setitem__(9, f'"{lines[9]}'),  # ends nowhere
        lambda lines: (lines.__setitem__(9, '0,0.5,1,"ok'), lines.__setitem__(30, '4,0.5,1,ok"')),  # ends far away
        lambda lines: (lines.__setitem__(9, '0,0.5,1,"ok'), lines.__setitem__(10, '1,0.5,1,ok"')),
        lambda lines: (lines.__setitem__(9, '0,0.5,1,"ok'), lines.__setitem__(11, '1,0.5,1,"a, b"')),
        lambda lines: (lines.insert(9, '# a,"comment'), lines.__setitem__(12, '1,0.5,1,"ok"')),
        lambda lines: lines.__setitem__(9, '0,"0.5,1,ok'),
    ],
)
def test_rows_that_a_quotation_joins_are_told(damage):
    lines = table()
    damage(lines)
    refused(r"q\.csv, line 10: a quotation", "info", write_lines("q.csv", lines))


def test_damaged_rows_are_counted():
    lines = table()
    lines[5], lines[20], lines[40] = "0,0.5", "\0\0\0\0", "6,0.25,1,ok,5,6"
    for on_disk in (False, True):
        with pytest.raises(DataError, match=r"line 6: 2 values for 4 columns in '0,0\.5', the first of 3 dama"):
            rpil.open(write_lines("a.csv", lines), on_disk=on_disk)


def texts(folder):
    for m in range(5):
        write_lines(folder / f"{m}.csv", [line.split(",", 1)[1] for line in table(1, 8)])
    (folder / "2.csv").write_bytes(b"\0" * 300)


def cut_line(folder):
    for m in range(5):
        steps = [{"observation": {"x": m + k / 7}, "action": k % 2} for k in range(8)]
        write_lines(folder / f"{m}.jsonl", [json.dumps(step) for step in steps])
    (folder / "2.jsonl").write_bytes((folder / "2.jsonl").read_bytes()[:-20])


def tables(folder):
    for m in range(5):
        columns = {"episode_index": [m] * 8, "observation.x": np.arange(8.0), "action": np.arange(8) % 2}
        pq.write_table(pa.table(columns), folder / f"{m}.parquet")
    (folder / "2.parquet").write_bytes((folder / "2.parquet").read_bytes()[:-40])


def arrays(folder):
    for m in range(5):
        seen = np.random.default_rng(m).normal(size=(8, 2))
        np.savez(folder / f"{m}.npz", observations=seen, actions=np.arange(8) % 2)
    (folder / "2.npz").write_bytes((folder / "2.npz").read_bytes()[:200])


@pytest.mark.parametrize("make", [texts, cut_line, tables, arrays])
def test_a_damaged_file_of_a_folder_is_skipped_and_named(make):
    folder = Path("runs")
    folder.mkdir()
    make(folder)
    name = next(file.name for file in folder.iterdir() if file.name.startswith("2."))
    refused(name.replace(".", r"\."), "info", "runs")
    assert f"Skipped, because damaged: {name}." in ok("info", "runs", "--skip-bad").stdout
    assert name in ok("check", "runs", "--skip-bad").stderr
    ok("keep", "runs", "-o", "kept.json", "--skip-bad", "--share", "1")
    assert len(json.loads(Path("kept.json").read_text())["episodes"]) == 4


@pytest.mark.parametrize(("version", "left"), [("v3.0", 0.5), ("v2.1", 0.0)])
def test_a_cut_file_of_lerobot_is_named_with_its_episodes(version, left):
    folder = lerobot_folders.write(Path("arm"), [9, 8, 7, 9, 8, 9, 7], version, cameras=())
    last = sorted(folder.rglob("data/**/*.parquet"))[1]
    last.write_bytes(last.read_bytes()[: int(left * last.stat().st_size)])
    lost, kept = (("episodes 3-5", "episodes 0-2, 6")) if version == "v3.0" else ("episode 1", "episodes 0, 2-6")
    place = last.relative_to(folder).as_posix()
    for command in (["check"], ["convert", "-o", "a.csv"]):
        refused(f"arm: damaged, .*: {lost} of {place}; .* {kept} with --skip-bad", command[0], "arm", *command[1:])
    named = f"Skipped, because damaged: {lost} of {place}."
    assert named in ok("info", "arm", "--skip-bad").stdout
    checked = ok("check", "arm", "--skip-bad")
    assert named in checked.stderr
    assert "episodes that it lists are not in the data" in checked.stdout
    n = 4 if version == "v3.0" else 6
    if version == "v3.0":
        assert named in ok("keep", "arm", "-o", "new", "--skip-bad", "--share", "1").stderr
        assert rpil.open("new").description.demonstrations == n
        assert rpil.check("new").findings == ()
    left = rpil.check("arm", skip_bad=True)
    assert {found.id for found in left.findings} == {""}  # of the folder alone
    assert re.match(r"\d+ recording faults of the whole set, of \d demonstrations", left.headline)
    ok("keep", "arm", "-o", "new.json", "--skip-bad", "--share", "1")
    assert len(json.loads(Path("new.json").read_text())["episodes"]) == n


def row(m, rng):
    note = rng.choice(["", "ok", '"a, b"', " 007 ", "1e400", str(10**30), "2024-01-01T00:00:00Z"])
    return f"{m},{rng.random()},{rng.randint(0, 1)},{note}"


@pytest.mark.parametrize("seed", range(4))
def test_each_kept_record_is_one_of_the_source_in_its_order(seed):
    rng = random.Random(seed)
    n, end, last = rng.randint(3, 8), rng.choice(["\n", "\r\n"]), rng.choice([True, False])
    records = [(m, row(m, rng)) for m in rng.sample(range(n), n) for _ in range(5)]
    if seed % 3 == 0:
        rng.shuffle(records)
    kept, head = rng.sample(range(n), rng.randint(1, n)), table(0)
    Path("a.csv").write_bytes((end.join([*head, *(text for _, text in records)]) + end * last).encode())
    rpil.open("a.csv").keep(kept, "kept.csv")
    expected = end.join([*head, *(text for m, text in records if m in kept)])
    assert Path("kept.csv").read_bytes().decode() in (expected, expected + end)
