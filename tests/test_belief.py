"""The sums over reliabilities and shares, against brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logsumexp

from problems import make, pooled_state
from rpil.belief import Belief, believe, evidence, power, resemblance
from rpil.em import run
from rpil.priors import ByLength, Share
from rpil.problem import Problem
from rpil.reliability import PointMasses, TwoBetas
from rpil.spaces import Discrete


def fitted(kind: str = "random", seed: int = 0, labels=None, reliability=None, prior=None):
    problem = make(kind, seed).problem()
    if labels is not None:
        problem = replace(problem, labels=np.asarray(labels))
    state = pooled_state(problem, "uniform", reliability or TwoBetas.start())
    state = replace(state, prior=prior or state.prior)
    return problem, run(problem, state, max_iter=10)


def brute_force(problem, result, belief: Belief) -> tuple[np.ndarray, np.ndarray, float]:
    """Log-odds (M,), posterior of the shares (P,) and of one group only, each combination on its own, none left out."""
    by_node = belief.power * evidence(problem, result.state, result.posterior.outputs)
    alternatives = result.state.reliability.alternatives
    shift, log_share = belief.prior.alternatives(problem.lengths)
    each = logsumexp(by_node[:, None] + alternatives.log_weight, axis=2)  # (M, T)
    of_pair = np.stack([each[:, rows] for rows in alternatives.pairs.T])  # (2, M, Q)
    log_z, log_each = [], []
    for s, prior in zip(shift, log_share, strict=True):
        log_odds = belief.prior.log_odds(problem.lengths) + s
        log_p = np.stack([-np.logaddexp(0, -log_odds), -np.logaddexp(0, log_odds)])
        joint = log_p[:, :, None] + of_pair
        counted = joint.copy()
        counted[1, problem.labels > 0] = counted[0, problem.labels < 0] = -np.inf
        log_z.append(logsumexp(counted, axis=0).sum(axis=0) + prior + alternatives.log_prior)
        log_each.append(joint - logsumexp(joint, axis=0))
    weight = np.exp(np.array(log_z) - logsumexp(log_z))
    two = np.einsum("pq,pgmq->gm", weight, np.exp(log_each))
    log_two = logsumexp(log_z) - logsumexp(log_share) - logsumexp(alternatives.log_prior)
    one = each.sum(axis=0)
    alike = expit(logsumexp(one) - np.log(len(one)) - log_two) if not (problem.labels < 0).any() else 0.0
    proba = alike * np.array([[1.0], [0.0]]) + (1 - alike) * two
    return np.log(proba[0]) - np.log(proba[1]), weight.sum(axis=1), alike


@pytest.mark.parametrize("labels", [None, [1, -1] + [0] * 10])
@pytest.mark.parametrize("reliability", [PointMasses(), TwoBetas.start()], ids=["masses", "betas"])
def test_against_brute_force(labels, reliability):
    problem, result = fitted("noisy", 3, labels, reliability, Share(0.4, 2.0, 3.0))
    short = replace(problem.select(np.arange(4)))
    result = replace(
        result, posterior=replace(result.posterior, outputs=result.posterior.outputs[: len(short.actions)])
    )
    belief, log_odds = believe(short, result.state, result.posterior.outputs)
    expected, shares, alike = brute_force(short, result, belief)
    assert belief.alike == pytest.approx(alike, abs=1e-3)
    np.testing.assert_allclose(belief.weight.sum(axis=1), shares, atol=2e-4)
    near = np.abs(expected) < 30
    np.testing.assert_allclose(log_odds[near], expected[near], atol=5e-3)


def test_new_demonstrations_are_judged_as_the_fitted_ones():
    problem, result = fitted("noisy", 1, prior=Share(0.5, fixed=True))
    belief, log_odds = believe(problem, result.state, result.posterior.outputs)
    by_node = evidence(problem, result.state, result.posterior.outputs)
    assert belief.alike == 0.0  # with a given share there are two groups
    np.testing.assert_allclose(belief.log_odds(by_node, problem.lengths), log_odds, atol=1e-2)
    one = problem.select(np.array([3]))
    assert belief.log_odds(by_node[3:4], one.lengths)[0] == pytest.approx(log_odds[3], abs=1e-2)


def test_where_all_are_alike_nobody_is_accused_but_a_stranger_is():
    """No signal: everybody's actions are equally (un)predictable; then comes one who does something else."""
    problem, result = fitted("none", 0)
    belief, log_odds = believe(problem, result.state, result.posterior.outputs)
    assert belief.alike > 0.5
    assert (log_odds > 0).all()
    stranger = make("random", 5, n_good=2, n_bad=20).problem().select(np.arange(2, 22))
    by_node = evidence(stranger, result.state, result.state.policy.outputs(stranger.features))
    assert (belief.log_odds(by_node, stranger.lengths) < 0).mean() > 0.9


