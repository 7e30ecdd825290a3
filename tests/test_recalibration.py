"""Labels that the fit did not see correct P(expert), and leave the ranking alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from audits import make_audit
from rpil import DataError
from rpil.audit.calibration import Recalibration


def test_too_sure_is_found_out():
    rng = np.random.default_rng(0)
    true = rng.normal(0.5, 1.5, size=4000)
    expert = rng.random(4000) < expit(true)
    found = Recalibration.fit(5.0 * true - 2.0, expert)  # so true = (reported + 2) / 5
    assert found.slope == pytest.approx(0.2, rel=0.1)
    assert found.offset == pytest.approx(0.4, abs=0.1)


def test_right_stays_right_and_few_labels_change_little():
    rng = np.random.default_rng(1)
    true = rng.normal(0.0, 2.0, size=4000)
    expert = rng.random(4000) < expit(true)
    found = Recalibration.fit(true, expert)
    assert (found.slope, found.offset) == (pytest.approx(1.0, abs=0.1), pytest.approx(0.0, abs=0.1))
    few = Recalibration.fit(np.array([30.0, -30.0, 30.0, -30.0]), np.array([True, False, True, False]))
    assert few.slope == pytest.approx(1.0, abs=0.01)
    assert few.offset == pytest.approx(0.0, abs=0.01)


def test_one_sort_of_labels_does_not_run_away():
    found = Recalibration.fit(np.full(6, -1.0), np.ones(6, dtype=bool))  # adversaries, it said, and all are experts
    assert 0 < found.log_odds(np.array([-1.0]))[0] < 4
    assert 0.1 < found.slope < 1


def test_order_stays_however_sure():
    z = np.array([-1e9, -300.0, -21.0, -20.0, 0.0, 19.9, 20.0, 25.0, 1e9])
    out = Recalibration(0.1, 1.0).log_odds(z)
    assert (np.diff(out) > 0).all()
    np.testing.assert_allclose(out[[2, 4, 7]], [-1.0, 1.0, 3.0], atol=0.01)


def audit():
    return make_audit()


def test_an_audit_calibrated():
    before = audit()
    names, sure = before.ids, np.argsort(before.log_odds)
    labels = {names[m]: "adversary" for m in sure[-4:]}  # those it trusts most are bad
    after = before.calibrated(labels)
    rest = sure[:-4]
    np.testing.assert_array_equal(np.argsort(after.log_odds[rest]), np.argsort(before.log_odds[rest]))
    assert (after.expert_proba[sure[-4:]] < 1e-6).all()
    assert set(after.labelled) == set(labels)
    assert all(after.verdicts[m] == "adversary" for m in sure[-4:])
    assert "Calibrated on 4 labels" in after.assumptions[-1]
    assert (after.step_weight <= np.repeat(after.expert_proba, after.lengths) + 1e-12).all()
    assert before.labelled == ()
    np.testing.assert_allclose(sum(after.evidence.values()), after.log_odds, atol=1e-9)
    assert (after.evidence["label"] != 0).sum() == 4


@pytest.mark.parametrize(
    ("labels", "match"),
    [
        ({}, "0 labels that the fit did not see are too few to calibrate with; give 4 at least"),
        ({"nobody": "expert"}, "no demonstration is called 'nobody'"),
        ({0: "perhaps"}, "Demonstration 0: the label 'perhaps' is unknown; use 'expert' or 'adversary'"),
    ],
)
def test_bad_labels_are_one_sentence(labels, match):
    with pytest.raises(DataError, match=match) as error:
        audit().calibrated(labels)
    assert ". " not in str(error.value)
