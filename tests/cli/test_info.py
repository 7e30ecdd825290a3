"""What ``rpil info`` says, and the head of an audit."""

from __future__ import annotations

import json
from pathlib import Path

from command_line import call, ok, refused


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
    refused("name it action, or name the columns with --action", "info", "a.csv", "--id", "bout")
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
