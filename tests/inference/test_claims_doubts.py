"""Reasons to doubt that some demonstrations differ from the others, each by name, and the question that is asked."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from hand_made import same_actions, scores_of, scoring_of
from rpil.inference.claims import Claims, Split, claim, doubts_of, runs_p, telling_pair
from rpil.inference.rivals import Lower
from rpil.inference.settings import ClaimSettings, JudgeSettings

SCORE = np.array([1.0] * 6 + [0.0] * 4)
TAIL = 0.3
"""Standard deviation of groups at 0 and 1 of which the lower is a tail."""


def scored(score=SCORE, discrete=False, parts=None, deviation=0.1, **limits):
    score = np.asarray(score, dtype=float)
    data, settings = same_actions(len(score), discrete), JudgeSettings(claims=replace(ClaimSettings(), **limits))
    upper = score > 0.5

    def gains(group):
        return np.where(group, 1.0, -1.0) if group[upper].any() else np.where(group, 0.0, -9.0)

    scoring = scoring_of(data, gains, settings, parts)
    return scoring, scores_of(scoring, score, 0.999, deviation)


def found(scored_, order=None):
    claims = claim(*scored_, None, order)
    assert (claims.finding == "in doubt") == bool(claims.doubts)
    assert not claims.doubts or not claims.verdicts.any()
    return claims.doubts


def runs_in(doubt):
    return [run.tolist() for run in doubt.runs]


def sentences(*arguments):
    return [doubt.sentence for doubt in found(*arguments)]


@pytest.mark.parametrize(("n_upper", "is_doubted"), [(5, False), (4, True)])
def test_more_than_half_below_at_many_levels_are_no_minority(n_upper, is_doubted):
    score = np.where(np.arange(10) < n_upper, 1.0, -0.2)
    doubts = found(scored(score, deviation=TAIL))
    assert [doubt.sentence for doubt in doubts] == [
        "More than half score low, at many levels: no limit between two groups is clear."
    ] * is_doubted
    assert all(doubt.runs == () for doubt in doubts)
    assert sentences(scored(score)) == []  # a cluster of its own may be the larger group


def disagreeing(correlation, min_agreement=0.2, discrete=False):
    """Scores whose gain over frequent actions ranks demonstrations with this correlation."""
    scoring, scores = scored(np.arange(5) / 4, discrete=discrete, min_agreement=min_agreement)
    order = {-1.0: [4, 3, 2, 1, 0], 0.1: [1, 4, 0, 3, 2], 0.3: [1, 3, 0, 4, 2]}[correlation]
    log_q = scores.fit.log_prob - scoring.data.per_step(np.array(order, dtype=float))
    lower = Lower(np.arange(5), np.arange(0), gain_upper=1.0, is_rival=False, is_noise=False)
    return replace(scoring, log_q=log_q), scores, lower


def doubts_about(scoring, scores, lower, verdicts=(-1, 0, 0, 0, 1), is_cluster=True, order=None):
    return doubts_of(scoring, scores, Split(np.array(verdicts), lower, True, is_cluster), order)


def test_two_rankings_that_differ_are_doubted():
    doubts = doubts_about(*disagreeing(-1.0))
    assert [doubt.sentence for doubt in doubts] == [
        "Two ways of scoring disagree about the order (rank correlation -1.00), so the low scores may be an artefact."
    ]
    assert doubts[0].runs == ()
    assert len(doubts_about(*disagreeing(0.1))) == 1
    assert doubts_about(*disagreeing(0.3)) == []
    assert doubts_about(*disagreeing(-1.0, min_agreement=-1.0)) == []  # the least agreement is enough
    assert doubts_about(*disagreeing(-1.0, discrete=True)) == []  # these rankings are not compared


def test_those_who_follow_one_another_are_a_session():
    score = np.array([1.0] * 10 + [0.0] * 4 + [1.0] * 8)
    doubts = found(scored(score), np.arange(22.0))
    assert [doubt.sentence for doubt in doubts] == [
        "Those with low scores follow one another in the order of recording ({members}): perhaps another session or "
        "set-up, and not necessarily worse."
    ]
    assert runs_in(doubts[0]) == [[10, 11, 12, 13]]
    assert sentences(scored(score)) == []  # no order is stated
    mixed = np.argsort(np.random.default_rng(0).permutation(22)).astype(float)
    assert runs_p((score < 0.5)[np.argsort(mixed)]) > 0.01
    assert sentences(scored(score), mixed) == []


def test_members_of_a_session_are_named_in_its_order():
    score = np.array([0.0] * 4 + [1.0] * 18)
    order = np.append([3.0, 1.0, 4.0, 2.0], np.arange(18) + 10.0)
    assert runs_in(found(scored(score), order)[0]) == [[1, 3, 0, 2]]
    p = runs_p(np.sort(score) < 0.5)
    assert found(scored(score, max_runs_p=p), order) == ()  # at the limit itself
    assert len(found(scored(score, max_runs_p=1.001 * p), order)) == 1


def test_runs_end_where_another_demonstration_comes_between():
    score = np.array([0.0] * 5 + [1.0] * 8 + [0.0] + [1.0] * 8 + [0.0] * 3)
    assert runs_in(found(scored(score), np.arange(25.0))[0]) == [[0, 1, 2, 3, 4], [13], [22, 23, 24]]


def test_demonstrations_of_one_time_stay_as_they_are():
    score = np.tile([1.0, 1.0, 0.0], 8)
    assert sentences(scored(score), np.zeros(24)) == []
    blocks = np.repeat([1.0, 1.0, 0.0], 8)
    assert found(scored(blocks), np.zeros(24))[0].runs[0].tolist() == list(range(16, 24))


@pytest.mark.parametrize(("n", "a"), [(8, 2), (10, 4), (12, 6), (12, 3)])
def test_probability_of_few_runs_is_that_of_all_orders(n, a):
    def runs(members):
        flags = np.isin(np.arange(n), members)
        return 1 + sum(flags[k] != flags[k - 1] for k in range(1, n))

    every = np.array([runs(members) for members in combinations(range(n), a)])
    for members in list(combinations(range(n), a))[:: max(1, len(every) // 40)]:
        exact = (every <= runs(members)).mean()
        assert runs_p(np.isin(np.arange(n), members)) == pytest.approx(exact, abs=0.08)
    assert runs_p(np.arange(n) < a) < 0.15
    assert runs_p(np.arange(n) < a) == pytest.approx((every <= 2).mean(), abs=0.03)


def test_probability_of_few_runs_by_hand():
    # 2 of one sort and 2 of the other: 3 runs are expected, with the variance 2/3
    assert runs_p(np.array([True, True, False, False])) == pytest.approx(0.2701, abs=1e-4)
    assert runs_p(np.array([True, False])) == 1.0  # two runs always, without variance
    assert runs_p(np.ones(5, dtype=bool)) == runs_p(np.zeros(5, dtype=bool)) == 1.0


def test_every_doubt_is_said():
    score = np.array([1.0] * 6 + [-0.2] * 14)
    doubts = found(scored(score, deviation=TAIL), np.arange(20.0))
    assert [doubt.sentence.split()[0] for doubt in doubts] == ["More", "Those"]


# The question.
def test_the_pair_are_the_points_of_nine_and_one_tenth():
    nobody = Claims("no outliers", np.zeros(21, dtype=int))
    score = np.random.default_rng(0).permutation(21).astype(float)
    first, second = telling_pair(nobody, score)
    assert (score[first], score[second]) == (18.0, 2.0)
    eight = np.random.default_rng(1).permutation(8).astype(float)
    first, second = telling_pair(Claims("no outliers", np.zeros(8, dtype=int)), eight)
    assert (eight[first], eight[second]) == (6.0, 1.0)


def test_no_pair_without_any_difference():
    assert telling_pair(Claims("no outliers", np.zeros(4, dtype=int)), np.ones(4)) is None
    assert telling_pair(Claims("no outliers", np.zeros(2, dtype=int)), np.array([0.0, 1e-9])) is not None


def test_the_pair_of_two_groups_are_their_middle_members():
    lower = Lower(np.arange(4), np.array([4, 5, 6]), gain_upper=1.0, is_rival=True, is_noise=False)
    two = Claims("two groups", np.zeros(7, dtype=int), (), lower)
    assert telling_pair(two, np.array([4.0, 3.0, 9.0, 1.0, -1.0, -5.0, -2.0])) == (0, 6)
