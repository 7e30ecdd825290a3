"""The action and the hook of pre-commit, whose steps are run as GitHub and pre-commit run them."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from recordings import spike, write_recording

ROOT = Path(__file__).parents[1]


@pytest.fixture
def environment(tmp_path):
    """Programs of this checkout: what python installs is written to a file, and rpil is the package that is tested."""
    programs = {"python": f'echo "$@" >> {tmp_path}/installed', "rpil": f'exec {sys.executable} -m rpil "$@"'}
    (tmp_path / "bin").mkdir()
    for name, line in programs.items():
        place = tmp_path / "bin" / name
        place.write_text(f"#!/bin/sh\n{line}\n")
        place.chmod(0o755)
    given = {"GITHUB_ACTION_PATH": str(ROOT), "GITHUB_STEP_SUMMARY": str(tmp_path / "summary")}
    return os.environ | given | {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}


def run_action(given, environment):
    """The exit codes of the steps of the action, with these inputs; none runs after one that fails."""
    action = yaml.safe_load((ROOT / "action.yml").read_text())
    inputs = {name: given.get(name, about.get("default", "")) for name, about in action["inputs"].items()}
    assert not set(given) - set(inputs)
    codes = []
    for step in action["runs"]["steps"]:
        named = {
            name: re.fullmatch(r"\$\{\{ inputs\.([\w-]+) \}\}", value)[1] for name, value in step.get("env", {}).items()
        }
        own = environment | {name: inputs[wanted] for name, wanted in named.items()}
        assert "${{" not in step["run"], "an input in a script is a way in"
        bash = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        codes.append(subprocess.run(bash, env=own, check=False).returncode)
        if codes[-1]:
            break
    return codes


@pytest.mark.slow
def test_the_action_lists_findings_and_fails(environment, tmp_path):
    write_recording("my data.parquet", spike)
    assert run_action({"data": "my data.parquet"}, environment) == [0, 0, 1]
    needed, own = (tmp_path / "installed").read_text().splitlines()
    assert needed == "-m pip install --quiet numpy pyarrow click rich", "tests/test_start.py runs a check with these"
    assert own == f"-m pip install --quiet --no-deps {ROOT}"
    assert "| RPIL-108 | 4 |" in (tmp_path / "summary").read_text()
    (run,) = json.loads(Path("rpil.sarif").read_text())["runs"]
    assert [result["ruleId"] for result in run["results"]] == ["RPIL-108"]
    only = {"data": "my data.parquet", "arguments": "--only 4-11 --skip-bad", "sarif": "other.sarif", "fail-on": ""}
    assert run_action(only, environment) == [0, 0, 0]
    assert len(json.loads(Path("other.sarif").read_text())["runs"][0]["results"]) == 1
    assert "1 of 8 demonstrations" in (tmp_path / "summary").read_text()
    assert run_action({"data": "none.parquet"}, environment) == [0, 2]


@pytest.mark.slow
def test_the_hook_fails_on_a_finding(environment):
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    assert hook["id"] == "rpil-check"
    assert hook["pass_filenames"] is False
    write_recording("bad.parquet", spike)
    write_recording("good.parquet")
    for args, code in ((["bad.parquet"], 1), (["good.parquet"], 0)):
        words = [*shlex.split(hook["entry"]), *args]
        assert subprocess.run(words, env=environment, check=False, capture_output=True).returncode == code