def test_strict_evidence_says_whether_there_are_two_groups_and_not_who_is_in_which():
    problem, result = fitted("random", 0)
    outputs = result.posterior.outputs
    belief, log_odds = believe(problem, result.state, outputs)
    assert belief.alike < 1e-3
    same, as_before = believe(problem, result.state, outputs, outputs)
    assert same.alike == pytest.approx(belief.alike)
    np.testing.assert_allclose(as_before, log_odds)
    nothing = np.full_like(outputs, -np.log(outputs.shape[1]))  # of what nobody can tell
    unsure, doubted = believe(problem, result.state, outputs, nothing)
    assert unsure.alike > 0.3
    np.testing.assert_array_equal(unsure.weight, belief.weight)
    np.testing.assert_array_equal(np.argsort(doubted), np.argsort(log_odds))
    assert (log_odds < -5).any()
    assert (doubted > -3).all()  # nobody is called an adversary, nor hardly one


@pytest.mark.parametrize("r", [0.0, 0.6])
def test_power_is_the_effective_share_of_steps(r):
    """Of log-ratios made by a first-order autoregression, whatever the means of the demonstrations."""
    rng = np.random.default_rng(0)
    x = np.zeros((20, 2000))
    for t in range(1, 2000):
        x[:, t] = r * x[:, t - 1] + rng.normal(size=20)
    ratio = 0.1 * x + rng.normal(size=(20, 1))
    problem = Problem(
        np.ones((40_000, 1)), np.zeros(40_000, dtype=int), np.arange(21) * 2000, Discrete(2), np.zeros(20, dtype=int)
    )
    assert power(*resemblance(problem, ratio.ravel())) == pytest.approx((1 - r) / (1 + r), abs=0.02)


def test_it_is_less_sure_than_point_estimates_and_of_the_same_mind():
    problem, result = fitted("random", 0)
    _, log_odds = believe(problem, result.state, result.posterior.outputs)
    np.testing.assert_array_equal(log_odds > 0, result.posterior.log_odds > 0)
    assert np.isfinite(log_odds).all()


def test_the_interval_of_the_share_is_the_betas_where_everything_is_clear():
    problem, result = fitted("random", 0, prior=Share())
    belief, log_odds = believe(problem, result.state, result.posterior.outputs)
    n_expert = (log_odds > 0).sum()
    assert np.abs(log_odds).min() > 5
    from scipy.stats import beta

    posterior = beta(2 + n_expert, 2 + len(log_odds) - n_expert)
    mean, low, high = belief.share(problem.lengths)
    assert mean == pytest.approx(posterior.mean(), abs=0.01)
    assert (low, high) == pytest.approx(posterior.interval(0.95), abs=0.02)


def test_a_given_share_has_no_interval():
    problem, result = fitted("random", 0, prior=Share(0.3, fixed=True))
    belief, _ = believe(problem, result.state, result.posterior.outputs)
    assert belief.share(problem.lengths) == pytest.approx((0.3, 0.3, 0.3))


def share(problem) -> float:
    _, result = fitted("noisy", 2, prior=Share())
    return believe(problem, result.state, result.posterior.outputs)[0].share(problem.lengths)[0]


def test_labels_move_the_share():
    problem, _ = fitted("noisy", 2, prior=Share())
    bad = replace(problem, labels=np.where(np.arange(problem.n_demonstrations) < 8, -1, 0))
    assert share(bad) < share(problem)


def test_length_helps_where_actions_say_little():
    """Experts are short; of two demonstrations with the same actions' evidence the short one is trusted more."""
    problem, result = fitted("random", 0)
    lengths = np.where(result.posterior.expert > 0.5, 10, 100) + np.arange(problem.n_demonstrations)
    prior = ByLength.start(lengths).fit(result.posterior.expert, lengths)
    belief, _ = believe(problem, replace(result.state, prior=prior), result.posterior.outputs)
    nothing = np.zeros((2, len(result.state.reliability.nodes)))
    belief = replace(belief, prior=prior)
    short, long = belief.log_odds(nothing, np.array([10, 110]))
    assert short > 0 > long
    assert 0.5 < expit(short) < 1
