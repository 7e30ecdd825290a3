"""The judge: held-out scores, concentration, effective steps, groups, rivals, and what they come to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.metrics import roc_auc_score

from problems import make, make_continuous
from rpil import RPIL, DataError
from rpil.audit.summary import longest_unlabelled
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.effective_steps import autocovariances, effective_steps
from rpil.inference.fitted_judge import FittedJudge
from rpil.inference.groups import Groups, fit_groups, one_group, two_groups
from rpil.inference.held_out import HeldOutRidge, HeldOutSoftmax, deal, frequencies, held_out_model, log_reference
from rpil.inference.rivals import find_rival, find_style, split_by_gradients, state_overlap
from rpil.inference.scores import mean_variance
from rpil.inference.settings import HeldOutSettings, JudgeSettings, TrimmingSettings
from rpil.inference.step_trust import step_trust
from rpil.inference.trimming import best_explained, choose_ridge, fit_trimmed, group_shares
from rpil.inference.trust import FINDINGS, judge
from rpil.numerics.regression import error_scale, standardise, student_log_density

STEPS = (40, 60)
LAPSE = HeldOutSettings().lapse


def problem_of(toy, labels=None) -> FitData:
    problem = toy.problem()
    return problem if labels is None else replace(problem, labels=np.asarray(labels))


# ---- effective steps -------------------------------------------------------------------------------------------------


def series(rng, n_series, n, r, lag=1):
    """Autoregressions x_t = r x_{t - lag} + noise with variance one, (n_series, n)."""
    x = rng.normal(size=(n_series, n))
    for t in range(lag, n):
        x[:, t] = r * x[:, t - lag] + np.sqrt(1 - r * r) * rng.normal(size=n_series)
    return x


def true_effective(r, n, lag=1):
    k = np.arange(1, n)
    correlation = np.where(k % lag == 0, float(r) ** (k // lag), 0.0)
    return n / (1 + 2 * ((1 - k / n) * correlation).sum())


@pytest.mark.parametrize("lag", [1, 2])
@pytest.mark.parametrize("r", [-0.5, 0.0, 0.3, 0.6, 0.9, 0.95])
@pytest.mark.parametrize("n", [3, 10, 100, 1000])
def test_effective_steps_of_autoregressions(r, n, lag):
    rng, n_series = np.random.default_rng(0), max(60, 6000 // n)
    found = []
    for _ in range(4):
        x = series(rng, n_series, n, r, lag)
        covariances = autocovariances(x.ravel(), np.arange(n_series + 1) * n)
        found.append(effective_steps(covariances, np.array([n]))[0])
    assert np.mean(found) == pytest.approx(true_effective(r, n, lag), rel=0.25)


def test_steps_of_a_right_policy_are_independent_however_slowly_states_move():
    rng = np.random.default_rng(0)
    state = series(rng, 40, 200, 0.99).ravel()
    proba = 1 / (1 + np.exp(-3 * state))
    action = rng.random(len(state)) < proba
    log_prob = np.log(np.where(action, proba, 1 - proba))
    expected = proba * np.log(proba) + (1 - proba) * np.log(1 - proba)
    offsets = np.arange(41) * 200
    assert effective_steps(autocovariances(log_prob - expected, offsets), np.array([200]))[0] >= 0.95 * 200
    assert effective_steps(autocovariances(log_prob - log_prob.mean(), offsets), np.array([200]))[0] < 0.8 * 200


# ---- held-out log-probabilities --------------------------------------------------------------------------------------


def test_softmax_scores_are_those_of_scikit_learn_on_the_other_folds():
    problem = problem_of(make("noisy", 0, steps=STEPS))
    weight = np.random.default_rng(0).random(len(problem.actions))
    found = HeldOutSoftmax(problem, deal(problem, 3, 0))
    scored = found.evaluate(weight, 1e-2)
    fold, q = problem.per_step(found.fold), frequencies(problem)
    for k in range(3):
        train, test = fold != k, fold == k
        C = 1 / (1e-2 * weight[train].sum())
        model = LogisticRegression(C=C, tol=1e-8, max_iter=5000)
        model.fit(problem.features[train][:, :-1], problem.actions[train], sample_weight=weight[train])
        proba = (1 - LAPSE) * model.predict_proba(problem.features[test][:, :-1]) + LAPSE * q
        taken = np.log(proba[np.arange(test.sum()), problem.actions[test]])
        np.testing.assert_allclose(scored.log_prob[test], taken, atol=0.03)
        entropy = (proba * np.log(proba)).sum(axis=1)
        np.testing.assert_allclose(scored.residual[test], taken - entropy, atol=0.05)


def test_ridge_scores_are_those_of_scikit_learn_on_the_other_folds():
    problem = problem_of(make_continuous("noisy", 0, steps=STEPS))
    weight = np.random.default_rng(0).random(len(problem.actions))
    found = HeldOutRidge(problem, deal(problem, 3, 0))
    scored = found.evaluate(weight, 1e-2)
    fold, actions = problem.per_step(found.fold), standardise(problem.actions)
    errors = np.empty_like(actions)
    for k in range(3):
        train, test = fold != k, fold == k
        model = Ridge(1e-2 * weight[train].sum())
        model.fit(problem.features[train][:, :-1], actions[train], sample_weight=weight[train])
        errors[test] = actions[test] - model.predict(problem.features[test][:, :-1]).reshape(-1, actions.shape[1])
    np.testing.assert_allclose(scored.log_prob, student_log_density(errors, error_scale(errors, weight)), atol=1e-6)


def test_a_demonstration_never_teaches_the_policy_that_scores_it():
    problem = problem_of(make("random", 0, steps=STEPS))
    other = replace(problem, actions=problem.actions.copy())
    fold = deal(problem, 3, 0)
    changed = problem.per_step(fold) == 1
    other.actions[changed] = (other.actions[changed] + 1) % problem.space.n
    weight = np.ones(len(problem.actions))
    one, two = (HeldOutSoftmax(p, fold).evaluate(weight, 1e-2) for p in (problem, other))
    q_one, q_two = frequencies(problem), frequencies(other)
    # The other steps of that fold are scored by the same policies; only the frequencies of the lapses differ.
    same = changed & (problem.actions == other.actions)
    assert not same.any()
    np.testing.assert_allclose(np.exp(one.log_prob[~changed]).mean(), np.exp(one.log_prob[~changed]).mean())
    assert not np.allclose(one.log_prob[~changed], two.log_prob[~changed], atol=1e-3)
    proba = (np.exp(one.log_prob[changed]) - LAPSE * q_one[problem.actions[changed]]) / (1 - LAPSE)
    shifted = (np.exp(two.log_prob[changed]) - LAPSE * q_two[other.actions[changed]]) / (1 - LAPSE)
    assert (proba + shifted <= 1 + 1e-9).all()  # two actions of one distribution


def test_folds_follow_a_demonstration_wherever_it_stands():
    problem = problem_of(make("noisy", 1, steps=(30, 30)))
    order = np.random.default_rng(0).permutation(problem.n_demonstrations)
    np.testing.assert_array_equal(deal(problem, 5, 0)[order], deal(problem.select(order), 5, 0))


@pytest.mark.parametrize("toy", [make("noisy", 0, steps=(30, 30)), make_continuous("noisy", 0, steps=(30, 30))])
def test_the_order_of_demonstrations_does_not_matter(toy):
    order = np.random.default_rng(1).permutation(len(toy.ids))
    rows = np.concatenate([np.arange(toy.offsets[m], toy.offsets[m + 1]) for m in order])
    lengths = np.diff(toy.offsets)[order]
    shuffled = Demonstrations.from_arrays(
        toy.observations[rows], toy.actions[rows], np.concatenate([[0], np.cumsum(lengths)])
    )
    one, two = RPIL().fit(toy.demonstrations), RPIL().fit(shuffled)
    np.testing.assert_allclose(two.log_odds_, one.log_odds_[order], atol=0.05)
    assert two.audit_.verdicts == tuple(one.audit_.verdicts[m] for m in order)


# ---- concentration ---------------------------------------------------------------------------------------------------


def test_concentration_teaches_by_the_best_explained():
    toy = make("random", 0, n_good=10, n_bad=10, steps=STEPS)
    problem = problem_of(toy)
    taught = fit_trimmed(problem, held_out_model(problem, 0), np.ones(20, dtype=bool), 1e-2, 0.6, 4)
    score = problem.mean_steps(taught.held_out.log_prob)
    assert roc_auc_score(toy.is_good, score) == 1.0
    assert taught.group.sum() == 12
    assert taught.group[toy.is_good].all()
    assert taught.history[-1] > taught.history[0]


def test_labelled_experts_teach_and_labelled_adversaries_do_not():
    problem = problem_of(make("random", 0), labels=[1, -1, *[0] * 10])
    chosen = best_explained(problem, np.array([-9.0, 9.0, *range(10)]), 4)
    assert chosen[0]
    assert not chosen[1]
    assert chosen.sum() == 4


def test_a_strong_ridge_is_chosen_where_there_is_nothing_to_learn():
    rng = np.random.default_rng(0)
    features = np.column_stack([rng.normal(size=(400, 100)), np.ones(400)])
    noise = FitData(features, rng.integers(4, size=400), np.arange(21) * 20, Discrete(4), np.zeros(20, dtype=int))
    assert choose_ridge(noise, held_out_model(noise, 0), np.ones(20, dtype=bool)) == 1e-1
    clear = replace(noise, actions=(features[:, 0] > 0).astype(int))
    assert choose_ridge(clear, held_out_model(clear, 0), np.ones(20, dtype=bool)) < 1e-1


# ---- groups of scores ------------------------------------------------------------------------------------------------


def fitted(score, variance=None, labels=None) -> Groups:
    m = len(score)
    variance = np.full(m, 1e-4) if variance is None else variance
    labels = np.zeros(m, dtype=int) if labels is None else labels
    return fit_groups(score, variance, labels, np.full(m, 100.0), np.full(m, 100))


def test_two_clear_groups_are_found_with_their_share_and_means():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0.0, 0.1, 14), rng.normal(1.0, 0.1, 6)])
    groups = fitted(score)
    assert groups.p_two > 0.99
    np.testing.assert_allclose(groups.mean, [0.0, 1.0], atol=0.1)
    assert groups.share == pytest.approx(0.3, abs=0.1)
    log_odds = groups.log_odds(score, np.full(20, 1e-4))
    assert (log_odds[:14] < -2.2).all()
    assert (log_odds[14:] > 2.2).all()


@pytest.mark.parametrize("draw", ["normal", "skewed"])
def test_one_group_is_rarely_taken_for_two(draw):
    rng, found = np.random.default_rng(0), []
    for _ in range(40):
        score = rng.normal(size=30) if draw == "normal" else -rng.gamma(4.0, size=30)
        found.append(fitted(score).p_two >= 0.9)
    assert np.mean(found) <= 0.1


def test_log_odds_rise_with_the_score():
    rng = np.random.default_rng(0)
    for spread in (0.1, 1.0):
        groups = fitted(np.concatenate([rng.normal(0.0, spread, 10), rng.normal(2.0, 0.1, 10)]))
        at = np.linspace(-6, 6, 101)
        assert (np.diff(groups.log_odds(at, np.full(101, 1e-4))) > 0).all()


def test_graded_scores_are_ranked_and_none_is_sure():
    score = np.linspace(0, 1, 40)
    groups = fitted(score, np.full(40, 1e-6))
    assert groups.p_two < 0.5
    proba = 1 / (1 + np.exp(-groups.log_odds(score, np.full(40, 1e-6))))
    assert (np.diff(proba) > 0).all()
    assert proba[0] > 0.1
    assert proba[-1] < 0.9
    alike = fitted(score, np.full(40, 10.0))  # nothing but error
    assert alike.graded == 0.0
    assert np.abs(alike.log_odds(score, np.full(40, 10.0))).max() < 0.3


def test_one_centre_with_tails_is_one_group():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0.0, 1.0, 20), rng.normal(0.0, 0.05, 80)])
    found = two_groups(score, np.full(100, 1e-6), np.zeros(100, dtype=int), 1.0)
    assert found is None or found[1].mean[1] - found[1].mean[0] >= np.sqrt(found[1].spread.mean())


def test_labels_fix_the_group():
    rng = np.random.default_rng(0)
    score = np.concatenate([rng.normal(0.0, 0.3, 10), rng.normal(1.0, 0.3, 10)])
    labels = np.zeros(20, dtype=int)
    labels[10 + np.argsort(score[10:])[:4]] = -1
    plain, told = (two_groups(score, np.full(20, 1e-4), given, 1.0) for given in (np.zeros(20, dtype=int), labels))
    assert plain is not None
    assert told is not None
    assert told[1].mean[0] > plain[1].mean[0] + 0.1
    assert told[0] < plain[0]


def test_one_group_is_a_maximum_over_the_three_parameters():
    score = np.random.default_rng(0).normal(size=50)
    normal = -0.5 * (np.log(2 * np.pi * score.var()) + 1) * 50
    assert normal <= one_group(score, np.full(50, 1e-9)) < normal + 5


@pytest.mark.parametrize(("kind", "seed", "n_good", "n_bad"), [("noisy", 0, 10, 30), ("window", 1, 8, 56)])
def test_few_experts_are_found_by_fewer_teachers(kind, seed, n_good, n_bad):
    toy = make(kind, seed, n_good=n_good, n_bad=n_bad, steps=STEPS)
    verdicts = np.array(RPIL().fit(toy.demonstrations).audit_.verdicts)
    assert (verdicts[toy.is_good] == "expert").all()
    assert (verdicts[~toy.is_good] == "adversary").mean() > 0.95
    problem = toy.problem("folded")
    settings = JudgeSettings(trimming=TrimmingSettings(halvings=0))
    assert judge(problem, held_out_model(problem, 0), settings).finding == "nobody stands out"


def test_shares_are_halved_while_enough_demonstrations_teach():
    assert group_shares(100) == [0.6, 0.3, 0.15, 0.075]
    assert group_shares(20) == [0.6, 0.3]
    assert group_shares(4) == [0.6]


# ---- rivals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_bad", [4, 6, 18])
def test_a_coherent_group_in_the_same_states_is_a_rival(n_bad):
    toy = make("shifted", 1, n_bad=n_bad, steps=STEPS)
    judgement = judge(problem_of(toy), held_out_model(problem_of(toy), 0))
    assert judgement.finding == "cannot be known"
    assert judgement.rival is not None
    groups = {frozenset(judgement.rival.trusted.tolist()), frozenset(judgement.rival.rival.tolist())}
    assert groups == {frozenset(range(6)), frozenset(range(6, 6 + n_bad))}


@pytest.mark.parametrize("kind", ["random", "noisy", "window"])
def test_noise_is_no_rival(kind):
    toy = make(kind, 0, n_good=10, n_bad=10, steps=STEPS)
    problem = problem_of(toy)
    assert find_rival(problem, held_out_model(problem, 0), toy.is_good, 1e-2, JudgeSettings(), 0) is None


def test_a_policy_in_other_states_is_no_rival():
    toy = make("shifted", 1, steps=STEPS)
    problem = problem_of(toy)
    away = problem.features.copy()
    away[problem.per_step(~toy.is_good), 0] += 20.0
    moved = replace(problem, features=away)
    first, second = np.flatnonzero(toy.is_good), np.flatnonzero(~toy.is_good)
    assert state_overlap(problem, first, second, 0) > 0.8
    assert state_overlap(moved, first, second, 0) < 0.1


def styles(seed, n_first=8, n_second=8, above=0.8, steps=400):
    """Everybody is good; the second style takes action 1 where the second observation is large, whatever the first."""
    rng = np.random.default_rng(seed)
    observations = rng.normal(size=((n_first + n_second) * steps, 2))
    offsets = np.arange(0, len(observations) + 1, steps)
    actions = observations[:, 0] + rng.normal(size=len(observations)) > 0
    second = np.arange(len(observations)) >= n_first * steps
    actions |= second & (observations[:, 1] > above)
    return Demonstrations.from_arrays(observations, actions.astype(int), offsets), second[offsets[:-1]]


@pytest.mark.parametrize("seed", range(4))
def test_two_styles_are_listed_and_a_label_chooses(seed):
    data, second = styles(seed)
    with pytest.warns(UserWarning, match="label one demonstration"):
        audit = RPIL().fit(data).audit_
    assert set(audit.verdicts) == {"uncertain"}
    assert {frozenset(group) for group in audit.competing} == {
        frozenset(np.flatnonzero(side).tolist()) for side in (second, ~second)
    }
    for style in (second, ~second):
        told = int(np.flatnonzero(style)[0])
        assert roc_auc_score(style, RPIL().fit(data, labels={told: "expert"}).audit_.log_odds) == 1.0


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_styles_that_differ_little_are_listed_without_a_warning(seed):
    data, second = styles(seed, above=1.2)
    audit = RPIL().fit(data).audit_
    assert audit.finding == "nobody stands out"
    assert audit.identifiable
    assert {frozenset(group) for group in audit.competing} == {
        frozenset(np.flatnonzero(side).tolist()) for side in (second, ~second)
    }
    assert np.ptp(audit.expert_proba) > 0
    told, other = int(np.flatnonzero(second)[0]), int(np.flatnonzero(~second)[0])
    one = RPIL().fit(data, labels={told: "expert"}).audit_
    assert roc_auc_score(second, one.log_odds) == 1.0
    assert one.verdicts.count("uncertain") == 15
    both = RPIL().fit(data, labels={told: "expert", other: "adversary"}).audit_
    assert (np.array(both.verdicts) == np.where(second, "expert", "adversary")).all()


def test_one_style_has_no_second():
    data, _ = styles(0, n_first=12, n_second=0)
    problem = FitData(
        np.column_stack([data.observations, np.ones(len(data.actions))]),
        data.actions,
        data.offsets,
        Discrete(2),
        np.zeros(12, dtype=int),
    )
    assert find_style(problem, held_out_model(problem, 0), 1e-3, JudgeSettings(), 0) is None


def test_sides_part_continuous_actions_too():
    toy = make_continuous("flipped", 0, n_good=6, n_bad=6, steps=(100, 120))
    side = split_by_gradients(toy.problem("raw"), 1e-3)
    assert (side == toy.is_good).all() or (side == ~toy.is_good).all()


@pytest.mark.parametrize(("minority", "finding"), [("ask", "cannot be known"), ("distrust", "told apart")])
def test_what_to_think_of_a_minority_is_the_users_choice(minority, finding):
    toy = make("shifted", 1, n_good=8, n_bad=4, steps=STEPS)
    audit = RPIL(minority=minority).fit(toy.demonstrations).audit_ if minority != "ask" else None
    if audit is None:
        with pytest.warns(UserWarning, match="label one demonstration"):
            audit = RPIL().fit(toy.demonstrations).audit_
        assert set(audit.verdicts) == {"uncertain"}
        assert (audit.expert_proba == 0.5).all()
    else:
        assert audit.verdicts == ("expert",) * 8 + ("adversary",) * 4
    assert audit.finding == finding
    trusting = RPIL(minority="trust").fit(toy.demonstrations).audit_
    assert "adversary" not in trusting.verdicts


# ---- what it comes to ------------------------------------------------------------------------------------------------


def test_nothing_could_be_learned_from_random_observations():
    rng = np.random.default_rng(0)
    for seed in range(3):
        toy = make("noisy", seed, n_good=10, n_bad=10, steps=STEPS)
        noise = Demonstrations.from_arrays(rng.normal(size=toy.observations.shape), toy.actions, toy.offsets)
        audit = RPIL().fit(noise).audit_
        assert audit.finding == "nothing could be learned"
        assert set(audit.verdicts) == {"uncertain"}


def test_log_odds_are_the_sum_of_their_parts():
    toy = make("random", 0, steps=STEPS)
    who = ["Ann"] * 3 + ["Bob"] * 3 + ["Cid"] * 6
    audit = RPIL(labels={"d0": "expert"}).fit(toy.demonstrations, demonstrators=who).audit_
    np.testing.assert_allclose(sum(audit.evidence.values()), audit.log_odds)
    assert audit.from_label[0] > 0
    assert not audit.from_label[1:].any()
    assert audit.from_demonstrator.any()
    assert audit.finding in FINDINGS


def test_what_is_kept_scores_as_the_judge_did():
    for toy in (make("random", 0, n_good=10, n_bad=10, steps=STEPS), make_continuous("random", 0, steps=STEPS)):
        problem = problem_of(toy)
        judgement = judge(problem, held_out_model(problem, 0))
        kept = FittedJudge.of(judgement, problem)
        measure, _ = kept.step_ratios(problem.features, problem.actions)
        score = problem.sum_steps(measure) / problem.lengths
        np.testing.assert_allclose(score, judgement.scores.score, atol=0.3 * np.ptp(judgement.scores.score))
        again = kept.log_odds(measure, problem.offsets)
        np.testing.assert_array_equal(again > 0, judgement.log_odds > 0)


def test_the_variance_of_a_mean():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(4000, 25))
    squares = ((values - values.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    variance = mean_variance(squares, np.full(4000, 25), 1.0, np.full(4000, 25.0), 20.0)
    assert variance.mean() == pytest.approx(values.mean(axis=1).var(), rel=0.1)


def test_reliability_is_the_share_of_steps_that_follow_the_policy():
    rng = np.random.default_rng(0)
    n_steps, share = 2000, np.array([0.1, 0.5, 0.9])
    follows = rng.random((3, n_steps)) < share[:, None]
    log_ratio = np.where(follows, np.log(0.9 / 0.25), np.log(0.1 / 3 / 0.25)).ravel()
    ones, zeros = np.ones((3 * n_steps, 1)), np.zeros(3 * n_steps, dtype=int)
    problem = FitData(ones, zeros, np.arange(4) * n_steps, Discrete(4), np.zeros(3, dtype=int))
    # An expert's step has the likelihood ratio of its action, and so has another step that happens to agree.
    trust = step_trust(problem, log_ratio, np.ones(3))
    assert (np.diff(trust.reliability) > 0.2).all()
    assert (trust.interval[:, 0] <= trust.reliability + 1e-9).all()
    assert (trust.interval[:, 1] >= trust.reliability - 1e-9).all()
    assert trust.step[follows.ravel()].mean() > trust.step[~follows.ravel()].mean() + 0.3
    wide = step_trust(problem, log_ratio, np.full(3, 0.01)).interval
    assert (np.ptp(wide, axis=1) > np.ptp(trust.interval, axis=1)).all()


def test_the_reference_does_not_look_at_the_state():
    problem = problem_of(make("random", 0))
    everyone = np.ones(problem.n_demonstrations, dtype=bool)
    shuffled = replace(problem, features=problem.features[::-1])
    np.testing.assert_array_equal(log_reference(problem, everyone), log_reference(shuffled, everyone))
    log_q = log_reference(problem, everyone)
    for action in range(problem.space.n):
        share = (problem.actions == action).mean()
        assert np.exp(log_q[problem.actions == action]).mean() == pytest.approx(share, abs=0.01)


# ---- labels and options against rivals and styles --------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
def test_any_expert_that_is_labelled_settles_which_of_two_groups_it_is(seed):
    toy = make("flipped", seed, n_good=6, n_bad=6, steps=STEPS)
    for m in range(6):
        audit = RPIL().fit(toy.demonstrations, labels={f"d{m}": "expert"}).audit_
        assert set(audit.verdicts[:6]) <= {"expert", "uncertain"}, m
        assert audit.verdicts[6:] == ("adversary",) * 6, m


def test_no_labelled_demonstration_is_asked_for():
    toy = make("flipped", 0, n_good=6, n_bad=6, steps=STEPS)
    with pytest.warns(UserWarning, match="label one demonstration"):
        first = RPIL().fit(toy.demonstrations).audit_.to_label
    assert len(first) == 2
    problem = problem_of(toy, np.array([m == first[0] for m in toy.ids], dtype=int))
    again = longest_unlabelled(problem, (np.arange(6), np.arange(6, 12)))
    assert len(again) == 2
    assert f"d{again[0]}" not in first or f"d{again[1]}" not in first
    assert longest_unlabelled(problem.select(again[:1]), (np.zeros(1, dtype=int),)) == [0]
    assert longest_unlabelled(replace(problem, labels=np.ones(12, dtype=int)), (np.arange(6),)) == []


def test_a_minority_that_is_trusted_stays_trusted_where_an_expert_is_labelled():
    toy = make("shifted", 1, n_good=8, n_bad=4, steps=STEPS)
    for labels in ({"d9": "expert"}, {"d1": "expert"}):
        audit = RPIL(minority="trust").fit(toy.demonstrations, labels=labels).audit_
        assert "adversary" not in audit.verdicts


def test_known_experts_in_both_groups_accuse_neither():
    toy = make("shifted", 1, n_good=8, n_bad=4, steps=STEPS)
    audit = RPIL().fit(toy.demonstrations, labels={"d1": "expert", "d9": "expert"}).audit_
    assert "adversary" not in audit.verdicts
    assert audit.finding != "cannot be known"


@pytest.mark.parametrize("large", [1.0, 1e12])
def test_columns_that_repeat_each_other_are_no_obstacle_to_a_policy_of_the_users(large):
    toy = make("none", 0, n_good=8, n_bad=4, steps=STEPS)
    twice = np.hstack([toy.observations, toy.observations[:, :1], np.zeros((len(toy.actions), 1))]) * large
    audit = RPIL(policy=LogisticRegression()).fit(twice, toy.actions, groups=toy.groups).audit_
    assert set(audit.verdicts) <= {"uncertain", "expert"}


def test_a_policy_of_the_users_scores_as_it_judged():
    for toy, policy in ((make("random", 0, n_good=8, n_bad=6, steps=STEPS), LogisticRegression()),):
        model = RPIL(policy=policy).fit(toy.demonstrations)
        again = model.score_demonstrations(toy.demonstrations)
        assert ((again > 0) == (model.audit_.log_odds > 0)).all()
    toy = make_continuous("random", 0, n_good=8, n_bad=6, steps=(40, 60))
    far = Demonstrations.from_arrays(toy.observations, 50 * toy.actions, toy.offsets, toy.ids)
    model = RPIL(policy=Ridge()).fit(far)
    assert ((model.score_demonstrations(far) > 0) == (model.audit_.log_odds > 0)).all()


def test_numbers_without_a_square_are_refused():
    toy = make("random", 0, steps=STEPS)
    with pytest.raises(DataError, match=r"beyond 1e\+150, where its square is no number; use larger units"):
        RPIL().fit(1e300 * toy.observations, toy.actions, groups=toy.groups)
