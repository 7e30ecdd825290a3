"""The section on demonstrators tells what was reached and what was missed."""

from __future__ import annotations


def test_demonstrators():
    from results import results

    def row(steps: int | None, without: float, knowing: float) -> dict:
        found = {"set": "car", "people": 3, "steps": steps, "without": without, "knowing": knowing}
        ends = {"without_ci95": [0.5, 0.9], "knowing_ci95": None}
        return found | ends | {"gain": knowing - without, "gain_se": None if steps is None else 0.02}

    found = {"adversary": "auto", "steps": 10, "draws": 3, "rows": [row(None, 0.9, 0.89), row(10, 0.6, 0.8)]}
    page = results({"demonstrators": found})
    assert "Cut to 10 steps: 0.600 without, 0.800 with" in page
    assert "car, all steps: -0.010." in page
    assert "| car | 3 | 10 | 0.600 (0.50 to 0.90) | 0.800 | +0.200 ± 0.020 |" in page
