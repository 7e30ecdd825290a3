"""The table of methods: AUROC against scikit-learn, words against the truth, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

import rpil
from problems import make, one_sentence
from rpil.data.errors import DataError
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.methods import compare_methods
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from small import FAST

TOY = make("random", 0)
DATA = TOY.demonstrations


def table(methods, truth=TOY.is_good, data=DATA, **options):
    """The rows by their methods."""
    rows = compare_methods(methods, data, truth, backend="pyarrow", **options).to_pylist()
    return {row.pop("method"): row for row in rows}


def test_estimators_are_judged_by_their_scores_and_words():
    given = RPIL(settings=FAST)
    found = table({"RPIL": given, "RM-ENT": RMEnt(6), "all": BehavioralCloning()})
    assert not hasattr(given, "audit_")  # it was cloned
    audit, selected = RPIL(settings=FAST).fit(DATA).audit_, RMEnt(6).fit(DATA)
    assert found["RPIL"]["auroc"] == roc_auc_score(TOY.is_good, audit.log_odds)
    right = sum(
        word == ("typical" if good else "unlike") for word, good in zip(audit.verdicts, TOY.is_good, strict=True)
    )
    assert (found["RPIL"]["right"], found["RPIL"]["open"]) == (right, audit.verdicts.count("open"))
    assert found["RM-ENT"]["auroc"] == roc_auc_score(TOY.is_good, selected.log_likelihood_)
    assert found["RM-ENT"]["right"] == ((selected.weights_ == 1) == TOY.is_good).sum()
    assert found["RM-ENT"]["right"] + found["RM-ENT"]["wrong"] == 12
    own = BehavioralCloning().fit(DATA)
    means = [own.log_prob(*episode).mean() for episode in DATA]
    assert found["all"]["auroc"] == roc_auc_score(TOY.is_good, means)
    assert [found["all"][name] for name in ("right", "wrong", "open")] == [0, 0, 12]
    assert all(row["seconds"] > 0 for row in found.values())


def test_a_wrong_word_is_counted_as_wrong():
    found = table({"RM-ENT": RMEnt(6)}, truth=~TOY.is_good)
    upright = table({"RM-ENT": RMEnt(6)})
    assert found["RM-ENT"]["wrong"] == upright["RM-ENT"]["right"] > 6
    assert found["RM-ENT"]["auroc"] == pytest.approx(1 - upright["RM-ENT"]["auroc"])


def test_the_interval_is_that_of_the_bootstrap():
    """Against resamples that are drawn, and scored by scikit-learn; ties count by half."""
    rng = np.random.default_rng(1)
    is_good = np.repeat([True, False], 30)
    score = np.round(is_good + rng.normal(0, 1.2, 60), 1)
    data = make("random", 0, n_good=30, n_bad=30, steps=(2, 3)).demonstrations
    (row,) = table({"score": lambda _: score}, is_good, data).values()
    assert row["auroc"] == pytest.approx(roc_auc_score(is_good, score))
    drawn = [np.concatenate([rng.integers(0, 30, 30), rng.integers(30, 60, 30)]) for _ in range(1000)]
    brute = np.quantile([roc_auc_score(is_good[rows], score[rows]) for rows in drawn], [0.025, 0.975])
    np.testing.assert_allclose([row["auroc_low"], row["auroc_high"]], brute, atol=0.02)


def test_every_method_meets_the_same_resamples_and_a_seed_gives_the_same_bits():
    score = np.random.default_rng(0).normal(size=12)
    found = table({"one": lambda _: score, "two": lambda _: 2 * score}, seed=4)
    again = table({"one": lambda _: score}, seed=4)
    for name in ("auroc", "auroc_low", "auroc_high"):
        assert found["one"][name] == found["two"][name] == again["one"][name]


def test_truth_by_id_may_leave_some_out():
    score = np.arange(12.0)
    truth = {"d0": "bad", "d1": True, "d7": "expert", "d9": np.False_, "d10": 1}
    (row,) = table({"score": lambda _: score}, truth).values()
    assert row["auroc"] == roc_auc_score([0, 1, 1, 0, 1], [0, 1, 7, 9, 10])
    assert row["open"] == 5


@pytest.mark.parametrize(
    ("methods", "truth", "words"),
    [
        ({}, TOY.is_good, "no methods to compare"),
        ([RPIL()], TOY.is_good, "no methods to compare"),
        ({"a": 3}, TOY.is_good, "method 'a' is a int; give an RPIL, an RMEnt or a function"),
        ({"a": lambda d: d.lengths[1:]}, TOY.is_good, "'a' returned no number for some demonstration"),
        ({"a": lambda d: np.full(len(d), np.nan)}, TOY.is_good, "'a' returned no number for some demonstration"),
        ({"a": lambda d: d.lengths}, TOY.is_good[1:], "truth has 11 values for 12 demonstrations"),
        ({"a": lambda d: d.lengths}, {"d99": True, "d1": False}, "no demonstration is called 'd99'"),
        ({"a": lambda d: d.lengths}, {"d0": 0.5, "d1": False}, "demonstration 'd0': truth is 0.5; give True or False"),
        ({"a": lambda d: d.lengths}, {"d0": "great", "d1": False}, "the label 'great' is unknown"),
        ({"a": lambda d: d.lengths}, [True] * 12, "needs a good and a bad demonstration"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_sentence(methods, truth, words):
    with pytest.raises(DataError, match=words) as error:
        compare_methods(methods, DATA, truth)
    assert one_sentence(error)


def test_it_is_public():
    assert rpil.compare_methods is compare_methods
