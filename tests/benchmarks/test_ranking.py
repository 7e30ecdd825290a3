"""The benchmark of rankings."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ranking


def test_quick(tmp_path, capsys):
    out = tmp_path / "ranking.json"
    assert ranking.main(["--quick", "--json", str(out)]) == 0
    assert "pendulum: 0." in capsys.readouterr().out
    found = json.loads(out.read_text())
    assert 0 <= found["pendulum"]["0"] <= 1  # one draw says little: the mean of twenty is about .65
    assert set(found["point mass"]) == {"stuck, continuous", "stuck, discrete"}


def test_auroc_by_hand():
    log_odds = np.array([3.0, 1.0, 1.0, 0.0])
    assert ranking.auroc(log_odds, np.array([1, 1, 0, 0])) == pytest.approx((2 + 0.5 + 1) / 4)
