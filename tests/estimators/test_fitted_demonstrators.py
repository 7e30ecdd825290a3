"""Who gave which demonstration: exact sums, shrinkage both ways, and no harm where it means nothing."""

from __future__ import annotations

import numpy as np
import pytest

from problems import make, refused
from rpil import RPIL

LABELS = {0: "good", 1: "good", 9: "bad", 10: "bad"}


def people(seed: int = 0, short: int = 8):
    """Ann gives good demonstrations and Bob random ones; then short good ones by Ann, Bob and somebody unknown."""
    toy = make("random", seed, n_good=9, n_bad=6, steps=(40, 40))
    lengths = np.diff(toy.offsets)
    kept = np.concatenate([np.arange(40) < (40 if not 6 <= m < 9 else short) for m in range(15)])
    first = toy.offsets[6]  # the same steps for all three
    observations, actions = toy.observations.copy(), toy.actions.copy()
    for m in (7, 8):
        observations[toy.offsets[m] : toy.offsets[m] + short] = observations[first : first + short]
        actions[toy.offsets[m] : toy.offsets[m] + short] = actions[first : first + short]
    ids = np.repeat(np.arange(15), lengths)
    who = {**dict.fromkeys(range(7), "Ann"), 7: "Bob", **dict.fromkeys(range(9, 15), "Bob")}
    return observations[kept], actions[kept], ids[kept], who


@pytest.fixture(scope="module")
def fitted():
    X, y, groups, who = people()
    return RPIL().fit(X, y, groups, demonstrators=who, labels=LABELS)


def test_answers_to_an_audit_tell_as_much_of_demonstrators_as_answers_to_the_fit(fitted):
    X, y, groups, who = people()
    asked = RPIL().fit(X, y, groups, demonstrators=who).audit_
    assert [one.trust for one in asked.demonstrators] == [None, None]
    answered = asked.answered(LABELS)
    np.testing.assert_allclose(answered.log_odds, fitted.audit_.log_odds)
    np.testing.assert_allclose(answered.from_demonstrator, fitted.audit_.from_demonstrator)
    np.testing.assert_allclose(answered.expert_proba, fitted.audit_.expert_proba)
    assert answered.verdicts == fitted.audit_.verdicts
    assert [one.name for one in answered.demonstrators] == ["Ann", "Bob"]
    for one, other in zip(answered.demonstrators, fitted.audit_.demonstrators, strict=True):
        assert one.trust.mean == pytest.approx(other.trust.mean)
    assert answered.prior.mean == pytest.approx(fitted.audit_.prior.mean)


def test_uninformative_demonstrators_change_no_bit():
    X, y, groups, _ = people()
    model = RPIL()
    alone = model.fit(X, y, groups).log_odds_
    for useless, said in ((["Ann"] * 15, "One demonstrator"), (range(15), "No demonstrator gave two")):
        with pytest.warns(UserWarning, match=said):
            model.fit(X, y, groups, demonstrators=useless)
        np.testing.assert_array_equal(model.log_odds_, alone)
        assert model.audit_.demonstrators == ()
        assert any(said in sentence for sentence in model.audit_.assumptions)


@pytest.mark.parametrize(
    ("demonstrators", "match"),
    [
        ({99: "Ann"}, "no demonstration is called '99'; the ids are '0', '1', '2', '3', '4', ...; correct the demonst"),
        ({0: ["Ann"]}, r"demonstration 0: the demonstrator \['Ann'\] is no name; give text or a number"),
        (["Ann", "Bob"], r"shape \(2,\); give one for each of the 15 demonstrations"),
        (np.zeros((15, 2)), r"shape \(15, 2\)"),
    ],
)
def test_invalid_demonstrators_are_refused_in_one_sentence(demonstrators, match):
    X, y, groups, _ = people()
    with refused(match):
        RPIL().fit(X, y, groups, demonstrators=demonstrators)
