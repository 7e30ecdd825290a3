"""What pyproject.toml promises: dependencies that are those of the code, and a package that works alone."""

from __future__ import annotations

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OPTIONAL = PROJECT["optional-dependencies"]
FOR_USERS = set(OPTIONAL) - {"all", "dev", "docs", "value"}


def packages(requirements):
    return {re.match(r"[\w-]+", requirement)[0] for requirement in requirements}


def imported(source: str) -> tuple[set[str], set[str]]:
    """The packages that a module of the library imports when it is imported, and all that it imports anywhere."""
    tree = ast.parse(source)
    found: tuple[set[str], set[str]] = set(), set()
    for names, nodes in zip(found, (tree.body, ast.walk(tree)), strict=True):
        for node in nodes:
            if isinstance(node, ast.Import):
                names |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(str(node.module).partition(".")[0])
    foreign = (names - sys.stdlib_module_names - {"rpil"} for names in found)
    first, every = ({{"sklearn": "scikit-learn"}.get(n, n.replace("_", "-")) for n in names} for names in foreign)
    return first, every


def test_what_is_imported_is_declared():
    core = packages(PROJECT["dependencies"])
    declared = core | packages(need for needs in OPTIONAL.values() for need in needs)
    of_files = [imported(path.read_text(encoding="utf-8")) for path in (ROOT / "src").rglob("*.py")]
    first, every = (set().union(*names) for names in zip(*of_files, strict=True))
    assert first <= core, "a package of an extra is imported within functions only"
    assert every <= declared
    assert core <= every, "declared and not used"
    source = "import threadpoolctl.x\nfrom sklearn.base import A"
    assert imported(source) == ({"threadpoolctl", "scikit-learn"},) * 2
    source = "import os, rpil.data\ndef f():\n    from google_crc32c import value"
    assert imported(source) == (set(), {"google-crc32c"})


def test_the_citation_is_of_this_version_and_licence_and_the_extra_all_holds_every_extra_for_users():
    (everything,) = OPTIONAL["all"]
    assert set(re.findall(r"\w+", everything)) == {"rpil", *FOR_USERS}
    citation = dict(re.findall(r"^(\S+): (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE))
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])
    assert citation["repository-code"] == PROJECT["urls"]["Repository"]


def test_the_matrix_has_every_python_and_system_and_the_site_is_built_as_here():
    versions = [kind.rpartition(" :: ")[2] for kind in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", kind)]
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "test.yml").read_text(encoding="utf-8"))["jobs"]
    matrix = jobs["test"]["strategy"]["matrix"]
    assert (matrix["python"], PROJECT["requires-python"]) == (versions, f">={versions[0]}")
    systems = {*matrix["os"], *(job["os"] for job in matrix["include"])}
    assert {system.partition("-")[0] for system in systems} == {"ubuntu", "windows", "macos"}
    site = yaml.safe_load((ROOT / ".readthedocs.yaml").read_text(encoding="utf-8"))
    assert (ROOT / site["sphinx"]["configuration"]).is_file()
    assert site["sphinx"]["fail_on_warning"] is True
    assert set(site["python"]["install"][0]["extra_requirements"]) <= set(OPTIONAL)


def packed() -> set[Path]:
    """The files beside Python that are packed."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    patterns = tool["setuptools"]["package-data"]["rpil"]
    return {path for pattern in patterns for path in (ROOT / "src" / "rpil").glob(pattern) if path.is_file()}


def test_every_file_of_the_library_is_in_the_package():
    files = (path for path in (ROOT / "src" / "rpil").rglob("*") if path.is_file())
    assert {path for path in files if path.suffix not in (".py", ".pyc")} == packed()


def test_every_requirement_has_a_lowest_version():
    tool = runpy.run_path(str(ROOT / "tools" / "environments.py"))
    lowest = tool["lowest_versions"](sorted(FOR_USERS))
    needs = [*PROJECT["dependencies"], *(need for extra in FOR_USERS for need in OPTIONAL[extra])]
    assert packages(lowest) == packages(needs)
    assert len(lowest) == len(needs)
    assert tool["lowest"]("gymnasium[box2d]>=1.2.3,<2") == "gymnasium[box2d]==1.2.3"
    with pytest.raises(ValueError, match="numpy<3"):
        tool["lowest"]("numpy<3")


@pytest.mark.slow
def test_the_package_works_without_extras(tmp_path):
    """The packed files with the packages that rpil needs alone; `.ci/run` builds the wheel, in an empty environment."""
    first = re.search(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)[1]
    assert first.startswith(f"pip install 'rpil[video,review] @ git+{PROJECT['urls']['Repository']}'")
    library, folder = tmp_path / "library", tmp_path / "work"
    for path in [*(ROOT / "src").rglob("*.py"), *packed()]:
        place = library / path.relative_to(ROOT / "src")
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)
    extras = packages(need for extra in FOR_USERS for need in OPTIONAL[extra]) - packages(PROJECT["dependencies"])
    absent = [module for module, names in packages_distributions().items() if extras & {*names}]
    (library / "sitecustomize.py").write_text(f"import sys\nsys.modules.update(dict.fromkeys({absent}))\n")
    folder.mkdir()
    module, _, name = PROJECT["scripts"]["rpil"].partition(":")
    landings = ROOT / "docs" / "lunarlander_corrupted.npz"
    command = [sys.executable, "-c", f"from {module} import {name}; {name}()"]
    environment = os.environ | {"PYTHONPATH": str(library)}
    command += ["audit", landings, "--report", "page.html"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "20 demonstrations" in done.stdout
    assert "lunarlander_corrupted" in (folder / "page.html").read_text(encoding="utf-8")
