"""The benchmark of segments: its measures by brute force, and its quick run."""

import json

import numpy as np
import pytest

import segments
from rpil.segments.ranges import Segments


def test_auroc_counts_pairs():
    rng = np.random.default_rng(0)
    score, bad = rng.integers(0, 5, 40).astype(float), rng.random(40) < 0.3
    pairs = score[bad][:, None] - score[~bad]
    assert segments.auroc(score, bad) == pytest.approx(((pairs < 0) + (pairs == 0) / 2).mean())
    assert np.isnan(segments.auroc(score, np.zeros(40, dtype=bool)))


def test_shortfall_is_the_sum_below_the_median():
    score = np.array([1.0, -2.0, np.nan, -1.0, 3.0])  # the median of the known ones is 0
    found = Segments(*[np.array([0, 0, 1, 1, 1])] * 4, score, [""] * 5)
    assert segments.shortfall(found, 3).tolist() == [-2.0, -1.0, 0.0]


@pytest.mark.slow
def test_quick_run_finds_planted_acts_and_names_nobody_else(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert segments.main(["--quick", "--demonstrations", "20", "--json", str(out)]) == 0
    rows = json.loads(out.read_text())["rows"]
    assert all(row["rows"] >= 0.9 for row in rows if row["bad"])
    clean = [row for row in rows if not row["bad"]]
    assert sum(row["named"] for row in clean) <= 0.01 * sum(row["segments"] for row in clean)
    assert "| wrong place | 1.000 |" in capsys.readouterr().out
