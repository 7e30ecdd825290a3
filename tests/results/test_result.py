"""What an audit holds: its methods give what its fields say."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from audits import make_audit
from rpil.results.judged import Demonstrator, Interval


def test_worst_steps_are_the_most_negative_and_never_positive():
    ratio = np.concatenate([[1.0, -2.0, 0.0], [5.0], [-1.0, -3.0, 2.0, -1.0], [-np.inf, 0.5], [-6, -2, -4, -3, -5]])
    audit = make_audit(("open",) * 5, lengths=[3, 1, 4, 2, 5], step_log_ratio=ratio)
    assert [audit.worst_steps(m) for m in range(5)] == [[1], [], [1, 0, 3], [0], [0, 4, 2, 3, 1]]
    assert audit.worst_steps(4, k=2) == [0, 4]
    np.testing.assert_array_equal(audit.step_log_ratio[audit.steps(2)], [-1.0, -3.0, 2.0, -1.0])


def test_a_copy_of_what_is_labelled_has_its_reason():
    made = make_audit(("good",) * 4 + ("bad",) * 4, anchor="answers", finding="answered", labels={0: 1})
    copied = replace(made, copy_of=np.array([0, 0, *range(2, 8)]))
    assert copied.reasons[1].startswith("Labelled good")
    assert not made.reasons[1].startswith("Labelled good")


def test_demonstrators_are_told_with_their_words_their_style_and_their_trust_if_it_is_known():
    ann, bob = Demonstrator("Ann", Interval(0.8, 0.7, 0.9), (0, 1)), Demonstrator("Bob", None, (2, 3))
    audit = make_audit(("open", "open", "outlier", "open"), lengths=[10, 20, 30, 40], demonstrators=(ann, bob))
    first, second = json.loads(json.dumps(audit.to_dict()))["demonstrators"]
    assert first["trust"] == {"mean": 0.8, "low": 0.7, "high": 0.9}
    assert second == {
        "name": "Bob",
        "trust": None,
        "n_demonstrations": 2,
        "style": "1.40 of the median length",
        "verdicts": {"open": 1, "outlier": 1},
    }
