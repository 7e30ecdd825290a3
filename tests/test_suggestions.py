"""Which labels are asked for, and why."""

from __future__ import annotations

import numpy as np
import pytest

from audits import make_audit
from problems import make
from rpil import RPIL, AmbiguousWarning, DataError, load, save
from rpil.audit.label_choice import NEXT, middle, suggest
from rpil.inference.judgement import FINDINGS


def test_every_finding_has_something_to_do_next():
    assert NEXT.keys() == FINDINGS.keys()
    assert all(sentence.endswith(".") and sentence.count(". ") == 0 for sentence in NEXT.values())


def test_which_label_settles_most_pairs():
    """Where rank r is an expert's with probability r, by counting pairs over random truths; the middle first."""
    size, draws = 11, 20_000
    rank = (np.arange(size) + 0.5) / size
    good = np.random.default_rng(0).random((draws, size)) < rank
    bad_above = (~good)[:, ::-1].cumsum(axis=1)[:, ::-1] - ~good
    good_below = good.cumsum(axis=1) - good
    wrong = np.where(good, bad_above, good_below).mean(axis=0)
    np.testing.assert_array_equal(middle(np.arange(size)), np.argsort(-(wrong + wrong[::-1]), kind="stable"))
    np.testing.assert_allclose(wrong, (size / 2 - 1) * rank * (1 - rank), atol=0.03)
    size = 21
    shuffled = np.random.default_rng(1).permutation(size)
    log_odds = np.empty(size)
    log_odds[shuffled] = np.sort(np.random.default_rng(2).normal(size=size) ** 3)
    asked = middle(log_odds)
    assert asked[0] == shuffled[10]
    assert set(asked[:5]) == set(shuffled[8:13])
    assert set(asked[-2:]) == {shuffled[0], shuffled[-1]}


def test_the_order_counts_and_not_how_sure():
    """An audit that trusts too many asks the same as one that does not."""
    log_odds = np.random.default_rng(0).normal(size=12)
    assert suggest(log_odds, [], [], 4) == suggest(np.exp(log_odds) + 5.0, [], [], 4)


def test_competing_groups_come_first_and_labels_are_not_asked_again():
    log_odds = np.array([-9.0, -8.0, 0.0, 1.0, 7.0, 8.0, 9.0])
    assert suggest(log_odds, [], [], 1) == [3]
    assert suggest(log_odds, [6, 0], [], 1) == [6]
    assert suggest(log_odds, [6, 0], [], 3) == [6, 0, 3]
    assert suggest(log_odds, [6, 0], [6, 3], 2) == [0, 2]
    assert suggest(log_odds, [], [3, 4, 5, 6], 1) == [1]  # in the middle of those that are left
    assert sorted(suggest(log_odds, [6], [3], 60)) == [0, 1, 2, 4, 5, 6]


def test_of_an_audit():
    audit = make_audit()
    asked = audit.suggest_labels(3)
    assert {audit.index(name) for name in asked} <= set(audit.ranking()[3:7])
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
