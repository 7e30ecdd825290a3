"""Reads the scores of others: a CSV file with a score for each demonstration, or a weight for each step."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .columns import Deed, best
from .peers.common import mean_of

if TYPE_CHECKING:
    from rpil import Demonstrations


def read(path: Path, data: Demonstrations) -> Deed:
    """The deed of a file with the columns id,score or id,step,score.

    Of scores the best 60 % are kept, as of the other columns; a score of a step is its weight, 0 or more, and the mean
    over a demonstration its score.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        names = rows.fieldnames or []
        if not {"id", "score"} <= set(names):
            raise SystemExit(f"{path}: it has the columns {', '.join(names)}; write id,score or id,step,score.")
        per_step = "step" in names
        values = {key_of(row, per_step, path, number): row["score"] for number, row in enumerate(rows, start=2)}
    wanted = [
        (str(name), step)
        for name, length in zip(data.ids, data.lengths.tolist(), strict=True)
        for step in (range(length) if per_step else [0])
    ]
    lacking = [key for key in wanted if key not in values]
    if lacking or len(values) > len(wanted):
        where = f"{lacking[0][0]!r}, step {lacking[0][1]}" if lacking else "others than those of this draw"
        raise SystemExit(f"{path}: {len(values)} scores, and {len(wanted)} are asked for; look at {where}.")
    try:
        score = np.array([float(values[key]) for key in wanted])
    except (TypeError, ValueError) as error:
        raise SystemExit(f"{path}: a score is no number ({error}); write numbers.") from error
    if not np.isfinite(score).all() or (per_step and (score < 0).any()):
        raise SystemExit(f"{path}: write finite scores, and of steps none below 0.")
    return Deed(mean_of(data, score), score) if per_step else Deed(score, best(score, data.lengths))


def key_of(row: dict[str, str], per_step: bool, path: Path, number: int) -> tuple[str, int]:
    try:
        return row["id"], int(row["step"]) if per_step else 0
    except (TypeError, ValueError) as error:
        raise SystemExit(f"{path}, line {number}: {row['step']!r} is no step; count them from 0.") from error
