"""The audit: its methods give what its fields hold."""

from __future__ import annotations

import json

import numpy as np
import pytest

from audits import make_audit
from rpil.audit.settings import AuditSettings, CalibrationSettings
from rpil.data.errors import DataError


def test_worst_steps_are_the_most_negative_and_never_positive():
    ratio = np.concatenate([[1.0, -2.0, 0.0], [5.0], [-1.0, -3.0, 2.0, -1.0], [-np.inf, 0.5], [-6, -2, -4, -3, -5]])
    audit = make_audit(("typical",) * 5, lengths=[3, 1, 4, 2, 5], step_log_ratio=ratio)
    assert [audit.worst_steps(m) for m in range(5)] == [[1], [], [1, 0, 3], [0], [0, 4, 2, 3, 1]]
    assert audit.worst_steps(4, k=2) == [0, 4]
    np.testing.assert_array_equal(audit.step_log_ratio[audit.steps(2)], [-1.0, -3.0, 2.0, -1.0])


def test_to_dict_has_the_documented_keys_and_is_json():
    log_odds = np.array([1.0, 2.0, -30.0, 0.0, -1.0])
    audit = make_audit(("typical",) * 5, ids=list("abcde"), lengths=[3, 1, 4, 2, 5], log_odds=log_odds)
    content = json.loads(json.dumps(audit.to_dict(), allow_nan=False))
    keys = {"n_demonstrations", "n_steps", "finding", "anchor", "adversary", "prior", "identifiable", "demonstrations"}
    assert set(content) == keys | {"groups", "to_label", "assumptions", "demonstrators"}
    assert set(content["prior"]) == {"mean", "low", "high"}
    keys = {"id", "n_steps", "log_odds", "evidence", "expert_proba", "reliability", "verdict", "reason", "worst_steps"}
    assert all(set(entry) == keys for entry in content["demonstrations"])
    assert [entry["id"] for entry in content["demonstrations"]] == ["b", "a", "d", "e", "c"]  # the most trusted first
    assert content["groups"] == []
    assert (content["n_demonstrations"], content["n_steps"]) == (5, 15)
    assert [entry["n_steps"] for entry in content["demonstrations"]] == [1, 3, 2, 5, 4]


def test_index_of_an_id():
    audit = make_audit(ids=list("abcdefghij"))
    assert audit.index("c") == 2
    with pytest.raises(DataError, match="No demonstration is called 'z'"):
        audit.index("z")


def test_suggested_labels_are_those_of_the_middle_without_a_label():
    audit = make_audit()
    suggested = audit.suggest_labels(3)
    assert {audit.index(name) for name in suggested} <= set(audit.ranking()[3:7])
    labelled = make_audit(labelled=suggested)
    assert not set(suggested) & set(labelled.suggest_labels(10))
    assert len(labelled.suggest_labels(100)) == 7
    with pytest.raises(DataError, match="ask for one at least"):
        audit.suggest_labels(0)


def test_calibrated_audit_follows_the_labels_and_keeps_the_order():
    before = make_audit()
    order = np.argsort(before.log_odds)
    most_trusted, others = order[-4:], order[:-4]
    labels = {before.ids[m]: "bad" for m in most_trusted}
    after = before.calibrated(labels)
    np.testing.assert_array_equal(np.argsort(after.log_odds[others]), np.argsort(before.log_odds[others]))
    assert (after.expert_proba[most_trusted] < 1e-6).all()
    assert set(after.labelled) == set(labels)
    assert all(after.verdicts[m] == "bad" for m in most_trusted)
    assert (after.finding, after.anchor, after.words.probability) == ("answered", "answers", "P(good)")
    assert "4 labels" in after.assumptions[-1]
    assert (after.step_weight <= np.repeat(after.expert_proba, after.lengths) + 1e-12).all()
    assert before.labelled == ()
    np.testing.assert_allclose(sum(after.evidence.values()), after.log_odds, atol=1e-9)
    assert (after.evidence["label"] != 0).sum() == 4


def test_number_of_labels_for_calibration_is_a_setting():
    settings = AuditSettings(calibration=CalibrationSettings(min_labels=1))
    assert make_audit().calibrated({0: "bad"}, settings).labelled == (0,)
    assert make_audit(settings=settings).calibrated({0: "bad"}).labelled == (0,)


@pytest.mark.parametrize(
    ("labels", "match"),
    [
        ({}, "0 labels that the fit did not see are too few to calibrate with; give at least 4"),
        ({"nobody": "good"}, "no demonstration is called 'nobody'"),
        ({0: "perhaps"}, "Demonstration 0: the label 'perhaps' is unknown; use 'good' or 'bad'"),
    ],
)
def test_unusable_calibration_labels_are_refused_in_one_sentence(labels, match):
    with pytest.raises(DataError, match=match) as error:
        make_audit().calibrated(labels)
    assert ". " not in str(error.value)


def test_competing_groups_cannot_be_calibrated():
    with pytest.raises(DataError, match="fit with one label before"):
        make_audit(identifiable=False).calibrated({})
