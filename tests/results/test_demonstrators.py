"""The demonstrators of an audit, in which order they stand, and for which of them a trust is known."""

from __future__ import annotations

import numpy as np

from audits import make_audit
from rpil.data.demonstrator_groups import Demonstrators
from rpil.results.demonstrators import Demonstrator, Interval, known_demonstrators, rank_demonstrators

IDS = ("first", "second", "third", "fourth", "fifth")
NAMES = Demonstrators.from_names(["Ann", "Bob", "Ann", None, "Bob"])
TRUST = np.array([[0.2, 0.1, 0.3], [0.8, 0.7, 0.9], [0.5, 0.0, 1.0]])


def test_demonstrators_are_ranked_by_trust_and_counted_by_verdict():
    bob, ann = rank_demonstrators(NAMES, TRUST, IDS)
    assert (bob.name, bob.demonstrations) == ("Bob", (IDS[1], IDS[4]))
    assert (ann.name, ann.demonstrations) == ("Ann", (IDS[0], IDS[2]))
    audit = make_audit(("unlike", "typical", "open", "typical", "typical"), ids=IDS, demonstrators=(bob, ann))
    assert audit.verdict_counts(bob.demonstrations) == {"typical": 2, "open": 0, "unlike": 0}
    assert audit.verdict_counts(ann.demonstrations) == {"typical": 0, "open": 1, "unlike": 1}
    assert bob.trust == Interval(0.8, 0.7, 0.9)
    assert rank_demonstrators(Demonstrators(), TRUST, IDS) == ()


def test_without_trust_demonstrators_stand_in_the_order_of_the_data():
    found = rank_demonstrators(NAMES, np.empty((0, 3)), IDS)
    assert [(who.name, who.trust) for who in found] == [("Ann", None), ("Bob", None)]


def test_the_demonstrators_of_an_audit_are_those_that_it_was_given():
    found = known_demonstrators(rank_demonstrators(NAMES, TRUST, IDS), IDS)
    np.testing.assert_array_equal(found.indicator, NAMES.indicator)
    assert found.names == NAMES.names
    assert known_demonstrators((), IDS).names == ()
    assert known_demonstrators((Demonstrator("Ann", None, ("fifth",)),), IDS).names == (None, None, None, None, "Ann")
