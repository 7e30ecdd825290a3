"""What a set agrees on: constants, limits, order and sign of columns, and where it is cut."""

import itertools
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import rpil
from recordings import demonstrations, recording
from rpil.faults.checking import check
from rpil.faults.conventions import TwoEpisodes, limit_of, motion_of, two_groups, undone
from rpil.faults.motion import Jump
from rpil.faults.rule import Measurements

N = 12
HOME = np.array([-90.0, 80, 0, 20])


def arm(seed=0):
    """Joints that leave their home and come back, and commands two steps before."""
    rng, episodes = np.random.default_rng(seed), []
    for _ in range(N):
        n = int(rng.integers(110, 140))
        path = HOME + 40 * np.sin(np.linspace(0, np.pi, n + 2))[:, None] * rng.uniform(0.6, 1.2, 4)
        path += 0.2 * rng.normal(size=path.shape)
        episodes.append((path[:-2], path[2:]))
    return episodes


CLEAN = arm()


def test_what_is_constant_is_one_line():
    constant = [(x, a * [1, 1, 1, 0] + [0, 0, 0, 12.5]) for x, a in CLEAN]
    found = [one for one in check(demonstrations(constant)).lines if one.rule == "constant"]
    assert [one.column for one in found] == ["action 3"]
    assert found[0].sentence.startswith("action 3 is 12.5 in every step: its range is 0, by which min-max")
    goal = [(np.c_[x, np.ones(len(x))], a) for x, a in CLEAN]
    (line,) = check(demonstrations(goal)).findings
    assert (line.rule, line.id, line.column, line.grade) == ("constant state", "", "observation 4", "odd")
    assert line.sentence.startswith("observation 4 is 1 in every step: its range is 0, by which min-max")
    assert "constant state" not in check(demonstrations([(x + m, a) for m, (x, a) in enumerate(goal)])).counts
    many = [(np.ones((5, 1)), np.ones((5, 1))) for _ in range(300)]
    many[2][0][3] = 5.0  # which no sample has
    assert "constant state" not in check(demonstrations(many)).counts
    codes = [(x, np.zeros(len(x), dtype=int)) for x, _ in CLEAN]
    assert "constant" not in check(demonstrations(codes)).counts


@pytest.mark.parametrize("told", [False, True])
def test_tasks_with_homes_on_either_side_are_no_conventions(told):
    """One joint begins at 80 or at -80, by the task: in turns, or one task after the other with a column of tasks."""
    is_other = [m >= N / 2 if told else m % 2 for m in range(N)]
    episodes = [
        (x * [1, -1, 1, 1], a * [1, -1, 1, 1]) if o else (x, a) for (x, a), o in zip(CLEAN, is_other, strict=True)
    ]
    names = [f"{kind}.{k}" for kind in ("state", "action") for k in range(4)]
    frames = [pd.DataFrame(np.c_[x, a], columns=names) for x, a in episodes]
    frame = pd.concat([one.assign(episode=m, task="place" if is_other[m] else "pick") for m, one in enumerate(frames)])
    options = {"task": "task"} if told else {"observations": "state.*"}
    assert "two conventions" not in check(rpil.open(frame, **options)).counts


def test_a_wrapped_angle_is_not_of_another_sign():
    """It begins on either side of 180 degrees, goes over it, and comes back."""
    episodes = []
    for m, (x, a) in enumerate(CLEAN):
        side = (-1) ** m
        both = [np.c_[side * (170 + values[:, 0] - HOME[0]), values[:, 1:]] for values in (x, a)]
        x, a = (np.c_[(values[:, :1] + 180) % 360 - 180, values[:, 1:]] for values in both)
        episodes.append((x, a))
    counts = check(demonstrations(episodes)).counts
    assert "wraps" in counts
    assert "two conventions" not in counts


def test_two_ways_that_begin_alike_are_no_conventions():
    bend = [
        np.sin(np.linspace(0, np.pi, len(x)))[:, None] * [0, 0, 60 * (-1) ** m, 0] for m, (x, _) in enumerate(CLEAN)
    ]
    both = [(x + b, a + b) for (x, a), b in zip(CLEAN, bend, strict=True)]
    assert "two conventions" not in check(demonstrations(both)).counts
    every = [(x[:, [1, 0, 2, 3]], a[:, [1, 0, 2, 3]]) for x, a in CLEAN]
    assert not check(demonstrations(every)).findings  # of all it cannot be known


