"""What ``rpil info`` says, and the head of an audit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from command_line import call, ok, refused


def test_info_describes_a_file_in_words_and_as_json(folder):
    text = ok("info", folder / "good.parquet").stdout
    said = json.loads(ok("info", folder / "good.parquet", "--format", "json").stdout)
    assert f"{said['demonstrations']} demonstrations, {said['steps']:,} steps" in text
    for name in said["observations"]:
        assert f"  {name}: " in text
    assert said["order_column"] == "step_index"


def test_rows_that_lie_apart_are_put_together(tmp_path):
    rng, k = np.random.default_rng(0), np.arange(400)
    (tmp_path / "many").mkdir()
    table = pa.table(
        {"episode": k % 8, "frame_index": k // 8, "x": rng.normal(size=400), "action": rng.normal(size=400)}
    )
    pq.write_table(table, tmp_path / "many" / "a.parquet")
    together = table.sort_by([("episode", "ascending"), ("frame_index", "ascending")])
    pq.write_table(together, tmp_path / "b.parquet")
    said = "Demonstrations by episode; steps in the order of frame_index; rows of a demonstration lay apart."
    text = ok("info", tmp_path / "many").stdout
    assert "8 demonstrations, 400 steps" in text
    assert said in text
    found, expected = (
        json.loads(ok("check", path, "--format", "json").stdout) for path in (tmp_path / "many", tmp_path / "b.parquet")
    )
    assert found == expected
    assert said in ok("info", tmp_path / "many", "--memory", "1kB").stdout
    shuffled = together.take(np.r_[25:50, 0:25, 50:400])
    pq.write_table(shuffled, tmp_path / "many" / "a.parquet")
    assert "steps sorted by frame_index, because rows" in ok("info", tmp_path / "many").stdout


def test_the_head_of_an_audit_is_what_info_says(folder):
    said = json.loads(ok("info", folder / "good.parquet", "--format", "json").stdout)
    audit = ok("audit", folder / "good.parquet", "--format", "json", "--report", "r.html")
    assert json.loads(audit.stdout)["input"] == said
    assert "What was read" in Path("r.html").read_text()
    assert ok("audit", folder / "good.parquet").stdout.splitlines()[1].startswith("good.parquet: Parquet; ")


def test_columns_are_named_with_options(folder):
    Path("a.csv").write_text(
        "bout,beat,x,y,who,gear\n" + "".join(f"{k // 9},{k % 9},{k / 2},1,Ann,{k % 2}\n" for k in range(36))
    )
    refused("name it episode_index, or name the column with --id", "convert", "a.csv", "-o", "b.csv")
    refused("name it action, or name the columns with --action", "info", "a.csv")
    options = ["--id", "bout", "--action", "gear", "--exclude", "y", "--order", "beat", "--operator", "who"]
    said = json.loads(ok("info", "a.csv", *options, "--format", "json").stdout)
    assert (said["demonstrations"], said["observations"], said["operators"]) == (4, ["x"], ["Ann"])
    said = json.loads(
        ok(
            "info", "a.csv", *options[:4], "--observations", "x,y", "--action-kind", "continuous", "--format", "json"
        ).stdout
    )
    assert (said["observations"], said["action_kind"]) == (["x", "y"], "continuous")


def test_a_missing_value_is_described_and_refused(folder):
    Path("b.csv").write_text("episode,x,action\n0,1,0\n0,,1\n1,2,0\n")
    result = call("info", "b.csv")
    assert result.exit_code == 2
    assert "Missing values:\n  x: 1" in result.stdout
    assert "demonstration 0, row 2: column 'x' has no value; fill it in, or read with --skip-bad." in result.stderr


def test_a_value_that_is_not_finite_names_the_option_that_leaves_it_out(folder):
    table = pq.read_table(folder / "good.parquet")
    x = next(name for name in table.column_names if name.startswith("observation"))
    values = table[x].to_numpy().copy()
    values[5] = np.inf
    pq.write_table(table.set_column(table.column_names.index(x), x, [values]), "n.parquet")
    assert (
        "repair the value, leave the demonstration out, or read with --skip-bad." in call("audit", "n.parquet").stderr
    )
    assert "Set aside: " in ok("info", "n.parquet", "--skip-bad").stdout
