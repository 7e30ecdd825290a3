"""Where figures come from: what tables and benchmarks write beside their own."""

from __future__ import annotations

import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rpil.numerics.parallel import cores

PACKAGES = ("rpil", "numpy", "scipy", "scikit-learn", "gymnasium", "box2d", "cleanlab", "dask", "pyarrow")
NAMED = ("numpy", "scipy", "scikit-learn")
"""Those that the line under a table names; files of figures have all of them."""

PAGES = "docs/results.md", "docs/speed.md"
"""What figures are written to, so that they are no source of them."""

_ROOT = Path(__file__).parents[1]


def source() -> dict[str, Any]:
    """Commit (None outside its checkout), and whether tracked files but `PAGES` differ from it."""
    return {
        "commit": _git("rev-parse", "--short=12", "HEAD"),
        "dirty": bool(
            _git("status", "--porcelain", "--untracked-files=no", "--", ".", *map(":(exclude){}".format, PAGES))
        ),
    }


def provenance(seeds: Any, arguments: dict[str, Any] | None = None) -> dict[str, Any]:
    """`source`, date, seeds and arguments as they are given, and machine; neither a host name nor a path is among
    them."""
    return source() | {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "seeds": seeds,
        "arguments": arguments or {},
        "python": platform.python_version(),
        "packages": {name: found for name in PACKAGES if (found := _version(name))},
        "cores": cores(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def line(found: dict[str, Any] | None) -> str:
    """What `provenance` found, as one line of Markdown; says so where a script recorded nothing."""
    if not found:
        return "*Where these figures come from was not recorded.*"
    commit = f"commit {found['commit']}" if found["commit"] else "no commit"
    changed = " with uncommitted changes" if found["dirty"] else ""
    packages = "".join(f", {name} {found['packages'][name]}" for name in NAMED if name in found["packages"])
    return (
        f"*{commit}{changed}, {found['date']}, seeds {found['seeds']}; {found['cores']} cores, "
        f"Python {found['python']}{packages}.*"
    )


def _git(*arguments: str) -> str | None:
    """What git says of the checkout that this file lies in; an installed copy may lie in somebody else's."""
    if not (_ROOT / ".git").exists():
        return None
    try:
        command = ["git", "-C", str(_ROOT), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
