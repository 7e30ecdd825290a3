"""docs/results.md: what runs, what is not run again, and where figures come from."""

import json
import platform
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import results
from provenance import line, provenance

ORIGIN = {
    "commit": "0123456789ab",
    "dirty": False,
    "date": "2026-01-02",
    "seeds": 0,
    "arguments": {},
    "python": "3.11.7",
    "packages": {"numpy": "2.0.0"},
    "cores": 2,
    "system": "Linux x86_64",
}


@pytest.fixture
def made(monkeypatch, tmp_path):
    """The script with stand-ins for two scripts; which of them ran; what git says, and where everything is."""
    state = SimpleNamespace(ran=[], commit="0123456789ab", dirty=False, fails=None, page=tmp_path / "page.md")
    state.folder = tmp_path / "figures"

    def now(seeds):
        return ORIGIN | {"commit": state.commit, "dirty": state.dirty}

    def run(command, **_):
        path = Path(command[command.index("--json") + 1])
        state.ran.append((path.stem, command[-4:]))
        if path.stem == state.fails:
            return SimpleNamespace(returncode=3)
        origin = now(0) | {"arguments": {"quick": True} if "--quick" in command else {}}
        path.write_text(json.dumps({"provenance": origin, "figure": len(state.ran)}))
        return SimpleNamespace(returncode=0)

    def section(name):
        return lambda found: f"## {name}\n\nfigure {found['figure']}"

    monkeypatch.setattr(results, "provenance", now)
    monkeypatch.setattr(results.subprocess, "run", run)
    monkeypatch.setattr(results, "SECTIONS", {name: section(name) for name in ("claims", "paper")})
    state.options = ["--data", "sets", "--folder", str(state.folder), "--page", str(state.page)]
    return state


def test_finished_figures_of_the_same_commit_are_not_made_again(made, capsys):
    assert results.main(made.options) == 0
    assert made.ran == [
        ("claims", ["--data", "sets", "--processes", "1"]),
        ("paper", ["--json", str(made.folder / "paper.json"), "--processes", "1"]),
    ]
    assert "+figure 1" in capsys.readouterr().out.splitlines()
    page = made.page.read_text()
    assert page.index("## claims") < page.index("## paper")
    assert page.count("*commit 0123456789ab,") == 2
    assert results.main(made.options) == 0
    assert len(made.ran) == 2
    assert capsys.readouterr().out == "Nothing changed.\n"
    made.commit = "ba9876543210"
    results.main(made.options)
    assert len(made.ran) == 4
    out = capsys.readouterr().out.splitlines()
    assert "-figure 1" in out
    assert "+figure 3" in out
    assert "## claims" not in out


def test_provenance_names_the_commit_and_no_machine():
    found = provenance("1000 to 1009")
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    head = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    assert (found["commit"] or "") == head[:12]
    assert found["python"] == platform.python_version()
    assert "numpy" in found["packages"]
    written = json.dumps(found) + line(found)
    assert "/" not in written
    assert "\\" not in written
    if len(platform.node()) > 3:
        assert platform.node() not in written
    assert "seeds 1000 to 1009" in line(found)
    assert "with uncommitted changes" in line(found | {"dirty": True})
    assert sys.executable not in written
