"""What the scores support without answers: every condition on scores made by hand, from both sides."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from scipy.special import expit

import rpil
from hand_made import same_actions, scores_of, scoring_of
from problems import make
from rpil.data.copies import Copies
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.inference import outliers
from rpil.inference.held_out import frequencies, indicators, log_densities, log_reference
from rpil.inference.outliers import Claims, lower_part, neighbour_gain, own_gain, telling_pair, widened
from rpil.inference.scores import dependence
from rpil.inference.settings import HeldOutSettings, JudgeSettings, OutlierSettings

UPPER = [1.3, 1.2, 1.0, 1.0, 0.8, 0.75]
SCORE = np.array([*UPPER, 0.0, 0.0, 0.0])
"""The last third is a lower group, and is not far below the others."""


def scored(score=SCORE, p_two=0.999, upper=1.0, own=0.0, deviation=0.1, discrete=False, **limits):
    score, settings = np.asarray(score, dtype=float), JudgeSettings(outliers=OutlierSettings(**limits))
    # The policy of a group gains on the group itself: by its first member an upper one, or another.
    gains = lambda group: np.where(group, upper if group[0] else own, -9.0)  # noqa: E731
    scoring = scoring_of(same_actions(len(score), discrete), gains, settings)
    return scoring, scores_of(scoring, score, p_two, deviation)


def claim(scoring, scores):
    """The claims where nearest states explain nothing: demonstrations made by hand are all alike."""
    with patch.object(outliers, "neighbour_gain", lambda *_: -np.inf):
        return outliers.claim(scoring, scores)


def said(*arguments, **given):
    """The finding, and who is below."""
    found = claim(*scored(*arguments, **given))
    return found.finding, np.flatnonzero(found.lower).tolist()


def below(score, *arguments, **given):
    scoring, scores = scored(score, *arguments, **given)
    return np.flatnonzero(lower_part(scores, scoring.settings.outliers)).tolist()


FAR = [0.8, 0.9, 1.0, 1.1, 1.2, 0.9, 1.1, -5.0, -5.0]


def test_far_below_is_by_robust_deviations_where_two_groups_explain_more_than_one():
    assert below(FAR, 0.51) == [7, 8]
    assert below(FAR, 0.5) == below(FAR, 0.49) == []
    gap = 5.9 / (1.4826 * 0.2)  # of the medians 0.9 and 0.2
    assert below(FAR, 0.51, min_gap=0.999 * gap) == [7, 8]
    assert below(FAR, 0.51, min_gap=1.001 * gap) == []
    assert below([0.8, 0.9, 1.0, 1.1, 1.2, 0.9, 1.1, -0.29, -0.29], 0.51) == [7, 8]  # -4.01 of them
    assert below([0.8, 0.9, 1.0, 1.1, 1.2, 0.9, 1.1, -0.28, -0.28], 0.51) == []  # -3.98


def test_members_of_a_lower_group_are_below_where_it_is_certain_and_lies_apart_and_the_limits_are_enough():
    for p_two, deviation, members in ((0.991, 0.33, [6, 7, 8]), (0.989, 0.33, []), (0.991, 0.34, [])):
        assert below(SCORE, p_two, deviation=deviation) == members
    _, scores = scored(deviation=0.3)
    at = {"min_p_two": scores.groups.p_two, "min_distance": scores.groups.distance}
    at["min_proba"] = float(expit(-scores.log_odds[8])) - 1e-9
    assert lower_part(scores, OutlierSettings(**at)).tolist() == [False] * 6 + [True] * 3
    for name, value in at.items():
        more = value + (1e-6 if name == "min_distance" else 2e-9)
        assert not lower_part(scores, OutlierSettings(**at | {name: more})).any()


def test_a_lower_part_has_two_members_at_least_and_is_not_all():
    assert (below(SCORE[:-2]), below(SCORE[:-1])) == ([], [6, 7])
    assert (below(SCORE, min_group=4), below(SCORE[:-2], min_group=1)) == ([], [6])
    assert below([0.0] * 9) == []


@pytest.mark.parametrize(("upper", "own", "is_noise"), [(2.0, 0.61, False), (2.0, 0.59, True), (0.1, -3.0, True)])
def test_those_without_a_policy_of_their_own_are_outliers(upper, own, is_noise):
    finding = "outliers" if is_noise else "a group apart"
    assert said(upper=upper, own=own) == (finding, [6, 7, 8])
    assert said(upper=upper, own=own, discrete=True) == (finding, [6, 7, 8])
    assert said(upper=1.0, own=0.5, max_own_gain=0.5)[0] == "outliers", "at the limit"


@pytest.mark.parametrize("n_lower", [2, 3, 4, 6])
def test_those_who_act_alike_are_a_group_apart_up_to_a_third(n_lower):
    score, finding = [*UPPER, *np.zeros(n_lower)], "a group apart" if n_lower <= 3 else "two groups"
    assert said(score, own=0.9) == (finding, [*range(6, 6 + n_lower)])
    assert said(score, own=0.1)[0] == "outliers"


@pytest.mark.parametrize(("upper", "own", "is_noise"), [(2.0, 0.61, False), (2.0, 0.59, True), (1.0, 0.31, True)])
def test_a_policy_of_the_nearest_states_counts_if_it_explains_more(upper, own, is_noise):
    gains = lambda group, *_: upper if group[0] else own  # noqa: E731
    with patch.object(outliers, "neighbour_gain", gains):
        found = outliers.claim(*scored(upper=1.1, own=0.1))
    assert found.finding == ("outliers" if is_noise else "a group apart")


@pytest.mark.parametrize("discrete", [False, True])
def test_nearest_states_of_other_members_predict_actions(discrete):
    data, group = same_actions(4, discrete), np.array([True, True, False, True])
    data = replace(data, features=2.0**data.features)  # no two states are as far from a third
    settings, steps = HeldOutSettings(), data.lengths[0]
    actions, state = indicators(data)[:steps], np.arange(steps)
    nearest = [sorted([*state, *state], key=lambda j: abs(2.0**j - 2.0**i))[:5] for i in range(steps)]
    expected = np.array([actions[near].mean(axis=0) for near in nearest])
    if discrete:
        proba = 0.99 * expected[state, data.actions[:steps]] + 0.01 * frequencies(data)[data.actions[:steps]]
        log_prob = np.log(proba)
    else:
        log_prob = log_densities(actions - expected, np.ones(steps), settings).sum(axis=1)
    over = log_prob - log_reference(data, group, settings)[:steps]
    assert neighbour_gain(group, data, settings) == pytest.approx(over.mean())
    assert neighbour_gain(np.arange(4) == 1, data, settings) == -np.inf, "the only member"


def test_of_many_steps_those_looked_at_are_of_all_times(monkeypatch):
    monkeypatch.setattr(outliers, "MAX_SEARCHED", 20)
    states, actions = np.random.default_rng(0).normal(size=(2, 20, 10, 1))
    states[:, 0] = actions[:, 0] = 0.0  # all begin alike; then there is no rule
    states, actions = states.reshape(200, 1), actions.reshape(200, 1)
    data = FitData(states, actions, np.arange(0, 201, 10), Box.around(actions))
    assert neighbour_gain(np.ones(20, dtype=bool), data, HeldOutSettings()) < 0.5


def test_a_minority_whose_rule_is_not_linear_is_a_group_apart():
    rng = np.random.default_rng(0)
    states = rng.uniform(-1, 1, size=(40, 50, 2))
    actions = np.where(np.arange(40)[:, None, None] < 8, np.abs(states), states) + 0.05 * rng.normal(size=states.shape)
    audit = rpil.audit(Demonstrations.from_episodes(zip(states, actions, strict=True)))
    assert (audit.finding, sorted(audit.competing[1])) == ("a group apart", [*range(8)])


def test_more_than_half_are_no_outliers_and_no_policy_is_fitted():
    scoring, scores = scored([*UPPER, *np.zeros(7)])
    assert claim(scoring, scores).finding == "two groups"
    assert scoring.model.fitted == []


def test_the_lower_of_two_groups_are_all_who_are_nearer_to_it():
    score = [*UPPER, 0.49, 0.0, 0.0, 0.0, 0.0]
    assert below(score) == [7, 8, 9, 10]
    assert said(score, own=0.9) == ("two groups", [6, 7, 8, 9, 10])
    assert said(score, own=0.1) == ("outliers", [7, 8, 9, 10])


def test_many_far_below_who_act_alike_are_no_groups_where_the_scores_are_none():
    score = [*FAR[:7], -5.0, -5.0, -5.0, -5.0]
    assert said(score, 0.51, own=0.9) == ("no outliers", [])
    assert said(score, 0.51, own=0.1) == ("outliers", [7, 8, 9, 10])
    assert said(FAR, 0.51, own=0.9) == ("a group apart", [7, 8])


def test_policies_that_do_not_explain_their_own_actions_say_nothing():
    for gain in (0.0, -1.0):
        assert said(upper=gain, own=-2.0) == ("nothing could be learned", [])
    assert said(upper=1e-6, own=-2.0) == ("outliers", [6, 7, 8])


def test_where_the_state_says_nothing_discrete_outliers_are_found_all_the_same():
    for discrete, score, expected in (
        (False, SCORE, ("nothing could be learned", [])),
        (True, SCORE, ("outliers", [6, 7, 8])),
        (True, UPPER, ("nothing could be learned", [])),
    ):
        scoring, scores = scored(score, discrete=discrete)
        found = claim(scoring, replace(scores, state_predicts_action=False))
        assert (found.finding, np.flatnonzero(found.lower).tolist()) == expected
    scoring, scores = scored([*FAR[:7], -0.29, -0.29], 0.51, discrete=True)
    unsure = replace(scores, excess=np.ones(9), state_predicts_action=False)  # by which nobody is below
    assert claim(scoring, unsure).finding == "nothing could be learned"
    assert said(UPPER) == said(UPPER, discrete=True) == ("no outliers", [])


def test_verdicts_and_groups_follow_from_the_finding():
    lower = np.array([False, True, False, True])
    nobody = [0] * 4, [[0, 2], [1, 3]]
    cases = ("outliers", [0, -1, 0, -1], None), ("a group apart", *nobody), ("two groups", *nobody)
    for finding, verdicts, groups in cases:
        found = Claims(finding, lower)
        assert found.verdicts.tolist() == verdicts
        assert (found.groups and [group.tolist() for group in found.groups]) == groups


def test_copies_are_what_the_first_of_them_is():
    found = Claims("outliers", np.array([False, True])).repeated(Copies.of(np.array([5, 3, 5, 3])))
    assert (found.finding, found.lower.tolist()) == ("outliers", [False, True, False, True])
    alone = Claims("outliers", np.array([False, True])).repeated(Copies.of(np.array([5, 5])))
    assert (alone.finding, alone.lower.tolist()) == ("nothing could be learned", [False, False])


SAMPLE = np.array([False, True])


@pytest.mark.parametrize(("finding", "first"), [("outliers", 7), ("a group apart", 7), ("two groups", 6)])
def test_claims_about_a_sample_are_widened_by_the_scores_of_all(finding, first):
    scoring, scores = scored([*UPPER, 0.49, 0.0, 0.0, 0.0, 0.0])
    found = widened(Claims(finding, SAMPLE), scores, scoring.settings.outliers)
    assert (found.finding, np.flatnonzero(found.lower).tolist()) == (finding, [*range(first, 11)])


def test_a_sample_without_outliers_finds_none_among_all_and_all_may_have_none():
    limits = OutlierSettings()
    for finding in ("no outliers", "nothing could be learned"):
        found = widened(Claims(finding, ~SAMPLE[:1] & False), scored()[1], limits)
        assert (found.finding, found.lower.any()) == (finding, False)
    nobody = widened(Claims("outliers", SAMPLE), scored(UPPER)[1], limits)
    assert (nobody.finding, nobody.lower.tolist()) == ("no outliers", [False] * 6)


def test_good_ones_in_states_that_the_policy_fits_badly_are_no_outliers():
    rng = np.random.default_rng(3)
    states = 0.2 * np.cumsum(rng.normal(size=(60, 60, 3)), axis=1)
    actions = np.tanh(-states[..., :1]) + 0.05 * rng.normal(size=(60, 60, 1))
    actions[:6] = rng.uniform(-1, 1, size=(6, 60, 1))
    data = Demonstrations.from_episodes(zip(states, actions, strict=True))
    named = {m for m, verdict in enumerate(rpil.audit(data).verdicts) if verdict == "outlier"}
    assert named >= {*range(6)}
    assert len(named) <= 8  # 10 without the errors of scores


def test_steps_that_depend_on_their_neighbours_make_a_mean_less_sure():
    noise, found = np.random.default_rng(0).normal(size=(200, 40)), []
    for steps in (noise, np.repeat(noise[:, ::5], 5, axis=1), noise[:, :15]):
        data = replace(same_actions(1), actions=steps.reshape(-1, 1), offsets=np.arange(201) * steps.shape[1])
        found.append(dependence(data, steps.ravel(), steps.shape[1] * steps.var(axis=1)).mean())
    assert 0 < found[0] < 0.006
    assert found[1:] == [pytest.approx(1 / 8 - 1 / 40, rel=0.1), 0.0]


def test_the_gain_of_a_group_is_the_median_of_its_members_against_the_actions_of_the_group_alone():
    data, settings, group = make("random", 0).problem(), HeldOutSettings(), np.arange(12) < 3
    model = SimpleNamespace(ridges=(), evaluate=lambda *_: log_prob)
    log_prob = np.random.default_rng(0).normal(size=len(data.actions))
    over = np.split(log_prob - log_reference(data, group, settings), data.offsets[1:-1])
    assert own_gain(group, data, model, 0.1, settings) == pytest.approx(np.median([one.mean() for one in over[:3]]))
    scoring = scoring_of(same_actions(5), lambda group: np.array([9.0, 1.0, 3.0, 2.0, -7.0]), JudgeSettings())
    group = np.arange(5) < 4
    assert own_gain(group, scoring.data, scoring.model, 0.1, settings) == pytest.approx(2.5)
    assert [one.tolist() for one in scoring.model.fitted] == [group.tolist()]


def test_the_pair_are_the_points_of_nine_and_one_tenth():
    nobody = Claims("no outliers", np.zeros(21, dtype=bool))
    for n, expected in ((21, (18.0, 2.0)), (8, (6.0, 1.0))):
        score = np.random.default_rng(0).permutation(n).astype(float)
        first, second = telling_pair(nobody, score)
        assert (score[first], score[second]) == expected
    assert telling_pair(nobody, np.ones(4)) is None
    assert telling_pair(nobody, np.array([0.0, 1e-9])) is not None


@pytest.mark.parametrize("finding", ["two groups", "a group apart"])
def test_the_pair_of_two_groups_are_their_middle_members(finding):
    two = Claims(finding, np.arange(7) > 3)
    assert telling_pair(two, np.array([4.0, 3.0, 9.0, 1.0, -1.0, -5.0, -2.0])) == (0, 6)
