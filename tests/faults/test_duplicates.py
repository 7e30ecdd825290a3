"""Demonstrations that are the same, or nearly, name the earlier one."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.data.demonstrations import Demonstrations
from rpil.faults import settings
from rpil.faults.checking import check
from rpil.faults.whole_rules import near_limit, nearest_others

CLEAN = recording()
M = 5  # the demonstration that is copied


@pytest.mark.parametrize(
    ("noise", "words", "expected"),
    [
        (0.0, f"it is the same as demonstration {M}", (0.0, 0.0, 1e3)),
        (1e-3, f"it is nearly the same as demonstration {M}", (0.00370274, 1.688922, 456.1272)),
    ],
)
def test_copies_are_found_and_named(noise, words, expected):
    rng = np.random.default_rng(0)
    again = tuple(values + noise * rng.normal(size=values.shape) for values in CLEAN[M])
    (found,) = check(demonstrations([*CLEAN, again])).findings
    assert (found.rule, found.id, found.sentence) == ("duplicate", len(CLEAN), words)
    assert (found.first, found.last, found.column) == (0, len(CLEAN[M][0]) - 1, "")
    assert (found.value, found.threshold, found.severity) == pytest.approx(expected, rel=1e-4)


def test_each_copy_names_the_first():
    first, second = recording(2)
    found = check(demonstrations([first, second, first, first])).findings
    assert [(f.rule, f.id, f.sentence[-1]) for f in found] == [("duplicate", 2, "0"), ("duplicate", 3, "0")]


@pytest.mark.parametrize(("least", "counts"), [(7, {"duplicate": 1}), (8, {})])
def test_few_demonstrations_are_only_compared_exactly(least, counts, monkeypatch):
    near = CLEAN[0][0] + 1e-6, CLEAN[0][1]
    monkeypatch.setattr(settings, "FEWEST_DEMONSTRATIONS", least)
    assert check(demonstrations([*CLEAN[:6], near])).counts == counts


@pytest.mark.parametrize(("n_steps", "n_found"), [(3, 0), (49, 0), (50, 9)])
def test_short_equal_demonstrations_of_codes_are_no_duplicates(n_steps, n_found):
    moves = np.arange(n_steps)[:, None] % 3.0, np.arange(n_steps) % 2
    assert check(Demonstrations.from_episodes([moves] * 10)).counts.get("duplicate", 0) == n_found


def test_nearest_others_are_those_of_all_pairs(monkeypatch):
    monkeypatch.setattr("rpil.faults.settings.NEIGHBOUR_ROWS", 7)
    points = np.random.default_rng(0).normal(size=(40, 3))
    every = np.linalg.norm(points[:, None] - points, axis=2) + np.diag(np.full(40, np.inf))
    distance, nearest = nearest_others(points)
    np.testing.assert_array_equal(nearest, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1))


def test_so_few_independent_points_lie_below_the_limit(monkeypatch):
    monkeypatch.setattr(settings, "NEAR_SHARE", 0.05)
    monkeypatch.setattr(settings, "NEAR_DUPLICATE", (0.0, 1.0))
    points = np.random.default_rng(0).normal(size=(2000, 2))
    distance, _ = nearest_others(np.round(points, 6))
    limit = near_limit(distance)
    assert (distance < limit).mean() == pytest.approx(0.05, abs=0.03)
    assert near_limit(1e-3 * distance) == pytest.approx(1e-3 * limit)
    assert near_limit(np.ones(9)) == near_limit(np.zeros(9)) == 0.0
    monkeypatch.setattr(settings, "NEAR_DUPLICATE", (0.3, 0.5))
    low, high = (np.quantile(distance, 0.5, method="lower") * share for share in (0.3, 0.5))
    assert low <= near_limit(distance) <= high
