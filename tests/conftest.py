"""What several files of tests share."""

import signal
from pathlib import Path

import pytest

import typecheck
from browser import browsing

typecheck.install()

TESTS = Path(__file__).parent

SLOW_FILES = {
    "cli/test_commands.py",
    "cli/test_demo.py",
    "cli/test_main.py",
    "data/test_archive.py",
    "estimators/test_continuous_actions.py",
    "estimators/test_passes.py",
    "estimators/test_persistence.py",
    "estimators/test_pipeline.py",
    "estimators/test_reweight.py",
    "estimators/test_rment.py",
    "estimators/test_rpil.py",
    "policies/test_skorch.py",
    "scale/test_dask.py",
    "scale/test_disk.py",
    "test_golden.py",
}
"""Files in which most tests take more than a second; a slow test of another file has the marker `slow` itself."""


def pytest_collection_modifyitems(items):
    """Mark the tests of `SLOW_FILES`."""
    for item in items:
        if item.path.relative_to(TESTS).as_posix() in SLOW_FILES:
            item.add_marker(pytest.mark.slow)


def pytest_runtest_setup():
    """Types are checked in the first calls of each test."""
    typecheck.calls.clear()


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    """One browser for all tests of a process; each renews its page."""
    with browsing(tmp_path_factory.mktemp("chromium")) as browser:
        yield browser


@pytest.fixture(autouse=True)
def current_folder(tmp_path, monkeypatch):
    """A current folder for each test."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def interruptible():
    """Processes that a test starts obey SIGINT, also where this one ignores it, as after ``nohup`` or ``&``: who
    ignores a signal hands that on, and who has a handler does not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
