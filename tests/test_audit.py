"""What the user is told follows from the posterior by rules that are written down."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.special import logit

from audits import make_audit
from problems import make, pooled_state
from rpil import RPIL
from rpil.audit.record import SURE, Audit, Interval
from rpil.audit.summary import WHOLE, step_weight, summarise
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.mixture.em import Posterior, Result, run

SHARE = Interval(0.3, 0.2, 0.4)
IDS = ("a", "b", "c", "d", "e")
LENGTHS = np.array([3, 1, 4, 2, 5])


def told(
    log_odds: tuple[float, ...],
    *,
    labels: tuple[int, ...] = (0,) * 5,
    log_ratio: np.ndarray | None = None,
) -> Audit:
    """The audit of five demonstrations."""
    offsets = np.concatenate([[0], np.cumsum(LENGTHS)])
    n = int(offsets[-1])
    problem = FitData(np.ones((n, 1)), np.zeros(n, dtype=int), offsets, Discrete(3), np.array(labels))
    state = pooled_state(problem, "uniform")
    ratio = np.linspace(-1, 1, n) if log_ratio is None else log_ratio
    posterior = Posterior(np.array(log_odds), np.zeros(5), np.zeros(5), ratio, np.zeros((n, 3)))
    result = Result(state, posterior, np.array([-2.0, -1.0]), True)
    return summarise(problem, result, SHARE, IDS)


def test_verdict_thresholds():
    edge = float(logit(SURE))
    found = told((edge + 1e-6, edge - 1e-6, 0.0, -edge + 1e-6, -edge - 1e-6))
    assert found.verdicts == ("expert", "uncertain", "uncertain", "uncertain", "adversary")
    np.testing.assert_allclose(found.expert_proba, 1 / (1 + np.exp(-found.log_odds)))


def test_labels_are_as_good_as_certain():
    found = told((-50.0, 50.0, -1.0, 1.0, 3.0), labels=(1, -1, 1, -1, 0))
    assert found.verdicts == ("expert", "adversary", "expert", "adversary", "expert")
    np.testing.assert_allclose(found.log_odds, [50.0, -50.0, 20.0, -20.0, 3.0])


def test_log_odds_are_finite():
    found = told((np.inf, -np.inf, 0.0, 1e6, -1e6), labels=(0, 0, 0, 0, 1))
    assert np.isfinite(found.log_odds).all()
    assert found.verdicts[:2] == ("expert", "adversary")
    np.testing.assert_allclose(found.log_odds[2:], [0.0, 1e6, 1e6])
    json.dumps(found.to_dict(), allow_nan=False)


def test_where_two_groups_compete_all_are_uncertain_and_one_of_each_is_asked_about():
    toy = make("shifted", 1, steps=(40, 60))
    with pytest.warns(UserWarning, match="two groups of demonstrations"):
        found = RPIL().fit(toy.demonstrations).audit_
    assert set(found.verdicts) == {"uncertain"}
    assert (found.expert_proba == 0.5).all()
    assert not found.identifiable
    assert {frozenset(group) for group in found.competing} == {frozenset(toy.ids[:6]), frozenset(toy.ids[6:])}
    lengths = dict(zip(toy.ids, np.diff(toy.offsets).tolist(), strict=True))
    assert [lengths[name] for name in found.to_label] == [
        max(lengths[name] for name in group) for group in found.competing
    ]
    assert told((1.0,) * 5).identifiable


def test_worst_steps_are_the_most_negative_first_and_no_positive_ones():
    ratio = np.concatenate([[1.0, -2.0, 0.0], [5.0], [-1.0, -3.0, 2.0, -1.0], [-np.inf, 0.5], [-6, -2, -4, -3, -5]])
    found = told((0.0,) * 5, log_ratio=ratio)
    assert [found.worst_steps(m) for m in range(5)] == [[1], [], [1, 0, 3], [0], [0, 4, 2, 3, 1]]
    assert found.worst_steps(4, k=2) == [0, 4]
    np.testing.assert_array_equal(found.step_log_ratio[found.steps(2)], [-1.0, -3.0, 2.0, -1.0])


def test_all_steps_of_a_demonstration_are_trusted_alike():
    found = told((50.0, -50.0, 0.0, 2.0, -2.0))
    np.testing.assert_array_equal(found.reliability, found.expert_proba)
    np.testing.assert_array_equal(found.reliability_interval, found.expert_proba[:, None] * [1, 1])
    np.testing.assert_array_equal(found.step_weight, np.repeat(found.expert_proba, LENGTHS))


def weighed(proba: list[float], reliability: list[float]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Weights of the steps of each demonstration, and P(the step is an expert's) of each."""
    step, ends = np.linspace(0, 1, 15), np.cumsum(LENGTHS)[:-1]
    weight = step_weight(LENGTHS, np.array(proba), np.array(reliability), step)
    return np.split(weight, ends), np.split(step, ends)


def test_weights_of_steps():
    """Every step of a wholly reliable expert counts in full; others as far as they are the expert's."""
    found, step = weighed([1.0, 0.0, 1.0, 0.0, 0.5], [1.0, 1.0, 0.5, 0.5, WHOLE])
    np.testing.assert_allclose(found[0], 1.0)
    np.testing.assert_allclose(found[1], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[2], step[2])
    np.testing.assert_allclose(found[3], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[4], 0.5)


def test_what_all_experts_fail_in_is_the_policys_misfit():
    """Where the typical expert is only half reliable, so is the policy: all of their steps are trained on."""
    found, step = weighed([1.0, 1.0, 1.0, 1.0, 0.0], [0.5, 0.5, 0.5, 0.1, 0.5])
    for m in range(3):
        np.testing.assert_allclose(found[m], 1.0)
    np.testing.assert_allclose(found[3], step[3])
    np.testing.assert_allclose(found[4], 0.0, atol=1e-12)


def test_the_share_is_the_one_given():
    assert told((1.0,) * 5).prior == SHARE


def test_to_dict_has_the_promised_keys_and_is_json():
    found = told((1.0, 2.0, -30.0, 0.0, -1.0))
    told_again = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    promised = {"n_demonstrations", "n_steps", "finding", "adversary", "prior", "identifiable", "demonstrations"}
    assert set(told_again) == promised | {"groups", "to_label", "assumptions", "demonstrators"}
    assert set(told_again["prior"]) == {"mean", "low", "high"}
    for entry in told_again["demonstrations"]:
        each = {"id", "n_steps", "log_odds", "evidence", "expert_proba", "reliability", "verdict", "worst_steps"}
        assert set(entry) == each
    assert [entry["id"] for entry in told_again["demonstrations"]] == [
        "b",
        "a",
        "d",
        "e",
        "c",
    ]  # the most trusted first
    assert told_again["groups"] == []
    assert (told_again["n_demonstrations"], told_again["n_steps"]) == (5, 15)
    assert [entry["n_steps"] for entry in told_again["demonstrations"]] == [1, 3, 2, 5, 4]


def test_to_dict_of_numpy_ids_is_json():
    toy = make("random", 0)
    ids = tuple(np.arange(12).tolist())
    problem = toy.problem()
    result = run(problem, pooled_state(problem, "uniform"), max_iter=5)
    found = summarise(problem, result, SHARE, ids)
    json.dumps(found.to_dict(), allow_nan=False)
    assert found.adversary == "uniform"
    np.testing.assert_array_equal(found.history, result.history)


def test_index():
    found = make_audit(ids=list("abcdefghij"))
    assert found.index("c") == 2
    with pytest.raises(DataError, match="No demonstration is called 'z'"):
        found.index("z")
