"""The acceptance script runs, and what it writes is true on the smallest cells."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "acceptance.py"


def test_quick_acceptance(tmp_path, capsys, monkeypatch):
    monkeypatch.syspath_prepend(SCRIPT.parent)
    main = runpy.run_path(str(SCRIPT))["main"]
    path = tmp_path / "acceptance.json"
    main(["--quick", "--json", str(path)])
    printed = capsys.readouterr().out
    found = json.loads(path.read_text())
    assert found["provenance"]["seeds"] == "1000 to 1001"
    cells = {cell["kind"]: cell for cell in found["cells"]}
    assert set(cells) == {"corrupted", "random", "noisy", "window", "shift"}
    assert all(kind in printed for kind in cells)
    assert len(found["draws"]) == 2 * len(cells)
    for kind in ("corrupted", "random"):
        assert cells[kind]["wrong"] == 0
        assert cells[kind]["behind"] <= cells[kind]["oracle"]["se"]
        assert cells[kind]["rpil"]["mean"] > cells[kind]["trust_all"]["mean"]
        assert cells[kind]["oracle"] == cells["random"]["oracle"]  # the good demonstrations do not depend on the kind
    assert cells["noisy"]["auroc"] == pytest.approx(1.0)
    assert cells["window"]["auroc"] == pytest.approx(1.0)
    assert (cells["shift"]["ambiguous"], cells["shift"]["wrong_labelled"]) == (2, 0)
