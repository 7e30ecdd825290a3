"""Whom a learner trusts: policies with written gains for each decision, and plain worlds from steps to parts."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import logsumexp

from hand_made import Written, reference, same_actions, scores_of, scoring_of
from problems import make, make_continuous
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference import two_parts as module
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings, PartSettings
from rpil.inference.trust import judge
from rpil.inference.two_parts import are_situations, divide, p_experts, thinned, two_parts

SETTINGS = PartSettings()
NOBODY = np.zeros(10, dtype=bool)


def rules(truth, first=2.0, second=2.0, mixed=0.0):
    """Gains of policies where `truth` says of each demonstration which of two rules it follows: the policy of a group
    that has one rule mostly explains its demonstrations with `first` or `second`, and others with -1; that of a group
    of everybody explains all with `mixed`."""

    def gains(group):
        if group.all():
            return np.full(len(group), mixed)
        is_first = truth[group].mean() >= 0.5
        return np.where(truth == is_first, first if is_first else second, -1.0)

    return gains


def trusted(gains, monkeypatch, outlier=NOBODY, score=None, n=10, ridge=1e-2, **limits):
    """The parts of `n` demonstrations by policies with these gains."""
    data, settings = same_actions(n), JudgeSettings(parts=replace(SETTINGS, **limits))
    model, asked, ridges = Written(data, gains, settings), [], []
    evaluate = model.evaluate
    model.evaluate = lambda weight, ridge: ridges.append(ridge) or evaluate(weight, ridge)
    monkeypatch.setattr(module, "held_out_model", lambda of, how: asked.append((of, how)) or model)
    score = np.linspace(1, 0, n) if score is None else score
    scores = scores_of(scoring_of(data, gains, settings), score, 0.9)
    scores = replace(scores, fit=replace(scores.fit, ridge=ridge))
    found = two_parts(data, scores, outlier, settings)
    assert set(ridges) == {ridge or 1e-4}  # the policy of a user has none: the weakest
    of_parts = replace(settings.held_out, max_left_out=0, tol=settings.parts.tol)
    assert asked == [(data, of_parts)]
    return found.tolist()


FIRST = np.arange(10)


@pytest.mark.parametrize(  # of ten, six are the experts with a probability of 7/12
    ("n_first", "max_tie", "sizes"),
    [(6, 0.58, (1, -1)), (6, 0.59, (0.5, -0.5)), (4, 0.58, (-1, 1)), (4, 0.59, (0.5, -0.5)), (5, 0.5, (0.5, -0.5))],
)
def test_the_larger_of_two_rules_is_trusted_and_both_of_a_tie(n_first, max_tie, sizes, monkeypatch):
    for ridge in (0.1, 0.0):  # of the judge, and without one the weakest
        found = trusted(rules(n_first > FIRST), monkeypatch, max_tie=max_tie, ridge=ridge)
        assert found == [sizes[0]] * n_first + [sizes[1]] * (10 - n_first)


def test_eleven_of_twenty_are_larger_and_twelve_of_twentytwo_are_not(monkeypatch):
    for n, n_first, value in ((20, 11, 1.0), (22, 12, 0.5), (40, 22, 1.0)):
        none = np.zeros(n, dtype=bool)
        assert trusted(rules(np.arange(n) < n_first), monkeypatch, none, n=n)[0] == value


@pytest.mark.parametrize("prior", [(2, 1), (1, 2), (9.0, 1.0), (3, 7), (40, 40.5), 0.9, 0.3])
@pytest.mark.parametrize(("n", "m"), [(6, 4), (30, 70), (5, 5), (2, 3)])
def test_the_probability_of_a_part_is_that_of_its_size_by_the_prior(prior, n, m):
    """By hand: a sum over shares p of experts."""
    p = np.linspace(0, 1, 200_001)[1:-1] if isinstance(prior, tuple) else np.array([prior])
    density = p ** (prior[0] - 1) * (1 - p) ** (prior[1] - 1) if isinstance(prior, tuple) else 1.0
    first, second = ((density * p**k * (1 - p) ** (n + m - k)).sum() for k in (n, m))
    assert p_experts(n, m, prior) == pytest.approx(first / (first + second), abs=1e-6)


@pytest.mark.parametrize("prior", [None, 0.5, (2, 2), (1, 1), (7.5, 7.5)])
def test_a_prior_that_says_nothing_of_sizes_leaves_the_larger_one(prior):
    for n, m in ((6, 4), (4, 6), (10, 0), (217, 183)):
        assert p_experts(n, m, prior) == pytest.approx((n + 1) / (n + m + 2))


@pytest.mark.parametrize(
    ("prior", "found"), [(None, 1.0), (0.9, 1.0), (0.3, -1.0), ((30, 70), -1.0), ((100, 99), 0.5), ((90, 10), 1.0)]
)
def test_a_prior_decides_between_two_rules_and_never_for_noise(prior, found, monkeypatch):
    for noisy, expected in ((2.0, [found] * 7 + [-found] * 3), (0.29, [-1.0] * 7 + [1.0] * 3)):
        gains = rules(FIRST < 7, noisy, 2.0, mixed=-3.0)
        assert trusted(gains, monkeypatch, prior=prior) == expected


@pytest.mark.parametrize(("gain", "sign"), [(0.29, 1), (0.31, -1), (-0.9, 1)])
@pytest.mark.parametrize("is_turned", [False, True])
def test_a_part_without_a_rule_is_not_trusted_however_large(gain, sign, is_turned, monkeypatch):
    """Seven of ten are noise: which of the two parts is the first one changes nothing."""
    truth, gains = FIRST < 3, (2.0, gain)
    found = trusted(rules(truth ^ is_turned, *(gains[::-1] if is_turned else gains), mixed=-3.0), monkeypatch)
    assert found == [sign] * 3 + [-sign] * 7


def test_the_limit_of_noise_is_noise(monkeypatch):
    own = iter([4.0, 1.0])
    monkeypatch.setattr(module, "own_gain", lambda *_: next(own))
    assert trusted(rules(FIRST < 3, mixed=-3.0), monkeypatch, max_noise=0.25) == [1.0] * 3 + [-1.0] * 7


@pytest.mark.parametrize(("outlier", "found"), [(NOBODY, [0.0] * 10), (FIRST > 7, [1.0] * 8 + [-1.0] * 2)])
def test_without_parts_the_outliers_are_the_other_part(outlier, found, monkeypatch):
    alike = rules(np.ones(10, dtype=bool))  # one policy explains all
    assert trusted(alike, monkeypatch, outlier) == found
    truth = FIRST < 6  # of two policies each explains 2, less the entropy of the sides in five steps
    joint = 2 - (0.6 * np.log(1 / 0.6) + 0.4 * np.log(1 / 0.4)) / 5
    for mixed, parts in ((joint - 0.0402, [1.0] * 6 + [-1.0] * 4), (joint - 0.0398, found)):
        assert trusted(rules(truth, mixed=mixed), monkeypatch, outlier) == parts


def test_the_best_of_the_starts_counts(monkeypatch):
    """They are the training group, the upper half, all but the lowest fifth, and all but the outliers."""
    begun, score = [], np.array([9.0, 8, 7, 6, 5, 4, 3, 2, 1, 0]) / 9
    ends = [(FIRST < 3, 1.0), None, (FIRST < 8, 3.0), (FIRST < 5, 2.0)]

    def written(data, model, part, *_):
        begun.append(np.flatnonzero(part).tolist())
        return ends[len(begun) - 1]

    monkeypatch.setattr(module, "divide", written)
    assert trusted(lambda group: 1.0, monkeypatch, FIRST == 4, score) == [1.0] * 8 + [-1.0] * 2
    assert begun == [[0, 1, 2, 3, 4], [0, 1, 2, 3, 4], [*range(8)], [0, 1, 2, 3, 5, 6, 7, 8, 9]]


def begun(first, part, steps=3):
    """Demonstrations that begin with these columns, and go on at random."""
    rng, n = np.random.default_rng(0), len(part)
    features = rng.normal(size=(n, steps, first.shape[1]))
    features[:, 0] = first
    actions = rng.integers(2, size=n * steps)
    return FitData(features.reshape(n * steps, -1), actions, np.arange(0, n * steps + 1, steps), Discrete(2))


@pytest.mark.parametrize(
    ("n", "shift", "found"), [(40, 0.0, False), (40, 1.0, False), (40, 4.0, True), (6, 9.0, False)]
)
def test_parts_that_the_first_step_tells_are_situations(n, shift, found):
    part, rng = np.arange(n) < 0.4 * n, np.random.default_rng(1)
    first = np.column_stack([rng.normal(size=(n, 3)) + shift * part[:, None] * [0, 1, 0], np.ones(n)])
    for group in (part, ~part):
        assert are_situations(begun(first, group), group) is found


def test_each_first_step_is_left_out():
    """By hand: ridge regression without it orders more than .85 of the pairs, or fewer."""
    part, found = np.arange(40) < 16, {}
    for seed in range(40):
        first = np.random.default_rng(seed).normal(size=(40, 4)) + 0.7 * part[:, None]
        z, aim = (first - first.mean(axis=0)) / first.std(axis=0), part - part.mean()
        left_out = []
        for m in range(40):
            kept = np.arange(40) != m
            left_out.append(z[m] @ np.linalg.solve(z[kept].T @ z[kept] + 40 * np.eye(4), z[kept].T @ aim[kept]))
        left_out = np.array(left_out)
        ordered = (left_out[part][:, None] > left_out[~part]).mean()
        found[ordered] = are_situations(begun(first, part), part)
    assert {*found.values()} == {True, False}
    assert all(is_told == (ordered > 0.85) for ordered, is_told in found.items())


def test_all_are_trusted_where_parts_are_situations_unless_one_is_noise(monkeypatch):
    monkeypatch.setattr(module, "are_situations", lambda *_: True)
    assert trusted(rules(FIRST < 7), monkeypatch) == [0.5] * 7 + [-0.5] * 3
    assert trusted(rules(FIRST < 7, 0.29, 2.0, mixed=-3.0), monkeypatch) == [-1.0] * 7 + [1.0] * 3


def divided(gains, part, **limits):
    data, settings = same_actions(len(part)), JudgeSettings()
    model = Written(data, gains, settings)
    return divide(data, [model, model], part, 1e-2, replace(SETTINGS, **limits)), model


def test_demonstrations_go_to_the_part_whose_policy_explains_them_better():
    truth = FIRST < 6
    (part, explained), model = divided(rules(truth, 2.0, 1.0), np.isin(FIRST, [0, 1, 2, 3, 6]))
    np.testing.assert_array_equal(part, truth)
    per_step = reference(model.data, model.settings).mean() + np.where(truth[:, None], [2.0, -1.0], [-1.0, 1.0])
    by_hand = logsumexp(np.log([0.6, 0.4]) + 5 * per_step, axis=1).sum() / 50
    assert explained == pytest.approx(by_hand)
    started = np.isin(FIRST, [0, 1, 2, 3, 6])
    np.testing.assert_array_equal(model.fitted, [started, ~started, truth, ~truth])


def test_equally_explained_ones_are_of_the_first_part_and_a_part_of_one_is_none():
    equal = lambda group: np.where(FIRST == 3, 1.0, rules(FIRST < 6)(group))  # noqa: E731
    assert divided(equal, FIRST >= 6)[0][0].tolist() == (FIRST >= 6).tolist()[:3] + [True] + [False] * 2 + [True] * 4
    for truth, is_found in ((FIRST < 2, True), (FIRST < 1, False), (FIRST < 9, False), (FIRST < 8, True)):
        assert (divided(rules(truth), truth)[0] is not None) is is_found


@pytest.mark.parametrize("max_iter", [1, 2, 3])
def test_sides_change_so_many_times_at_most(max_iter):
    """One demonstration more every time."""
    grow = lambda group: np.where(group.sum() >= FIRST, 1.0, -1.0) if group[0] else np.zeros(10)  # noqa: E731
    (part, _), model = divided(grow, FIRST < 2, max_iter=max_iter)
    assert np.flatnonzero(part).tolist() == [*range(1 + max_iter)]
    assert len(model.fitted) == 2 * max_iter


def test_sides_that_alternate_end():
    turned = lambda group: np.where(group, -1.0, 1.0)  # noqa: E731
    assert divided(turned, FIRST < 5)[0][0].tolist() == (FIRST >= 5).tolist()


@pytest.mark.parametrize(("max_steps", "k"), [(9, 1), (8, 2), (5, 2), (4, 3), (1, 9)])
def test_every_kth_step_of_each_demonstration_is_kept(max_steps, k):
    offsets = np.array([0, 5, 6, 9])
    data = FitData(np.arange(9.0)[:, None], np.arange(9) % 2, offsets, Discrete(2))
    kept = [np.arange(begin, end)[::k] for begin, end in pairwise(offsets)]
    found = thinned(data, max_steps)
    assert found.features[:, 0].tolist() == np.concatenate(kept).tolist()
    assert found.actions.tolist() == (np.concatenate(kept) % 2).tolist()
    assert found.lengths.tolist() == [len(one) for one in kept]


@pytest.mark.parametrize(
    ("maker", "kind", "n_good", "n_bad", "good", "bad"),
    [
        *[(maker, "random", 6, 10, 1, -1) for maker in (make, make_continuous)],  # noise is the larger part
        *[(maker, "flipped", 10, 4, 1, -1) for maker in (make, make_continuous)],
        *[(maker, "flipped", 4, 10, -1, 1) for maker in (make, make_continuous)],  # the larger rule
        *[(maker, "flipped", 7, 7, 0.5, -0.5) for maker in (make, make_continuous)],
        *[(maker, "none", 8, 4, 0, 0) for maker in (make, make_continuous)],
        *[(maker, "noisy", 10, 4, 1, -1) for maker in (make, make_continuous)],
    ],
)
def test_parts_of_plain_worlds(maker, kind, n_good, n_bad, good, bad):
    toy = maker(kind, 1, n_good=n_good, n_bad=n_bad, steps=(40, 60))
    data = toy.problem()
    found = judge(data, held_out_model(data, HeldOutSettings()), JudgeSettings(), learner=data).part
    turned = np.sign(found[0] * good) if abs(good) == 0.5 else 1  # of a tie either part is the first
    np.testing.assert_array_equal(found * turned, np.where(toy.is_good, good, bad))
