"""Imports flow one way, files stay short, nothing is unpickled: docs/architecture.md says why."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import rpil

ROOT = Path(__file__).parents[1] / "src" / "rpil"
FILES = sorted(path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py")
# A part imports from those before it only; a package is one part.
# fmt: off
ORDER = [
    "errors", "_arrays", "files", "demonstrations", "formats",
    "passes", "spaces", "demonstrators", "problem", "parallel", "features", "solvers", "engines",
    "policies", "adversaries",
    "em", "judge", "search", "suggestions", "recalibration", "audit", "verdicts",
    "polish", "inputs", "mixture", "selection", "assumptions", "large", "cloning", "estimators", "rment",
    "reweighting",
    "schema", "persistence", "checkpoints",
    "actions", "experts", "corruptions", "environments", "rollouts", "simulation",
    "plots", "report", "data", "demo", "reproduce", "terminal", "commands", "cli", "__main__",
]
# fmt: on


def imports(path: Path) -> set[str]:
    """Parts of rpil that a file imports when it is imported itself."""
    tree = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {
        f"{node.module}." if isinstance(node, ast.ImportFrom) else f"{n.name}." for node in tree for n in node.names
    }
    return {name.split(".")[1] for name in names if name.startswith("rpil.")} - {""}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_module(path):
    part = path.relative_to(ROOT).parts[0].removesuffix(".py")
    assert part in ORDER, f"say in ORDER where {part} belongs"
    assert imports(path) <= {*ORDER[: ORDER.index(part)], part}
    assert len(path.read_text().splitlines()) <= 400
    assert not re.search(r"^\s*(import|from) (pickle|joblib|dill|cloudpickle)\b", path.read_text(), re.MULTILINE)


FRESH = """
import sys

for name in sys.argv[1:]:
    for module in [module for module in sys.modules if module.partition(".")[0] == "rpil"]:
        del sys.modules[module]  # as if nothing of it had been imported yet
    found = getattr(__import__("rpil", fromlist=[name]), name)
    assert not isinstance(found, type(sys)), name
"""


def test_every_public_name_is_what_it_says_and_no_module():
    names = sorted(set(rpil.__all__) - {"__version__"})
    found = subprocess.run([sys.executable, "-W", "error", "-c", FRESH, *names], check=False)
    assert found.returncode == 0
