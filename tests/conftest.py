"""What several files of tests share."""

from __future__ import annotations

import pytest
from jaxtyping import install_import_hook

from typecheck import ROOMS

install_import_hook(ROOMS, "typecheck.check")  # before anything of rpil is imported


@pytest.fixture
def small(monkeypatch):
    """Hundreds of steps fill a block."""
    monkeypatch.setattr("rpil.data.demonstrations.BLOCK_STEPS", 700)
