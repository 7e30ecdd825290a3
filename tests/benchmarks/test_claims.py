"""Claims without answers: the paper's draws by seed, and how often a demonstration with such a P is good."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from claims import PAPER, Job, audited, good_by_proba, of_paper
from rpil.audit.words import WORDS

RESULTS = Path(__file__).parents[2] / "docs" / "results.md"


def draw(env, kind, seed):
    """The number of words of one draw of a cell of the paper, and those that are wrong: (typical, unlike)."""
    row = audited(Job("paper", f"{env} {kind} {seed}", lambda: of_paper(env, kind, seed)))
    good, words = np.array(row["good"]), np.array(row["words"])
    return int((words != 0).sum()), int(((words > 0) & (good == 0)).sum()), int(((words < 0) & (good == 1)).sum())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3, 7])
@pytest.mark.parametrize(("env", "kind"), [cell for cell in PAPER if cell[0] != "LunarLander-v3"])
def test_every_demonstration_of_the_papers_cells_gets_the_right_word(env, kind, seed):
    assert draw(env, kind, seed) == (20, 0, 0)


# The draws that are known to fail: in each, one demonstration of the expert scores about as low as the bad ones do, in
# two of them lower than some; of "random 7" two random ones score nearly as high as the expert's. The numbers are
# those of today: 1 wrong word of 20, 1 of 20, 2 of 18, 1 of 20, 1 of 12 and 1 of 20.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed", "most_typical", "most_unlike"),
    [
        ("corrupted", 9, 0, 1),
        ("corrupted", 11, 0, 1),
        ("random", 7, 2, 0),
        ("random", 9, 0, 1),
        ("random", 11, 0, 1),
        ("random", 14, 0, 1),
    ],
)
def test_the_draws_that_are_known_to_fail_get_no_worse(kind, seed, most_typical, most_unlike):
    _, typical, unlike = draw("LunarLander-v3", kind, seed)
    assert typical <= most_typical  # bad ones called typical
    assert unlike <= most_unlike  # good ones called unlike


def row(proba, good, kind="recorded"):
    return {"kind": kind, "proba": proba, "good": good}


def test_good_ones_are_counted_by_p():
    rows = [
        row([0.995, 0.95, 0.9, 0.1, 0.0], [1, 1, 0, 0, 1]),
        row([1.0, 0.5, 0.05, 0.99], [0, -1, 0, 1]),
        row([1.0] * 9, [0] * 9, kind="half"),
    ]
    lines = good_by_proba(rows)
    assert "| 0 to 0.01 | 1 | 1 | 100% | 1 |" in lines
    assert "| 0.01 to 0.1 | 1 | 0 | 0% | 1 |" in lines
    assert "| 0.1 to 0.3 | 1 | 0 | 0% | 1 |" in lines
    assert "| 0.5 to 0.7 | 0 | 0 |  | 0 |" in lines  # middling quality is left out
    assert "| 0.9 to 0.99 | 2 | 1 | 50% | 1 |" in lines
    assert "| 0.99 to 1 | 3 | 2 | 67% | 2 |" in lines
    assert lines[-1] == (
        "In 2 recorded sets 60% of the demonstrations with P(typical) of .9 or more were good, 33% of those with .1 or "
        "less, and 50% of all."
    )
    assert good_by_proba(rows[2:]) == []


def test_what_an_audit_says_of_p_is_in_the_results():
    sentence = WORDS["none"].experience.removesuffix(" (docs/results.md).")
    assert sentence.startswith("In 29 recorded sets")
    assert [words.experience for anchor, words in WORDS.items() if anchor != "none"] == ["", ""]
    assert sentence in RESULTS.read_text(encoding="utf-8")
