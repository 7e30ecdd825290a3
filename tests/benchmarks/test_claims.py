"""Claims without answers: how words are counted."""

from __future__ import annotations

from claims import report
from worlds.recorded import CHANGES


def told(kind, name, good, verdicts, apart=None, **more):
    found = {"kind": kind, "name": name, "good": good, "verdicts": verdicts, "apart": apart or [0] * len(good)}
    found |= {"log_odds": [float(value) for value in good], "finding": "outliers", "pair": [1, 0], "n_steps": 20}
    return found | {"first": [len(good) - 1], "ids": list(range(len(verdicts)))} | more


def test_words_are_counted_by_kind():
    of_changes = {change: [0, 0, -1, 0] for change in CHANGES} | {"seed 1": [0, 0, 0, -1], "all twice": [0] * 8}
    rows = [
        told("recorded", "right", [1, 1, 0, -1], [0, 0, -1, 0]),
        told("recorded", "wrong", [1, 1, 0, 0], [-1, 0, 0, 0], [0, 1, 1, 1]),
        *(
            told("changes", f"right: {name}", [1, 1, 0, 0] * (len(verdicts) // 4), verdicts)
            for name, verdicts in of_changes.items()
        ),
    ]
    lines = report(rows)
    assert "| as it is | 1 | 0 | 0 |" in lines
    assert "| seed 1 | 1 | 1 | 1 |" in lines
    assert "| all twice | 1 | 1 | 0 |" in lines
    assert "| recorded | 2 | 1, 1 | 2, 1 | 100% | 43% | 1 |" in lines
    asked = "The question names a good and a bad demonstration in 2 of 2 recorded sets. "
    assert f"{asked}In 0 sets it names one of middling quality." in lines
    assert "- wrong: AUROC 1.00, outliers, 1 outliers, 1 of them good." in lines
