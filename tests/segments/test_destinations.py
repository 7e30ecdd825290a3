"""Progress: the densities by brute force, and what needs others."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.segments.find import near, progress
from rpil.segments.settings import SegmentSettings

SETTINGS = SegmentSettings()


def acts(n=60, seed=0):
    rng = np.random.default_rng(seed)
    demonstration = np.sort(rng.integers(0, 20, n))
    return rng.uniform(size=(n, 3)), rng.uniform(size=(n, 3)), rng.random((n, 3)) < 0.6, demonstration


@pytest.mark.parametrize("seed", range(3))
def test_near_counts_values_of_others(seed):
    after, before, _, demonstration = acts(seed=seed)
    at, values = after[:, 0], before[:, 0]
    others = demonstration[:, None] != demonstration
    assert np.array_equal(
        near(at, values, demonstration, 0.1), (others & (np.abs(at[:, None] - values) <= 0.1)).sum(axis=1)
    )


def test_near_never_counts_less_than_none_on_a_grid():
    values = np.repeat(np.arange(8) * 0.03, 4)  # distances that equal the width but for rounding
    assert near(values, values, np.zeros(len(values), dtype=int), 0.03).tolist() == [0] * len(values)


def test_progress_by_brute_force():
    after, before, moved, demonstration = acts()
    found = progress(after, before, moved, demonstration, SETTINGS)
    for k in range(len(after)):
        ratios = []
        for c in np.flatnonzero(moved[k]):
            others = moved[:, c] & (demonstration != demonstration[k])
            f, g = ((np.abs(x[others, c] - after[k, c]) <= SETTINGS.near).sum() for x in (after, before))
            ratios.append(np.log((f + 2 * SETTINGS.near) / (g + 2 * SETTINGS.near)))
        assert found[k] == pytest.approx(np.mean(ratios)) if ratios else np.isnan(found[k])


def test_progress_of_what_few_others_move_is_unknown():
    after, before, moved, demonstration = acts()
    moved[:, 2] = False
    moved[: SETTINGS.least_acts, 2] = True
    demonstration = np.arange(len(after))
    alone = moved & (np.arange(3) == 2)
    assert np.isnan(progress(after, before, alone, demonstration, SETTINGS)).all()
    alone[SETTINGS.least_acts, 2] = True
    assert np.isfinite(progress(after, before, alone, demonstration, SETTINGS)[: SETTINGS.least_acts + 1]).all()


def test_a_place_where_others_leave_things_is_better_than_any_other():
    rng = np.random.default_rng(1)
    before, after = rng.uniform(size=(30, 1)), np.full((30, 1), 0.8)
    after[3] = 0.2
    found = progress(after, before, np.ones((30, 1), dtype=bool), np.arange(30), SETTINGS)
    assert found.argmin() == 3
    assert found[3] < 0 < np.median(found)
