"""From a posterior to verdicts, step weights and demonstrators, by rules that are written down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from audits import make_audit
from hand_made import answers_of
from problems import pooled_state
from rpil.data.fit_data import Demonstrators, FitData
from rpil.data.spaces import Box, Discrete
from rpil.inference.channels import CHANNELS
from rpil.inference.outliers import Claims
from rpil.mixture.em import MixtureFit, Posterior
from rpil.results.judged import AuditSettings, Interval
from rpil.results.reasons import TWO_GROUPS
from rpil.results.record import Audit
from rpil.results.summary import audit_from_mixture, notes_of, parts_not_judged, whom_it_trusts

IDS = ("a", "b", "c", "d", "e")
LENGTHS = np.array([3, 1, 4, 2, 5])


def mixture_audit(
    log_odds: tuple[float, ...], labels: tuple[int, ...] = (0,) * 5, settings: AuditSettings = AuditSettings()
) -> Audit:
    """The audit of five demonstrations with these posterior log-odds."""
    offsets = np.concatenate([[0], np.cumsum(LENGTHS)])
    n = int(offsets[-1])
    data = FitData(np.ones((n, 1)), np.zeros(n, dtype=int), offsets, Discrete(3), np.array(labels))
    state = pooled_state(data, "uniform")
    posterior = Posterior(np.array(log_odds), np.zeros(5), np.zeros(5), np.linspace(-1, 1, n), np.zeros((n, 3)))
    result = MixtureFit(state, posterior, np.array([-2.0, -1.0]), True)
    return audit_from_mixture(data, result, Interval(0.3, 0.2, 0.4), IDS, settings)


def test_verdicts_change_at_the_thresholds():
    edge = float(logit(0.9))
    audit = mixture_audit((edge + 1e-6, edge - 1e-6, 0.0, -edge + 1e-6, -edge - 1e-6))
    assert audit.verdicts == ("expert", "open", "open", "open", "adversary")
    assert (audit.anchor, audit.finding, audit.vocabulary.probability) == ("named adversary", "mixture", "P(expert)")
    np.testing.assert_allclose(audit.expert_proba, 1 / (1 + np.exp(-audit.log_odds)))


def test_labels_are_as_good_as_certain():
    audit = mixture_audit((-50.0, 50.0, -1.0, 1.0, 3.0), labels=(1, -1, 1, -1, 0))
    assert audit.verdicts == ("expert", "adversary", "expert", "adversary", "expert")
    assert audit.labels == ("good", "bad", "good", "bad", "")
    np.testing.assert_allclose(audit.log_odds, [50.0, -50.0, 20.0, -20.0, 3.0])
    np.testing.assert_allclose(sum(audit.evidence.values()), audit.log_odds)


def test_notes_name_the_only_operator_of_all_outliers_or_how_groups_differ():
    lower, columns = np.array([False, True, True, False, False]), np.zeros((5, len(CHANNELS) + 1))

    def notes(names, finding="outliers", lower=lower):
        people = Demonstrators.from_names(names) if names else Demonstrators()
        return notes_of(Claims(finding, lower), columns, LENGTHS, people)

    said = r"All outliers are of one operator, Ann\x1b: perhaps a style or a set-up, and not necessarily worse."
    assert notes(["Bob", "Ann\x1b", "Ann\x1b", "Bob", "Ann\x1b"]) == (said,)
    assert notes(["Bob", "Ann", "Bob", "Bob", "Ann"]) == notes(["Ann"] * 5) == notes([]) == ()
    assert notes(["Bob", "Ann", "Ann", "Bob", "Bob"], lower=lower & (np.arange(5) < 2)) == (), "one alone"
    assert notes(["Bob", "Ann", "Ann", "Bob", "Bob"], "no outliers", lower & False) == ()
    for finding in ("a group apart", "two groups"):
        (note,) = notes(["Bob", "Ann", "Ann", "Bob", "Bob"], finding)
        assert note.startswith(TWO_GROUPS)


@pytest.mark.parametrize(
    ("part", "sentence"),
    [
        ((1, 1, 1, -1, -1), "The policy trusts 3 of 5 that agree; two labels can change this."),
        ((-1, -1, 1, -1, -1), "The policy trusts 1 of 5 that agree; two labels can change this."),
        ((-0.5, -0.5, 0.5, 0.5, 0.5), "Two parts, 3 and 2, act differently; without two labels all are trusted."),
        ((0.5, 0.5, -0.5, -0.5, -0.5), "Two parts, 3 and 2, act differently; without two labels all are trusted."),
        ((0,) * 5, ""),
    ],
)
def test_whom_a_learner_trusts_is_said_until_answers_contrast(part, sentence):
    audit = make_audit(("open",) * 5, part=np.array(part, dtype=float))
    assert whom_it_trusts(audit) == sentence
    for labels in ([1, 1, 0, 0, 0], [1, 0, 0, 0, 0]):
        assert whom_it_trusts(replace(audit, answers=answers_of(labels))) == sentence
    assert whom_it_trusts(replace(audit, answers=answers_of([1, 0, 0, -1, 0]))) == ""


def test_parts_that_rest_are_named():
    def sentences(judged, names=()):
        actions = np.zeros((10, len(judged)))
        box = Box(actions[0], actions[0] + 1)
        data = FitData(np.ones((10, 1)), actions, np.array([0, 10]), box, judged=np.array(judged), action_names=names)
        return parts_not_judged(data)

    names = ("actions.left.1", "actions.left.2", "actions.right.1", "actions.right.2", "actions.right.3")
    said = "3 of 5 parts of the action never move, and do not count: actions.left.1, actions.left.2, actions.right.2."
    assert sentences([False, False, True, False, True], names) == (said,)
    assert sentences([True, False]) == ("1 of 2 parts of the action never move, and do not count: 1.",)
    assert sentences([True]) == ()
