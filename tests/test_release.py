"""`tools/release.py`: versions that disagree, licences that ask for more, and the list of all packages."""

import runpy
from pathlib import Path

import pytest

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "release.py"))


@pytest.mark.parametrize(
    ("version", "heading", "cited", "faults"),
    [
        ("1.2.0", "1.2.0 (2026-11-29)", "1.2.0", 0), ("1.2.0.dev0", "1.2.0 (unreleased)", "1.2.0.dev0", 0),
        ("1.2.0", "1.2.0 (unreleased)", "1.2.0", 1), ("1.2.0.dev0", "1.2.0 (2026-11-29)", "1.2.0.dev0", 1),
        ("1.2.0", "1.1.0 (2026-11-29)", "1.1.0", 2), ("1.2", "1.2 (2026-11-29)", "1.2", 1),
    ],
)  # fmt: skip
def test_versions_that_disagree_are_named(tmp_path, version, heading, cited, faults):
    (tmp_path / "pyproject.toml").write_text(f'[project]\nversion = "{version}"\n')
    (tmp_path / "CHANGELOG.md").write_text(f"# Changelog\n\n## {heading}\n")
    (tmp_path / "CITATION.cff").write_text(f"version: {cited}\n")
    assert len(TOOL["version_faults"](tmp_path)) == faults
    assert TOOL["version_faults"]() == []  # of this checkout


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
