"""Each rule finds a fault that is planted, in its place; finds none without it; and says where nothing can be known."""

import numpy as np
import pytest

from recordings import changed, demonstrations, edited, recording
from rpil.faults.checking import check
from rpil.faults.recorded import FOLDER_RULES
from rpil.faults.report import RULES
from rpil.faults.rule import Rule

CLEAN = recording()
M = 5  # the demonstration with the fault
X, A = CLEAN[M]
T = len(X)
WHOLE, SECOND = (0, T - 1), np.array([1, -1, 1])
HIGH = max(x.max() for x, _ in CLEAN)


def of_rows(rows):
    return {"observations": X[rows], "actions": A[rows]}


def inserted(at, n):
    return of_rows(np.insert(np.arange(T), at, [at] * n))


def held(value, column):
    stays = f"{column} stays at {value:.4g} for 40 steps from step 50 while others move (usual: up to 12 steps)"
    return (50, 89), column, stays, 39 / 12


def wrapped(x):
    """The second joint turns round once more than the others, and its encoder wraps at half a turn."""
    turned = x + np.linspace(0, 4 * np.pi, len(x))[:, None] * [0, 1, 0]
    return np.where([False, True, False], (turned + np.pi) % (2 * np.pi) - np.pi, x)


PLANTED = {
    "spike": (
        {"observations": edited(X, 60, 1, X[60, 1] + 20)},
        *((60, 60), "observation 1", "leaps by 19.9 for one step at step 60 (usual: up to 0.21)", 94.783533),
    ),
    "jump": (
        {"actions": edited(A, slice(80, None), 2, A[80:, 2] + 20)},
        *((79, 80), "action 2", "action 2 jumps by 19.9 at step 80 (usual: up to 0.259)", 77.1246),
    ),
    "frozen sensor": ({"observations": edited(X, slice(50, 90), 1, X[50, 1])}, *held(X[50, 1], "observation 1")),
    "frozen action": ({"actions": edited(A, slice(50, 90), 0, A[50, 0])}, *held(A[50, 0], "action 0")),
    "saturation": ({"observations": edited(X, slice(50, 90), 1, HIGH + 1)}, *held(HIGH + 1, "observation 1")),
    "scale": (
        {"observations": X * [1, 1, 57.3]},
        *(WHOLE, "action 2", "action 2 changes 0.0175 times as much as observation 2, which follows it", 3.6849731),
    ),
    "scale of less": (
        {"observations": X * [1, 1e-3, 1]},
        *(WHOLE, "observation 1", "399 times smaller than usual: perhaps another unit, perhaps little", 31.680180),
    ),
    "lag": (
        {"actions": A[np.maximum(np.arange(T) - 4, 0)]},
        *(WHOLE, "", "the state moves 2 steps before its command: the actions are recorded late, or", 26.479449),
    ),
    "idle head": (inserted(0, 40), (0, 39), "", "nothing moves for the first 40 steps", 4.0),
    "idle tail": (inserted(T - 1, 40), (T, T + 39), "", "moves for the last 40 steps", 4.0),
    "length": (of_rows(slice(15)), (0, 14), "", "it has 15 steps (usual: 76 to 362 steps)", 5.1),
    "repeated frames": (
        inserted(70, 4),
        *((71, 74), "", "4 rows repeat the row before while all moves, most from step 71 (usual: none)", 4 / 3),
    ),
    "sign": ({"observations": X * SECOND}, WHOLE, "action 1", "has the other sign than observation 1, which", 2.0),
    "exchanged": (
        {"actions": A[:, [1, 0, 2]]},
        *(WHOLE, "action 1", "action 1 goes with observation 0: the columns of the action, or of the state", 28527.568),
    ),
    "wraps": ({"observations": wrapped(X)}, *(WHOLE, "observation 1", "observation 1 wraps: it leaps by 6.283", 4.0)),
    "pause": (inserted(70, 60), (71, 130), "", "nothing moves for 60 steps from step 71", 5.0),
    "never moves": (
        {"actions": np.where(SECOND < 0, A[:1], A)},
        *(WHOLE, "action 1", "action 1 does not move, and in the others it does", 2.7942906),
    ),
}
"""What is changed, and the finding: its steps, its column, a part of its sentence, and its severity."""

