"""What a judge is compared with: the short one (`short_judge.py`), and that of 0.3 as it was, by its rankings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from worlds import Array

FROZEN = Path(__file__).with_name("judge_of_0_3.npz")


def judge_of_0_3() -> dict[str, Array]:
    """The log-odds of each set of `claims.py`, named "kind: name", by the judge at commit 71e0fb77."""
    with np.load(FROZEN, allow_pickle=False) as stored:
        return dict(zip(stored["names"].tolist(), np.split(stored["log_odds"], stored["ends"][:-1]), strict=True))