@pytest.mark.parametrize(
    ("values", "upper"),
    [
        ([0, 0.1, 1, 1.1], [2, 3]), ([5, 0, 5.1, 0.2, 5], [0, 2, 4]), ([0, 1, 2, 3, 4], None),
        ([0, 0.1, 0.2, 9], None),  # one alone
        ([0, 2] * 3 + [5.1, 7.1] * 3, [6, 7, 8, 9, 10, 11]),  # later, by eight standard errors
        ([0, 2] * 3 + [5, 7] * 3, None),
    ],
)  # fmt: skip
def test_two_groups_lie_far_apart(values, upper):
    found = {tuple(np.flatnonzero(rows).tolist()) for rows in two_groups(np.array(values, float)[:, None])}
    assert found == ({tuple(upper)} if upper else set())


@pytest.mark.parametrize(
    ("tops", "limit"),
    [
        ([1, 1, 1, 1, 0.9, 2, 2, 2], 1), ([1] * 6 + [2.5] * 14, 1), ([7, 7, 7, 7, 7, 6, 9], 7),
        ([7, 7, 7, 7, 9, 9, 9, 9, 9], np.nan),  # which is the limit cannot be known
        ([3, 3, 3, 1, 1, 2, 2], np.nan), ([3] * 6 + [0.1, 0.2, 1, 2], 3), ([3] * 4 + [0.1, 0.2, 2], np.nan),
    ],
)  # fmt: skip
def test_a_limit_is_what_most_touch_and_never_pass(tops, limit):
    np.testing.assert_equal(limit_of(np.array(tops, float)), limit)


def clipped(m, stretched=(), hand=(-1.0, 1.0)):
    x, a = recording(N, joints=3)[m]
    a = np.clip(1.5 * a, -1, 1) * np.where((m in stretched) & (a < 0), 2.5, 1)
    return x, np.c_[a, np.where(np.arange(len(a)) % 40 < 20, *hand)]


@pytest.mark.parametrize("stretched", [(), (2, 9), range(6), range(8), range(N)])
def test_actions_beyond_the_limit_that_the_others_touch_are_outside(stretched):
    report = check(demonstrations([clipped(m, stretched) for m in range(N)]))
    found = {fault.id: fault for fault in report.findings if fault.rule == "outside range"}
    assert {*found} == (set() if len(stretched) == N else {*stretched})  # of all it cannot be known
    if len(found) == 2:
        assert [fault.severity for fault in found.values()] == pytest.approx([15.0, 15.0])  # 1.5 beyond a range of 2
        assert all("action 0 goes to -2.5; the others touch -1 and" in fault.sentence for fault in found.values())
        larger = [(x, 7 * a) for x, a in (clipped(m, stretched) for m in range(N))]
        assert "outside range" not in check(demonstrations(larger)).counts  # a measurement may begin where others end


def test_a_value_that_one_task_alone_has_is_named_with_the_task():
    rows = []
    for m in range(N):
        task = ("pour", "stack", "wipe")[m % 3]
        x, a = clipped(m, hand=(0.0, 1.0))
        a[5:9, 3] = 3.0 if task == "pour" else 1.0
        columns = {f"observation.{k}": x[:, k] for k in range(3)} | {f"action.{k}": a[:, k] for k in range(4)}
        rows.append(pd.DataFrame({"episode": m, "task": task, **columns}))
    (line,) = [one for one in rpil.check(pd.concat(rows), task="task").lines if one.rule == "outside range"]
    said = f"4 of 12 demonstrations, those of the task 'pour': {line.column} goes to 3; the others touch 1 and never"
    assert line.sentence.startswith(said)
    assert "outside range" not in rpil.check(pd.concat(rows).drop(columns="task")).counts  # one more value


