"""Which labels are asked for, and why."""

from __future__ import annotations

import numpy as np
import pytest

from audits import make_audit
from problems import make
from rpil import RPIL, AmbiguousWarning, DataError, load, save
from rpil.suggestions import opinions, suggest

SAME = np.full(6, 50)


def test_different_opinions_only():
    one, other = np.array([0.9, 0.9, 0.1]), np.array([0.9, 0.1, 0.1])
    found = opinions(one, [one - 0.05, other, other + 0.1, 1 - one])
    np.testing.assert_array_equal(found, [one, other, 1 - one])


def test_who_is_disputed_is_asked_about():
    """Two solutions differ on 2 and 3; that 5 is uncertain in both tells nothing of the others."""
    solutions = np.array([[0.99, 0.99, 0.99, 0.99, 0.01, 0.5], [0.99, 0.99, 0.01, 0.01, 0.01, 0.5]])
    assert suggest(solutions, [], [], SAME, 1)[0] in (2, 3)
    lengths = np.where(np.arange(6) == 3, 80, 50)
    asked = suggest(solutions, [], [], lengths, 3)
    assert asked[0] == 3  # the longer of two that tell the same
    assert set(asked[1:]) == {2, 5}


def test_answers_complement_each_other():
    """One label splits the four solutions in two, the second splits these again."""
    first, second = np.array([0.97, 0.97, 0.97, 0.5, 0.5, 0.5]), np.array([0.5, 0.5, 0.5, 0.97, 0.97, 0.97])
    half = np.arange(6) < 3
    solutions = np.array(
        [np.where(half, a, b) for a in (first, 1 - first) for b in (second, 1 - second)],
    )
    one, other = suggest(solutions, [], [], SAME, 2)
    assert (one < 3) != (other < 3)


def test_competing_groups_come_first_and_labels_are_not_asked_again():
    solutions = np.array([[0.5, 0.5, 0.5, 0.5, 0.02, 0.6]])
    groups = [np.array([0, 1]), np.array([2, 3])]
    assert suggest(solutions, groups, [1, 3], SAME, 1) == [1]
    assert suggest(solutions, groups, [1, 3], SAME, 3)[:2] == [1, 3]
    solutions[0, 1] = np.nan
    assert 1 not in suggest(solutions, [], [], SAME, 6)
    assert len(suggest(solutions, [], [], SAME, 60)) == 5


def test_of_an_audit():
    audit = make_audit(solutions=np.empty((0, 0)))
    asked = audit.suggest_labels(3)
    assert len(set(asked)) == 3
    assert "uncertain" in [audit.verdicts[audit.index(name)] for name in asked]
    labelled = make_audit(labelled=asked)
    assert not set(asked) & set(labelled.suggest_labels(10))
    assert len(labelled.suggest_labels(100)) == 7
    with pytest.raises(DataError, match="ask for one at least"):
        audit.suggest_labels(0)


def test_of_a_fit_and_back_from_a_file(tmp_path):
    toy = make("noisy", 0, n_good=6, n_bad=6)
    model = RPIL(adversary="uniform").fit(toy.demonstrations, labels={"d0": "expert"})
    audit = model.audit_
    assert audit.labelled == ("d0",)
    assert audit.solutions.shape[1] == 12
    assert "d0" not in audit.suggest_labels(12)
    assert len(audit.suggest_labels(12)) == 11
    save(model, tmp_path / "model")
    assert load(tmp_path / "model").audit_.suggest_labels(4) == audit.suggest_labels(4)


def test_the_first_suggestion_settles_competing_groups():
    toy = make("flipped", 3, n_actions=4, n_good=6, n_bad=6, steps=(60, 60))
    with pytest.warns(AmbiguousWarning):
        audit = RPIL().fit(toy.demonstrations).audit_
    (asked,) = audit.suggest_labels(1)
    assert asked == audit.to_label[0]
    truth = dict(zip(toy.ids, toy.is_good, strict=True))
    found = RPIL().fit(toy.demonstrations, labels={asked: "expert" if truth[asked] else "adversary"}).audit_
    assert found.identifiable
    assert [verdict == "expert" for verdict in found.verdicts] == toy.is_good.tolist()
