"""A copy of a folder of LeRobot with verdicts and scores in its table of episodes."""

import filecmp
import json

import pyarrow.parquet as pq
import pytest

from command_line import ok, refused
from lerobot_folders import write

EPISODES = "meta/episodes/chunk-000/file-000.parquet"


def all_files(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def source(tmp_path):
    return write(tmp_path / "set", [12, 9, 15, 11, 13])


def test_an_audit_adds_verdicts_and_scores(source, tmp_path):
    result = ok("audit", source, "--annotate", tmp_path / "new", "--format", "json")
    printed = {one["id"]: one for one in json.loads(result.stdout)["demonstrations"]}
    assert all_files(tmp_path / "new") == all_files(source)
    others = [str(name) for name in all_files(source) if str(name) != EPISODES]
    assert filecmp.cmpfiles(source, tmp_path / "new", others, shallow=False)[0] == others
    old, new = (pq.read_table(folder / EPISODES) for folder in (source, tmp_path / "new"))
    parts = [f"rpil_subtask_{name}" for name in ("names", "start_frames", "end_frames")]
    assert new.column_names == [*old.column_names, "rpil/verdict", "rpil/score", "rpil/rejected_by", *parts]
    for n, kinds, starts, ends in zip([12, 9, 15, 11, 13], *(new[name].to_pylist() for name in parts), strict=True):
        assert len(kinds) == len(starts) == len(ends) > 0
        assert [*starts, n] == [0, *(end + 1 for end in ends)]  # both included, and they tile the episode
    assert new.select(old.column_names).equals(old)
    rows = new.select(["episode_index", "rpil/verdict", "rpil/score", "rpil/rejected_by"]).to_pylist()
    assert [row["episode_index"] for row in rows] == [*range(5)]
    for row in rows:
        assert row["rpil/verdict"] == printed[row["episode_index"]]["verdict"]
        assert row["rpil/score"] == printed[row["episode_index"]]["log_odds"]
        assert row["rpil/rejected_by"] == printed[row["episode_index"]]["rejected_by"]
    again = json.loads(ok("audit", tmp_path / "new", "--format", "json").stdout)["demonstrations"]
    assert {one["id"]: one["log_odds"] for one in again} == {m: one["log_odds"] for m, one in printed.items()}


def test_episodes_that_are_not_judged_have_null_and_old_columns_are_replaced(source, tmp_path):
    ok("audit", source, "--annotate", tmp_path / "one")
    text = ok("audit", tmp_path / "one", "--without", "3", "--annotate", tmp_path / "two").stdout
    assert "episode_filter=lambda episode: " in text
    table = pq.read_table(tmp_path / "two" / EPISODES)
    assert table.column_names.count("rpil/score") == 1
    assert [value is None for value in table["rpil/score"].to_pylist()] == [False, False, False, True, False]


def test_what_cannot_be_annotated_is_refused_before_any_work(source, tmp_path):
    refused("it is there already", "audit", source, "--annotate", source.parent)
    refused("it is the data themselves", "audit", source, "--annotate", source / "new")
    older = write(tmp_path / "older", [12, 9, 15], version="v2.1")
    refused(r"no folder of LeRobot 3\.0", "audit", older, "--annotate", tmp_path / "new")
    (tmp_path / "data.csv").write_text("episode,x,action\n" + "0,1,2\n1,2,3\n" * 9)
    refused(r"no folder of LeRobot 3\.0", "audit", tmp_path / "data.csv", "--annotate", tmp_path / "new")
