"""What several files of tests share."""

from __future__ import annotations

import pytest
from jaxtyping import install_import_hook

from typecheck import ROOMS

install_import_hook(ROOMS, "typecheck.check")  # before anything of rpil is imported

from rpil.scale import fit as large  # noqa: E402


@pytest.fixture
def small(monkeypatch):
    """A world in which thousands of steps are many, and hundreds fill a block."""
    monkeypatch.setattr(large, "SAMPLE_STEPS", 600)
    monkeypatch.setattr(large, "STEPS_PER_COEFFICIENT", 20)
    monkeypatch.setattr(large, "SAMPLE_DEMONSTRATIONS", 20)
    monkeypatch.setattr(large, "TIMES", 4)
    monkeypatch.setattr("rpil.data.demonstrations.BLOCK_STEPS", 700)
