"""`RPIL` with the judge: order, styles, labels, and policies of the user."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge

import rpil
from problems import make, make_continuous, refused
from rpil import RPIL
from rpil.data.demonstrations import Demonstrations

STEPS = (40, 60)


@pytest.mark.parametrize(("policy", "width"), [(None, 2), (LogisticRegression(), 2), (LogisticRegression(), 201)])
def test_a_learner_trusts_the_larger_part_by_linear_policies_and_says_so(policy, width):
    """Whatever its own policy is, and of many columns; labels of both parts turn it, and an audit looks for none."""
    toy = make("flipped", 0, n_good=10, n_bad=5, steps=STEPS)
    toy = replace(toy, observations=toy.observations @ np.random.default_rng(0).normal(size=(2, width)))
    model = RPIL(policy=policy).fit(toy.demonstrations)
    np.testing.assert_array_equal(model.audit_.part, np.where(toy.is_good, 1, -1))
    np.testing.assert_array_equal(model.audit_.step_weight, toy.is_good[toy.groups])
    assert "The policy trusts 10 of 15 that agree; two labels can change this." in model.audit_.notes
    turned = RPIL(policy=policy).fit(toy.demonstrations, labels={"d0": "bad", "d14": "good"})
    np.testing.assert_array_equal(turned.audit_.step_weight, ~toy.is_good[toy.groups])
    assert not any("trusts" in note for note in turned.audit_.notes)
    assert (model.predict(toy.observations) == turned.predict(toy.observations)).mean() < 0.6
    assert not rpil.audit(toy.demonstrations).part.any()


def test_observations_with_infinite_squares_are_refused():
    toy = make("random", 0, steps=STEPS)
    with refused(r"observation '0' is beyond 1e\+150, where a square is no number; use larger units"):
        RPIL().fit(1e300 * toy.observations.clip(min=0), toy.actions, groups=toy.groups)


@pytest.mark.parametrize(
    ("maker", "numbers"), [(make, [*range(18)]), (make_continuous, [17] * 10), (make, [3, 3, 12]), (make, [0] * 10)]
)
def test_copies_change_no_score_and_no_word_of_the_others(maker, numbers):
    toy = maker("random", 3, n_good=12, n_bad=6)
    every = np.concatenate([np.arange(18), numbers])
    once, more = RPIL(C=1.0).fit(toy.demonstrations).audit_, with_copies(toy.demonstrations, every)
    found = RPIL(C=1.0).fit(more).audit_
    np.testing.assert_array_equal(found.log_odds, once.log_odds[every])
    np.testing.assert_array_equal(found.columns, once.columns[every])
    np.testing.assert_array_equal(found.reliability, once.reliability[every])
    assert found.verdicts == tuple(once.verdicts[m] for m in every)
    assert "outlier" in found.verdicts
    assert (found.finding, found.pair) == (once.finding, once.pair)
    steps = np.concatenate([np.arange(once.offsets[m], once.offsets[m + 1]) for m in every])
    np.testing.assert_array_equal(found.step_log_ratio, once.step_log_ratio[steps])
    sentence = f"{len(numbers)} demonstrations are copies of {len(set(numbers))} other"
    assert sum(note.startswith(sentence) for note in found.notes) == 1
    assert not any("copies" in note for note in once.notes)


def with_copies(demonstrations: Demonstrations, every) -> Demonstrations:
    """The demonstrations at the places `every`, under ids of their own."""
    rows = np.concatenate([np.arange(*demonstrations.offsets[m : m + 2]) for m in every])
    offsets = np.append(0, np.cumsum(demonstrations.lengths[every]))
    ids = [*demonstrations.ids, *(f"copy {k}" for k in range(len(every) - len(demonstrations)))]
    return Demonstrations(demonstrations.observations[rows], demonstrations.actions[rows], offsets, ids)


@pytest.mark.parametrize("policy", [None, "own"])
def test_nothing_is_learned_from_copies_of_one_demonstration(policy):
    toy = make_continuous("random", 3, n_good=1, n_bad=1)
    own = Ridge() if policy else None
    audit = RPIL(policy=own).fit(Demonstrations.from_episodes([toy.demonstrations[0]] * 6)).audit_
    assert (audit.finding, audit.pair, audit.question) == ("nothing could be learned", (), None)
    assert set(audit.verdicts) == {"open"}
    assert np.ptp(audit.log_odds) == 0
    assert "All 6 demonstrations are copies of one: there is nothing to compare." in audit.notes
