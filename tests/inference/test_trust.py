"""The judge: its stages in order, and how answers and demonstrators change what is said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from hand_made import Written, groups_of, same_actions, scores_of, scoring_of
from problems import make, make_continuous
from rpil.data.copies import Copies
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import Demonstrators
from rpil.inference import trust as module
from rpil.inference.answers import Answers
from rpil.inference.channels import CHANNELS, columns_of, spaced
from rpil.inference.groups import expert_share_interval
from rpil.inference.held_out import held_out_model
from rpil.inference.outliers import Claims
from rpil.inference.scores import Scoring
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import Judgement, judge, repeated, score_by_best_group
from rpil.results.judged import AuditSettings
from rpil.results.summary import audit_from_judgement
from rpil.results.vocabulary import SIDES

STEPS = (40, 60)
SETTINGS = JudgeSettings()
SCORE = np.array([1.0, 0.9, 1.1, 1.0, 1.05, 0.95, 0.0, 0.1, -0.1, 0.0])
LOWER = SCORE < 0.5
TOLD = [1, 0, 0, 1, 0, 0, -1, -1, 0, 0]


SOURCE = Demonstrations(np.zeros((10, 1)), np.arange(10) % 2, np.arange(11))


def concluded(labels=None, p_two=0.999, finding="outliers"):
    """The judgement of `SCORE`, and the audit with these labels."""
    scores = scores_of(scoring_of(same_actions(10), lambda group: 0.0, SETTINGS), SCORE, p_two)
    facts = np.cos(np.outer(np.arange(10.0), np.arange(1, len(CHANNELS))))  # one for each of the other channels
    columns = columns_of(scores.log_odds, facts, np.empty((10, 0)), SCORE)
    claims, spread, own = Claims(finding, LOWER), np.ones(2), np.arange(10)
    none = np.zeros(10), np.zeros(0), np.zeros(10)
    judgement = Judgement(scores, columns, spread, claims, own, *none)
    answers = Answers.of_labels(np.array(labels if labels is not None else [0] * 10, dtype=np.int64))
    return judgement, audit_from_judgement(judgement, SOURCE, answers, Demonstrators(), AuditSettings())


def test_without_answers_the_claims_are_said():
    judgement, audit = concluded()
    assert (audit.finding, audit.anchor, audit.identifiable) == ("outliers", "none", True)
    assert [SIDES[verdict] for verdict in audit.verdicts] == ["open"] * 6 + ["lower"] * 4
    np.testing.assert_array_equal(audit.from_actions, judgement.scores.log_odds)
    assert not audit.from_label.any()
    np.testing.assert_array_equal(audit.log_odds, audit.from_actions)
    np.testing.assert_array_equal(judgement.scores.fit.group, ~LOWER)
    np.testing.assert_array_equal(audit.columns, judgement.columns)
    apart = concluded(finding="a group apart")[1]
    assert (apart.competing, apart.identifiable) == ((tuple(range(6)), tuple(range(6, 10))), False)
    assert set(apart.verdicts) == {"open"}


def test_the_pair_that_is_asked_about_are_no_copies():
    judgement, audit = concluded()
    assert judgement.pair == audit.pair == (4, 6)  # of the ranking 8 6 9 7 1 5 0 3 4 2
    of_two = np.array([0, 1, 2, 3, 4, 5, 6, 6, 8, 6])
    assert replace(judgement, copy_of=of_two).pair == (4, 6)
    of_six = np.array([0, 1, 2, 0, 0, 0, 6, 6, 8, 6])  # 8 6 1 0 2
    assert replace(judgement, copy_of=of_six).pair == (2, 8)
    assert replace(judgement, copy_of=np.zeros(10, dtype=int)).pair is None


def test_the_share_of_experts_is_known_where_groups_or_answers_are():
    for labels, p_two, assumed in ((None, 0.999, 1.0), (None, 0.3, 0.3), (TOLD, 0.3, 1.0)):
        audit = concluded(labels, p_two)[1]
        share = audit.prior.mean, audit.prior.low, audit.prior.high
        assert share == pytest.approx(expert_share_interval(expit(audit.log_odds), assumed))


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
    scores = score_by_best_group(kind(data, model, SETTINGS, 0.1, *np.zeros((2, len(data.actions))), np.zeros(10)))
    assert model.fitted[0].all()
    np.testing.assert_array_equal(scores.fit.group, model.fitted[-1])
    return [np.flatnonzero(group).tolist() for group in model.fitted[1:]]


def test_policies_are_fitted_once_more_to_a_smaller_upper_group():
    assert fitted_to([1.0] * 4 + [0.0] * 6) == [[0, 1, 2, 3, 4, 5], [0, 1, 2, 3]]
    assert fitted_to([1.0] * 5 + [0.0] * 5) == [[0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4]]
    assert fitted_to([1.0] * 2 + [0.0] * 8)[-1] == [0, 1], "two are enough"


@pytest.mark.parametrize("n_upper", [0, 1, 6, 8])
def test_a_larger_upper_group_or_none_changes_nothing(n_upper):
    assert len(fitted_to(np.where(np.arange(10) < n_upper, 1.0, 0.0))) == 1


def test_discrete_actions_that_chance_explains_better_are_left_out():
    score = [1.0] * 4 + [-0.2] + [-2.0] * 5
    assert fitted_to(score, Low, discrete=True)[-1] == [0, 1, 2, 3]
    assert fitted_to(score, Low)[-1] == [0, 1, 2, 3, 4]
    score[3] = 0.0  # as well as by chance is no better
    assert fitted_to(score, Low, discrete=True)[-1] == [0, 1, 2]


# From steps to findings.
def judged(kind, seed, n_good, n_bad, maker=make, **given):
    toy = maker(kind, seed, n_good=n_good, n_bad=n_bad, steps=STEPS)
    data = toy.problem()
    return toy, judge(data, held_out_model(data, HeldOutSettings()), SETTINGS, **given)


@pytest.mark.parametrize("maker", [make, make_continuous])
@pytest.mark.parametrize(
    ("kind", "n_good", "n_bad", "finding"),
    [
        *[("random", 10, 4, "outliers"), ("flipped", 10, 4, "a group apart"), ("flipped", 7, 6, "two groups")],
        *[("random", 6, 10, "two groups"), ("none", 8, 4, "no outliers")],
    ],
)
def test_findings_of_plain_worlds(kind, n_good, n_bad, finding, maker):
    toy, found = judged(kind, 1, n_good, n_bad, maker)
    assert found.claims.finding == finding
    if finding == "two groups":  # either may be the lower one
        assert set(toy.is_good[found.claims.lower]) == {toy.is_good[found.claims.lower][0]}
        assert found.claims.lower.sum() in (n_good, n_bad)
    else:
        np.testing.assert_array_equal(found.claims.lower, ~toy.is_good & (finding != "no outliers"))


def test_the_judge_tells_its_stages_and_keeps_what_they_found():
    said = []
    toy, found = judged("random", 0, 10, 6, progress=said.append)
    assert said == ["ridge", "fitting the training group", "what the scores support"]
    assert toy.is_good[found.pair[0]]
    assert not toy.is_good[found.pair[1]]
    assert found.log_ratio.shape == (toy.offsets[-1],)
    assert found.reliability[toy.is_good].min() > found.reliability[~toy.is_good].max()
    np.testing.assert_array_equal(found.columns[:, 0], spaced(found.scores.log_odds, found.scores.score))
    np.testing.assert_allclose(found.columns[:, -1], np.arcsinh(found.scores.log_odds))
    assert found.columns.shape == (16, len(CHANNELS) + 8 + 1)
    assert found.part.tolist() == [0.0] * 16  # nobody learns
    assert found.copy_of.tolist() == [*range(16)]


@pytest.mark.parametrize("kind", ["random", "flipped"])
def test_parts_are_looked_for_by_the_data_of_the_learner_and_the_outliers(kind, monkeypatch):
    given, learner = [], make(kind, 0, n_good=10, n_bad=4, steps=STEPS).problem()
    monkeypatch.setattr(module, "two_parts", lambda *parts: given.append(parts) or np.full(14, 0.5))
    toy, found = judged(kind, 0, 10, 4, learner=learner)
    assert found.part.tolist() == [0.5] * 14
    ((data, scores, outlier, settings),) = given
    assert (data, scores, settings) == (learner, found.scores, SETTINGS)
    np.testing.assert_array_equal(outlier, ~toy.is_good & (kind == "random"))  # and not a group apart


def test_copies_have_what_was_found_of_the_first_of_them():
    toy, found = judged("random", 0, 10, 6, learner=make("random", 0, n_good=10, n_bad=6, steps=STEPS).problem())
    place, lengths = np.append(np.arange(16), [12, 3]), np.diff(toy.offsets)
    every = repeated(found, Copies.of(place), np.append(0, np.cumsum(lengths[place])))
    np.testing.assert_array_equal(every.scores.log_odds, found.scores.log_odds[place])
    for name in ("columns", "reliability", "part"):
        np.testing.assert_array_equal(getattr(every, name), getattr(found, name)[place], err_msg=name)
    np.testing.assert_array_equal(every.claims.lower, found.claims.lower[place])
    assert every.copy_of.tolist() == place.tolist()
    first, last = np.split(every.log_ratio[toy.offsets[-1] :], [lengths[12]])
    np.testing.assert_array_equal(first, found.log_ratio[toy.offsets[12] : toy.offsets[13]])
    np.testing.assert_array_equal(last, found.log_ratio[toy.offsets[3] : toy.offsets[4]])
