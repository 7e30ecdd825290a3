"""The judge: its stages in order, and how answers and demonstrators change what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from hand_made import Written, groups_of, same_actions, scores_of, scoring_of
from problems import fit_data_of, make
from rpil.data.demonstrator_groups import Demonstrators
from rpil.inference.answered import answer, columns_of
from rpil.inference.answers import Answers
from rpil.inference.channels import StateScale
from rpil.inference.claims import Claims
from rpil.inference.groups import expert_share_interval
from rpil.inference.held_out import held_out_model
from rpil.inference.scores import Scoring
from rpil.inference.settings import ClaimSettings, HeldOutSettings, JudgeSettings
from rpil.inference.step_trust import StepTrust
from rpil.inference.trust import Judgement, judge, score_by_best_group
from rpil.mixture.demonstrator_prior import demonstrator_posterior
from rpil.results.settings import AuditSettings
from rpil.results.summary import audit_from_judgement
from rpil.results.vocabulary import SIDES

STEPS = (40, 60)
SETTINGS = JudgeSettings()
SCORE = np.array([1.0, 0.9, 1.1, 1.0, 1.05, 0.95, 0.0, 0.1, -0.1, 0.0])
WORDS = np.array([1] * 6 + [-1] * 4)
TOLD = [1, 0, 0, 1, 0, 0, -1, -1, 0, 0]


def concluded(labels=None, p_two=0.999, data=None):
    """The judgement of `SCORE`, of which agreement and length are known, the audit with these labels, and the labels as
    answers."""
    data = data or same_actions(10)
    scores = scores_of(scoring_of(same_actions(10), lambda group: 0.0, SETTINGS), SCORE, p_two)
    described = np.column_stack([SCORE, np.cos(np.arange(10.0))])
    columns = columns_of(described, described[:, :0], scores.log_odds, SETTINGS.answers)
    claims, states, own = Claims("outliers", WORDS), StateScale(np.ones(2), 0.0), np.arange(10)
    steps = StepTrust(np.zeros(10), np.zeros((10, 2)), np.zeros(0), 0.0)
    judgement = Judgement(scores, columns, states, claims, (4, 8), own, np.empty((10, 0)), steps, np.zeros(0))
    answers = Answers.of_labels(np.array(labels if labels is not None else [0] * 10, dtype=np.int64))
    return judgement, audit_from_judgement(judgement, data, range(10), answers, AuditSettings()), answers


def signs(audit):
    """The verdicts as 1, 0 and -1."""
    return np.array([{"upper": 1, "open": 0, "lower": -1}[SIDES[verdict]] for verdict in audit.verdicts])


def test_without_answers_the_claims_are_said():
    judgement, audit, _ = concluded()
    assert audit.finding == "outliers"
    assert audit.anchor == "none"
    np.testing.assert_array_equal(signs(audit), WORDS)
    np.testing.assert_array_equal(audit.from_actions, judgement.scores.log_odds)
    assert not audit.from_label.any()
    assert not audit.from_demonstrator.any()
    np.testing.assert_array_equal(audit.log_odds, audit.from_actions)
    assert audit.pair == (4, 8)
    np.testing.assert_array_equal(judgement.training_group, SCORE > 0.5)
    np.testing.assert_array_equal(audit.columns, judgement.columns)


def test_claims_that_log_odds_contradict_are_not_said():
    judgement, _, _ = concluded()
    turned = replace(judgement, claims=Claims("outliers", -WORDS))
    assert not turned.verdicts.any()


def test_the_share_of_experts_is_known_where_groups_or_answers_are():
    for labels, p_two, assumed in ((None, 0.999, 1.0), (None, 0.3, 0.3), (TOLD, 0.3, 1.0)):
        audit = concluded(labels, p_two)[1]
        share = audit.prior.mean, audit.prior.low, audit.prior.high
        assert share == pytest.approx(expert_share_interval(expit(audit.log_odds), assumed))


def operated(names):
    """Data of two operators."""
    return replace(same_actions(10), demonstrators=Demonstrators.from_names(names))


def test_answers_count_before_operators():
    data = operated(["a"] * 5 + ["b"] * 5)
    _, audit, answers = concluded(TOLD, data=data)
    by_hand = answer(audit.columns, answers, SETTINGS.answers, np.arange(10), WORDS)
    np.testing.assert_allclose(audit.from_actions + audit.from_label, by_hand.log_odds)
    posterior = demonstrator_posterior(data.demonstrators, by_hand.log_odds, answers.labels, SETTINGS.demonstrators)
    of_operator = np.where(answers.labels, 0.0, posterior.log_odds)  # a label says what its demonstration is
    np.testing.assert_allclose(audit.log_odds, by_hand.log_odds + of_operator)
    trust = {who.name: (who.trust.mean, who.trust.low, who.trust.high) for who in audit.demonstrators}
    np.testing.assert_allclose([trust["a"], trust["b"]], posterior.intervals())


# The training group.
class Fixed(Scoring):
    """A scoring that always gives the scores that its policies explain."""

    groups = groups_of(0.5)

    def score(self, fit):
        gains = self.model.gains(fit.group)
        return replace(scores_of(self, gains, 0.5), fit=fit, groups=self.groups)


class Low(Fixed):
    """Whose upper group begins below zero."""

    groups = replace(groups_of(0.5), mean=np.array([-1.5, -0.5]))


def fitted_to(score, kind=Fixed, discrete=False):
    """The groups to which policies are fitted."""
    data, score = same_actions(10, discrete), np.asarray(score, dtype=float)
    model = Written(data, lambda group: score, SETTINGS)
    everyone = np.ones(10, dtype=bool)
    scores = score_by_best_group(kind(data, model, SETTINGS, 0.1, *np.zeros((2, len(data.actions)))), everyone)
    assert model.fitted[0].all()
    np.testing.assert_array_equal(scores.fit.group, model.fitted[-1])
    return [np.flatnonzero(group).tolist() for group in model.fitted[1:]]


def test_policies_are_fitted_once_more_to_a_smaller_upper_group():
    assert fitted_to([1.0] * 4 + [0.0] * 6) == [[0, 1, 2, 3, 4, 5], [0, 1, 2, 3]]
    assert fitted_to([1.0] * 5 + [0.0] * 5) == [[0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4]]


@pytest.mark.parametrize("n_upper", [0, 1, 6, 8])
def test_a_larger_upper_group_or_none_changes_nothing(n_upper):
    assert len(fitted_to(np.where(np.arange(10) < n_upper, 1.0, 0.0))) == 1


def test_an_upper_group_of_two_is_enough():
    assert fitted_to([1.0] * 2 + [0.0] * 8)[-1] == [0, 1]


def test_discrete_actions_that_chance_explains_better_are_left_out():
    score = [1.0] * 4 + [-0.2] + [-2.0] * 5
    assert fitted_to(score, Low, discrete=True)[-1] == [0, 1, 2, 3]
    assert fitted_to(score, Low)[-1] == [0, 1, 2, 3, 4]
    score[3] = 0.0  # as well as by chance is no better
    assert fitted_to(score, Low, discrete=True)[-1] == [0, 1, 2]


# From steps to verdicts.
def judged(kind, seed, n_good, n_bad, settings=SETTINGS, **given):
    toy = make(kind, seed, n_good=n_good, n_bad=n_bad, steps=STEPS)
    data = fit_data_of(toy)
    return toy, judge(data, held_out_model(data, 0, HeldOutSettings()), settings, **given)


def test_random_actions_are_unlike():
    said = []
    toy, judgement = judged("random", 0, 10, 6, progress=said.append)
    assert judgement.claims.finding == "outliers"
    np.testing.assert_array_equal(judgement.verdicts, np.where(toy.is_good, 1, -1))
    assert said == ["ridge", "fitting the training group", "other folds", "what the scores support"]
    assert toy.is_good[judgement.pair[0]]
    assert not toy.is_good[judgement.pair[1]]
    steps = np.concatenate([[0], np.cumsum(np.diff(toy.offsets))])
    assert judgement.log_ratio.shape == judgement.step_trust.share.shape == (steps[-1],)
    reliability = judgement.step_trust.reliability
    assert reliability[toy.is_good].min() > reliability[~toy.is_good].max()


def test_a_policy_of_their_own_makes_two_groups():
    toy, judgement = judged("shifted", 1, 6, 4)
    assert judgement.claims.finding == "two groups"
    assert not judgement.verdicts.any()
    groups = {frozenset(group.tolist()) for group in judgement.claims.groups}
    assert groups == {frozenset(np.flatnonzero(toy.is_good)), frozenset(np.flatnonzero(~toy.is_good))}
    first, second = judgement.pair
    assert toy.is_good[first] != toy.is_good[second]


class Twice(Written):
    """That would deal other folds."""

    def dealt_again(self, seed):
        self.fitted.append(f"dealt by {seed}")


def dealt(gains, min_p_two_of_noise=0.2, **given):
    """The judgement of demonstrations with these gains, and how other folds were dealt."""
    data = same_actions(10)
    claims = replace(ClaimSettings(), min_p_two_of_noise=min_p_two_of_noise)
    settings = JudgeSettings(groups=replace(SETTINGS.groups, min_steps=1), claims=claims)
    model = Twice(data, lambda group: gains, settings)
    judgement = judge(data, model, settings, **given)
    return judgement, [one for one in model.fitted if isinstance(one, str)]


def test_other_folds_are_dealt_where_groups_are_likely():
    judgement, said = dealt(100 * SCORE, seed=5)
    assert said == ["dealt by 6"]
    assert dealt(100 * SCORE)[1] == ["dealt by 1"]
    assert dealt(np.ones(10))[1] == []
    p_two = judgement.scores.groups.p_two
    assert 0.2 < p_two < 1.0
    assert len(dealt(100 * SCORE, p_two)[1]) == 1
    assert dealt(100 * SCORE, np.nextafter(p_two, 1.0))[1] == []


def test_nothing_could_be_learned_from_random_observations():
    toy = make("noisy", 0, n_good=10, n_bad=10, steps=STEPS)
    data = toy.problem()
    noise = np.random.default_rng(0).normal(size=data.features.shape)
    noise[:, -1] = 1.0
    data = replace(data, features=noise)
    judgement = judge(data, held_out_model(data, 0, HeldOutSettings()), JudgeSettings())
    assert judgement.claims.finding == "nothing could be learned"
    assert not judgement.verdicts.any()
