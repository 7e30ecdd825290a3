"""What rules measure and compare, against loops over small random sets with ties, single steps and exact limits."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rpil.data.demonstrations import Block
from rpil.faults import settings
from rpil.faults.measured_columns import MeasuredColumns, MovingBlock
from rpil.faults.motion import RepeatedFrames
from rpil.faults.rule import Measurements
from rpil.faults.still import FrozenAction, FrozenSensor, HeldValue, NeverMoves, Saturation, idle_runs, resting_rows
from rpil.faults.tracking import Tracked
from rpil.faults.whole_rules import IdleEnd

LENGTHS = (40, 1, 2, 3, 33, 60, 21)
OFFSETS = np.cumsum([0, *LENGTHS])


def moving(values, n_states, offsets=OFFSETS, **more):
    """The block of columns (C, T), observations first, whose scales are 1/2, 1, 2 and so on."""
    c = len(values)
    given = {
        "scale": 2.0 ** (np.arange(c) - 1),
        "spread": np.ones(c),
        "moving": np.ones(c),
        "memory": np.ones(c),
    } | more
    columns = MeasuredColumns(tuple(f"c{k}" for k in range(c)), np.arange(c), np.arange(c) >= n_states, **given)
    block = Block(0, values[:n_states].T.copy(), values[n_states:].T.copy(), offsets)
    return MovingBlock.of(block, np.arange(len(offsets) - 1), columns)


def each(values, offsets=OFFSETS):
    return [values[..., a:b] for a, b in itertools.pairwise(offsets.tolist())]


def held(rng, c, n=OFFSETS[-1], share=0.2):
    """Columns of few values, each of which stays for five steps in the mean."""
    values = rng.integers(0, 4, size=(c, n)).astype(float)
    last = np.maximum.accumulate(np.where(rng.random((c, n)) < share, np.arange(n), 0), axis=1)
    return np.take_along_axis(values, last, axis=1)


@pytest.mark.parametrize(("c", "n_states"), [(3, 3), (5, 2), (8, 8), (9, 8), (18, 10)])
def test_motion_is_the_mean_of_the_changes_in_usual_ones(c, n_states):
    block = moving(held(np.random.default_rng(c), c, share=0.6), n_states, motion=6.0)
    change = np.concatenate([np.diff(part, axis=1, prepend=part[:, :1]) for part in each(block.values)], axis=1)
    size = np.abs(change) / 2.0 ** (np.arange(c) - 1)[:, None]
    bounded = np.minimum(size, 3)
    np.testing.assert_allclose(block.growth, np.log1p(size).mean(axis=0))
    np.testing.assert_allclose([block.motion, block.of_states], [bounded.mean(axis=0), bounded[:n_states].mean(axis=0)])
    np.testing.assert_array_equal(block.moves, bounded.mean(axis=0) > 0.05 * 6.0)


@pytest.mark.parametrize("seed", range(5))
def test_rows_repeat_between_rows_that_move(seed):
    rng = np.random.default_rng(seed)
    changed, moves = rng.random((2, OFFSETS[-1])) < [[0.5], [0.7]]
    found = RepeatedFrames.between(changed, moves, OFFSETS)
    for m, (a, b) in enumerate(itertools.pairwise(OFFSETS.tolist())):
        starts = [a, *(a + 1 + np.flatnonzero(changed[a + 1 : b])).tolist()]
        inner = [(s, e) for s, e in itertools.pairwise(starts) if s > a and moves[s] and moves[e]]
        repeated = sorted(((e - s - 1, -s) for s, e in inner), reverse=True)
        (most, first), (second, _) = [*repeated, (0, 0), (0, 0)][:2]
        assert (found[0][m], found[2][m], found[3][m]) == (sum(n for n, _ in repeated), most, second)
        assert found[1][m] == 1 - first - a or not most


def runs_of(column):
    """The first step and the length of each run of one value."""
    starts = [t for t in range(len(column)) if t == 0 or column[t] != column[t - 1]]
    return [(a, b - a) for a, b in itertools.pairwise([*starts, len(column)])]


@pytest.mark.parametrize("n_states", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_the_value_that_is_held_while_most_moves(n_states, seed, monkeypatch):
    """A column counts steps in which its partner moves, all observations together those in which an action does."""
    monkeypatch.setattr(settings, "MIN_FROZEN", 6)
    values, partner = held(np.random.default_rng(seed), 5), np.array([3, 4, -1, 0, -1])
    for m, n in ((0, 12), (4, 6), (5, 13)):  # which is more and less than a fifth
        values[:n_states, OFFSETS[m + 1] - n : OFFSETS[m + 1]] = 1.0
    block = moving(values, n_states, motion=9.0, partner=partner)
    found = HeldValue.measure(block, None)
    for m, (x, moves, acts) in enumerate(
        zip(each(values), each(block.moves), each((block.size[n_states:] > 0).any(axis=0)), strict=True)
    ):
        change = np.diff(x, axis=1, prepend=x[:, :1])
        for c, p in enumerate(partner):
            counts = moves & (True if p < 0 else change[p] != 0)
            still, first, length = max(
                ((int(counts[a + 1 : a + n].sum()), -a, n) for a, n in runs_of(x[c])), key=lambda run: run[:2]
            )
            first, length = (-first, length) if still else (0, 1)
            other = np.abs(x[p] - x[c, first])[first : first + length]
            far = (other[0], other.max()) if p >= 0 and length >= 6 else (0, 0)
            own = still, first, length, x[c, first], x[c].min(), x[c].max()
            assert (*(of[m, c] for of in (*found[:6], *found[8:])),) == (*own, *far)
        together = runs_of(np.cumsum((change[:n_states] != 0).any(axis=0)))
        n, first, length = max((int(acts[a + 1 : a + n].sum()), -a, n) for a, n in together)
        to_end = n > 0 and -first + length == x.shape[1] and n >= 0.2 * x.shape[1] and first < 0
        assert found[7][m] == n * (to_end and n_states > 1)
        assert found[6][m] == (-first if n else 0)


@pytest.mark.parametrize("rule", [FrozenSensor, FrozenAction, Saturation])
@pytest.mark.parametrize("is_command", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_one_value_for_long_is_a_fault_unless_it_is_usual_or_its_partner_rests(rule, is_command, seed):
    """Of a state, its command, and one that moves in a quarter of the steps or less."""
    rng, m, shape = np.random.default_rng(seed), 8, (8, 3)
    still, first = (
        rng.choice([1, 2, 12, 13, 30], p=[0.5, 0.3, 0.05, 0.05, 0.1], size=shape),
        rng.choice([0, 1, 5], size=shape),
    )
    length, at = still + rng.choice([1, 8, 9], size=shape), rng.choice([0.0, 1.0, 5.0, 9.0, 10.0], size=shape)
    low, high = np.minimum(at, 1.0), np.maximum(at, 9.0)
    last = np.where(np.arange(m) == seed, 11 + seed, 0)
    begins, far = rng.choice([0.5, 1.0], size=shape), rng.choice([1.9, 2.0, 2.1, 3.4, 3.6], size=shape)
    moving, spread = np.array([1.0, 0.25, 0.25 - 0.1 * (seed > 2)]), np.array([1.0, 2.0, 1.0])
    columns = MeasuredColumns((*"abc",), np.arange(3), np.arange(3) > 0, spread, spread, moving, np.ones(3))
    columns = replace(columns, partner=np.array([1, 0, -1]))
    one = np.ones(1, dtype=int)
    tracked = Tracked(one, 0 * one, one, one > 0, 1, is_command)
    measured = {rule.measure: (still, first, length, at, low, high, np.full(m, 3), last, begins, far)}
    learned = SimpleNamespace(columns=columns, tracked=tracked)
    made = rule(Measurements(learned, measured, tuple(range(m)), np.full(m, 50), None))
    for k, c in enumerate({FrozenSensor: [0], FrozenAction: [1, 2], Saturation: [0, 1, 2]}[rule]):
        limit = max(made.fence(still[:, c], 2.5, 2.0), 12)
        extreme = (at[:, c] == low[:, c].min()) | (at[:, c] == high[:, c].max())
        own = (extreme == (rule is Saturation)) & (first[:, c] > 0)
        known = (moving[1 - c] if c < 2 else moving[c]) >= 0.25 and np.isfinite(limit)
        severity = np.where(own, still[:, c], 0) / limit if known else np.full(m, np.nan)
        stays = (first[:, c] > 0) & (length[:, c] >= 12) & (c < 2) & is_command & (rule is not Saturation)
        leaves = stays & own & (far[:, c] > 0.5 * spread[c] + 3 * begins[:, c])
        goes_on = (leaves | (stays & (leaves.sum() >= 2))) & ~(severity > 1)
        np.testing.assert_allclose(made.severity[:, k], np.where(goes_on, 2.0, severity))
        np.testing.assert_array_equal(made.threshold[goes_on, k], 12)
        for fault in [one for one in made.findings() if one.column == "abc"[c]]:
            ends = f" while {'ba'[c]} goes on" if goes_on[fault.id] else " while others move (usual"
            assert (ends in fault.sentence, fault.first) == (True, first[fault.id, c])
    if rule is FrozenSensor:
        np.testing.assert_allclose(made.severity[:, 1], np.where(last >= 12, last, 0) / 6)


def long(rows):
    """The rows without those of runs of fewer than seven."""
    return np.concatenate([np.full(n, rows[t] and n >= 7) for t, n in runs_of(rows)])


def steady(values, noise, drift):
    """Rows in which the means over W rows and over the next W agree, for each W."""
    found = np.ones(values.shape[1], dtype=bool)
    for w in (3, 8, 24):
        kept = np.zeros(len(found), dtype=bool)
        for t, n in [run for run in runs_of(found) if found[run[0]]]:
            kept[t : t + n] = n < 2 * w
            for k in range(t, t + n - 2 * w + 1):
                apart = values[:, k : k + w].mean(axis=1) - values[:, k + w : k + 2 * w].mean(axis=1)
                kept[k : k + 2 * w] |= (np.abs(apart) <= 3 * np.sqrt(2 / w) * noise + drift * w).all()
        found = long(kept)
    return found


def resting(block, is_command, by_states):
    """Rows at rest: those of a steady stretch near its median, and up to an end that is near."""
    columns, starts, ends = block.columns, {*block.offsets[:-1].tolist()}, {*block.offsets[1:].tolist()}
    rests, exact, found = np.zeros(len(block.moves), dtype=bool), np.zeros(len(block.moves), dtype=bool), []
    noise, drift, actions = columns.noise, 2e-4 * columns.spread + 1e-12, block.block.actions
    tells = np.flatnonzero(3 * noise <= 0.5 * columns.spread)
    states = tells[~columns.is_action[tells]]

    def stretches(own, a, b):
        rows = steady(block.values[own, a:b], noise[own], drift[own])
        return [(own, a + t, a + t + n, a, b) for t, n in runs_of(rows) if rows[t]]

    for a, b in itertools.pairwise(block.offsets.tolist()) if len(states) else ():
        same = (actions[a + 1 : b] == actions[a : b - 1]) | ((actions[a + 1 : b] == 0) & (not is_command))
        same = np.append(False, same.all(axis=1))
        for t, n in runs_of(same):
            if same[t] and 7 <= n < b - a - 1:
                exact[a + t - 1 : a + t + n] = True
                found += stretches(states, a + t - 1, a + t + n)
        if by_states:
            found += [one for one in stretches(tells, a, b) if not exact[one[1] : one[2]].any()]
    for own, a, b, low, high in found:
        off = np.abs(block.values[own, a:b] - np.median(block.values[own, a:b], axis=1, keepdims=True))
        near = np.flatnonzero((off <= 3 * (noise + drift)[own, None]).all(axis=0))
        if len(near) and near[-1] - near[0] >= 6:
            first = low if a - low <= 3 and low in starts else a + near[0] + 1
            rests[first : high if high - b <= 3 and high in ends else a + near[-1] + 1] = True
    return np.concatenate([long(own) for own in each(rests, block.offsets)])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("is_command", [True, False])
@pytest.mark.parametrize("noisy", [0, 1, 2])
def test_rest_and_where_it_is_by_loops(seed, is_command, noisy):
    """Columns that stay for stretches, with noise, and actions that stay for others."""
    rng, offsets = np.random.default_rng(seed), np.cumsum([0, 90, 1, 7, 60, 8, 120, 30])
    edges = np.append(np.flatnonzero(rng.random(offsets[-1]) < 0.05), offsets[-1])
    values = np.cumsum(rng.normal(size=(4, offsets[-1])), axis=1)
    for k, (a, b) in enumerate(itertools.pairwise(np.append(0, edges).tolist())):
        values[: 2 + k % 3, a:b] = values[: 2 + k % 3, a, None] if k % 3 < 2 or noisy else values[: 2 + k % 3, a:b]
        values[2:, a:b] *= k % 4 > 0
    for end in offsets[1:-1]:  # actions are the same on both sides
        values[2:, end - 9 : end + 9] = noisy
    noise = np.array([0.03, 0.02, 0.0, 0.01])
    values += noise[:, None] * rng.normal(size=values.shape)
    spread = np.array([1.0, 0.12 if noisy else 0.11, 1.0, 1.0 if noisy < 2 else 0.01])
    block = moving(values, 2, offsets, noise=noise, spread=spread)
    for by_states in (True, False):
        np.testing.assert_array_equal(resting_rows(block, is_command, by_states), resting(block, is_command, by_states))
    found = [np.zeros(7, dtype=int) for _ in range(4)]
    for m, own in enumerate(each(resting(block, is_command, is_command), offsets)):
        for t, n in runs_of(own):
            if own[t] and t == 0:
                found[0][m] = n - 1
            elif own[t] and t + n == len(own):
                found[1][m] = n
            elif own[t] and n > found[3][m]:
                found[2][m], found[3][m] = t, n
    np.testing.assert_array_equal(idle_runs(block, is_command), found)


@pytest.mark.parametrize("seed", range(6))
def test_ends_are_idle_where_no_controller_settles(seed):
    """A tail decays, and a head grows, from a third of it to the other by more than a quarter."""
    rng, lengths = np.random.default_rng(seed), [1, 9, 10, 11, 12, 13, 14, 40, 41, 42, 43, 44, 45, 46]
    offsets = np.cumsum([0, *lengths])
    motion = rng.choice([0.0, 0.01, 0.012, 0.0125, 0.013, 0.02], size=offsets[-1])
    for a, b in itertools.pairwise(offsets[5:].tolist()):
        motion[a + rng.integers(8, 14) : b - rng.integers(8, 14)] = 1.0
    block = {"moves": motion > 0.05, "motion": motion, "offsets": offsets, "numbers": range(14), "columns": None}
    block = SimpleNamespace(**block, block=SimpleNamespace(actions=np.zeros(len(motion), dtype=int)))
    found = IdleEnd.measure(block, SimpleNamespace(tracked=SimpleNamespace(is_command=False)))
    assert not np.any(found[2:])
    for m, own in enumerate(each(motion, offsets)):
        moves = np.flatnonzero(own > 0.05)
        head, tail = (max(moves[0] - 1, 0), len(own) - 1 - moves[-1]) if len(moves) else (len(own), 0)
        for part, (n, rows) in enumerate(((head, own[1:head]), (tail, own[len(own) - tail + 1 :][::-1]))):
            third = len(rows) // 3
            settles = n >= 10 and 0 < 1.25 * rows[1 : third + 1].mean() < rows[-third:].mean()
            assert found[part][m] == (0 if settles else n)


@pytest.mark.parametrize(
    ("m", "n_still"), [(8, 1), (8, 2), (8, 3), (11, 3), (14, 3), (17, 4), (20, 5), (60, 6), (60, 7), (8, 7)]
)
def test_a_column_never_moves_where_few_do_not_and_the_others_move_alike(m, n_still):
    """Of an action and its state, which goes far or not, and of columns that are absent in some."""
    rng = np.random.default_rng(n_still)
    ranges = rng.choice([0.25, 0.9, 1.0, 1.1, 4.0], p=[0.02, 0.3, 0.36, 0.3, 0.02], size=(m, 3))
    ranges[:n_still, 0], ranges[1, 1], ranges[2, 1], ranges[3:5, 2] = 0.0, 0.004, 0.005, 0.0
    zeros, lengths = np.where(ranges == 0, rng.choice([0.5, 1.0], size=(m, 3)), 0.1), rng.choice([1, 20, 30], size=m)
    pairs = Tracked(np.array([1]), np.array([0]), np.ones(1), np.ones(1, dtype=bool), 1, is_command=n_still % 2 > 0)
    columns = MeasuredColumns((*"abc",), np.arange(3), np.arange(3) > 0, np.ones(3), np.full(3, 1.0), *np.ones((2, 3)))
    learned = SimpleNamespace(columns=columns, tracked=pairs)
    rule = NeverMoves(Measurements(learned, {NeverMoves.measure: (ranges, zeros)}, tuple(range(m)), lengths, None))
    for c in range(3):
        usual = np.nanmedian(np.where(rule.absent[:, c], np.nan, ranges[:, c]))
        still = ranges[:, c] <= 0.005 * usual
        others = ranges[~still, c]
        known = still.sum() <= min(max(4, -(-m // 10)), m / 4) and min(others) >= usual / 4 and max(others) <= 4 * usual
        still = still & (lengths > 1)
        for k in range(m):
            expected = 2.0 * still[k] if known else np.nan
            if pairs.is_command and c < 2 and still[k] and ranges[k, 1 - c] > 1.0:
                expected = 2.0
            expected = (1e6 if rule.absent[k, c] else expected) + still[k] * min(others) / max(ranges[:, c])
            assert rule.severity[k, c] == pytest.approx(np.nan if lengths[k] < 20 else expected, nan_ok=True)