OTHERS = {"scale": {"jump", "spike"}, "scale of less": {"never moves"}, "pause": {"repeated frames"}}
"""Rules that find a planted fault as well."""


NOT_SAID = {"dropped frames", "frame rate", "frame count"}  # without timestamps and lengths that the recording says


def rule_of(case):
    return max((rule for rule in RULES if case.startswith(rule)), key=len)


@pytest.mark.parametrize("case", PLANTED)
def test_planted_fault_is_found_in_its_place(case):
    arrays, steps, column, words, severity = PLANTED[case]
    report = check(demonstrations(changed(CLEAN, M, **arrays)))
    (fault,) = [fault for fault in report.findings if fault.rule == rule_of(case)]
    assert (fault.id, fault.first, fault.last, fault.column) == (M, *steps, column)
    assert words in fault.sentence
    assert fault.severity == pytest.approx(severity, rel=1e-6)
    assert fault.threshold == 1 or rule_of(case) != "lag"
    assert {fault.id for fault in report.findings} == {M}
    assert set(report.counts) == {rule_of(case)} | OTHERS.get(case, set())


@pytest.mark.parametrize("n", [19, 20])
def test_a_scale_and_a_sign_take_twenty_steps(n):
    swift = [(x[::5], a[::5]) for x, a in CLEAN]  # as a robot that is looked at less often
    for rule, changes in (("scale", {"observations": 57.3 * swift[M][0]}), ("sign", {"actions": swift[M][1] * SECOND})):
        short = {name: changes.get(name, swift[M][k])[:n] for k, name in enumerate(("observations", "actions"))}
        report = check(demonstrations(changed(swift, M, **short)))
        assert (rule in report.counts) == (n == 20)
        assert rule not in report.not_checked
    shorter = check(demonstrations([(x[:n], a[:n]) for x, a in swift]))
    reasons = [shorter.not_checked.get(rule) for rule in ("scale", "offset")]  # which tells signs of commands
    assert (reasons == [Rule.unknown] * 2) == (n == 19)


def test_small_values_follow_from_a_length_that_is_odd():
    grow = [np.linspace(0, 1, len(x))[:, None] ** 3 for x, _ in CLEAN]
    slow = [(x * g, a * g) for (x, a), g in zip(CLEAN, grow, strict=True)]
    cut = check(demonstrations(changed(slow, M, observations=slow[M][0][:30], actions=slow[M][1][:30])))
    assert "length" in cut.counts
    assert "scale" not in cut.counts
    larger = [57.3 * values[:30] for values in CLEAN[M]]
    both = check(demonstrations(changed(CLEAN, M, observations=larger[0], actions=larger[1])))
    assert {"length", "scale"} <= set(both.counts)
    (scale,) = (fault for fault in both.findings if fault.rule == "scale")
    assert scale.value > scale.threshold > 1


def test_without_it_there_is_no_fault_and_nothing_is_unknown():
    report = check(demonstrations(CLEAN))
    assert (report.findings, report.unknown, report.trims) == ((), {}, {})
    assert set(report.not_checked) == NOT_SAID
    assert report.usual == {"lag": "observation 0 follows action 0 after 2 steps"}


@pytest.mark.parametrize(("by", "when"), [(1, "1 step later"), (-3, "3 steps sooner")])
def test_another_lag_of_speeds_is_found_beside_the_others(by, when):
    speeds = [(np.cumsum(a, axis=0), a) for _, a in CLEAN]
    late = speeds[M][0][np.clip(np.arange(T) - by, 0, T - 1)]
    found = check(demonstrations(changed(speeds, M, observations=late))).findings
    said = [(fault.id, fault.value, fault.sentence) for fault in found if fault.rule == "lag"]
    assert said == [(M, abs(by), f"the state follows the action {when} than usual")]


