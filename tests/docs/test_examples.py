"""Every example runs, and its last line reports what it should: enough right actions, or the better policy."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
LEAST = {"plot_torch_loop.py": 0.88, "plot_weighted_sampler.py": 0.9}
"""Share of right actions on the last printed line."""

COMPARED = "compare_choices.py"

RUN = """
import runpy, sys
for path in sys.argv[1:]:
    runpy.run_path(path)
    print("--- end of an example")
"""


@pytest.mark.slow
def test_examples():
    """All in one process of their own, because torch is imported in seconds."""
    pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", RUN, *(EXAMPLES / name for name in LEAST)],
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    printed = run.stdout.split("--- end of an example\n")[:-1]
    for (name, least), text in zip(LEAST.items(), printed, strict=True):
        assert float(re.findall(r"0\.\d+", text)[-1]) > least, name


def test_every_example_is_run():
    assert {path.name for path in EXAMPLES.glob("*.py")} == {*LEAST, COMPARED}


@pytest.mark.slow
def test_the_example_of_a_comparison_says_that_choosing_was_better():
    pytest.importorskip("gymnasium", reason="gymnasium is not installed: pip install 'rpil[gym]'")
    run = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / COMPARED], capture_output=True, text=True, timeout=300, check=False
    )
    assert run.returncode == 0, run.stderr
    first, *_, last = run.stdout.splitlines()
    assert first == "kept 8 of 20 demonstrations, 8 of 8 good ones"
    assert re.fullmatch(r"kept is better than all by \d\.\d \+- \d\.\d over 5 seeds\.", last)
