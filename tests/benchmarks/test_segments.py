"""The benchmark of segments: its measures by brute force, and its quick run."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import segments
from ocbench_episodes import EPISODES
from rpil.segments.ranges import Segments

OCBENCH = Path(os.environ.get("RPIL_OCBENCH", "../shared/data/ocbench"))


def test_auroc_counts_pairs():
    rng = np.random.default_rng(0)
    score, bad = rng.integers(0, 5, 40).astype(float), rng.random(40) < 0.3
    pairs = score[bad][:, None] - score[~bad]
    assert segments.auroc(score, bad) == pytest.approx(((pairs < 0) + (pairs == 0) / 2).mean())
    assert np.isnan(segments.auroc(score, np.zeros(40, dtype=bool)))


def test_rows_have_the_score_of_their_segment():
    start, end, score = np.array([0, 3, 5]), np.array([3, 5, 6]), np.array([1.0, np.nan, 3.0])
    found = Segments(np.zeros(3, dtype=int), start, end, np.zeros(3, dtype=np.int8), score, [""] * 3)
    assert segments.of_rows(found).tolist() == [1, 1, 1, 2, 2, 3]


@pytest.mark.slow
def test_quick_run_finds_planted_acts_and_names_nobody_else(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert segments.main(["--quick", "--demonstrations", "20", "--json", str(out)]) == 0
    rows = json.loads(out.read_text())["rows"]
    assert all(row["rows"] >= 0.9 for row in rows if row["bad"])
    clean = [row for row in rows if not row["bad"]]
    assert sum(row["named"] for row in clean) <= 0.01 * sum(row["segments"] for row in clean)
    assert "| wrong place | 1.000 |" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.skipif(not any(OCBENCH.glob("block_*.npz")), reason=f"no episodes in {OCBENCH.name}; see ocbench_episodes")
def test_quick_run_on_ocbench():
    rows = list(segments.of_ocbench(OCBENCH, range(1), 1))
    assert all(row["segments"] > EPISODES for row in rows)
    assert np.mean([row["rows"] for row in rows]) >= 0.75
