"""Labels decide which of two groups is the expert's."""

from __future__ import annotations

import pytest

from problems import make
from rpil import RPIL

STEPS = (40, 60)


@pytest.mark.parametrize("seed", range(2))
def test_label_of_any_expert_decides_between_two_groups(seed):
    toy = make("flipped", seed, n_good=6, n_bad=6, steps=STEPS)
    for m in range(seed, 6, 4):
        audit = RPIL().fit(toy.demonstrations, labels={f"d{m}": "good"}).audit_
        assert set(audit.verdicts[:6]) <= {"good", "open"}, m
        assert audit.verdicts[6:] == ("bad",) * 6, m


def test_trusted_minority_stays_trusted_with_labelled_experts():
    toy = make("shifted", 1, n_good=8, n_bad=4, steps=STEPS)
    for labels in ({"d9": "good"}, {"d1": "good"}):
        audit = RPIL(minority="trust").fit(toy.demonstrations, labels=labels).audit_
        assert "bad" not in audit.verdicts


def test_labelled_experts_in_both_groups_give_no_adversaries():
    toy = make("shifted", 1, n_good=8, n_bad=4, steps=STEPS)
    audit = RPIL().fit(toy.demonstrations, labels={"d1": "good", "d9": "good"}).audit_
    assert "bad" not in audit.verdicts
    assert audit.finding != "two groups"
