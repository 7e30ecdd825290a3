"""Segments tile demonstrations; planted acts are found and named, and nobody else; cuts; and what marks teach."""

from dataclasses import replace

import numpy as np
import pytest

from rpil import Demonstrations
from rpil.segments import find
from rpil.segments.ranges import KINDS, Segments
from worlds.tidying import CLEAN, tidied

N, SETTINGS = 20, find.SegmentSettings()


def share_of(rows, made, found):
    """The share of each segment in which `rows` holds."""
    first = made.offsets[found.demonstration] + found.start
    return np.array([rows[a:b].mean() for a, b in zip(first, first + found.end - found.start, strict=True)])


def found_in(family, n=N, **given):
    made = tidied(family, n, 0)
    if family == "takeover":
        given["takeover"] = made.takeover
    found = find.find_segments(made.demonstrations, **given)
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
    rate = len({*found.demonstration[is_bad].tolist()}) / N
    for few, is_named in ((0.99 * rate, False), (rate, True)):
        again = find.find_segments(made.demonstrations, settings=find.SegmentSettings(few=few))
        assert any("again" in reason for reason in again.reason) == is_named


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
    found = find.find_segments(still, labels=[(0, 0, 12, True)])
    assert (found.demonstration.max(), found.end.max()) == (n - 1, 12)
    assert not any(found.reason)
    assert np.isnan(found.score).all()


def acts(n=60, seed=0):
    rng = np.random.default_rng(seed)
    demonstration = np.sort(rng.integers(0, 20, n))
    return rng.uniform(size=(n, 3)), rng.uniform(size=(n, 3)), rng.random((n, 3)) < 0.6, demonstration


def test_scores_and_reasons_of_acts_by_hand():
    of_none, number = np.zeros(5, dtype=bool), np.arange(5)
    known = np.array([0.0, 1.0, 2.0, np.nan, -9.0])
    made = find.Acts(number, number * 0, number * 0, number, known, number == 1, (number == 2) | (number == 3))
    found = find.scores(made, SETTINGS)
    assert found.tolist() == [0.0, 0.0, -1.0, -3.0, -9.0]
    taken, low = "a person takes over after it", "moves 4 columns and ends no nearer to where others end"
    assert find.reasons_of(made, found, SETTINGS) == ["", "", taken, taken, low]
    still = replace(made, progress=number * 0.0, again=of_none, taken=of_none)
    assert find.reasons_of(still, np.full(5, -9.0), SETTINGS) == [""] * 5  # no value lies below 0


