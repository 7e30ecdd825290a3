"""Errors of the user end with one sentence, exit code 2 and no other effect."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from command_line import G, npz, refused


def test_failed_write_keeps_old_files(monkeypatch):
    npz("data.npz")
    for name in ("w.csv", "policy"):
        Path(name).write_text("old")

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    data = "data.npz"
    refused("w.csv: it cannot be written .No space left", "audit", data, "--weights", "w.csv")
    refused("policy: it cannot be written .No space left", "fit", data, "-o", "policy")


def test_ids_with_control_characters_are_escaped():
    npz("data.npz", episode_ids=np.array([f"é\x1b{g}" for g in G]))
    command = [Path(sys.executable).parent / "rpil", "audit", "data.npz"]
    result = subprocess.run(command, capture_output=True, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert result.returncode == 0, result.stderr
    assert b"\x1b" not in result.stdout
