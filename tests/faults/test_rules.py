"""Copies, trims, missing values, and which findings there are of a demonstration with several faults."""

from __future__ import annotations

import numpy as np

from recordings import changed, demonstrations, recording, with_missing
from rpil.faults.checking import check

CLEAN = recording()
M = 5  # the demonstration with the fault
X, A = CLEAN[M]
T = len(X)


def edited(values, rows, columns, new):
    out = values.copy()
    out[rows, columns] = new
    return out


def insert(at, n):
    return {"observations": np.insert(X, [at] * n, X[at], axis=0), "actions": np.insert(A, [at] * n, A[at], axis=0)}


def test_trims_name_the_steps_to_keep():
    assert check(demonstrations(changed(CLEAN, M, **insert(0, 40)))).trims == {M: (40, T + 40)}
    assert check(demonstrations(changed(CLEAN, M, **insert(T - 1, 40)))).trims == {M: (0, T)}


def test_the_worst_comes_first_and_each_demonstration_once_for_each_rule():
    spiky = changed(CLEAN, M, observations=edited(edited(X, 60, 1, X[60, 1] + 20), 90, 2, X[90, 2] + 30))
    other = spiky[1][0]
    report = check(demonstrations(changed(spiky, 1, observations=edited(other, 40, 0, other[40, 0] + 90))))
    assert [(f.rule, f.id) for f in report.findings] == [("spike", 1), ("spike", M)]
    assert "1 more column" in report.findings[1].sentence


def test_the_order_of_demonstrations_changes_nothing():
    faulty = demonstrations(changed(CLEAN, M, actions=edited(A, slice(80, None), 2, A[80:, 2] + 20)))
    backwards = check(faulty.select(np.arange(len(faulty))[::-1]))
    assert [f.sentence for f in backwards.findings] == [f.sentence for f in check(faulty).findings]


def test_missing_values_are_set_aside_on_demand():
    damaged = with_missing(changed(CLEAN, M, observations=edited(X, slice(30, 33), 1, np.nan)))
    report = check(damaged)
    assert "spike" in report.not_checked
    rest = check(damaged, skip_bad=True)
    assert rest.set_aside == (M,)
    assert "spike" not in rest.not_checked


def test_infinite_actions_are_named():
    damaged = with_missing(changed(CLEAN, 0, actions=edited(CLEAN[0][1], 3, 2, np.inf)))
    (found,) = check(damaged).findings
    assert (found.column, found.first, found.sentence) == ("action 2", 3, "action 2 is inf at step 3")
    assert np.isinf(damaged.actions).any()