def test_an_act_ends_in_its_last_row_and_the_next_demonstration_undoes_nothing():
    """One column moves in the last row alone, there and in the next demonstration back."""
    values = np.concatenate([[0.0] * 9, [1.0], [1.0] * 9, [0.0]] * 2)[:, None]
    moves = np.arange(40)[:, None] % 10 > 7
    columns = find.MovedColumns(values, np.arange(0, 41, 10), 3, moves, np.zeros(1, dtype=bool))
    found = find.find_acts(columns, np.zeros(40, dtype=bool), SETTINGS)
    assert found.n_moved.tolist() == [1] * 4
    assert found.kind.tolist() == [KINDS.index("act")] * 4
    found = find.find_acts(columns, np.arange(40) // 2 == 1, find.SegmentSettings(least_acts=1))
    assert found.n_moved.tolist() == [0, 0, 1, 1, 1, 1]
    assert found.progress[0] == found.progress[1] == found.progress[2]  # which is that of the next that moves anything


def test_near_counts_values_of_others_and_never_less_than_none():
    for seed, most in enumerate((20, 20, 2)):
        after, before, _, demonstration = acts(seed=seed)
        at, values, demonstration = after[:, 0], before[:, 0], demonstration * most // 20
        counted = (demonstration[:, None] != demonstration) & (np.abs(at[:, None] - values) <= 0.1)
        assert np.array_equal(find.near(at, values, demonstration, 0.1), counted.sum(axis=1))
    values = np.repeat(np.arange(8) * 0.03, 4)  # distances that equal the width but for rounding
    assert find.near(values, values, np.zeros(len(values), dtype=int), 0.03).tolist() == [0] * len(values)


def test_progress_by_brute_force():
    after, before, moved, demonstration = acts()
    found = find.progress(after, before, moved, demonstration, SETTINGS)
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
    assert np.isnan(find.progress(after, before, alone, demonstration, SETTINGS)).all()
    alone[SETTINGS.least_acts, 2] = True
    assert np.isfinite(find.progress(after, before, alone, demonstration, SETTINGS)[: SETTINGS.least_acts + 1]).all()


@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_the_hand_is_the_grip_and_things_are_what_it_moves(noise):
    made = tidied("nobody", 20, 0, noise).demonstrations
    found = find.MovedColumns.of(made, SETTINGS)
    closed, has_hand = found.closed(SETTINGS)
    assert has_hand
    grip = made.observations[:, 2] > 0.5
    assert (closed == grip).mean() > 0.9
    assert np.flatnonzero(found.things(closed, SETTINGS)).tolist() == [3, 4, 5, 6]


def test_a_cut_lies_where_the_hand_turns():
    made = tidied("wrong place", 20, 0)
    found = find.MovedColumns.of(made.demonstrations, SETTINGS)
    cuts = found.cuts(found.closed(SETTINGS)[0])
    offsets = made.demonstrations.offsets
    for begin in np.flatnonzero(np.diff(made.bad.astype(int)) != 0) + 1:
        if begin not in offsets:
            assert np.abs(cuts - begin).min() <= 4
    assert not np.isin(offsets, cuts).any()


def test_without_a_hand_acts_lie_between_rests():
    one = np.concatenate([np.linspace(0, 1, 40), np.full(30, 1.0), np.linspace(1, 2, 40)])
    made = Demonstrations.from_episodes([(one[:, None] + 0.1 * k, np.zeros((110, 1))) for k in range(3)])
    found = find.MovedColumns.of(made, SETTINGS)
    closed, has_hand = found.closed(SETTINGS)
    assert not has_hand
    cuts = found.cuts(closed)
    assert len(cuts) == 3
    assert ((cuts - made.offsets[:-1] >= 35) & (cuts - made.offsets[:-1] <= 75)).all()


def test_moves_are_differences_over_a_window_within_a_demonstration():
    rng = np.random.default_rng(0)
    episodes = [(rng.normal(scale=0.003, size=(n, 2)).cumsum(axis=0), [0, 1] * (n // 2)) for n in (300, 400, 500)]
    made = Demonstrations.from_episodes(episodes)
    found = find.MovedColumns.of(made, SETTINGS)
    assert found.values.shape == (1200, 2)  # classes of actions are no columns
    assert found.window == 10  # a fortieth of the median length
    for first, end in zip(made.offsets[:-1], made.offsets[1:], strict=True):
        for row in range(first, end):
            move = found.values[min(row + 5, end - 1)] - found.values[max(row - 5, first)]
            assert (found.moves[row] == (np.abs(move) > SETTINGS.least_move)).all()


def column(*values):
    """One column, whose three demonstrations are alike."""
    still = np.zeros((3 * len(values), 1), dtype=bool)
    offsets = np.arange(4) * len(values)
    return find.MovedColumns(np.tile(np.array(values), 3)[:, None], offsets, 3, still, np.zeros(1, dtype=bool))


def test_a_hand_is_near_its_home_and_returns():
    near = 0.45 * SETTINGS.level
    assert column(0.0, *[near] * 40, *[1.0] * 50, *[near] * 40).closed(SETTINGS)[1]
    assert not column(*[0.0] * 50, *[1.0] * 50).closed(SETTINGS)[1]  # home again in the next demonstration alone
    closed, has_hand = column(*[1.0] * 50, *[0.0] * 50, *[1.0] * 50).closed(SETTINGS)
    assert has_hand
    assert closed.tolist() == ([False] * 50 + [True] * 50 + [False] * 50) * 3
    for home, away in ((90, 10), (10, 90)):  # hardly ever away, or at home
        assert not column(*[0.0] * home, *[1.0] * away, 0.0).closed(SETTINGS)[1]


def test_things_move_in_a_larger_share_of_the_rows_of_a_closed_hand():
    closed = np.arange(100) < 10
    moves = np.stack([np.arange(100) % 10 < 1 + 4 * closed, np.zeros(100, dtype=bool)], axis=1)
    found = find.MovedColumns(np.zeros((100, 2)), np.array([0, 100]), 3, moves, np.zeros(2, dtype=bool))
    assert found.things(closed, SETTINGS).tolist() == [True, False]  # of which the second never moves


def test_a_cut_is_the_corner_of_the_way_between_two_acts():
    up = np.linspace(0, 1, 11)
    way = np.concatenate([np.stack([np.ones(11), up], axis=1), np.stack([1 - up, np.ones(11)], axis=1)[1:]])
    found = find.MovedColumns(way, np.array([0, 21]), 3, np.zeros((21, 2), dtype=bool), np.zeros(2, dtype=bool))
    closed = (np.arange(21) < 2) | (np.arange(21) > 18)
    assert found.cuts(closed).tolist() == [10]
    assert not len(found.cuts((np.arange(21) < 2) | (np.arange(21) > 3)))  # open for fewer rows than the window


def segments(n=40):
    start = np.tile([0, 10], n // 2)
    score = np.linspace(-2.0, 2.0, n)
    return Segments(np.arange(n) // 2, start, start + 10, np.zeros(n, dtype=np.int8), score, [""] * n)


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ((0, 0, 10, True), [1, 0]), ((0, 0, 10, False), [-1, 0]), ((0, 2, 20, True), [1, 1]),
        ((0, 12, 14, False), [0, -1]), ((0, 6, 13, True), [1, 0]), ((0, 5, 15, True), [1, 1]),
        ((0, 3, 4, True), [1, 0]), ((1, 0, 10, True), [0, 0]),
    ],
)  # fmt: skip
def test_a_label_marks_what_it_shares_half_with(label, expected):
    assert find.marked(segments(), [label])[:2].tolist() == expected


def test_one_side_changes_nothing_and_two_labels_make_probabilities():
    made = segments()
    assert find.taught(made, np.zeros((40, 1)), [(0, 0, 10, True), (3, 0, 10, True)], find.SegmentSettings()) is made
    of = np.zeros((40, 1)), [(0, 0, 10, False), (19, 10, 20, True)], find.SegmentSettings()
    found = find.taught(made, *of)
    assert ((found.score > 0) & (found.score < 1)).all()
    assert np.array_equal(np.argsort(found.score), np.argsort(made.score))
    far = 2 * made.score  # of what lies beyond 2 nats the rank alone counts
    near, farther = (find.taught(replace(made, score=np.where(abs(far) > 2, k * far, far)), *of) for k in (1, 3))
    assert np.array_equal(near.score, farther.score)


def test_labels_are_learned_from_facts_that_the_ranking_lacks():
    made, rng = segments(160), np.random.default_rng(0)
    fact = rng.permutation(np.arange(160.0))
    labels = [(k // 2, 10 * (k % 2), 10 * (k % 2) + 10, bool(fact[k] > 80)) for k in range(80)]
    found = find.taught(made, fact[:, None], labels, find.SegmentSettings())
    assert np.corrcoef(found.score[80:], fact[80:] > 80)[0, 1] > 0.75
    assert np.abs(np.corrcoef(made.score[80:], fact[80:] > 80)[0, 1]) < 0.3
    said = np.array([reason == "is like what was marked bad" for reason in found.reason])
    assert said.any()
    assert (fact[said] <= 80).all()
    assert not said[:80].any()


def test_step_scores_are_a_fact():
    made = tidied("nobody", 20, 0).demonstrations
    plain = find.find_segments(made)
    first = made.offsets[plain.demonstration] + plain.start
    bad = np.random.default_rng(0).random(len(first)) < 0.5
    ratio = np.repeat(np.where(bad, -1.0, 1.0), plain.end - plain.start)
    rows = zip(plain.demonstration, plain.start, plain.end, bad, strict=True)
    told = [(int(m), int(a), int(b), not is_bad) for m, a, b, is_bad in rows]
    found = find.find_segments(made, ratio, labels=told[:20])
    assert len(first) == len(found.score)
    below = found.score[20:][bad[20:], None] < found.score[20:][~bad[20:]]
    assert below.mean() > 0.9  # of pairs of a bad and a good one
