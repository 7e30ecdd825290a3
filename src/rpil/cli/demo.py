"""``rpil demo``: the audit of real people, compared with a score that it did not see."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import as_file, files

import numpy as np
from scipy.stats import bootstrap, spearmanr

from rpil import formats
from rpil.data.files import StrPath
from rpil.estimators.within_tasks import audit
from rpil.numerics.types import Array, Float
from rpil.results.html.page import About, write_page

OVERCOOKED = "overcooked_cramped_room.npz"
"""File of the bundled data: observations and actions, and the truth, which is read for the comparison only."""


def run(path: StrPath, progress: Callable[[str], None]) -> str:
    """Audit the bundled people, and write the report to `path`; a sentence on the ranking and the truth."""
    with as_file(files("rpil.cli") / "bundled" / OVERCOOKED) as bundled:
        people = audit(formats.read(bundled), progress=progress)
        with np.load(bundled, allow_pickle=False) as arrays:
            is_good, quality = arrays["is_good"], arrays["episode_quality"]
    sides = people.log_odds[is_good == 1], people.log_odds[is_good == 0]
    interval = bootstrap(sides, auroc, method="percentile", random_state=np.random.default_rng(0))
    low, high = interval.confidence_interval
    sentence = (
        f"Overcooked, {len(people.ids)} real people: {people.finding}. Agreement of the ranking with a score that it "
        f"did not see: AUROC {auroc(*sides):.2f} (95 % interval {low:.2f} to {high:.2f}, the best third against the "
        f"worst), Spearman {spearmanr(people.log_odds, quality).statistic:.2f}."
    )
    write_page(path, people, About("Overcooked: real people", "cramped_room"), [("Compared with the truth", sentence)])
    return sentence


def auroc(good: Array, bad: Array, axis: int = -1) -> Float[Array, " *samples"]:
    """The share of pairs in which the good demonstration has the higher score, equal scores half; the last axis of
    `good` and `bad` is that of the demonstrations."""
    return np.asarray((0.5 + 0.5 * np.sign(good[..., :, None] - bad[..., None, :])).mean(axis=(-2, -1)))