@pytest.mark.parametrize("late", [7, -7, 0])
def test_ends_that_are_late_or_early_are_seen_where_the_rows_go_on(late):
    rng = np.random.default_rng(0)
    episodes = [(x + 60 * rng.normal(size=4), a) for x, a in CLEAN]
    states, actions = (np.concatenate([pair[k] for pair in episodes]) for k in (0, 1))
    ends = np.cumsum([len(x) for x, _ in episodes])
    cuts = np.r_[0, ends[:-1] + late, ends[-1]]
    made = [(states[a:b], actions[a:b]) for a, b in itertools.pairwise(cuts)]
    found = {fault.id: fault.sentence for fault in check(demonstrations(made)).findings if fault.rule == "two episodes"}
    assert set(found) == {7: set(range(N - 1)), -7: set(range(1, N)), 0: set()}[late]
    said = {7: "its last 7 rows are those of the next one", -7: "its first 7 rows are those of the one before"}
    assert all(said[late] in one for one in found.values())


P = np.array([1.0, 2, 4, 7, 6, 5, 3, 2])  # means over parts of time


@pytest.mark.parametrize(
    ("change", "motion", "path", "said"),
    [
        (P + 1.29, 1, 1, "alike"),
        *((of, 1, 1, "") for of in (P + 1.31, P + 1.9 + 1.52 * (P == 1), 1.46 - P + 1.4 * (P == 1), 2 - P)),
        (P, 3.1, 1, ""), (P - 1.9, 1, 1, "is 1.9 lower throughout"),
        (P + 1.9 + 1.44 * (P == 1), 1, 1, "is 2.08 higher throughout"), (1.44 - P, 1, 1, "has another sign"),
        (1.46 - P, 1, 1, "goes the other way"), (57.3 * P + 67, 57.3, 57.3 * 2.9, "is 57.3 times larger"),
        (57.3 * P + 69, 57.3, 57.3, ""), (57.3 * P, 57.3 * 1.5, 57.3, "is 57.3 times larger"),
        *((57.3 * P, *of, "") for of in ((57.3 * 1.6, 57.3), (57.3, 57.3 * 3.1))),
        (P / 1000, 1e-3, 1e-3, "is 1e+03 times smaller"), (100 * P, 100, 100, "is 100 times larger"),
    ],
)  # fmt: skip
def test_a_part_is_like_the_rest_once_a_change_is_undone(change, motion, path, said):
    """Alike is within four standard errors, of .1, and .15 of how far a column goes."""
    rest, of = P[:, None] * [1, -1, 0.5], np.array([1, 1, 0.5])
    part, variance = np.column_stack([change, rest[:, 1:]]), np.full((8, 3), 0.005)
    own = (part, variance, 6 * of * [motion, 1, 1], 10 * of * [path, 1, 1])
    columns = SimpleNamespace(names=("c0", "c1", "c2"), is_action=np.zeros(3, dtype=bool))
    found, alike, moves = undone(own, (rest, variance, 6 * of, 10 * of), columns)
    assert (alike.tolist(), moves.all()) == ([said == "alike", True, True], True)
    assert [one for _, one in found.values()] == [f"c0 {said}"] * (said not in ("", "alike"))


@pytest.mark.parametrize(
    ("n", "at", "more", "found"),
    [
        *((4, at, {"length": length}, range(4)) for at, length in ((20, 40), (15, 20))),
        (5, 19, {}, range(1, 5)),  # of the first nothing lies before
        *((4, 30, more, ()) for more in ({"gap": 4.7}, {"length": 19}, {"memory": 0.69}, {"change": 0.0})),
        *((n, at, {}, ()) for n, at in ((4, 3), (3, 30))),
    ],
)
def test_demonstrations_go_on_in_the_next_one(n, at, more, found):
    """Beyond changes of 1, which are usual, to the next one is a gap; all columns leap in the first `n` of eight."""
    length, memory, change, gap = ({"length": 40, "memory": 0.7, "change": 1.0, "gap": 4.6} | more).values()
    ones, change = np.ones(1), np.full((8, 1), change)
    columns = SimpleNamespace(is_action=ones > 1, scale=ones, memory=memory * ones, names=("c0",))
    jumps = None, None, None, 3.0 * (np.arange(8)[:, None] < n), np.full((8, 1), at), np.zeros((8, 1))
    measured = {Jump.measure: jumps, TwoEpisodes.measure: (0 * change, 0 * change + gap, change, change)}
    learned = SimpleNamespace(columns=columns)
    rule = TwoEpisodes(Measurements(learned, measured, tuple(range(8)), np.full(8, length), None))
    assert [(one.id, one.last, one.severity) for one in rule.findings()] == [(m, at, 3 / 0.35) for m in found]


