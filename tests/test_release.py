"""`tools/release.py`: versions that disagree, files that are missing, licences that ask for more, the list of all."""

from __future__ import annotations

import io
import runpy
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOOL = runpy.run_path(str(ROOT / "tools" / "release.py"))


@pytest.mark.parametrize(
    ("version", "heading", "cited", "faults"),
    [
        ("1.2.0", "1.2.0 (2026-11-29)", "1.2.0", 0),
        ("1.2.0.dev0", "1.2.0 (unreleased)", "1.2.0.dev0", 0),
        ("1.2.0", "1.2.0 (unreleased)", "1.2.0", 1),
        ("1.2.0.dev0", "1.2.0 (2026-11-29)", "1.2.0.dev0", 1),
        ("1.2.0", "1.1.0 (2026-11-29)", "1.1.0", 2),
        ("1.2", "1.2 (2026-11-29)", "1.2", 1),
    ],
)
def test_versions_that_disagree_are_named(tmp_path, version, heading, cited, faults):
    (tmp_path / "pyproject.toml").write_text(f'[project]\nversion = "{version}"\n')
    (tmp_path / "CHANGELOG.md").write_text(f"# Changelog\n\n## {heading}\n")
    (tmp_path / "CITATION.cff").write_text(f"version: {cited}\n")
    assert len(TOOL["version_faults"](tmp_path)) == faults
    assert TOOL["version_faults"]() == []  # of this checkout


def test_what_is_built_holds_the_library_and_no_more(tmp_path):
    (tmp_path / "src" / "rpil").mkdir(parents=True)
    for name in ("__init__.py", "new.py"):
        (tmp_path / "src" / "rpil" / name).write_text("")
    wheel, source = tmp_path / "rpil.whl", tmp_path / "rpil.tar.gz"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in ("rpil/__init__.py", "rpil/old.py", "rpil-1.dist-info/METADATA"):
            archive.writestr(name, "")
    inside = ["pyproject.toml", "LICENSE", "NOTICE", "README.md", "tests/a.py"]
    inside += ["src/rpil/__init__.py", "src/rpil/new.py"]
    with tarfile.open(source, "w:gz") as archive:
        for name in inside:
            archive.addfile(tarfile.TarInfo(f"rpil-1/{name}"), io.BytesIO())
    assert TOOL["contents_faults"](wheel, source, tmp_path) == [
        "rpil.whl: rpil/new.py is missing",
        "rpil.whl: rpil/old.py is not of the library",
        "rpil.tar.gz: holds tests/a.py",
    ]


def test_licences_are_permissive_and_the_bill_of_materials_names_every_package_and_what_needs_it():
    found = TOOL["dependencies"](())
    assert {"numpy", "scipy", "scikit-learn", "pyarrow", "click", "rich", "jinja2", "joblib"} <= set(found)
    assert TOOL["licence_faults"](found) == []
    strict = {"one": {"licence": "GPL-3.0-only"}, "two": {"licence": ""}, "nvidia-x": {"licence": "own"}}
    assert len(TOOL["licence_faults"](strict)) == 2
    bill = TOOL["bill_of_materials"](found)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    refs = [bill["metadata"]["component"]["bom-ref"], *(part["bom-ref"] for part in bill["components"])]
    assert len(refs) == len(set(refs)) == len(found) + 1
    graph = {each["ref"]: each["dependsOn"] for each in bill["dependencies"]}
    assert set(graph) == set(refs)
    assert {ref for needs in graph.values() for ref in needs} <= set(refs)
    assert bill == TOOL["bill_of_materials"](found)
