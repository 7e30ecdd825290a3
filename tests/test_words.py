"""Docstrings and commit subjects in plain words; `tools/lint_words.py` is called by `make lint`."""

import runpy
from pathlib import Path

import pytest

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "lint_words.py"))


@pytest.mark.parametrize(
    "source",
    [
        '"""What is left."""', 'class A:\n    """Those that stay."""', 'def f():\n    """\n    Of a step."""',
        'LIMIT = 3\n"""That which is allowed."""', 'class A:\n    width: int\n    """Of a column."""',
    ],
)  # fmt: skip
def test_a_riddle_is_seen(tmp_path, source):
    (tmp_path / "module.py").write_text(source)
    assert len(TOOL["riddles"](tmp_path)) == 1


def test_no_docstring_begins_with_a_riddle(tmp_path):
    assert TOOL["riddles"]() == []
    source = '"""Offsets of steps."""\nx = "What is text"\n\n\ndef f():\n    """Thatch."""\n'
    (tmp_path / "module.py").write_text(source)
    assert TOOL["riddles"](tmp_path) == []


def test_commit_subjects_since_the_lint_are_short_imperatives():
    faults = {line: TOOL["subject_faults"](line.partition(" ")[2]) for line in TOOL["subjects"]()}
    assert {line: found for line, found in faults.items() if found} == {}


@pytest.mark.parametrize(
    ("subject", "n"),
    [
        ("Fix endless seek in review videos", 0), ("Test outputs and extensions beside their module", 0),
        ("Merge branch 'x' that nobody has named in the imperative and that is far too long", 0),
        ("Films that are moved before they play do not seek for ever, and rest where they end", 2),
        ("Fixed a crash", 1), ("Adding a test", 1), ("The page shows what it prints", 1), ("fix a crash.", 1),
        ("Process a seed", 0),
    ],
)  # fmt: skip
def test_a_subject_that_is_no_imperative_is_seen(subject, n):
    assert len(TOOL["subject_faults"](subject)) == n
