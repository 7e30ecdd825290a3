"""Claims without answers: the paper's draws by seed, and how words are counted."""

from __future__ import annotations

import numpy as np
import pytest

import claims
from claims import Job, audited, beside_0_3, plain_cells, report
from rivals import judge_of_0_3
from worlds import plain
from worlds.recorded import CHANGES
from worlds.simulated import PAPER, of_paper


@pytest.mark.slow
@pytest.mark.parametrize(("env", "kind"), [cell for cell in PAPER if cell[0] == "Acrobot-v1"])
def test_the_bad_ones_of_the_papers_cells_are_outliers_and_no_other_is(env, kind):
    """Those of Mountain Car are in the quick run of tests/benchmarks/test_scripts.py."""
    row = audited(Job("paper", f"{env} {kind} 0", lambda: of_paper(env, kind, 0)))
    assert row["verdicts"] == [0 if good else -1 for good in row["good"]]
    assert len(row["good"]) == 20


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


def test_cells_of_plain_worlds_in_which_nobody_is_named_are_counted():
    good = [1] * 8 + [0] * 2
    rows = [
        told("plain", "size 10, a", good, [0] * 9 + [-1]),
        told("plain", "b", good, [0] * 10),
        told("plain", "c", good, [-1] * 9 + [0], n_steps=9),
        told("plain", "d", good, [0] * 10, log_odds=[0.0] * 10),
    ]
    assert plain_cells(rows) == [
        "In plain worlds with a right ranking and 2 to 36 % bad demonstrations, the audit names nobody in 1 of 2 cells "
        "(b). It names 8 of 32 good demonstrations, and 1 of 2 bad ones in worlds of several sizes."
    ]


def test_the_ranking_is_compared_with_that_of_0_3(monkeypatch):
    before = judge_of_0_3()
    names = {f"plain: {name}" for name, _ in plain.cells()}
    assert names <= {*before}
    assert len(before["plain: share 0.2, reach"]) == 100
    monkeypatch.setattr(claims, "judge_of_0_3", lambda: {"recorded: a": np.array([2.0, 1.0, 0.0])})
    for log_odds, text in (([2, 1, 0], "by more than 0.01 in 0 and higher in 0."), ([0, 2, 1], "in 1 (a 1.000 to")):
        assert text in beside_0_3([told("recorded", "a", [1, 1, 0], [0, 0, 0], log_odds=log_odds)])[0]
    assert beside_0_3([told("recorded", "b", [1, 0], [0, 0])]) == []
