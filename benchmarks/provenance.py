"""Where figures come from: what every script writes beside its own, and `results.py` prints."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("numpy", "scipy", "scikit-learn", "gymnasium", "cleanlab")


def provenance(seeds: Any) -> dict[str, Any]:
    """Commit, date, seeds and machine, as plain numbers and text; neither a host name nor a path is among them.

    Parameters
    ----------
    seeds : int, list of int or str
        Whatever says which seeds were used; kept as it is.

    Returns
    -------
    dict
        "commit" (None outside a repository), "dirty" (whether tracked files differ from it), "date" (UTC), "seeds",
        "python", "packages" (name to version, of those installed), "cores" (that this process may use), "system".
    """
    return {
        "commit": _git("rev-parse", "--short=12", "HEAD"),
        "dirty": bool(_git("status", "--porcelain", "--untracked-files=no")),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "seeds": seeds,
        "python": platform.python_version(),
        "packages": {name: found for name in PACKAGES if (found := _version(name))},
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def line(found: dict[str, Any] | None) -> str:
    """What `provenance` found, as one line of Markdown; says so where a script recorded nothing."""
    if not found:
        return "*Where these figures come from was not recorded.*"
    commit = f"commit {found['commit']}" if found["commit"] else "no commit"
    changed = " with uncommitted changes" if found["dirty"] else ""
    packages = ", ".join(f"{name} {number}" for name, number in found["packages"].items())
    return (
        f"*{commit}{changed}, {found['date']}, seeds {found['seeds']}; {found['cores']} cores, {found['system']}, "
        f"Python {found['python']}, {packages}.*"
    )


def _git(*arguments: str) -> str | None:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
