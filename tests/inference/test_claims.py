"""What the scores support without answers: every condition on scores made by hand, from both sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from hand_made import same_actions, scores_of, scoring_of
from rpil.inference.claims import Claims, Doubt, by_chance, by_groups, claim, extended, said
from rpil.inference.rivals import Contrast, Lower, SecondWay
from rpil.inference.settings import ClaimSettings, JudgeSettings, RivalSettings

SCORE = np.array([1.0] * 6 + [0.0] * 4)
TYPICAL_AND_UNLIKE = [1] * 6 + [-1] * 4
NOBODY = [0] * 10
ONE_GROUP = "Another calculation, with other parts of the data held out, finds no outliers."


@pytest.fixture(autouse=True)
def no_second_way(monkeypatch):
    """Scores made by hand have no steps from which a second way could be learned."""
    own = SecondWay(-1.0, 1.0, 0.0, True, False, RivalSettings())
    monkeypatch.setattr(SecondWay, "of", classmethod(lambda cls, *_: own))


def settings_with(**limits):
    return JudgeSettings(claims=replace(ClaimSettings(), **limits))


def policies(upper=1.0, lower=0.0, elsewhere=-1.0, spread=0.0, n_upper=1):
    """Gains of policies of the first `n_upper` demonstrations, or some of them, and of those of lower ones: with a
    large `spread` around `lower` they are not credible."""

    def gains(group):
        is_upper = group[:n_upper].any()
        own = upper if is_upper else lower + spread * np.linspace(-1, 1, group.sum())
        found = np.full(len(group), elsewhere if is_upper else -9.0)
        found[group] = own
        return found

    return gains


def scored(score=SCORE, p_two=0.999, gains=None, discrete=False, limits=(), **other):
    score = np.asarray(score, dtype=float)
    data = same_actions(len(score), discrete)
    scoring = scoring_of(data, gains or policies(), settings_with(**dict(limits)))
    scores = scores_of(scoring, score, p_two, **other)
    explained = scoring.model.evaluate(data.per_step((score > 0.5).astype(float)), scoring.ridge)
    return scoring, replace(scores, fit=replace(scores.fit, log_prob=explained))


def claimed(scored_, again=None, order=None):
    found = claim(*scored_, again, order)
    return found.finding, found.verdicts.tolist()


def sentences(found: Claims) -> list[str]:
    return [doubt.sentence for doubt in found.doubts]


def lower_of(upper, rival, is_rival=True) -> Lower:
    upper, rival = (np.array(members, dtype=int) for members in (upper, rival))
    return Lower(upper, rival, gain_upper=1.0, is_rival=is_rival, is_noise=False)


@pytest.mark.parametrize(("p_two", "finding"), [(0.991, "outliers"), (0.989, "no outliers")])
def test_two_groups_of_scores_must_be_nearly_certain(p_two, finding):
    verdicts = TYPICAL_AND_UNLIKE if finding == "outliers" else NOBODY
    assert claimed(scored(p_two=p_two)) == (finding, verdicts)


def test_the_least_probability_of_two_groups_is_enough():
    p_two = scored()[1].groups.p_two
    assert claimed(scored(limits={"min_p_two": p_two}))[0] == "outliers"
    found = scored(limits={"min_p_two": p_two})
    assert claimed(found, found[1])[0] == "outliers"


def test_nothing_could_be_learned_where_the_state_says_nothing():
    """Of discrete actions the worst ones may be found by chance all the same."""
    assert claimed(scored(p_two=0.5, state_predicts_action=False)) == ("nothing could be learned", NOBODY)
    assert claimed(scored(state_predicts_action=False)) == ("nothing could be learned", NOBODY)
    assert claimed(scored(discrete=True, state_predicts_action=False))[0] == "outliers"


@pytest.mark.parametrize("gain", [0.0, -1.0])
def test_a_policy_that_does_not_explain_its_own_actions_convicts_nobody(gain):
    found = claim(*scored(gains=lambda group: np.full(10, gain)), None, None)
    assert (found.finding, found.verdicts.tolist()) == ("nothing could be learned", NOBODY)
    assert found.lower is not None


def test_a_small_gain_of_the_upper_group_is_a_gain():
    assert claimed(scored(gains=policies(upper=1e-6, lower=-1.0)))[0] == "outliers"


@pytest.mark.parametrize(("own", "finding"), [(0.3, "two groups"), (0.05, "outliers"), (0.0, "outliers")])
def test_a_policy_of_their_own_makes_two_groups_of_which_neither_is_unlike(own, finding):
    found = claim(*scored(gains=policies(lower=own)), None, None)
    assert found.finding == finding
    if finding == "outliers":
        assert found.groups is None
        assert found.contrast is None
    else:
        assert found.verdicts.tolist() == NOBODY
        assert [group.tolist() for group in found.groups] == [[0, 1, 2, 3, 4, 5], [6, 7, 8, 9]]
        assert found.contrast.length.tolist() == [5.0, 5.0]


@pytest.mark.parametrize(("n_upper", "finding"), [(1, "no outliers"), (2, "outliers")])
def test_the_upper_group_has_two_members_at_least(n_upper, finding):
    score = np.where(np.arange(10) < n_upper, 1.0, 0.0)
    assert claimed(scored(score))[0] == finding


def test_all_in_the_upper_group_are_no_split():
    assert by_groups(*scored(np.ones(10)), None) is None
    assert by_chance(*scored(np.ones(10), discrete=True), None) is None


def test_words_begin_at_the_log_odds_of_the_limit_itself():
    limits, log_odds = ClaimSettings(), float(logit(ClaimSettings().min_proba))
    assert log_odds == pytest.approx(np.log(9))
    _, scores = scored()
    given = np.array([log_odds, -log_odds, log_odds - 1e-9, 1e-9 - log_odds, *np.zeros(6)])
    assert said(scores, limits, np.ones(10, dtype=bool), given).tolist() == [1, -1] + [0] * 8


def test_typical_is_the_better_half_where_the_lower_group_is_a_tail():
    score = np.array([1.3, 1.2, 1.1, 1.0, 0.9, 0.8, -0.1, 0.0, 0.1, 0.0])
    tail = scored(score, deviation=0.26)
    assert not tail[1].groups.is_cluster
    assert claimed(tail)[1] == [1, 1, 1, 0, 0, 0, -1, -1, -1, -1]
    cluster = scored(score, deviation=0.2)
    assert cluster[1].groups.is_cluster
    assert claimed(cluster)[1] == TYPICAL_AND_UNLIKE
    middle = scored(score[1:], deviation=0.26)  # the middle one of five is in the better half
    assert claimed(middle)[1] == [1, 1, 1, 0, 0, -1, -1, -1, -1]


@pytest.mark.parametrize("n_upper", [0, 3])
@pytest.mark.parametrize("deviation", [0.1, 0.3])
def test_typical_are_members_of_the_upper_group(deviation, n_upper):
    _, scores = scored(deviation=deviation)
    verdicts = said(scores, ClaimSettings(), np.arange(10) < n_upper, np.full(10, 5.0))
    assert verdicts.tolist() == [1] * n_upper + [0] * (10 - n_upper)


def test_noise_leaves_the_better_half_typical_where_scores_have_a_tail():
    score = np.array([1.3, 1.2, 1.1, 1.0, 0.9, 0.8, -1.1, -1.0, -0.9, -1.0])
    found = scored(score, 0.3, discrete=True, deviation=0.26)
    assert by_chance(*found, None).verdicts.tolist() == [1, 1, 1, 0, 0, 0, -1, -1, -1, -1]


def test_nobody_unlike_means_that_nobody_is_called_typical():
    score = np.array([1.0] * 6 + [0.49] * 4)
    assert claimed(scored(score)) == ("no outliers", NOBODY)


def test_words_need_both_dealings_of_the_folds():
    scoring, scores = scored()
    again = scores_of(scoring, [1, 1, 1, 1, 1, 0.4, 0.6, 0, 0, 0.49], 0.999)
    assert claimed((scoring, scores), again) == ("outliers", [1, 1, 1, 1, 1, 0, 0, -1, -1, -1])


@pytest.mark.parametrize(("p_two", "doubts"), [(0.991, []), (0.98, [ONE_GROUP])])
def test_other_folds_must_give_two_groups(p_two, doubts):
    scoring, scores = scored()
    found = claim(scoring, scores, scores_of(scoring, SCORE, p_two), None)
    assert sentences(found) == doubts
    assert found.finding == ("in doubt" if doubts else "outliers")
    assert found.verdicts.tolist() == (NOBODY if doubts else TYPICAL_AND_UNLIKE)
    assert all(doubt.runs == () for doubt in found.doubts)


# By chance: the lower group takes discrete actions as noise does.
NOISE = np.array([1.0] * 6 + [-1.0] * 4)


def by_noise(score=NOISE, p_two=0.3, lower=0.0, limits=(), discrete=True, again=None, upper=1.0):
    of_policies = policies(upper, lower, spread=0.4, n_upper=int((score > 0).sum()))
    scoring, scores = scored(score, p_two, of_policies, discrete, limits)
    return by_chance(scoring, scores, None if again is None else scores_of(scoring, *again))


@pytest.mark.parametrize(("p_two", "finding"), [(0.21, "outliers"), (0.19, "no outliers")])
def test_noise_needs_some_evidence_of_two_groups(p_two, finding):
    found = scored(NOISE, p_two, discrete=True)
    assert claimed(found, found[1]) == (finding, TYPICAL_AND_UNLIKE if finding == "outliers" else NOBODY)


def test_the_least_evidence_of_noise_is_enough():
    p_two = scored(NOISE, 0.3)[1].groups.p_two
    assert by_noise(limits={"min_p_two_of_noise": p_two}) is not None


def test_continuous_actions_are_never_noise_by_chance():
    assert by_noise(discrete=False) is None
    assert claimed(scored(NOISE, 0.3))[0] == "no outliers"


def test_no_gain_of_the_upper_group_no_noise():
    assert by_noise(upper=0.0, lower=-1.0) is None
    assert by_noise(upper=0.5, lower=-1.0) is not None


def test_a_credible_policy_is_no_noise_however_small_its_gain():
    found = scored(NOISE, 0.3, policies(lower=0.01), discrete=True)
    assert by_chance(*found, None) is None


@pytest.mark.parametrize(("n_upper", "is_split"), [(0, False), (1, False), (2, True), (9, True), (10, False)])
def test_noise_is_below_two_demonstrations_at_least(n_upper, is_split):
    score = np.where(np.arange(10) < n_upper, 1.0, -1.0)
    assert (by_noise(score) is not None) is is_split


@pytest.mark.parametrize(("enough", "is_split"), [(4, True), (5, False)])
def test_so_few_that_no_policy_could_be_learned_are_no_noise(enough, is_split):
    few, of_policies = np.full(10, -1.0), policies(1.0, 0.0, spread=0.4)
    found = scored(
        NOISE, 0.3, lambda group: few if group[:6].any() and group.sum() < enough else of_policies(group), True
    )
    assert (by_chance(*found, None) is not None) is is_split


def test_noise_lies_half_the_gain_below_frequent_actions():
    score = NOISE * 2
    score[4:8] = 0.01, 0.0, -0.99, -1.01
    found = by_noise(score, upper=2.0)
    assert found.verdicts.tolist() == [1, 1, 1, 1, 1, 0, 0, -1, -1, -1]
    assert found.with_other_folds
    assert found.is_cluster
    score[6] = -0.5 * found.lower.gain_upper
    assert by_noise(score, upper=2.0).verdicts[6] == -1


def test_noise_is_noise_with_both_dealings():
    again = NOISE.copy()
    again[[0, 1, 9]] = -0.1, 0.0, -0.4
    assert by_noise(again=(again, 0.3)).verdicts.tolist() == [0, 0, 1, 1, 1, 1, -1, -1, -1, 0]


def test_noise_stands_where_other_folds_give_one_group_of_scores():
    found = scored(NOISE, discrete=True)
    assert claimed(found, scores_of(found[0], NOISE, 0.5)) == ("outliers", TYPICAL_AND_UNLIKE)


def test_groups_come_first_and_noise_adds_words_to_them():
    score = np.array([1.0, 1.0, 1.0, 1.0, 0.51, 0.49, -0.6, -1.0, -1.0, -1.0])
    found = scored(score, discrete=True, deviation=0.1)
    groups, chance = by_groups(*found, None), by_chance(*found, None)
    assert groups.verdicts.tolist() == [1, 1, 1, 1, 0, 0, -1, -1, -1, -1]
    assert chance.verdicts.tolist() == [1, 1, 1, 1, 1, 1, -1, -1, -1, -1]
    both = claim(*found, None, None)
    assert both.verdicts.tolist() == [1, 1, 1, 1, 1, 1, -1, -1, -1, -1]
    assert both.lower.upper.tolist() == [0, 1, 2, 3, 4]  # by groups


def test_noise_beside_groups_is_a_cluster_of_its_own():
    score = np.array([1.0] * 3 + [-1.0] * 7)
    tail = {"score": score, "deviation": 0.3, "discrete": True}
    assert claimed(scored(**tail))[0] == "outliers"
    assert claimed(scored(**tail, gains=policies(lower=0.2, spread=0.5)))[0] == "in doubt"


# A sample stands for all.
def test_claims_about_a_sample_extend_to_all():
    scoring, scores = scored([1.0, 0.0, 1.0, 0.0, 1.0, 1.0])
    of_sample = Claims("outliers", np.array([1, 0]), (), lower_of([0], [1], False))
    found = extended(of_sample, scores, np.array([4, 3]), scoring.settings)
    assert found.verdicts.tolist() == [1, -1, 1, 0, 1, 1]  # as said of the sample, and by the scores of the others
    assert found.lower.upper.tolist() == [0, 2, 4, 5]
    assert found.lower.rival.tolist() == [3]
    assert found.finding == "outliers"


def test_sampled_groups_and_doubts_extend_to_all():
    scoring, scores = scored([1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
    doubt = Doubt("{members} follow one another.", (np.array([0, 2]),))
    contrast = Contrast(((0, 1.0),), np.ones((2, 1)), np.ones(1), np.ones(2))
    two = Claims("two groups", np.zeros(3, dtype=int), (doubt,), lower_of([0, 2], [1]), contrast)
    found = extended(two, scores, np.array([1, 2, 5]), scoring.settings)
    assert found.verdicts.tolist() == [0] * 6
    assert [group.tolist() for group in found.groups] == [[0, 1, 4, 5], [2, 3]]
    assert [run.tolist() for run in found.doubts[0].runs] == [[1, 5]]
    assert found.contrast is contrast
    assert extended(Claims("no outliers", np.zeros(2, dtype=int)), scores, np.arange(2), scoring.settings).lower is None
