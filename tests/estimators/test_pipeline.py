"""`RPIL` with the judge: order, styles, minorities, labels, and policies of the user."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.metrics import roc_auc_score

from problems import fit_data_of, make, make_continuous, two_styles
from rpil import RPIL, DataError
from rpil.audit.summary import longest_unlabelled
from rpil.data.demonstrations import Demonstrations
from rpil.inference.findings import FINDINGS

STEPS = (40, 60)


@pytest.mark.parametrize("toy", [make("noisy", 0, steps=(30, 30)), make_continuous("noisy", 0, steps=(30, 30))])
def test_order_of_demonstrations_does_not_matter(toy):
    order = np.random.default_rng(1).permutation(len(toy.ids))
    rows = np.concatenate([np.arange(toy.offsets[m], toy.offsets[m + 1]) for m in order])
    lengths = np.diff(toy.offsets)[order]
    shuffled = Demonstrations.from_arrays(
        toy.observations[rows], toy.actions[rows], np.concatenate([[0], np.cumsum(lengths)])
    )
    one, two = RPIL().fit(toy.demonstrations), RPIL().fit(shuffled)
    np.testing.assert_allclose(two.log_odds_, one.log_odds_[order], atol=0.05)
    assert two.audit_.verdicts == tuple(one.audit_.verdicts[m] for m in order)


@pytest.fixture(scope="module")
def few() -> RPIL:
    """Fitted to so few steps that another deal of folds changes the verdicts."""
    return RPIL().fit(make("random", 3, n_good=7, n_bad=4, steps=(13, 13)).demonstrations)


@pytest.mark.parametrize("names", [*permutations(range(3)), ("right", "left", "none")])
def test_names_of_actions_change_nothing(few, names):
    toy = make("random", 3, n_good=7, n_bad=4, steps=(13, 13))
    renamed = Demonstrations.from_arrays(toy.observations, np.array(names)[toy.actions], toy.offsets)
    audit = RPIL().fit(renamed).audit_
    np.testing.assert_allclose(audit.log_odds, few.log_odds_, atol=1e-6)
    assert (audit.finding, audit.verdicts) == (few.audit_.finding, few.audit_.verdicts)


def test_opposed_styles_are_listed_and_a_label_decides():
    data, second = two_styles(0)
    with pytest.warns(UserWarning, match="label one demonstration"):
        audit = RPIL().fit(data).audit_
    assert set(audit.verdicts) == {"open"}
    assert {frozenset(group) for group in audit.competing} == {
        frozenset(np.flatnonzero(side).tolist()) for side in (second, ~second)
    }
    for style in (second, ~second):
        told = int(np.flatnonzero(style)[0])
        assert roc_auc_score(style, RPIL().fit(data, labels={told: "good"}).audit_.log_odds) == 1.0


def test_similar_styles_are_listed_without_a_warning():
    data, second = two_styles(1, above=1.2)
    audit = RPIL().fit(data).audit_
    assert audit.finding == "nobody stands out"
    assert audit.identifiable
    assert {frozenset(group) for group in audit.competing} == {
        frozenset(np.flatnonzero(side).tolist()) for side in (second, ~second)
    }
    assert np.ptp(audit.expert_proba) > 0
    told, other = int(np.flatnonzero(second)[0]), int(np.flatnonzero(~second)[0])
    one = RPIL().fit(data, labels={told: "good"}).audit_
    assert roc_auc_score(second, one.log_odds) == 1.0
    assert one.verdicts.count("open") == 15
    both = RPIL().fit(data, labels={told: "good", other: "bad"}).audit_
    assert (np.array(both.verdicts) == np.where(second, "good", "bad")).all()


@pytest.mark.parametrize(("minority", "finding"), [("ask", "two groups"), ("distrust", "some are unlike")])
def test_minority_parameter_decides_about_a_rival(minority, finding):
    toy = make("shifted", 1, n_good=8, n_bad=4, steps=STEPS)
    audit = RPIL(minority=minority).fit(toy.demonstrations).audit_ if minority != "ask" else None
    if audit is None:
        with pytest.warns(UserWarning, match="label one demonstration"):
            audit = RPIL().fit(toy.demonstrations).audit_
        assert set(audit.verdicts) == {"open"}
        assert (audit.expert_proba == 0.5).all()
    else:
        assert audit.verdicts == ("typical",) * 8 + ("unlike",) * 4
    assert audit.finding == finding
    trusting = RPIL(minority="trust").fit(toy.demonstrations).audit_
    assert "unlike" not in trusting.verdicts


def test_log_odds_are_the_sum_of_their_parts():
    toy = make("random", 0, steps=STEPS)
    who = ["Ann"] * 3 + ["Bob"] * 3 + ["Cid"] * 6
    audit = RPIL(labels={"d0": "good"}).fit(toy.demonstrations, demonstrators=who).audit_
    np.testing.assert_allclose(sum(audit.evidence.values()), audit.log_odds)
    assert audit.from_label[0] > 0
    assert not audit.from_label[1:].any()
    assert audit.from_demonstrator.any()
    assert audit.finding in FINDINGS


def test_labelled_demonstrations_are_not_asked_for_again():
    toy = make("flipped", 0, n_good=6, n_bad=6, steps=STEPS)
    with pytest.warns(UserWarning, match="label one demonstration"):
        first = RPIL().fit(toy.demonstrations).audit_.to_label
    assert len(first) == 2
    problem = fit_data_of(toy, np.array([m == first[0] for m in toy.ids], dtype=int))
    again = longest_unlabelled(problem, (np.arange(6), np.arange(6, 12)))
    assert len(again) == 2
    assert f"d{again[0]}" not in first or f"d{again[1]}" not in first
    assert longest_unlabelled(problem.select(again[:1]), (np.zeros(1, dtype=int),)) == [0]
    assert longest_unlabelled(replace(problem, labels=np.ones(12, dtype=int)), (np.arange(6),)) == []


@pytest.mark.parametrize("large", [1.0, 1e12])
def test_user_policy_with_repeated_columns(large):
    toy = make("none", 0, n_good=8, n_bad=4, steps=STEPS)
    twice = np.hstack([toy.observations, toy.observations[:, :1], np.zeros((len(toy.actions), 1))]) * large
    audit = RPIL(policy=LogisticRegression()).fit(twice, toy.actions, groups=toy.groups).audit_
    assert set(audit.verdicts) <= {"open", "typical"}


def test_user_policy_scores_demonstrations_as_it_judged_them():
    for toy, policy in ((make("random", 0, n_good=8, n_bad=6, steps=STEPS), LogisticRegression()),):
        model = RPIL(policy=policy).fit(toy.demonstrations)
        again = model.score_demonstrations(toy.demonstrations)
        assert ((again > 0) == (model.audit_.log_odds > 0)).all()
    toy = make_continuous("random", 0, n_good=8, n_bad=6, steps=(40, 60))
    far = Demonstrations.from_arrays(toy.observations, 50 * toy.actions, toy.offsets, toy.ids)
    model = RPIL(policy=Ridge()).fit(far)
    assert ((model.score_demonstrations(far) > 0) == (model.audit_.log_odds > 0)).all()


def test_observations_with_infinite_squares_are_refused():
    toy = make("random", 0, steps=STEPS)
    with pytest.raises(DataError, match=r"beyond 1e\+150, where its square is no number; use larger units"):
        RPIL().fit(1e300 * toy.observations, toy.actions, groups=toy.groups)