def test_copies_name_the_first():
    copies = demonstrations([CLEAN[0], CLEAN[1], CLEAN[0], CLEAN[0]])
    found = check(copies).findings
    left_out = check(copies, expected={"RPIL-123": 2, "duplicate": [0]})
    assert (left_out.findings, left_out.n_expected) == (found[1:], 1)
    assert [(f.rule, f.id, f.sentence) for f in found] == [
        ("duplicate", m, "it is the same as demonstration 0") for m in (2, 3)
    ]
    assert {(f.first, f.last, f.column) for f in found} == {(0, len(CLEAN[0][0]) - 1, "")}
    for n_steps, n_found in ((3, 0), (49, 0), (50, 9)):  # short ones of codes may be equal by chance
        moves = np.arange(n_steps)[:, None] % 3.0, np.arange(n_steps) % 2
        assert check(demonstrations([moves] * 10)).counts.get("duplicate", 0) == n_found


def resting(values, columns=(1,)):
    """These columns keep each value for four steps."""
    return edited(values, slice(None), columns, values[np.arange(len(values)) // 4 * 4][:, columns])


def repeating(m):
    """More and more rows are repeated, in later demonstrations."""
    x, a = CLEAN[m]
    t = np.arange(len(x))
    rows = np.repeat(t, np.where((t % 8 == 0) & (t < 20 * m), 2, 1))
    return x[rows], a[rows]


def idling(m):
    """Later demonstrations begin and end with more idle steps."""
    rows = np.pad(np.arange(len(CLEAN[m][0])), 1 + 2 ** (m // 2), mode="edge")
    return CLEAN[m][0][rows], CLEAN[m][1][rows]


RNG = np.random.default_rng(0)
UNKNOWN = {
    "sizes": [(x * 4.0**m, a * 4.0**m) for m, (x, a) in enumerate(CLEAN)],
    "lengths": [(x[: 12 * 2 ** (m % 5)], a[: 12 * 2 ** (m % 5)]) for m, (x, a) in enumerate(CLEAN)],
    "resting": [(resting(x), resting(a)) for x, a in CLEAN],
    "repeating": [repeating(m) for m in range(len(CLEAN))],
    "idling": [idling(m) for m in range(len(CLEAN))],
    "levels": [(x + 9 * RNG.normal(size=3), a + 9 * RNG.normal(size=3)) for x, a in CLEAN],
    "noise": [(RNG.normal(size=(60, 2)), RNG.normal(size=(60, 1))) for _ in range(12)],
}
NOTHING = {
    "sizes": {"scale", "never moves"},
    "lengths": {"length"},
    "resting": set(),
    "repeating": {"repeated frames"},
    "idling": {"idle head", "idle tail"},
    "levels": {"scale"},
    "noise": {"spike", "lag", "sign", "offset", "exchanged", "action is state"},
}
LACKING = {"lag", "sign", "offset", "exchanged", "action is state"}


@pytest.mark.parametrize("data", UNKNOWN)
def test_rules_say_where_nothing_can_be_known(data):
    report = check(demonstrations(UNKNOWN[data]))
    assert set(report.not_checked) == NOT_SAID | NOTHING[data]
    for rule in NOTHING[data] - (LACKING if data == "noise" else set()):
        assert report.not_checked[rule] == RULES[rule].unknown
    if data == "resting":
        kept = dict.fromkeys(("saturation", "spike", "jump", "scale"), ("observation 1", "action 1"))
        assert report.unknown == {"frozen sensor": ("observation 1",), "frozen action": ("action 1",)} | kept


def test_few_demonstrations_tell_nothing():
    report = check(demonstrations(CLEAN[:3]))
    alone = {"missing values", "duplicate", "constant", "constant state", "wraps"}
    alone |= {"offset", "exchanged", "action is state"}
    free = {*alone, *NOT_SAID}
    beside = {rule.name for rule in FOLDER_RULES}
    assert set(report.not_checked) == set(RULES) - alone - beside
    for rule in set(RULES) - free - beside:
        assert report.not_checked[rule] == "it takes 4 demonstrations to know what is usual"
    assert set(check(demonstrations(CLEAN[:4])).not_checked) < set(report.not_checked)
