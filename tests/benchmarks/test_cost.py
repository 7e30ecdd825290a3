"""The cost model: what it measures adds up, what it predicts follows, and its tables are those of docs/scale.md."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
import cost  # noqa: E402
from rpil import SampleSettings, Settings  # noqa: E402


@pytest.mark.slow
def test_it_measures_and_predicts():
    sample = SampleSettings(min_steps=1000, steps_per_coefficient=20, n_demonstrations=20, min_samples=4)
    found = cost.run(20_000, 3, 3, repetitions=1, with_dask=False, settings=Settings(sample=sample))
    measured = found["cost"]
    assert measured["passes"] > 1
    assert measured["judge_columns"] == 7  # three observations, folded, and the constant
    assert measured["n_columns"] == 4
    assert measured["product_flops"] == 4 * 4 * 3
    assert measured["kept_bytes"] == 3 * 4 + 8 + 7 * 4 + 4 * 4 + 16
    assert 3 * 4 <= measured["read_bytes"] < 3 * 4 + 8
    names = ("read_ns", "prepare_ns", "score_ns", "weigh_ns", "pass_ns", "product_ns", "sum_bytes")
    assert min(measured[name] for name in names) > 0
    few, many = (cost.predict(measured, 1e9, workers) for workers in (10, 100))
    assert few["memory_bytes"] == pytest.approx(10 * many["memory_bytes"])
    assert few["place_s"] == pytest.approx(10 * many["place_s"])
    assert few["weights_s"] == many["weights_s"] == 16.0
    assert "| 10^11 | 1,000 |" in cost.render(found)


def test_tables_replace_tables():
    text = (ROOT / "docs" / "scale.md").read_text()
    once = cost.splice(text, "new")
    assert cost.splice(once, "new") == once
    assert once.split(cost.MARKS[0])[0] == text.split(cost.MARKS[0])[0]
    assert "for each step |" in text
