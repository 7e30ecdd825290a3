"""Names of scripts and of ablations are those that texts use."""

import re
from collections import Counter
from pathlib import Path

import ablations

ROOT = Path(__file__).parents[2]


def test_helpers_of_tests_and_benchmarks_have_different_names():
    """All of them are imported by their base names."""
    modules = [*(ROOT / "tests").glob("*.py"), *(ROOT / "benchmarks").glob("*.py")]
    assert max(Counter(path.name for path in modules).values()) == 1


def test_the_readme_names_every_script_and_every_script_that_is_named_is_there():
    """In documents and in the source; the changelog names those of its time."""
    text = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    scripts = [path.name for path in (ROOT / "benchmarks").glob("*.py") if "\ndef main(" in path.read_text()]
    assert len(scripts) >= 9
    assert [name for name in scripts if name not in text] == []
    places = [*ROOT.glob("docs/*.md"), *ROOT.glob("*.md"), *ROOT.glob("src/**/*.py"), ROOT / "Makefile"]
    named = {
        (path.name, name)
        for path in places
        if path.name != "CHANGELOG.md"
        for name in re.findall(r"benchmarks/([\w/]+\.(?:py|md))", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 5
    assert [(path, name) for path, name in sorted(named) if not (ROOT / "benchmarks" / name).exists()] == []


def test_every_ablation_that_settings_name_is_measured():
    text = " ".join((ROOT / "src" / "rpil" / "inference" / "settings.py").read_text(encoding="utf-8").split())
    groups = re.findall(r"ablations\.py \(((?:\"[^\"]+\"(?:, )?)+)\)", text)
    quoted = [name for group in groups for name in group.split('"')[1::2]]
    assert len(quoted) > 6
    assert [name for name in quoted if not any(rule.startswith(name) for rule in ablations.RULES)] == []
