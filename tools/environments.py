"""Tests of the built package in empty environments: with the lowest versions that pyproject.toml allows, or the newest.

``python tools/environments.py lowest`` takes Python 3.11, and ``newest`` takes every later Python at hand as well. Both
build the wheel and the source distribution from a copy of this checkout, check them, install the wheel, and run the
tests of the checkout against it: the fast ones, or what ``--pytest`` says.
torch is left out unless ``--extras`` names it, because its package for Linux comes with gigabytes of others.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
OLDEST, LATEST = 11, 16
"""Minor versions of Python 3: the first that is supported, and the last that is looked for."""

EXTRAS = "plot,gym,dask,zarr,hdf5,video,review"
NOT_IN_A_COPY = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info", "__pycache__")
WHEELS_ONLY = ("--only-binary=:all:",)
"""Of others: to build an old version can take an hour, and runs code that nobody reads."""

# Old versions call what Python and packages that they need have deprecated since: nothing that users see.
OF_OLD_VERSIONS = ("-W", "ignore::DeprecationWarning")


def lowest(requirement: str) -> str:
    """The lowest version that a requirement such as "gymnasium[box2d]>=1.2.3,<2" allows, as a requirement."""
    found = re.match(r"([\w.-]+(?:\[[\w,-]+\])?)>=([\d.]+)", requirement)
    if found is None:
        raise ValueError(f"pyproject.toml: {requirement!r} names no lowest version; write NAME>=VERSION")
    return f"{found[1]}=={found[2]}"


def lowest_versions(extras: Iterable[str]) -> list[str]:
    """The lowest versions of everything that is needed, and that `extras` need."""
    project = PROJECT["project"]
    optional = [need for extra in extras for need in project["optional-dependencies"][extra]]
    return [lowest(need) for need in (*project["dependencies"], *optional)]


def test_tools() -> list[str]:
    """What the tests need, at the versions of the extra ``dev``."""
    return [need for need in PROJECT["project"]["optional-dependencies"]["dev"] if "==" in need]


def interpreters() -> Iterator[str]:
    """Python 3.11 and every later one: on the PATH, or of pyenv, whose commands on the PATH may be of no version."""
    for minor in range(OLDEST, LATEST + 1):
        of_pyenv = Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python")
        for path in (shutil.which(f"python3.{minor}"), *map(str, of_pyenv)):
            if path and subprocess.run([path, "-c", "import venv"], capture_output=True).returncode == 0:
                yield path
                break
        else:
            print(f"Python 3.{minor}: not at hand, skipped", flush=True)


def call(*command: str | Path, folder: Path = ROOT) -> None:
    """Run a command, or end with its status."""
    print("$", *command, flush=True)
    status = subprocess.run([str(part) for part in command], cwd=folder, env=_environment()).returncode
    if status:
        sys.exit(status)


def _environment() -> dict[str, str]:
    """Without what would find the source of the checkout."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"OPENBLAS_NUM_THREADS": "1"}


def make_environment(folder: Path, python: str = sys.executable) -> Path:
    """Make an empty virtual environment; returns its Python."""
    call(python, "-m", "venv", folder)
    return folder / ("Scripts" if os.name == "nt" else "bin") / "python"


def install(python: Path, *what: str | Path) -> None:
    call(python, "-m", "pip", "install", "-qq", "--disable-pip-version-check", *what)


def copy_checkout(folder: Path) -> Path:
    """A copy in which a build leaves its files."""
    return Path(shutil.copytree(ROOT, folder, ignore=NOT_IN_A_COPY))


def build(folder: Path) -> Path:
    """Build and check the wheel and the source distribution; returns the wheel."""
    python = make_environment(folder / "release")
    install(python, *WHEELS_ONLY, *PROJECT["dependency-groups"]["release"])
    call(python, "-m", "build", "--quiet", "--outdir", folder / "dist", copy_checkout(folder / "checkout"))
    made = sorted((folder / "dist").iterdir())
    wheel = next(path for path in made if path.suffix == ".whl")
    call(python, "-m", "twine", "check", "--strict", *made)
    call(python.with_name("check-wheel-contents"), wheel)
    for name in ("release", "checkout"):
        shutil.rmtree(folder / name)  # the environments of the tests need the disk
    return wheel


def check(python: str, folder: Path, wheel: Path, versions: Sequence[str], tests: Sequence[str], extras: str) -> None:
    """Run the tests against the wheel in an environment that has nothing else but `versions` and their tools."""
    inside = make_environment(folder, python)
    install(inside, *WHEELS_ONLY, f"{wheel}[{extras}]", *versions, *test_tools())
    call(inside, "-m", "pip", "--disable-pip-version-check", "list")
    call(inside, "-c", f"import rpil; assert rpil.__file__.startswith({str(folder)!r}), rpil.__file__")
    call(inside, "-m", "pytest", "-p", "no:cacheprovider", "-n", "2", "--dist", "loadfile", "--quiet", *tests)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("versions", choices=("lowest", "newest"))
    parser.add_argument("--extras", default=EXTRAS, help=f"extras to install (default: {EXTRAS})")
    parser.add_argument(
        "--pytest", metavar="ARGUMENTS", default="-m 'not slow'", help="which tests (default: fast ones)"
    )
    given = parser.parse_args()
    tests = shlex.split(given.pytest)
    with tempfile.TemporaryDirectory(prefix="rpil-") as name:
        folder = Path(name)
        wheel = build(folder)
        if given.versions == "lowest":
            pins = lowest_versions(given.extras.split(","))
            check(next(interpreters()), folder / "lowest", wheel, pins, [*OF_OLD_VERSIONS, *tests], given.extras)
        else:
            for python in interpreters():
                check(python, folder / "newest", wheel, (), tests, given.extras)
                shutil.rmtree(folder / "newest")


if __name__ == "__main__":
    main()