def test_motion_is_the_range_and_the_way_without_the_largest_change():
    ranges, ways = motion_of(np.array([[0.0, 4, 1, 2], [0, 6, 1, 3], [0, 1, 2, 9]])[..., None])
    assert (ranges.tolist(), ways.tolist()) == ([6], [4])


def in_part(rows, change):
    return [(change(x), change(a)) if m in rows else (x, a) for m, (x, a) in enumerate(CLEAN)]


PARTS = {
    "two units": (lambda v: np.deg2rad(v), "is 57.3 times smaller", 7),
    "moved": (lambda v: v + np.array([0, 0, 25, 0]), "higher throughout", 1),
    "turned": (lambda v: [0, 0, 0, 60] - v * [-1, -1, -1, 1], "goes the other way", 1),
    "order": (lambda v: v[:, [1, 2, 0, 3]], "are in another order", 0),
    "sign": (lambda v: v * [-1, 1, 1, 1], "has another sign", 1),
}


@pytest.mark.parametrize("kind", PARTS)
@pytest.mark.parametrize("rows", [range(3), range(6, 12), range(3, 12), range(12)])
def test_states_and_actions_that_differ_together_in_a_part_are_one_line(kind, rows):
    change, said, more = PARTS[kind]
    report = check(demonstrations(in_part(rows, change)))
    if len(rows) == N:
        assert not report.findings  # of all it cannot be known
        return
    smaller = tuple(rows) if len(rows) <= 6 else tuple(range(3))
    assert {(one.id, one.ids) for one in report.findings} == {("", smaller)}
    assert report.findings[0].rule == ("two units" if kind == "two units" else "two conventions")
    assert f"{said} in {len(smaller)} of 12 " in report.findings[0].sentence or len(rows) > 6
    also = f"; the same in {more} more column{'s' * (more > 1)}" * bool(more)
    assert report.findings[0].sentence.endswith(f"; which is right cannot be known{also}")
    if kind == "moved":
        by = float(report.findings[0].sentence.split(" is ")[1].split()[0])
        assert by == pytest.approx(25, abs=4)


def test_another_unit_of_few_hides_no_fault_of_others():
    made = [(x.copy(), a) for x, a in in_part((0, 1), np.deg2rad)]
    made[5][0][50, 2] += 60
    report = check(demonstrations(made))
    assert {one.id for one in report.findings if one.rule == "spike"} == {5}
    assert [one.ids for one in report.findings if one.rule == "two units"] == [(0, 1)]
    (half,) = check(demonstrations(in_part(range(1, N, 2), np.deg2rad))).findings
    assert half.ids == tuple(range(1, N, 2))  # without the first


@pytest.mark.parametrize("places", [(-0.8, -0.4, 0.05, 0.4, 0.8), (-0.6, -0.2, 0.2, 0.6), (-0.5, 0.5)])
def test_tasks_that_begin_at_one_home_and_go_the_other_way_have_no_other_sign(places):
    rng, ways = np.random.default_rng(0), np.sin(np.pi * np.linspace(0, 1, 60))
    sizes = np.array([[40 * place, 10, 20, 30] for place in np.repeat(places, 8)])
    states = 5 + sizes[:, None] * (1 + 0.1 * rng.normal(size=(len(sizes), 1, 4))) * ways[:, None]
    states = (states + rng.normal(0, 0.05, states.shape) * (ways > 0)[:, None]).reshape(-1, 4)
    actions = np.roll(states, -1, axis=0) + rng.normal(0, 0.05, states.shape)
    report = rpil.check(rpil.Demonstrations(states, actions, np.arange(0, len(states) + 1, 60)))
    assert "two conventions" not in report.counts
