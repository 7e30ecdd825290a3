"""Segments: they tile demonstrations, and planted acts are found and named; where nothing is planted nobody is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpil import Demonstrations
from rpil.segments.find import (
    Acts,
    MovedColumns,
    SegmentSettings,
    find_acts,
    find_segments,
    near,
    progress,
    reasons_of,
    scores,
    shortfall,
)
from rpil.segments.ranges import KINDS
from worlds.tidying import CLEAN, tidied

N, SETTINGS = 20, SegmentSettings()


def share_of(rows, made, found):
    """The share of each segment in which `rows` holds."""
    first = made.offsets[found.demonstration] + found.start
    return np.array([rows[a:b].mean() for a, b in zip(first, first + found.end - found.start, strict=True)])


def found_in(family, n=N, **given):
    made = tidied(family, n, 0)
    if family == "takeover":
        given["takeover"] = made.takeover
    found = find_segments(made.demonstrations, **given)
    first = made.demonstrations.offsets[found.demonstration]  # segments tile every demonstration
    assert np.array_equal(first + found.end, np.append(first[1:] + found.start[1:], made.demonstrations.n_steps))
    assert (found.end > found.start).all()
    assert len(found.reason) == len(found.kind) == len(found.score)
    return made, found, share_of(made.bad, made.demonstrations, found)


@pytest.mark.parametrize("family", ["wrong place", "undone"])
def test_wrong_acts_are_lowest_and_named(family):
    _, found, share = found_in(family, 40)
    bad = share > 0.5
    assert found.score[bad].max() < found.score[~bad].min()
    named = np.array([reason != "" for reason in found.reason])
    assert named[bad].mean() > 0.9
    assert named[~bad].sum() <= 1
    if family == "undone":
        assert (found.kind[bad] == KINDS.index("back")).all()
        assert any("undoes it" in reason for reason in found.reason)


def test_a_try_beside_the_thing_is_named_unless_many_do_it_again():
    made, found, share = found_in("retry")
    is_bad = (share > 0.5) & (found.kind != KINDS.index("idle"))
    said = [reason for reason, bad in zip(found.reason, is_bad, strict=True) if bad]
    assert set(said) == {"moves nothing, and the next act does it again"}
    all_of_them = find_segments(made.demonstrations, settings=SegmentSettings(few=0.1))
    assert not any("again" in reason for reason in all_of_them.reason)


def test_the_act_before_a_takeover_is_named():
    made, found, share = found_in("takeover")
    said = {reason for reason, bad in zip(found.reason, share > 0.5, strict=True) if bad}
    assert said == {"a person takes over after it"}
    person = share_of(made.takeover, made.demonstrations, found) > 0.5
    assert np.array_equal(person, found.kind == KINDS.index("takeover"))


@pytest.mark.parametrize("family", CLEAN)
def test_nobody_is_named_where_nothing_is_planted(family):
    assert {*found_in(family, 40)[1].reason} == {""}


def test_pauses_are_idle_and_leave_the_score_of_the_act_around_them():
    made, found, _ = found_in("pause")
    idle = found.kind == KINDS.index("idle")
    rows = np.repeat(idle, found.end - found.start)
    assert rows[made.pause].mean() > 0.9
    assert rows[~made.pause].mean() < 0.01
    assert np.isnan(found.score[idle]).all()
    k = np.flatnonzero(idle)[0]
    assert found.score[k - 1] == found.score[k + 1]


@pytest.mark.parametrize("actions", [np.zeros((12, 1)), np.arange(12) % 3])
@pytest.mark.parametrize("n", [1, 3])
def test_sets_without_acts(n, actions):
    still = Demonstrations.from_episodes([(np.ones((12, 2)), actions)] * n)
    found = find_segments(still, labels=[(0, 0, 12, True)])
    assert (found.demonstration.max(), found.end.max()) == (n - 1, 12)
    assert not any(found.reason)
    assert np.isnan(found.score).all()
    assert shortfall(found, n).tolist() == [0.0] * n


def test_shortfall_is_the_sum_below_the_median():
    _, found, _ = found_in("wrong place")
    middle = np.nanmedian(found.score)
    own = [found.score[found.demonstration == m] for m in range(N)]
    assert np.allclose(shortfall(found, N), [np.minimum(score - middle, 0).sum() for score in own])
    assert shortfall(replace(found, score=np.full(len(found.score), np.nan)), N).tolist() == [0.0] * N


def acts(n=60, seed=0):
    rng = np.random.default_rng(seed)
    demonstration = np.sort(rng.integers(0, 20, n))
    return rng.uniform(size=(n, 3)), rng.uniform(size=(n, 3)), rng.random((n, 3)) < 0.6, demonstration


def test_scores_and_reasons_of_acts_by_hand():
    of_none, number = np.zeros(5, dtype=bool), np.arange(5)
    known = np.array([0.0, 1.0, 2.0, np.nan, -9.0])
    made = Acts(number, number * 0, number * 0, number, known, number == 1, (number == 2) | (number == 3))
    found = scores(made, SETTINGS)
    assert found.tolist() == [0.0, 0.0, -1.0, -3.0, -9.0]
    taken, low = "a person takes over after it", "moves 4 columns and ends no nearer to where others end"
    assert reasons_of(made, found, SETTINGS) == ["", "", taken, taken, low]
    still = replace(made, progress=number * 0.0, again=of_none, taken=of_none)
    assert reasons_of(still, np.full(5, -9.0), SETTINGS) == [""] * 5  # no value lies below 0


def test_an_act_ends_in_its_last_row_and_the_next_demonstration_undoes_nothing():
    """One column moves in the last row alone, there and in the next demonstration back."""
    values = np.concatenate([[0.0] * 9, [1.0], [1.0] * 9, [0.0]] * 2)[:, None]
    moves = np.arange(40)[:, None] % 10 > 7
    columns = MovedColumns(values, np.arange(0, 41, 10), 3, moves, np.zeros(1, dtype=bool))
    found = find_acts(columns, np.zeros(40, dtype=bool), SETTINGS)
    assert found.n_moved.tolist() == [1] * 4
    assert found.kind.tolist() == [KINDS.index("act")] * 4


def test_near_counts_values_of_others_and_never_less_than_none():
    for seed in range(3):
        after, before, _, demonstration = acts(seed=seed)
        at, values = after[:, 0], before[:, 0]
        counted = (demonstration[:, None] != demonstration) & (np.abs(at[:, None] - values) <= 0.1)
        assert np.array_equal(near(at, values, demonstration, 0.1), counted.sum(axis=1))
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
