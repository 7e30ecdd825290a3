"""Findings for other tools: SARIF, Markdown, JSON by its schema, and rules by their numbers."""

import json
import re
from dataclasses import replace
from pathlib import Path

import rpil
from command_line import call, ok
from lerobot_folders import change_info
from lerobot_folders import write as write_folder
from recordings import spike, write_recording
from rpil.cli.exchange import Numbered, markdown, of_faults, sarif
from rpil.faults.report import NUMBERS, OF_AUDIT, RULE_NAMES, RULES
from rpil.faults.rule import Fault
from rpil.inference.findings import FINDINGS
from rpil.results.vocabulary import SIDES

ROOT = Path(__file__).parents[2]
TYPES = {"string": str, "integer": int, "number": (int, float), "array": list, "object": dict, "null": type(None)}
TYPES["boolean"] = bool


def faults_of(value, schema, defs, place="$"):
    """Where a value of JSON is not as a schema says, by the words of docs/schemas; what it does not name is a fault."""
    if "$ref" in schema:
        schema = defs[schema["$ref"].rpartition("/")[2]]
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    right = [
        kind for kind in kinds if isinstance(value, TYPES[kind]) and isinstance(value, bool) <= (kind == "boolean")
    ]
    if kinds and not right:
        return [f"{place}: {value!r} is no {kinds}"]
    is_right = value in schema.get("enum", [schema.get("const", value)])
    is_right &= not isinstance(value, str) or re.search(schema.get("pattern", ""), value) is not None
    is_right &= "minimum" not in schema or schema["minimum"] <= value <= schema["maximum"]
    wrong = [] if is_right else [f"{place}: {value!r}"]
    if isinstance(value, list) and "items" in schema:
        wrong += [
            one for k, item in enumerate(value) for one in faults_of(item, schema["items"], defs, f"{place}[{k}]")
        ]
    if isinstance(value, dict):
        known, others = schema.get("properties", {}), schema.get("additionalProperties")
        wrong += [f"{place}: no {name}" for name in schema.get("required", []) if name not in value]
        for name, item in value.items():
            if name in known or others:
                wrong += faults_of(item, known.get(name, {} if others is True else others), defs, f"{place}.{name}")
            elif known:
                wrong.append(f"{place}: {name} is not described")
    return wrong


def check_schema(printed, command):
    schema = json.loads((ROOT / "docs" / "schemas" / f"{command}.json").read_text())
    assert faults_of(printed, schema, schema["$defs"]) == []


def test_every_finding_has_one_number_that_stays_and_a_line_of_the_page():
    assert {*RULES, *OF_AUDIT} <= {*NUMBERS}  # a rule that is gone keeps its number
    assert len(RULE_NAMES) == len(NUMBERS)
    assert {verdict for verdict, side in SIDES.items() if side == "lower"} <= {*OF_AUDIT}
    assert {*OF_AUDIT} - {*SIDES} <= {*FINDINGS}
    some = {"missing values": 101, "frozen sensor": 105, "jump": 109, "offset": 114, "length": 124}
    some |= {"metadata": 205, "video file": 301, "outlier": 401}
    assert {name: NUMBERS[name] for name in some} == {name: f"RPIL-{number}" for name, number in some.items()}
    page = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    words = {name: rule.words for name, rule in RULES.items()} | OF_AUDIT
    lines = [f"| {number} | {name} | {words[name]} |" for number, name in RULE_NAMES.items() if name in words]
    assert re.findall(r"^(\| RPIL-.*? \| .*? \| .*? \|).* \|$", page, re.MULTILINE) == lines


def test_json_of_a_check_is_as_its_schema_says(tmp_path):
    write_recording("data.parquet", spike)
    printed = json.loads(ok("check", "data.parquet", "--format", "json").stdout)
    assert printed["schema"] == {"name": "rpil.check", "version": 1}
    assert [one["number"] for one in printed["findings"]] == ["RPIL-108"]
    check_schema(printed, "check")
    assert json.loads(ok("check", "data.parquet", "--format", "json").stdout) == printed
    change_info(folder := write_folder(tmp_path / "set", [30] * 5), total_frames=7)
    printed = json.loads(ok("check", folder, "--format", "json").stdout)
    check_schema(printed, "check")
    assert [(one["number"], one["id"]) for one in printed["findings"]] == [("RPIL-202", "")]


