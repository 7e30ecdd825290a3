"""Every example runs, and its last line reports enough right actions."""

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


@pytest.mark.slow
@pytest.mark.parametrize("name", LEAST)
def test_example(name):
    pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")
    run = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / name],
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert float(re.findall(r"0\.\d+", run.stdout)[-1]) > LEAST[name]


def test_every_example_is_run():
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(LEAST)
