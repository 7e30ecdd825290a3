"""What several files of tests share."""

from __future__ import annotations

import pytest

import typecheck

typecheck.install()


SLOW_FILES = {
    "test_commands.py",
    "test_continuous_actions.py",
    "test_dask.py",
    "test_demo.py",
    "test_fit_from_disk.py",
    "test_fitted_audits.py",
    "test_golden.py",
    "test_judge.py",
    "test_main.py",
    "test_passes.py",
    "test_reweight.py",
    "test_rment.py",
    "test_rpil.py",
    "test_streaming.py",
    "test_torch.py",
}
"""Files in which most tests take more than a second; a slow test of another file has the marker `slow` itself."""


def pytest_collection_modifyitems(items):
    """Mark the tests of `SLOW_FILES`."""
    for item in items:
        if item.path.name in SLOW_FILES:
            item.add_marker(pytest.mark.slow)