def test_json_of_an_audit_is_as_its_schema_says(folder):
    Path("labels.csv").write_text("id,label\n0,good\n7,bad\n")
    Path("who.csv").write_text("id,demonstrator\n" + "".join(f"{m},{'ab'[m % 2]}\n" for m in range(12)))
    for more in ([], ["--labels", "labels.csv", "--operator", "who.csv"]):
        printed = json.loads(ok("audit", folder / "good.parquet", "--format", "json", *more).stdout)
        assert printed["schema"] == {"name": "rpil.audit", "version": 1}
        check_schema(printed, "audit")


def check_sarif(log, line):
    """The parts of SARIF 2.1.0 that code scanning needs."""
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    rules = run["tool"]["driver"]["rules"]
    assert all(re.fullmatch(r"RPIL-\d{3}", rule["id"]) and rule["shortDescription"]["text"] for rule in rules)
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["level"] in ("note", "warning", "error")
        (place,) = result["locations"]
        assert place["physicalLocation"]["region"]["startLine"] == line(place["logicalLocations"][0]["name"])
        assert re.fullmatch(r"(file:///)?[\w.%/-]+", place["physicalLocation"]["artifactLocation"]["uri"])
    marks = [result["partialFingerprints"]["primaryLocationLineHash"] for result in run["results"]]
    assert len({*marks}) == len(marks)
    return run["results"]


def test_sarif_of_a_check():
    write_recording("my data.parquet", spike)
    result = call("check", "my data.parquet", "--format", "sarif", "--fail-on", "any")
    assert result.exit_code == 1
    starts = rpil.open("my data.parquet").steps.offsets
    (found,) = check_sarif(json.loads(result.stdout), lambda name: starts[int(name)] + 60 + 1)
    assert found["ruleId"] == "RPIL-108"
    assert found["message"]["text"].startswith("4: ")
    assert found["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "my%20data.parquet"


def test_sarif_names_the_file_of_a_folder_and_its_row(tmp_path):
    folder = write_folder(tmp_path / "set", [30] * 5)  # three a file
    fault = Fault("spike", 4, 2, 2, "x", 1.0, 0.0, 2.0, "leaps")
    (result,) = sarif(of_faults([fault], rpil.open(folder)), str(folder))["runs"][0]["results"]
    place = result["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"].endswith("set/data/chunk-000/file-001.parquet")
    assert place["region"]["startLine"] == 30 + 2 + 1
    Path("a.csv").write_text("episode,x,action\n" + "".join(f"{k // 3},{k},0\n" for k in range(9)))
    (text,) = of_faults([replace(fault, id="", ids=(2, 0))], rpil.open("a.csv"))
    assert text.line == 3 * 2 + 2 + 2  # below its head


def test_sarif_and_markdown_of_an_audit(folder):
    starts = rpil.open(data := folder / "good.parquet").steps.offsets
    log = json.loads(ok("audit", data, "--format", "sarif", "--quiet").stdout)
    found = check_sarif(log, lambda name: starts[int(name)] + 1)
    assert {one["ruleId"] for one in found if one["level"] == "note"} == {"RPIL-401"}
    text = ok("audit", data, "--format", "markdown", "--quiet").stdout
    assert text.startswith("### rpil audit: ")
    assert text.count("| RPIL-401 |") == sum(one["ruleId"] == "RPIL-401" for one in found) == 6


def test_markdown_shows_text_of_a_file_as_it_is():
    text = markdown("x", "y", [Numbered("RPIL-108", "a|b\n<img> @me [l](http://h)", "*s*")] * 200)
    row = text.splitlines()[8]
    assert row == r"| RPIL-108 | a\|b \<img\> @me \[l\](http://h) | \*s\* |".replace("@", "@\u200b").replace(
        "://", ":\u200b//"
    )
    address = markdown("x", "y", [Numbered("RPIL-108", "www.evil.com WWW.evil.com", "www")])
    assert "| www\u200b.evil.com WWW\u200b.evil.com | www |" in address
    assert text.splitlines()[4] == "200 findings: 200 spike (RPIL-108)."
    assert (text.count(row), text.splitlines()[-2:]) == (100, ["", "... and 100 more."])
    assert markdown("x", "y", [Numbered("RPIL-108", "a", "b")] * 100).endswith("\n| RPIL-108 | a | b |")
    assert markdown("x_", "y", []) == "### x\\_\n\ny"
